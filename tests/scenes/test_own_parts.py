"""Parts of a user's own in scenes: controllers, costs, estimators and paths by `module:NAME`, and mistakes in them."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from control.faults.injected import INJECTED
from control.parts import FAULT
from control.sensing.sensors import QUANTITIES
from scenes.language.errors import SceneError
from scenes.language.parts import PartSection
from scenes.models.control.build import controller_of
from scenes.models.control.reference import path_of
from scenes.models.loading import load_scene
from scenes.models.switched import switched_keys, switched_parts
from scenes.running.runner import simulate

MODULE = """
from dataclasses import dataclass

import worm3d
from control.estimation.estimator import Estimator
from control.gaits import steering
from control.parts import part
from control.planning.terms import CostTerm
from control.tracking.paths import Line


@part("controller")
class Blind:
    @classmethod
    def of(cls, worm, reference, identified, mechanism, control_period, sensors):
        made = cls()
        made.generator = steering.WaveGenerator(identified.schedule, worm)
        return made

    def reset(self):
        self.generator.reset()
        self.t = 0.0

    @property
    def waves(self):
        return self.generator.waves

    def step(self, t, measurement):
        before, self.t = self.t, t
        return self.generator.step(t - before, steering.GaitParameters(0.3, 0.8))


class Stops(Blind):
    def step(self, t, measurement):
        return 3 if t > 1.0 else super().step(t, measurement)


class Silent(Blind):
    waves = None


class Still(Blind):
    def step(self, t, measurement):
        return self.generator.step(0.0, steering.GaitParameters(0.0, 0.8))


@part("controller")
@part("estimator")
class NoOf:
    pass


class Unmarked:
    @classmethod
    def of(cls, *given):
        raise AssertionError("called")

    for_sensors = of


@part("path")
def diagonal():
    return Line(azimuth=0.5)


@part("path")
class Nowhere:
    def __init__(self):
        raise SystemExit(3)


@part("term")
def three():
    return 3


class Raises(Blind):
    @classmethod
    def of(cls, *given):
        raise KeyError("nothing")


class No(Blind):
    @classmethod
    def of(cls, *given):
        return 3


@dataclass(frozen=True)
class Thrift(CostTerm):
    tolerance: float = 0.5

    def misses(self, at):
        return at.given.frequency / self.tolerance


class Wrong(Thrift):
    def misses(self, at):
        return at.nothing


DIAGONAL = Line(azimuth=0.5)
UNMARKED = Unmarked()


class Own(Estimator):
    pass
"""


@pytest.fixture(autouse=True)
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    (tmp_path / "own_parts.py").write_text(MODULE)
    (tmp_path / "own_broken.py").write_text("import nothing_of_that_name\n")
    (tmp_path / "own_ends.py").write_text("import sys\nsys.exit(4)\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    yield
    for name in ("own_parts", "own_broken"):
        sys.modules.pop(name, None)


def line(*overrides: str):
    return load_scene("path_line", ("run.duration_s=4", "run.record_every=4", *overrides))


def test_a_controller_that_is_no_wave_controller_drives_the_worm_and_is_timed() -> None:
    record = simulate(line("controller.kind=own_parts:Blind"))
    assert record.status == "done"
    assert record["com"][-1, 0] > 0.6
    assert len(record["decision_time"]) == 20
    np.testing.assert_allclose(record["waves"], 0.8 * record["time"], atol=1e-9)
    assert record.summary.faults == []
    assert any(each.name == "control_step_ms_p99" for each in record.timing)


def test_what_a_controller_raises_is_told_once_and_the_worm_rests(caplog: pytest.LogCaptureFixture) -> None:
    record = simulate(line("controller.kind=own_parts:Stops"))
    assert record.status == "done"
    (fault,) = record.summary.faults
    raised = "Stops raised an exception in 299 of 400 steps, and the worm rested: "
    assert fault["what"] == raised + "TypeError: step returned int, must be a worm3d.Command"
    assert fault["time_s"] == pytest.approx(1.01)
    told = [each for each in caplog.records if each.name == "control.guest"]
    assert [each.exc_info is not None for each in told] == [True]
    assert record.summary["mpc_failures"] is None
    assert "plans nothing" not in record.summary.reasons["mpc_failures"], "which would read as: it raised nothing"
    assert np.abs(record["contraction"][-1]).max() < 1e-3


@pytest.mark.parametrize("kind", ["Blind", "Silent"])
def test_what_keeps_the_worm_from_its_way_is_found_whoever_drives_it(kind: str) -> None:
    """Silent does not tell the phase of its wave, of 0.8 Hz; that of the map is assumed."""
    longer = ("run.duration_s=9", f"controller.kind=own_parts:{kind}")
    broken = ("fault.chamber=true", "fault.chamber_segment=2", "fault.chamber_begin_s=3")
    fault, *_ = simulate(line(*longer, *broken)).summary.faults
    assert fault["kind"] == "chamber 2 left", "and then that it leaves its path"
    assert fault["time_s"] < 3.0 + 3.0 / 0.8
    assert simulate(line(*longer)).summary.faults == []


def test_a_worm_that_is_told_to_rest_is_not_too_slow() -> None:
    """As of controllers that ship: it may be where it is to be."""
    assert simulate(line("run.duration_s=6", "controller.kind=own_parts:Still")).summary.faults == []


@pytest.mark.slow
def test_an_own_term_of_the_cost_slows_the_wave() -> None:
    usual, thrifty = (
        simulate(line("run.duration_s=8", *more))
        for more in ((), ('cost.parts=["speed", "offset", "own_parts:Thrift"]',))
    )
    frequency, slowed = (record["decision_parameters"][15:, 1].mean() for record in (usual, thrifty))
    assert slowed < frequency - 0.05


def test_tolerances_and_gains_of_scenes_arrive() -> None:
    (term, *_) = controller_of(line("cost.speed_tolerance=0.01", 'cost.parts=["speed"]').settings).planner.cost.terms
    assert term.tolerance == 0.01
    gains = controller_of(line("controller.kind=pi_los", "controller.gain_reach=0.4").settings).gains
    assert (gains.reach, gains.heading) == (0.4, 1.2)
    (limit,) = controller_of(line('constraints.parts=["corridor"]').settings).planner.cost.constraints or (None,)
    assert limit is None or type(limit).__name__ == "Corridor"


def test_own_paths_and_estimators_are_used() -> None:
    for name in ("DIAGONAL", "diagonal"):
        assert path_of(line(f"reference.kind=own_parts:{name}").settings).azimuth == 0.5
    found = controller_of(line("controller.estimator=own_parts:Own").settings).estimator
    assert type(found).__name__ == "Own"


@pytest.mark.parametrize(
    ("override", "said"),
    [
        ("controller.kind=mpd", "did you mean 'mpc'?"),
        ("controller.kind=own_ports:Blind", "there is no module 'own_ports'"),
        ("controller.kind=own_broken:Blind", "cannot be imported: No module named 'nothing_of_that_name'"),
        ("controller.kind=own_parts:Blnd", "has no 'Blnd'; did you mean 'Blind'?"),
        ("controller.kind=own_parts:NoOf", "must be a controller: a class with of("),
        ("controller.kind=own_parts:", "or module:NAME"),
        ("reference.kind=own_parts:NoOf", "is the class NoOf, not marked as a path: derive it from control.tracking"),
        ("reference.kind=own_parts:UNMARKED", "is an object of Unmarked, not marked as a path: derive its class from"),
        ("reference.kind=own_parts:Nowhere", "own_parts:Nowhere() raised SystemExit: 3"),
        (
            "controller.kind=own_parts:Unmarked",
            "or write @part('controller') above it (from control.parts import part)",
        ),
        (
            "controller.model=own_parts:Blind",
            "the class Blind, not marked as a model: derive it from control.estimation",
        ),
        ('cost.parts=["speed", "own_parts:NoOf"]', "not marked as a term of the cost: derive it from control.planning"),
        ('cost.parts=["own_parts:three"]', "three() is an object of int, must be a term of the cost, with all that"),
        ("controller.kind=own_ends:Blind", "the module 'own_ends' cannot be imported: SystemExit: 4"),
        ("controller.kind=os:abort", "os:abort: 'os' is a module of Python itself; a module of your own needs another"),
        ("controller.kind=pip.__main__:main", "'pip.__main__' is a program, which ends when it has run"),
        ('cost.parts=["sped"]', "did you mean 'speed'?"),
        ("cost.parts=[]", "parts: got none, must be at least one"),
        ("controller.estimator=own_parts:NoOf", "a class with for_sensors"),
        ("controller.gain_reach=0.3", "only for controller.kind = 'pi_los' or 'module:NAME'"),
    ],
)
def test_wrong_names_give_one_sentence(override: str, said: str) -> None:
    with pytest.raises(SceneError) as caught:
        line(override)
    (sentence,) = caught.value.lines
    assert said in sentence


def test_parts_that_a_controller_does_not_take_are_refused() -> None:
    with pytest.raises(SceneError, match="'pi_los' takes no terms"):
        line("controller.kind=pi_los", "cost.speed_tolerance=0.01")
    with pytest.raises(SceneError, match="takes no estimator"):
        line("controller.kind=own_parts:Blind", "controller.estimator=own_parts:Own")


@pytest.mark.parametrize(
    ("override", "said"),
    [
        ("controller.kind=own_parts:Raises", "KeyError: 'nothing'"),
        ("controller.kind=own_parts:No", "returned int, must have reset"),
        ('cost.parts=["own_parts:Wrong"]', "controller: own_parts:Wrong: AttributeError: 'Moment' object has no"),
    ],
)
def test_what_makes_no_controller_is_told(override: str, said: str) -> None:
    with pytest.raises(SceneError, match=said):
        simulate(line(override))


def test_who_is_not_told_takes_the_sensors_for_usual_ones() -> None:
    told, untold = (
        controller_of(line("sensor.com_noise_m=0.02", *more).settings) for more in ((), ("controller.told=false",))
    )
    assert told.estimator.noise.told == 0.02
    assert untold.estimator.noise.told == 0.005


SENSING = """
from dataclasses import dataclass

import numpy as np
from own_parts import Blind

from control.faults.injected import Injected
from control.sensing.sensors import QUANTITIES, Channel, Quantity
from worm3d.values.parameters import parameter

for name in ("tail", "unasked"):
    QUANTITIES[name] = Quantity(
        "height of the tail",
        "m",
        Channel(noise=0.001),
        true_value=lambda seen: np.array(seen.joints[0, 2]),
        shape=lambda worm: (),
        limits=lambda worm: (-1.0, 1.0),
        mirrored=lambda value: value,
    )


@dataclass(frozen=True, kw_only=True)
class Worded(Injected, name="worded"):
    word: str = parameter("some", meaning="a word")


class Feeler(Blind):
    senses = ("tail",)
    felt = []

    def step(self, t, measurement):
        self.felt.append((measurement["tail"].value, "unasked" in measurement))
        return super().step(t, measurement)
"""


@pytest.fixture
def sensing(own: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "own_senses.py").write_text(SENSING)
    yield
    for table, names in ((QUANTITIES, ("tail", "unasked")), (INJECTED, ("worded",))):
        for name in names:
            table.pop(name, None)
    sys.modules.pop("own_senses", None)


def test_a_controller_may_stand_in_the_module_of_its_sensor_and_of_a_fault(sensing: None) -> None:
    record = simulate(line("controller.kind=own_senses:Feeler", "run.duration_s=0.4"))
    assert record.status == "done"
    felt = sys.modules["own_senses"].Feeler.felt
    assert len(felt) == 40
    assert np.isfinite([float(value) for value, _ in felt]).all()
    assert not any(unasked for _, unasked in felt), "which the controller does not sense"


def test_a_fault_may_have_a_field_of_text(sensing: None) -> None:
    importlib.import_module("own_senses")
    fault = INJECTED["worded"]
    assert fault(word="other").word == "other"
    with pytest.raises(ValueError, match="word: got int, must be a text"):
        fault(word=3)
    keys = switched_keys({"worded": fault})
    assert keys["worded_word"].hint is str

    class Faults(PartSection, keys=keys):
        """Faults."""

    (made,) = switched_parts(FAULT, Faults(worded=True, worded_word="third", worded_begin_s=1.0))
    assert (made.word, made.begin) == ("third", 1.0)
