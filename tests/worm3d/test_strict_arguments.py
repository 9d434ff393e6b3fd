"""Python is as strict as the command line: what a scene refuses, `simulate` refuses, and nothing is dropped or clipped.

The rules stand in the library; the first test takes scenes past their own checks to see that the library has them too.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import pytest

import worm3d
from control.gaits import (
    GAITS,
    ContractionEngine_segmentdriven,
    Reflexive,
    TravellingWave,
)
from control.gaits.gait import BoundGait
from control.gaits.steering import GaitParameters, SteeredWave
from planar import linkage, published
from scenes.language import toml
from scenes.language.errors import SceneError
from scenes.language.overrides import apply_overrides
from scenes.language.reading import trusted
from scenes.models.loading import parse_scene
from scenes.models.worm.build import problem_of
from scenes.models.worm.schema import WormScene
from worm3d import ClampedGround, Command, Plane, State, Worm
from worm3d.running.run import Run

REFUSED = [
    ("run.dt_s=0.5",),
    ("run.dt_s=0.21",),
    ("gait.period_s=0.09",),
    ("run.record_every=7", "run.duration_s=0.5"),
    ("run.accuracy=0.01", "run.integrator=implicit_euler"),
    ("gait.kind=segment_driven", "gait.contract_time_s=0.05", "run.dt_s=0.1"),
    ("gait.amplitude=0.9",),
    ("gait.kind=shc", "gait.amplitude=0.5"),
    ("worm.stroke=[-0.1, 0.15]",),
    ("gait.kind=discrete", "gait.contracted=9"),
    ("world.kind=clamped", "start.lift_m=0.1"),
    ("world.kind=pipe", "start.position_m=[0.1, 0.2]"),
    ("world.kind=pipe", "start.azimuth_deg=30"),
    ("worm.mass_kg=5",),
    ("worm.payload_kg=1",),
    ("worm.half_height_m=[0.05, 0.05]",),
]


@pytest.mark.parametrize("overrides", REFUSED, ids=", ".join)
def test_what_a_scene_refuses_python_refuses_too(overrides: tuple[str, ...]) -> None:
    text = 'model = "worm"\nrun.duration_s = 1.0\n'
    with pytest.raises(SceneError):
        parse_scene(text, "test", overrides)
    data, _, _ = apply_overrides(toml.parse(text), overrides)
    scene = trusted(WormScene, data)
    with pytest.raises(ValueError, match=r"got|carries|must"):
        Run(problem_of(scene))


@pytest.mark.parametrize("name", GAITS)
def test_no_gait_takes_steps_that_miss_its_wave_nor_an_amplitude_beyond_the_stroke(name: str) -> None:
    gait = GAITS[name]
    period = "T_wave" if name == "segment_driven" else "period"
    if hasattr(gait(), period):
        with pytest.raises(ValueError, match=r"dt: got 0\.21 s, must be at most a 10th of .*, 2 s"):
            worm3d.simulate(Worm(), Plane(), actuation=gait(**{period: 2.0}), duration=1.0, dt=0.21)
        bound = gait(**{period: 2.0}).bind(Worm())
        if isinstance(bound, BoundGait):  # a gait that senses is a controller
            with pytest.raises(ValueError, match=r"dt: got 0\.21 s, must be at most a 10th of .*, 2 s"):
                worm3d.simulate(Worm(), Plane(), actuation=bound, duration=1.0, dt=0.21)
    for amplitude in (0.4501, 0.9, 20.0):
        with pytest.raises(ValueError, match=f"amplitude: got {amplitude}, must be at most 0.45, the worm's stroke"):
            worm3d.simulate(Worm(), Plane(), actuation=gait(amplitude=amplitude), duration=0.5)
    if name not in ("planned_turn",):  # whose amplitude is above 0
        with pytest.raises(ValueError, match=r"amplitude: got -0\.2, must be at least -0\.1, the worm's stroke"):
            worm3d.simulate(Worm(), Plane(), actuation=gait(amplitude=-0.2), duration=0.5)


@pytest.mark.parametrize(
    ("actuation", "dt", "sentence"),
    [
        (Reflexive(TravellingWave(), ()), 0.25, "dt: got 0.25 s, must be at most a 10th of the gait's period"),
        (Reflexive(TravellingWave(amplitude=0.5), ()), 0.01, "amplitude: got 0.5, must be at most 0.45"),
        (SteeredWave(GaitParameters(0.4, 1.0)), 0.2, "dt: got 0.2 s, must be at most a 10th of the period of the"),
        (SteeredWave(GaitParameters(0.5, 1.0)), 0.01, "amplitude: got 0.5, must be at most 0.45"),
        (SteeredWave(GaitParameters(-0.5, 1.0)), 0.01, "amplitude: got 0.5, must be at most 0.45"),
        (ContractionEngine_segmentdriven(T_contract=0.05), 0.1, "dt: got 0.1 s, must be at most T_contract"),
        (ContractionEngine_segmentdriven(contractType="dirac"), 0.05, "dt: got 0.05 s, must be at most impulse"),
        (None, 0.7, "dt: got 0.7 s, must be at most the duration of the run"),
    ],
)
def test_other_actuations(actuation: Any, dt: float, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        worm3d.simulate(Worm(), Plane(), actuation=actuation, duration=0.5, dt=dt)


def test_what_is_just_within_is_taken() -> None:
    gait = TravellingWave(amplitude=0.15 * 3.0, period=0.7)
    assert worm3d.simulate(Worm(), Plane(), actuation=gait, duration=0.7, dt=0.07).status is worm3d.Status.DONE
    lengthening = TravellingWave(amplitude=0.3, rectified=False)  # by more than the stroke: clipped, and counted
    assert lengthening.bind(Worm()).commands(np.linspace(0.0, 2.0, 99)).contraction.min() == -0.1
    only_lengthens = Worm(stroke=(-0.3, 0.0))
    assert TravellingWave(amplitude=0.3, rectified=False).bind(only_lengthens)(0.4).contraction.max() == 0.0


def test_the_planar_models_have_the_same_rule() -> None:
    with pytest.raises(ValueError, match=r"dt: got 0\.5 s, must be at most a 10th of T_wave, 2 s"):
        published.simulate(n=6, T_wave=2.0, dt=0.5, steps=3)
    with pytest.raises(ValueError, match=r"dt: got 0\.5 s, must be at most the duration of the run, 0\.4 s"):
        linkage.simulate(linkage.Linkage(), lambda t: np.zeros(6), duration=0.4, dt=0.5)


def test_a_height_that_a_world_cannot_give_is_refused() -> None:
    assert State.straight(Worm(), Plane(), (0.0, 0.0, -1e-17)).laid, "rounding lifts nothing"
    with pytest.raises(ValueError, match="position: got -1 m as its third number, must be at least 0"):
        State.straight(Worm(), Plane(), position=(0.0, 0.0, -1.0))
    for lift in (-1.0, 1.0):
        with pytest.raises(ValueError, match="as its third number, must be 0 on a ClampedGround"):
            State.straight(Worm(), ClampedGround(), position=(0.0, 0.0, lift))
    assert State.straight(Worm(), None, position=(0.0, 0.0, -1.0)).joints[0, 2] == -1.0
    assert State.straight(Worm(), Plane(), position=(0.0, 0.0, 0.2)).joints[0, 2] == pytest.approx(0.25)


def test_commands_that_met_an_end_of_the_stroke_are_counted() -> None:
    """A sine of 0.9 is beyond 0.45 for a third of its time, and below -0.1 for 46 %."""

    def met(amplitude: float, worm: Worm) -> float:
        def one(t: float) -> Command:
            contraction = np.zeros((6, 2))
            contraction[2, 1] = amplitude * np.sin(2.0 * np.pi * t)
            return Command(contraction)

        found = worm3d.simulate(worm, None, actuation=one, duration=1.0, dt=0.001).summary()["commands_at_limit"]
        assert isinstance(found, float)
        return found

    above, below = (0.5 - np.arcsin(end / 0.9) / np.pi for end in (0.45, 0.1))
    assert met(0.9, Worm()) == pytest.approx(1000.0 * (above + below), abs=3.0)
    assert met(0.9, Worm(stroke=(0.0, 0.45))) == pytest.approx(1000.0 * above, abs=2.0), "0 is no end"
    assert met(0.09, Worm()) == 0.0
    biased = TravellingWave(amplitude=0.3, bias=1.0)
    assert worm3d.simulate(Worm(), Plane(), actuation=biased, duration=1.0).summary()["commands_at_limit"] > 10.0


def test_the_sentence_about_a_fold_names_what_was_beyond_90_degrees() -> None:
    """A stiff joint is asked to bend farther than it can: what it was asked for is told, not that it is bent so far."""

    def hinged(t: float) -> Command:
        return Command(np.zeros((6, 2)), hinge=np.array([0.0, 0.0, 0.0, 3.0 * t, 0.0]))

    run = worm3d.simulate(Worm(), Plane(), actuation=hinged, duration=3.0)
    assert run.status is worm3d.Status.FOLDED
    assert "were bent by 90 degrees or more, or asked to bend so far" in run.stop.sentence
    bent, asked = (float(run.stop.reason.split(words)[1].split()[0].strip(",")) for words in ("bent by ", "ask for "))
    assert max(bent, asked) >= 90.0
    assert ("stiffer" in run.stop.reason) == (bent >= asked)


def test_the_speed_of_a_run_counts_its_controller() -> None:
    """A controller that thinks for 5 ms in steps of 10 ms lets a run be twice as fast as real time at most."""

    class Slow:
        def reset(self) -> None:
            """Begin anew."""

        def step(self, t: float, measurement: Any) -> Command:
            """Return rest, late."""
            time.sleep(0.005)
            return Command(np.zeros((6, 2)))

    run = worm3d.simulate(Worm(), Plane(), actuation=Slow(), duration=0.5)
    assert run.wall_s > 50 * 0.005
    assert 0.0 < float(run.summary()["real_time_factor"] or 0.0) < 2.0
