"""Controllers by name: each is found, made in the same way and drives a worm; scenes know the same names."""

import numpy as np
import pytest

from control.controllers import CONTROLLERS, controller
from control.identification.identified import load
from control.loop import SOURCES, WaveController
from control.sensing.sensors import QUANTITIES, Channel, Measurement
from control.task import ControlTask
from control.tracking.paths import Line
from control.tracking.references import Constant, Reference
from scenes.language.schema import keys_in
from scenes.models.control.schema import Controller
from worm3d import Worm

WORM = Worm()


@pytest.mark.parametrize("name", CONTROLLERS)
def test_every_controller_is_made_by_its_name_alone(name: str) -> None:
    found = load(WORM)
    assert found is not None
    line = Reference(Constant(0.08), path=Line())
    made = controller(name).of(ControlTask(WORM, line, found, "bias", 0.1, {"com": Channel(noise=0.01)}))
    assert isinstance(made, WaveController)
    more = {name: (np.zeros(QUANTITIES[name].shape(WORM)), 0.0) for name in made.senses}
    seen = Measurement(0.0, strain=(np.zeros((6, 2)), 0.0), com=(np.zeros(3), 0.0), **more)
    assert np.isfinite(made.step(0.0, seen).contraction).all()
    (decision,) = made.decisions
    assert decision.source in SOURCES
    assert decision.parameters.hinge == 0.0
    assert made.control_period == 0.1


def test_scenes_know_the_same_names() -> None:
    assert keys_in(Controller)["kind"].choices == tuple(CONTROLLERS)


def test_only_those_that_plan_can_have_failures_of_plans() -> None:
    assert [name for name in CONTROLLERS if controller(name).plans] == ["mpc", "climber", "bending"]
