"""Runs that are cut in two, saved, halved, controlled or stopped give the very numbers of one that is not."""

from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import worm3d
from control.gaits import ContractionEngine_segmentdriven, TravellingWave
from worm3d import ClampedGround, Command, Energy, Friction, Pipe, Plane, State, Status, Worm
from worm3d.running import run as run_module
from worm3d.running.problem import Problem

BOTH = pytest.mark.parametrize("integrator", ["bdf2", "implicit_euler"])
TURNING = TravellingWave(amplitude=0.3, bias=0.3, hinge=0.5, force=0.1)

ROWS = [
    "time",
    "joints",
    "joint_velocity",
    "points",
    "directors",
    "bend",
    "chamber_length",
    "command",
    "contraction",
    "hinge",
    "force",
    "com",
    "momentum",
    "angular_momentum",
    "normal_load",
    "slip",
    "joint_load",
    "joint_slip",
    "anchors",
]
STEPS = ["newton_iterations", "gradient_evaluations", "breakaways"]


def saved_and_loaded(state: State, folder: Path) -> State:
    """Write a state as plain arrays and read it again."""
    arrays = {f.name: np.asarray(getattr(state, f.name)) for f in fields(state) if f.name != "memory"}
    np.savez(folder / "state.npz", **arrays, **{f"memory.{name}": array for name, array in state.memory.items()})
    with np.load(folder / "state.npz") as file:
        memory = {name.removeprefix("memory."): file[name] for name in file if name.startswith("memory.")}
        plain = {name: file[name] for name in file if not name.startswith("memory.")}
    return State(**{**plain, "time": float(plain["time"])}, memory=memory)


def assert_goes_on(whole: worm3d.Result, first: worm3d.Result, second: worm3d.Result) -> None:
    """Every array of the two halves is that of the whole run, bit for bit."""
    cut = len(first.time)
    assert len(whole.time) == cut + len(second.time) - 1
    for name in ROWS:
        entire = getattr(whole, name)
        assert_array_equal(getattr(first, name), entire[:cut], err_msg=name)
        rows = slice(1, None) if name in ("slip", "joint_slip") else slice(None)
        assert_array_equal(getattr(second, name)[rows], entire[cut - 1 :][rows], err_msg=name)
    for f in fields(Energy):
        assert_array_equal(getattr(second.energy, f.name)[1:], getattr(whole.energy, f.name)[cut:], err_msg=f.name)
    for name in STEPS:
        assert_array_equal(np.concatenate([getattr(first, name), getattr(second, name)]), getattr(whole, name))
    assert first.halved_steps + second.halved_steps == whole.halved_steps
    for name, array in whole.state.memory.items():
        assert_array_equal(second.state.memory[name], array, err_msg=name)


SNAKING = np.column_stack([np.linspace(0.0, 4.0, 7), 0.5 * np.sin(np.linspace(0.0, 4.0, 7)), np.zeros(7)])
CASES: dict[str, tuple[Worm, Any, Friction, Any, float]] = {
    "level": (Worm(), Plane(), Friction(), TURNING, 0.01),
    "slope": (Worm(), Plane(0.1, 0.6), Friction(), TURNING, 0.01),
    "engine": (Worm(segments=9), Plane(), Friction(), ContractionEngine_segmentdriven(amplitude=0.1), 0.013),
    "rate limit": (Worm(rate_limit=0.2, actuator_lag=0.3), Plane(), Friction(0.1, 0.1, 0.1), TURNING, 0.007),
    "clamped": (Worm.planar(mass=0.1, half_height=0.05, k_torsion=0.1), ClampedGround(), Friction(), None, 0.01),
    "pipe": (Worm(), Pipe(SNAKING, 0.12), Friction(), TURNING, 0.01),
    "free": (Worm(drag=0.1), None, Friction(), TURNING, 0.01),
}


def wave(t: float) -> Command:
    contraction = 0.2 * np.maximum(0.0, np.sin(2 * np.pi * (np.arange(6) / 6 + t / 2)))
    return Command(np.column_stack([contraction, contraction]))


@BOTH
@pytest.mark.parametrize("name", CASES)
def test_resumed_it_goes_on_bit_for_bit(name: str, integrator: str, tmp_path: Path) -> None:
    worm, world, ground, actuation, dt = CASES[name]
    actuation = wave if actuation is None else actuation
    steps = 437  # neither half is a whole number of chunks

    def run(count: int, state: State | None = None) -> worm3d.Result:
        return worm3d.simulate(
            worm, world, ground, actuation=actuation, duration=count * dt, dt=dt, integrator=integrator, state=state
        )

    whole, first = run(steps), run(201)
    assert whole.status is Status.DONE
    second = run(steps - 201, saved_and_loaded(first.state, tmp_path))
    assert_goes_on(whole, first, second)
    assert np.abs(whole.joints[-1] - whole.joints[200]).max() > 1e-3, "it moves"


ROUGH: dict[str, Any] = {
    "worm": Worm(segments=10, k_torsion=0.02, k_yaw=0.02, k_twist=0.02, mass=0.05),
    "ground": Friction(0.8, 0.5, 1.2, static_ratio=1.0),
    "actuation": TravellingWave(amplitude=0.35, period=0.8, bias=0.5, hinge=0.3),
    "dt": 0.03,
}


def rough(steps: int, state: State | None = None) -> worm3d.Result:
    """Run a soft, fast worm on rough ground, which needs halved steps."""
    case = dict(ROUGH)
    return worm3d.simulate(case.pop("worm"), Plane(), duration=steps * case["dt"], state=state, **case)


def test_with_halved_steps_too() -> None:
    whole = rough(60)
    assert whole.status is Status.DONE
    assert whole.halved_steps > 0
    for cut in (20, 41):
        first = rough(cut)
        assert_goes_on(whole, first, rough(60 - cut, first.state))


def test_a_run_repeats_bit_for_bit() -> None:
    runs = [worm3d.simulate(Worm(), Plane(), actuation=TURNING, duration=2.0) for _ in range(2)]
    for name in ROWS:
        assert_array_equal(getattr(runs[1], name), getattr(runs[0], name), err_msg=name)


def test_recording_less_changes_nothing_else() -> None:
    """Rows are those of a full record; energy and slip are the sums since the row before."""
    full = worm3d.simulate(Worm(), Plane(), actuation=TURNING, duration=2.0)
    some = worm3d.simulate(Worm(), Plane(), actuation=TURNING, duration=2.0, record_every=8)
    assert len(some.time) == 26
    for name in ROWS:
        if name not in ("slip", "joint_slip"):
            assert_array_equal(getattr(some, name), getattr(full, name)[::8], err_msg=name)
    assert_allclose(some.slip[1:], full.slip[1:].reshape(25, 8, 6, 6).sum(axis=1), rtol=1e-12, atol=1e-18)
    total = full.energy.friction_loss[1:].reshape(25, 8).sum(axis=1)
    assert_allclose(some.energy.friction_loss[1:], total, rtol=1e-9, atol=1e-15)
    assert len(some.newton_iterations) == 200


@pytest.mark.parametrize("duration", [0.6, 1.0, 1.7, 2.4, 3.1])
def test_a_state_without_memory_starts_afresh_from_its_pose(duration: float) -> None:
    """The worm settles anew, uncommanded, near where it was."""
    first = worm3d.simulate(Worm(), Plane(), actuation=TURNING, duration=duration)
    pose = first.state.with_changes(joint_velocity=0.0)
    assert not pose.memory
    again = worm3d.simulate(Worm(), Plane(), actuation=TURNING, duration=0.5, state=pose)
    assert again.status is Status.DONE
    assert_allclose(again.time[0], duration, rtol=1e-12)
    assert_allclose(again.com[0], first.com[-1], rtol=0, atol=0.03)


def test_results_end_where_their_state_is() -> None:
    """The state of a run that reached its end is its last row."""
    run = worm3d.simulate(Worm(), Plane(), actuation=TURNING, duration=1.0)
    assert_array_equal(run.state.joints, run.joints[-1])
    assert_array_equal(run.state.directors, run.directors[-1])
    assert_array_equal(run.state.bend, run.bend[-1])
    assert_array_equal(run.state.joint_velocity, run.joint_velocity[-1])
    assert run.state.time == run.time[-1]


def test_a_run_that_was_given_up_ends_where_its_state_is() -> None:
    """What a guard refuses is no part of the run: the state is that of the last finished step."""
    run = worm3d.simulate(Worm(), Plane(), actuation=TravellingWave(amplitude=0.3, hinge=2.0), duration=5.0)
    assert run.status is Status.FOLDED
    assert run.stop.step == len(run.time)
    assert run.state.time == run.time[-1]
    assert_array_equal(run.state.joints, run.joints[-1])


class Controller:
    """Commands the wave of a gait, and keeps what it is given."""

    def __init__(self) -> None:
        self.resets, self.seen = 0, []

    def reset(self) -> None:
        self.resets += 1
        self.seen = []

    def step(self, t: float, measurement: Any) -> Command:
        self.seen.append((t, measurement))
        return wave(t)


@BOTH
def test_a_controller_sees_the_start_of_each_step_and_commands_its_end(integrator: str) -> None:
    """The command decided at t_n acts as that of t_{n+1}: the run is that of the function wave(t - dt)."""
    controller, dt = Controller(), 0.02
    run = worm3d.simulate(Worm(), Plane(), actuation=controller, duration=1.0, dt=dt, integrator=integrator)
    assert controller.resets == 1
    assert len(controller.seen) == 50
    assert_allclose([t for t, _ in controller.seen], np.arange(50) * dt, rtol=0, atol=1e-12)
    for k in (0, 7, 49):
        seen = controller.seen[k][1]
        assert_array_equal(seen.joints, run.joints[k])
        assert_allclose(seen.com, run.com[k], rtol=0, atol=1e-15)
        assert_allclose(seen.com_velocity, run.com_velocity[k], rtol=1e-12, atol=1e-15)
        assert_allclose(seen.chamber_strain, run.chamber_strain[k], rtol=0, atol=1e-15)
        assert_array_equal(seen.contraction, run.contraction[k])
        assert_array_equal(seen.normal_load, run.normal_load[k])
        assert_allclose(seen.heading, run.heading[k], rtol=0, atol=1e-15)
    expected = np.array([wave(k * dt).contraction for k in range(50)])
    assert_array_equal(run.command[1:], np.minimum(expected, 0.45))
    again = worm3d.simulate(Worm(), Plane(), actuation=controller, duration=0.1, dt=dt)
    assert controller.resets == 2
    assert len(controller.seen) == 5
    assert_array_equal(again.command[1:], run.command[1:6])


def test_a_sensor_makes_the_measurement() -> None:
    class Sensor:
        def __init__(self) -> None:
            self.resets = 0

        def reset(self) -> None:
            self.resets += 1

        def __call__(self, observation: worm3d.Observation) -> dict[str, float]:
            return {"twice": 2.0 * observation.com[0]}

    controller, sensor = Controller(), Sensor()
    run = worm3d.simulate(Worm(), Plane(), actuation=controller, sensor=sensor, duration=0.1)
    assert sensor.resets == 1
    assert_allclose([seen["twice"] for _, seen in controller.seen], 2.0 * run.com[:-1, 0], rtol=1e-12)


def test_a_gait_is_bound_to_the_worm() -> None:
    """A gait, its bound function, and a plain function that does the same are one actuation."""
    runs = [
        worm3d.simulate(Worm(), Plane(), actuation=actuation, duration=0.5)
        for actuation in (TURNING, TURNING.bind(Worm()), lambda t: TURNING.bind(Worm())(t))
    ]
    for run in runs[1:]:
        assert_array_equal(run.joints, runs[0].joints)
    assert runs[0].period == 2.0
    assert runs[1].period is None


@pytest.mark.parametrize(
    ("bad", "sentence"),
    [
        (lambda t: Command(np.zeros((4, 2))), "command for 4 segments, must be for the worm's 6"),
        (lambda t: np.zeros((6, 2)), "returned a ndarray, must return a worm3d.Command"),
        (lambda t: Command(np.full((6, 2), np.nan)), "contraction: got nan, every value must be finite"),
        (lambda t: Command(np.full((6, 2), 1.0)), "contraction: got 1.0, must be below 1"),
    ],
    ids=["segments", "type", "nan", "one"],
)
@pytest.mark.parametrize("controlled", [False, True], ids=["function", "controller"])
def test_a_bad_command_ends_the_run_with_its_reason(bad: Any, sentence: str, controlled: bool) -> None:
    """The steps before are kept, and are those of the run without the mistake."""

    def function(t: float) -> Command:
        return bad(t) if t > 0.6 else wave(t)

    class Bad(Controller):
        def step(self, t: float, measurement: Any) -> Command:
            return function(t)

    run = worm3d.simulate(Worm(), Plane(), actuation=Bad() if controlled else function, duration=2.0)
    assert run.status is Status.BAD_COMMAND
    assert sentence in run.stop.reason
    assert sentence in run.stop.sentence
    assert run.stop.step == len(run.time) == (62 if controlled else 61)
    good = worm3d.simulate(Worm(), Plane(), actuation=Controller() if controlled else wave, duration=2.0)
    assert_array_equal(run.joints, good.joints[: len(run.time)])
    assert_array_equal(run.state.joints, run.joints[-1])


def test_a_bad_force_ends_the_run_with_its_reason() -> None:
    run = worm3d.simulate(
        Worm(), Plane(), external_force=lambda t: np.zeros((7, 3)) if t < 0.5 else np.zeros((6, 3)), duration=1.0
    )
    assert run.status is Status.BAD_COMMAND
    assert "external_force: got shape (6, 3)" in run.stop.reason
    assert len(run.time) == 50


@pytest.mark.parametrize("every", [1, 125, 1250])
def test_a_run_that_is_watched_is_the_same(every: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """It goes on in smaller chunks."""
    given = {"actuation": TURNING, "duration": 12.5, "record_every": every}
    chunks: list[int] = []
    advance = run_module.advance
    monkeypatch.setattr(run_module, "advance", lambda *a: (chunks.append(len(a[3])), advance(*a))[1])
    alone = worm3d.simulate(Worm(), Plane(), **given)
    assert max(chunks) == run_module.MAX_STEPS_UNOBSERVED
    chunks.clear()
    seen: list[int] = []
    watched = worm3d.simulate(Worm(), Plane(), **given, observer=lambda t, view: seen.append(view.step), every=30)
    assert max(chunks) == 30
    assert seen == [*range(0, 1250, 30), 1250], "the start, every 30th step, and the end"
    assert_array_equal(alone.time, [k * every * alone.dt for k in range(1250 // every + 1)])
    for name in ("time", "joints", "contact_force", "newton_iterations"):
        assert_array_equal(getattr(alone, name), getattr(watched, name))


def test_every_number_of_a_row_is_written() -> None:
    problem = Problem(worm=Worm(), world=Plane(), actuation=TURNING, duration=0.1, record_every=5)
    run = run_module.Run(problem)
    for array in run.records.arrays().values():
        array[1:] = np.nan
    assert run.finish().status is Status.DONE
    assert all(np.isfinite(array).all() for array in run.records.arrays().values())


def test_an_observer_may_end_the_run() -> None:
    times: list[float] = []

    def observer(t: float, view: worm3d.View) -> bool:
        times.append(t)
        return bool(view.com[0] < 0.6)

    run = worm3d.simulate(Worm(), Plane(), actuation=TURNING, duration=5.0, observer=observer, every=7)
    assert run.status is Status.INTERRUPTED
    assert not run.status.diverged
    assert_allclose(times, 0.07 * np.arange(len(times)), atol=1e-12)
    assert len(run.time) == 7 * (len(times) - 1) + 1 < 500
    assert run.com[-1, 0] >= 0.6 > run.com[-8, 0]
    whole = worm3d.simulate(Worm(), Plane(), actuation=TURNING, duration=5.0)
    rest = worm3d.simulate(Worm(), Plane(), actuation=TURNING, duration=5.0 - run.time[-1], state=run.state)
    assert_goes_on(whole, run, rest)
