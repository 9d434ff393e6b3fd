"""Misspelt names in Python get the sentences that scenes have: which name was meant, or which ones there are."""

import copy
import dataclasses
import inspect
import pickle
import re
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import pytest

import control.gaits
import control.sensing
import worm3d
from control.baselines import Gains
from control.faults.injected import INJECTED
from control.gaits import GAITS, REFLEXES, Gait, TravellingWave, steering
from control.planning.constraints import CONSTRAINTS
from control.planning.terms import TERMS
from control.sensing import Channel
from control.tracking import paths, references
from planar import linkage, published
from planar.published_worm import Parameters
from worm3d.physics.friction_laws import LAWS
from worm3d.physics.hysteresis import HYSTERESES
from worm3d.physics.loads import LOADS
from worm3d.physics.media import MEDIA
from worm3d.values.parameters import PARAMETER

REGISTRIES = (GAITS, REFLEXES, INJECTED, TERMS, CONSTRAINTS, LAWS, HYSTERESES, MEDIA, LOADS, worm3d.ACTUATORS)
REGISTERED = {part for registry in REGISTRIES for part in registry.values()}
PUBLIC = {part for name in dir(worm3d) if inspect.isclass(part := getattr(worm3d, name))}
PUBLIC -= {part for part in PUBLIC if Protocol in part.__bases__}  # nobody makes one
OTHERS = {Channel, Gains, Parameters, linkage.Linkage, linkage.Friction, paths.Line, paths.Circle, paths.SCurve}
OTHERS |= {references.Reference, references.Steps, steering.GaitParameters, steering.Schedule, steering.SteeredWave}
MADE_BY_OTHERS = {
    worm3d.Commands,
    worm3d.Controller,
    worm3d.Response,
    worm3d.LoadStep,
    worm3d.Spring,
    worm3d.Status,
    worm3d.View,
    worm3d.Observation,
    worm3d.Stop,
}
"""Classes that a run makes, not a user."""
MADE_BY_OTHERS |= {worm3d.ErrorEstimate, worm3d.Spread, worm3d.WorldKernel}
CLASSES = sorted(
    {part for part in REGISTERED | PUBLIC | OTHERS if not issubclass(part, Exception)} - MADE_BY_OTHERS,
    key=lambda part: f"{part.__module__}.{part.__name__}",
)
FUNCTIONS = [
    worm3d.simulate,
    worm3d.simulate_batch,
    worm3d.load,
    worm3d.draw,
    worm3d.show,
    worm3d.recovery,
    worm3d.fit,
    worm3d.optimise,
    worm3d.sweep,
    worm3d.slope_into_pipe,
    worm3d.State.straight,
    worm3d.Worm.planar,
    worm3d.Centreline.of,
    published.simulate,
    linkage.simulate,
]


@pytest.mark.parametrize("part", [*CLASSES, *FUNCTIONS], ids=lambda part: part.__qualname__)
def test_an_argument_that_there_is_not_is_refused_by_name(part: Any) -> None:
    name = part.__name__ if inspect.isclass(part) else part.__qualname__
    with pytest.raises(TypeError, match=f"^{name}: zzzz: unknown argument; known here: "):
        part(zzzz=1)


@pytest.mark.parametrize("part", [*CLASSES, *FUNCTIONS], ids=lambda part: part.__qualname__)
def test_a_slip_of_the_pen_is_told_with_the_name_that_was_meant(part: Any) -> None:
    function = part.__init__ if inspect.isclass(part) else part
    named = inspect.signature(function).parameters.values()
    long = [each.name for each in named if each.kind is not each.VAR_KEYWORD and len(each.name) > 4]
    for name in long:
        with pytest.raises(TypeError, match=f"did you mean '(?:{'|'.join(long)})'"):
            part(**{name + "x": 1})


@pytest.mark.parametrize("part", [part for part in CLASSES if dataclasses.is_dataclass(part)], ids=lambda p: p.__name__)
def test_keys_of_scenes_lead_to_the_parameter(part: Any) -> None:
    """Who knows `length_m` and `mu_forward` of scenes is led to `length` and `forward`."""
    for field in dataclasses.fields(part):
        known = field.metadata.get(PARAMETER)
        for tried in {known.key, *known.aka} - {"", field.name} if known else ():
            with pytest.raises(TypeError, match=f"{tried}: unknown argument; did you mean '{field.name}'"):
                part(**{tried: 1})


@pytest.mark.parametrize("function", [worm3d.simulate, worm3d.simulate_batch])
def test_words_of_scenes_and_pages_lead_to_the_arguments(function: Any) -> None:
    meant = {"gait": "actuation", "gaits": "actuation", "controller": "actuation", "friction": "ground"}
    for tried, name in {**meant, "time_step": "dt", "terrain": "world"}.items():
        with pytest.raises(TypeError, match=f"{tried}: unknown argument; did you mean '{name}'"):
            function(**{tried: 1})


@pytest.mark.parametrize(
    ("ask", "sentence"),
    [
        (lambda: worm3d.gaits, "worm3d: gaits: unknown name; it is in control: from control import gaits"),
        (lambda: worm3d.TravellingWave, "it is in control.gaits: from control.gaits import TravellingWave"),
        (lambda: worm3d.Sensors, "it is in control.sensing: from control.sensing import Sensors"),
        (lambda: worm3d.Simulate, "worm3d: Simulate: unknown name; did you mean 'simulate'?"),
        (lambda: worm3d.Friktion, "did you mean 'Friction'?"),
        (lambda: worm3d.Plain, "did you mean 'Plane'?"),
        (lambda: control.gaits.travelling_wave, "did you mean 'TravellingWave'?"),
        (lambda: control.gaits.TravelingWave, "did you mean 'TravellingWave'?"),
        (lambda: control.gaits.Sensors, "it is in control.sensing"),
        (lambda: control.sensing.Sensor, "did you mean 'Sensors'?"),
        (lambda: control.sensing.zzzz, "known here: QUANTITIES, Channel, "),
    ],
)
def test_names_that_modules_do_not_have(ask: Any, sentence: str) -> None:
    with pytest.raises(AttributeError, match=re.escape(sentence)):
        ask()


def test_programs_that_ask_get_the_plain_answer() -> None:
    assert not hasattr(worm3d, "__wrapped__")
    assert not hasattr(control.gaits, "_pytestfixturefunction")
    from control.gaits import steering as submodule  # an import tries the name first

    assert submodule is steering


def test_what_makes_and_copies_objects_goes_on_as_before() -> None:
    worm = worm3d.Worm(segments=4, half_height=0.06)
    assert copy.deepcopy(worm).segments == pickle.loads(pickle.dumps(worm)).segments == 4
    assert dataclasses.replace(TravellingWave(), period=3.0).period == 3.0
    assert [*inspect.signature(worm3d.Worm).parameters][:2] == ["segments", "length"]
    assert "duration" in inspect.signature(worm3d.simulate).parameters
    with pytest.raises(TypeError, match="TravellingWave: periode: unknown argument; did you mean 'period'"):
        dataclasses.replace(TravellingWave(), periode=3.0)


def test_a_gait_of_ones_own_has_the_same_sentences() -> None:
    @dataclasses.dataclass(frozen=True, kw_only=True)
    class Mine(Gait):
        lift: float = 0.1
        lengthens = False

        def activations(self, times: Any, segments: int) -> Any:
            return np.zeros((len(times), segments))

    with pytest.raises(TypeError, match="Mine: lifft: unknown argument; did you mean 'lift'"):
        Mine(lifft=3)


def test_a_result_that_there_is_not_is_told_with_what_lies_beside_it(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="nope: no such file; a result is what Result"):
        worm3d.load("nope")
    (tmp_path / "flat").mkdir()
    with pytest.raises(FileNotFoundError, match=r"flta: no such file.*; did you mean '.*flat'"):
        worm3d.load(tmp_path / "flta")
    with pytest.raises(FileNotFoundError, match=r"result\.nc: no such file"):
        worm3d.load(tmp_path / "flat")
