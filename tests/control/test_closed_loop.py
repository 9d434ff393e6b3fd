"""The whole loop on the full plant, with noisy sensors: bars of one seed, injected failures, mirror images.

Offsets may be half as much again as the worst of five seeds on the circle, 0.0041, and twice that uphill, 0.0032.
All seeds and scenes, and the baselines beside them: `worm3d study control`.
"""

from dataclasses import replace

import numpy as np
import pytest

from control.baselines import PiLineOfSight
from control.estimation.estimator import Estimate, Estimator
from control.estimation.reduced import ReducedModel
from control.gaits.steering import WAVE_SCHEDULES, Wave
from control.identification.identified import Identified, load
from control.planning.gauss_newton import PlanStatus
from control.planning.mpc import GaitMPC, Plan
from control.sensing.sensors import Sensors
from control.supervisor import Supervisor
from control.task import ControlTask
from control.tracking.metrics import Motion, summary, tracking
from control.tracking.paths import Circle, Line, Path
from control.tracking.references import Constant, Reference, Steps
from worm3d import Command, Plane, Result, Worm, simulate

WORM = Worm()
AHEAD = (0.5, 0.0)
"""Where the centre of mass is at the start."""
CRUISE = Constant(0.08)


def known(wave: Wave = "sine") -> Identified:
    found = load(WORM, schedule=WAVE_SCHEDULES[wave])
    assert found is not None
    return found


class Watched:
    """A supervisor of which the commands and the phase are kept."""

    def __init__(self, supervisor: Supervisor) -> None:
        self.supervisor = supervisor
        self.reset()

    def reset(self) -> None:
        self.supervisor.reset()
        self.commands: list[Command] = []
        self.waves: list[float] = []

    def step(self, t: float, measurement) -> Command:
        self.commands.append(self.supervisor.step(t, measurement))
        self.waves.append(self.supervisor.generator.waves)
        return self.commands[-1]


class Unreliable(GaitMPC):
    """An MPC of which three plans in ten fail."""

    def reset(self) -> None:
        self._chance = np.random.default_rng(9)
        super().reset()

    def plan(self, t: float, estimate: Estimate, reference: Reference) -> Plan:
        made = super().plan(t, estimate, reference)
        return replace(made, status=PlanStatus.NOT_SOLVED) if self._chance.random() < 0.3 else made


def run(
    reference: Reference, duration: float, slope: float = 0.0, planner=None, wave: Wave = "sine", **sensing
) -> tuple[Result, Watched]:
    task = ControlTask(WORM, reference, known(wave))
    supervisor = Supervisor.of(task)
    if planner is not None:
        model = ReducedModel.of(WORM, known())
        supervisor = Supervisor(task, model, Estimator(WORM, model), planner(WORM, known(), model))
    watched = Watched(supervisor)
    sensor = Sensors(**{"seed": 1, **sensing})
    result = simulate(WORM, Plane(slope=slope), actuation=watched, duration=duration, sensor=sensor)
    assert result.stop.status.name == "DONE"
    return result, watched


def figures(result: Result, watched: Watched, reference: Reference) -> dict[str, float]:
    waves = np.array([0.0, *watched.waves])
    motion = Motion(result.time, result.com[:, :2], result.heading, waves)
    found, _ = summary(tracking(motion, reference), reference, WORM.length)
    return {name: value for name, value in found.items() if value is not None}


def test_round_a_circle() -> None:
    reference = Reference(CRUISE, path=Circle(1.5, start=AHEAD))
    result, watched = run(reference, 30.0)
    found = figures(result, watched, reference)
    assert found["cross_track_rms_bl"] <= 0.006
    assert abs(found["speed_bias_relative"]) <= 0.02
    assert found["speed_error_rms_relative"] <= 0.06
    assert watched.supervisor.failures == 0
    assert result.heading[-1] == pytest.approx(0.08 * 30.0 / 1.5, abs=0.2)


@pytest.mark.parametrize(
    "azimuth", [pytest.param(np.pi, marks=pytest.mark.slow), -2.9, pytest.param(np.pi / 2.0, marks=pytest.mark.slow)]
)
def test_a_worm_that_faces_another_way_turns_round(azimuth: float) -> None:
    reference = Reference(CRUISE, path=Line(start=AHEAD, azimuth=azimuth))
    result, _ = run(reference, 24.0)
    late = result.time > 21.0
    way = result.com[late, :2] @ [np.cos(azimuth), np.sin(azimuth)]
    assert (way[-1] - way[0]) / 3.0 == pytest.approx(0.08, rel=0.1)
    aside = (result.com[:, :2] - AHEAD) @ [-np.sin(azimuth), np.cos(azimuth)]
    assert np.abs(aside[late]).max() < 0.05
    assert np.abs(aside).max() < 0.7, "it turns where it is"


@pytest.mark.slow
def test_a_steep_wave_goes_at_twice_the_cruise_and_takes_half_the_work() -> None:
    fast = Reference(Constant(0.2), path=Line(start=AHEAD))
    found = figures(*run(fast, 12.0, wave="steep"), fast)
    assert abs(found["speed_bias_relative"]) <= 0.02
    assert found["cross_track_rms_bl"] <= 0.006
    cruise = Reference(CRUISE, path=Line(start=AHEAD))
    sine, steep = (run(cruise, 12.0, wave=wave)[0] for wave in ("sine", "steep"))
    work = [each.energy.work_contract.sum() / each.distance for each in (sine, steep)]
    assert 0.4 < work[1] / work[0] < 0.65


@pytest.mark.parametrize(("controller", "most_deg"), [(Supervisor.of, 0.4), (PiLineOfSight, 0.9)])
def test_without_a_sensor_a_controller_sees_exactly(controller, most_deg: float) -> None:
    """Line-of-sight changes its speed a lot in the first waves, and the filter is less sure of a worm that does."""
    reference = Reference(CRUISE, path=Circle(1.5, start=AHEAD))
    watched = Watched(controller(ControlTask(WORM, reference, known())))
    result = simulate(WORM, Plane(), actuation=watched, duration=12.0)
    found = figures(result, watched, reference)
    assert found["cross_track_rms_bl"] <= 0.002, "a third of what it is with noise"
    assert found["heading_error_rms_deg"] <= most_deg
    assert watched.supervisor.gate.refused.total() == 0
    last = watched.supervisor.decisions[-1].estimate
    assert last is not None
    # A wave rocks the true heading about that of the estimate.
    assert last.heading == pytest.approx(np.interp(last.time, result.time, result.heading), abs=0.02)


@pytest.mark.slow
def test_three_failures_in_ten_cost_two_percent_of_the_speed_at_most() -> None:
    reference = Reference(CRUISE, path=Circle(1.5, start=AHEAD))
    result, watched = run(reference, 25.0, planner=Unreliable)
    found = figures(result, watched, reference)
    assert watched.supervisor.failures > 25
    assert found["speed_bias_relative"] >= -0.02
    assert found["cross_track_rms_bl"] <= 0.006


@pytest.mark.slow
def test_up_a_slope_that_it_does_not_know_of() -> None:
    reference = Reference(CRUISE, path=Line(start=AHEAD))
    result, watched = run(reference, 25.0, slope=float(np.deg2rad(3.0)))
    found = figures(result, watched, reference)
    assert abs(found["speed_bias_relative"]) <= 0.05
    assert found["cross_track_rms_bl"] <= 0.0065
    assert abs(found["heading_error_mean_deg"]) <= 1.0
    last = watched.supervisor.decisions[-1].estimate
    assert last is not None
    assert last.state.slip > 0.1, "it makes up for the slope because it has found it"


@pytest.mark.slow
def test_a_step_of_the_speed() -> None:
    reference = Reference(Steps(0.05, (12.0,), (0.1,)), path=Line(start=AHEAD))
    result, watched = run(reference, 24.0)
    assert figures(result, watched, reference)["settling_periods"] <= 3.0


@pytest.mark.slow
def test_mirrored_paths_and_measurements_have_mirrored_commands_on_the_plant() -> None:
    def path(side, offset: float) -> Path:
        return Circle(1.5, start=(0.5, offset), towards=side)

    _, left = run(Reference(CRUISE, path=path("left", 0.05)), 8.0)
    _, right = run(Reference(CRUISE, path=path("right", -0.05)), 8.0, mirrored=True)
    assert max(np.abs(command.hinge).max() for command in left.commands) > 0.02
    for one, other in zip(left.commands, right.commands, strict=True):
        assert np.abs(one.contraction - other.contraction[:, ::-1]).max() < 1e-6
        assert np.abs(one.hinge + other.hinge).max() < 1e-6
