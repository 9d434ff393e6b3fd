"""Tasks of controllers: each field is verified, and controllers of users get the task, or its fields one by one."""

import sys
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

from control.controllers import made
from control.guest import Guest
from control.identification.identified import load
from control.loop import WaveController
from control.parts import part
from control.sensing.sensors import Channel, Measurement
from control.task import ControlTask
from control.tracking.paths import Line
from control.tracking.references import Constant, Reference
from worm3d import Command, Worm

WORM, LINE = Worm(), Reference(Constant(0.08), path=Line())
FIELDS: dict[str, Any] = {"worm": WORM, "reference": LINE, "map": load(WORM)}


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [
        ({"worm": LINE}, r"worm: got .*Reference, must be a worm: worm3d.Worm\(\)"),
        ({"reference": Line()}, "reference: got .*Line, must be a control.tracking.references.Reference"),
        ({"map": load(WORM).maps}, "map: got .*, must be a map"),  # type: ignore[union-attr]
        ({"mechanism": "tail"}, "mechanism: got 'tail', must be one of the identified mechanisms: 'hinge'"),
        ({"period": 0.0}, "period: got 0.0 s, must be finite and above 0"),
        ({"period": np.nan}, "period: got nan"),
        ({"sensors": 3.0}, "sensors: got float, must be channels by name"),
        ({"control_period": 0.1}, "control_period: unknown argument"),
    ],
)
def test_mistakes_in_a_task(wrong: dict[str, Any], sentence: str) -> None:
    with pytest.raises((ValueError, TypeError), match=sentence):
        ControlTask(**FIELDS | wrong)


class Rests:
    """A controller that shares nothing with those that ship."""

    def __init__(self, *given: Any) -> None:
        self.given = given

    def reset(self) -> None:
        """Nothing to begin anew."""

    def step(self, t: float, measurement: Measurement) -> Command:
        return Command(np.zeros((6, 2)))


class TakesTask(Rests):
    @classmethod
    def of(cls, task: ControlTask, gains: float = 1.0) -> Rests:
        return cls(task, gains)


class TakesFields(Rests):
    @classmethod
    def of(cls, worm, reference, identified, mechanism, control_period, sensors):
        return cls(worm, reference, identified, mechanism, control_period, sensors)


class Straight(WaveController):
    """The least that a controller on the loop that ships has to say."""

    def _choose(self, t, estimate):
        return SimpleNamespace(source="own", parameters=self._target, status="", plan=None, failed=False)


@pytest.fixture
def mine(monkeypatch: pytest.MonkeyPatch) -> None:
    module = ModuleType("my_controllers")
    module.Task, module.Fields, module.Straight = map(part("controller"), (TakesTask, TakesFields, Straight))  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "my_controllers", module)


@pytest.mark.usefixtures("mine")
def test_own_controllers_get_the_task_or_its_fields() -> None:
    task = ControlTask(**FIELDS, mechanism="bias", period=0.1, sensors={"com": Channel(noise=0.01)})
    whole = made("my_controllers:Task", task, gains=2.0)
    assert isinstance(whole, Guest)
    assert whole.guest.given == (task, 2.0)  # type: ignore[attr-defined]
    one_by_one = made("my_controllers:Fields", task)
    assert isinstance(one_by_one, Guest)
    assert one_by_one.guest.given == (WORM, LINE, task.map, "bias", 0.1, task.sensors)  # type: ignore[attr-defined]
    assert not isinstance(one_by_one, WaveController)
    assert one_by_one.control_period == 0.1
    with pytest.raises(ValueError, match="has no part 'gains'"):
        made("my_controllers:Fields", task, gains=2.0)


@pytest.mark.usefixtures("mine")
def test_a_controller_on_the_loop_needs_to_choose_only() -> None:
    own = made("my_controllers:Straight", ControlTask(**FIELDS))
    assert isinstance(own, WaveController)
    assert not own.step(0.0, Measurement(0.0)).contraction.any()
    assert [decision.source for decision in own.decisions] == ["own"]
