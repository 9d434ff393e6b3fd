"""Measurements damaged at random: closed loops reach their end, hardly worse, and nothing unusable passes the gate."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from fuzzing import TIMES, examples, replaced
from hypothesis import given
from hypothesis import strategies as st

from control.baselines import OpenLoop, PiLineOfSight
from control.estimation.estimator import Estimator
from control.estimation.reduced import ReducedModel
from control.gaits.steering import GaitParameters
from control.identification.identified import load
from control.loop import WaveController
from control.sensing.gate import SPAN, Gate
from control.sensing.sensors import COM, HEADING_SENSOR, STRAIN, Measurement, Sensors
from control.supervisor import Supervisor
from control.task import ControlTask
from control.tracking.metrics import Motion, summary, tracking
from control.tracking.paths import Circle
from control.tracking.references import Constant, Reference
from worm3d import Command, Observation, Plane, Result, Worm, simulate

WORM = Worm()
FOUND = load(WORM)
REFERENCE = Reference(Constant(0.08), path=Circle(1.5, start=(0.5, 0.0)))
NAN, INF = float("nan"), float("inf")
NOW = 5.0

Corruption = Callable[[np.random.Generator, str, Any], Any]


def part(value: float) -> Corruption:
    """Return what puts a value into one number of a sample."""

    def corrupt(random: np.random.Generator, name: str, sample: Any) -> Any:
        array = np.array(sample, dtype=float)
        array.flat[random.integers(array.size)] = value
        return array if array.ndim else float(array)

    return corrupt


def outlier(random: np.random.Generator, name: str, sample: Any) -> Any:
    """Return a sample that could be one, but is not."""
    size = {"strain": 0.2, "com": 2.0, "heading": 3.0}[name]
    return np.asarray(sample) + size * random.uniform(-1.0, 1.0, np.shape(sample))


VALUES: dict[str, Corruption] = {
    "nan": part(NAN),
    "infinite": part(float("inf")),
    "huge": part(1e300),
    "negative": part(-1e9),
    "all nan": lambda random, name, sample: np.full(np.shape(sample), NAN),
    "shape": lambda random, name, sample: np.zeros(random.integers(1, 9)),
    "text": lambda random, name, sample: "fault",
    "lost": lambda random, name, sample: None,
    "outlier": outlier,
}
INSTANTS: dict[str, Callable[[float], Any]] = {
    "future": lambda t: t + 1.0,
    "far future": lambda t: 1e300,
    "no time": lambda t: NAN,
    "none": lambda t: None,
    "old": lambda t: t - 100.0,
    "late": lambda t: t - 0.11,
}


class Corrupted:
    """Sensors of which some samples are corrupted.

    Parameters
    ----------
    share : float
        Of the samples of each channel.
    seed : int
    sensors : Sensors
    """

    def __init__(self, share: float, seed: int, sensors: Sensors) -> None:
        self.share, self.seed, self.sensors = share, seed, sensors
        self.reset()

    def reset(self) -> None:
        self.sensors.reset()
        self._random, self.count = np.random.default_rng([self.seed, 7]), 0

    def __call__(self, seen: Observation) -> Measurement:
        measured = self.sensors(seen)
        for name in ("strain", "com", "heading"):
            sample = getattr(measured, name)
            if sample is not None and self._random.random() < self.share:
                self.count += 1
                measured = replaced(measured, **self._wrong(name, sample, getattr(measured, f"{name}_time")))
        return measured

    def _wrong(self, name: str, sample: Any, instant: float) -> dict[str, Any]:
        if self._random.random() < 0.6:
            kinds = list(VALUES.values())
            return {name: kinds[self._random.integers(len(kinds))](self._random, name, sample)}
        instants = list(INSTANTS.values())
        return {f"{name}_time": instants[self._random.integers(len(instants))](instant)}


class Watched:
    """A controller of which phases are kept, and commands looked at."""

    def __init__(self, controller: WaveController) -> None:
        self.controller = controller
        self.reset()

    def reset(self) -> None:
        self.controller.reset()
        self.waves: list[float] = []

    def step(self, t: float, measurement: Measurement) -> Command:
        command = self.controller.step(t, measurement)
        assert np.isfinite(command.contraction).all()
        assert np.isfinite(command.hinge).all()
        self.waves.append(self.controller.generator.waves)
        return command


def controller(kind: str, heading: bool) -> WaveController:
    assert FOUND is not None
    channels = {"strain": STRAIN, "com": COM} | ({"heading": HEADING_SENSOR} if heading else {})
    if kind == "mpc":
        return Supervisor.of(ControlTask(WORM, REFERENCE, FOUND, sensors=channels))
    return (PiLineOfSight if kind == "pi_los" else OpenLoop)(ControlTask(WORM, REFERENCE, FOUND))


def run(kind: str, share: float, seed: int, heading: bool, duration: float = 12.0) -> tuple[Result, Watched, Corrupted]:
    watched = Watched(controller(kind, heading))
    sensors = Corrupted(share, seed, Sensors(heading=HEADING_SENSOR if heading else None, seed=seed))
    result = simulate(WORM, Plane(), actuation=watched, sensor=sensors, duration=duration)
    return result, watched, sensors


def figures(result: Result, watched: Watched) -> dict[str, float | None]:
    motion = Motion(result.time, result.com[:, :2], result.heading, np.array([0.0, *watched.waves]))
    return summary(tracking(motion, REFERENCE), REFERENCE, WORM.length)[0]


@pytest.mark.parametrize(
    ("kind", "seed", "heading", "share"),
    [
        pytest.param("mpc", 1, False, 0.03, marks=pytest.mark.slow),
        *(("mpc", 2, True, 0.1), ("open_loop", 5, True, 0.03)),
        pytest.param("pi_los", 4, True, 0.03, marks=pytest.mark.slow),
        *((("mpc", "pi_los")[k % 2], 100 + k, k % 3 == 0, 0.03) for k in range(10 * (TIMES - 1))),
    ],
)
def test_rare_corruption_of_all_channels_costs_little(kind: str, seed: int, heading: bool, share: float) -> None:
    """Against the run of the same seed that is not corrupted."""
    result, watched, sensors = run(kind, share, seed, heading)
    assert result.stop.status.name == "DONE", result.stop.sentence
    assert sensors.count > 40
    assert watched.controller.gate.refused.total() > 0.7 * sensors.count
    assert watched.controller.failures == 0
    assert not watched.controller.faults
    found, whole = figures(result, watched), figures(*run(kind, 0.0, seed, heading)[:2])
    assert found["cross_track_rms_bl"] < whole["cross_track_rms_bl"] + 0.0015
    assert abs(found["speed_bias_relative"] - whole["speed_bias_relative"]) < 0.008


@pytest.mark.parametrize("kind", ["mpc", "pi_los"])
def test_when_nearly_everything_is_corrupted_it_still_crawls(kind: str) -> None:
    result, watched, _ = run(kind, 0.9, 6, True, 8.0)
    assert result.stop.status.name == "DONE", result.stop.sentence
    assert np.isfinite([d.estimate.state for d in watched.controller.decisions if d.estimate]).all()
    assert result.com[-1, 0] > 0.7


def test_a_camera_from_above_without_heights_is_enough() -> None:
    assert FOUND is not None

    class Above(Sensors):
        def __call__(self, seen: Observation) -> Measurement:
            measured = super().__call__(seen)
            return measured if measured.com is None else replaced(measured, com=measured.com * [1.0, 1.0, NAN])

    watched = Watched(controller("mpc", False))
    result = simulate(WORM, Plane(), actuation=watched, sensor=Above(seed=1), duration=12.0)
    assert figures(result, watched)["cross_track_rms_bl"] < 0.009
    assert np.isfinite(watched.controller.decisions[-1].estimate.slope).all()


def test_a_chamber_without_a_strain_sensor_is_done_without() -> None:
    class Blind(Sensors):
        def __call__(self, seen: Observation) -> Measurement:
            measured = super().__call__(seen)
            if measured.strain is not None:
                measured.strain[2, 0] = NAN
                measured.strain[4] = NAN
            return measured

    watched = Watched(controller("mpc", False))
    result = simulate(WORM, Plane(), actuation=watched, sensor=Blind(seed=1), duration=12.0)
    assert figures(result, watched)["cross_track_rms_bl"] < 0.009


@pytest.mark.parametrize(
    "wrong",
    [
        {"com": np.full(3, NAN)},
        {"com": np.array([NAN, 0.0, 0.07])},
        {"com": np.array([0.5, 0.0, NAN])},
        {"com": np.array([1e200, 0.0, 0.07])},
        {"com_time": 99.0},
        {"strain": np.full((6, 2), NAN)},
        {"heading": NAN, "heading_time": 1.0},
        {"heading": 0.1, "heading_time": 1e9},
    ],
)
def test_an_estimator_without_a_gate_stays_finite_too(wrong: dict[str, Any]) -> None:
    assert FOUND is not None
    for heading in (None, 0.0):
        estimator = Estimator(WORM, ReducedModel.of(WORM, FOUND), heading=heading)
        for k in range(200):
            t = 0.01 * k
            strain, com = np.full((6, 2), -0.05), np.array([0.5 + 0.08 * t, 0.0, 0.07])
            seen = com if k % 5 == 0 else None
            measured = Measurement(t, strain=(strain, t), com=(seen, t), heading=(None, NAN))
            if k in (0, 100, 101):
                measured = replaced(measured, **({"com": com} | wrong))
            estimator.take(t, measured, GaitParameters(0.28, 0.9), 0.9 * 2.0 * np.pi * t)
            last = estimator.estimate(t)
        assert np.isfinite(last.state).all()
        assert np.isfinite(last.covariance).all()
        assert np.isfinite(last.slope).all()
        assert last.state.x == pytest.approx(0.66, abs=0.02)


NUMBER = st.one_of(st.floats(), st.sampled_from([NAN, INF, -INF, 1e308, -1e308, 0.0, 0.3]))
ANYTHING = st.one_of(st.none(), NUMBER, st.text(max_size=3), st.integers(), st.lists(NUMBER, max_size=4), st.binary())


@examples(150)
@given(
    strain=st.one_of(ANYTHING, st.lists(NUMBER, min_size=12, max_size=12).map(lambda v: np.reshape(v, (6, 2)))),
    com=st.one_of(ANYTHING, st.lists(NUMBER, min_size=3, max_size=3).map(np.array)),
    heading=ANYTHING,
    instants=st.lists(ANYTHING, min_size=3, max_size=3),
)
def test_whatever_comes_what_passes_can_be_used(strain, com, heading, instants) -> None:
    gate = Gate(WORM)
    samples = dict(zip(("strain", "com", "heading"), zip((strain, com, heading), instants, strict=True), strict=True))
    seen = gate(NOW, Measurement(NOW, **samples))
    for name in ("strain", "com", "heading"):
        if getattr(seen, name) is not None:
            assert NOW - SPAN <= getattr(seen, f"{name}_time") <= NOW + 1e-6
    if seen.strain is not None:
        assert seen.strain.shape == (6, 2)
        assert np.isfinite(seen.strain).any(axis=1).sum() >= 4
        assert np.nanmin(seen.strain) >= -1.0
    if seen.com is not None:
        assert seen.com.shape == (3,)
        assert np.isfinite(seen.com[:2]).all()
    if seen.heading is not None:
        assert np.isfinite(seen.heading)
