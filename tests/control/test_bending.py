"""A controller whose worm bends along its path, on the full plant."""

import numpy as np
import pytest

from control.chambers.controller import Bending
from control.identification import identified
from control.sensing.sensors import Sensors
from control.task import ControlTask
from control.tracking.paths import Circle, offset, track
from control.tracking.references import Constant, Reference
from worm3d import Plane, Worm, simulate

WORM = Worm()
CIRCLE = Circle(0.6, start=(0.5, 0.0))


def run(kind, duration):
    found = identified.load(WORM)
    made = kind.of(ControlTask(WORM, Reference(Constant(0.08), None, CIRCLE), found))
    return made, simulate(WORM, Plane(), actuation=made, sensor=Sensors(seed=10), duration=duration, dt=0.01)


def off(places):
    return offset(CIRCLE, places, track(CIRCLE, places))


@pytest.fixture(scope="module")
def bending():
    return run(Bending, 25.0)


@pytest.mark.slow
def test_head_and_tail_are_nearer_to_the_path_than_those_of_a_stiff_worm(bending):
    _, result = bending
    later = result.time > 10.0
    rms = [float(np.sqrt(np.mean(off(result.joints[later, j, :2]) ** 2))) for j in (0, -1)]
    assert max(rms) < 0.115  # the supervisor alone: 0.17 and 0.14
    assert np.sqrt(np.mean(off(result.com[later, :2]) ** 2)) < 0.02
    assert result.on_its_side is None
