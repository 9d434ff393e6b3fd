"""The law of one segment along a way: the one that the simulation follows."""

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import worm3d
from worm3d import Hysteresis, Jenkins, Pneumatic, Worm, stretch_segment

RUBS = Jenkins(moment=0.02, load_ratio=0.5, give=2e-4)


@pytest.mark.parametrize("own", [Hysteresis(), RUBS])
def test_it_needs_the_force_that_has_moved_a_segment_of_the_simulation(own: Hysteresis) -> None:
    """Pulled so slowly, and so light, that its masses do not matter: out, back and beyond, by the same steps."""
    worm = Worm(segments=1, length=0.2, mass=1e-4, k_apex=0.02, kelvin_voigt_time=0.05, hysteresis=own)

    def pull(t: float) -> float:
        return float(3.0 * np.sin(1.5 * t) * min(t, 1.0))

    run = worm3d.simulate(
        worm,
        None,
        external_force=lambda t: np.array([[-pull(t), 0.0, 0.0], [pull(t), 0.0, 0.0]]),
        duration=6.0,
        gravity=(0, 0, 0),
        integrator="implicit_euler",
    )
    found = stretch_segment(worm, run.chamber_length[:, 0, 0], run.time)
    assert np.ptp(found.length) > 0.03
    assert_allclose(found.force[1:], [pull(t) for t in run.time[1:]], rtol=0, atol=1e-3)
    for name in ("elastic", "viscous_loss", "hysteresis_loss"):
        assert_allclose(getattr(found, name), getattr(run.energy, name), rtol=1e-6, atol=1e-12, err_msg=name)


def test_a_way_there_and_back_without_losses_needs_no_work() -> None:
    way = 0.2 + 0.02 * np.sin(np.linspace(0.0, 2.0 * np.pi, 2001))
    found = stretch_segment(Worm(segments=1, length=0.2, kelvin_voigt_time=0.0), way, np.linspace(0.0, 1.0, 2001))
    assert abs(np.trapezoid(found.force, way)) < 1e-6 * np.abs(found.elastic).sum()
    assert_allclose(np.cumsum(found.elastic), 13.0 * 0.2 / 2.0 * (way / 0.2 - 1.0) ** 2, rtol=0, atol=1e-14)
    assert_array_equal(found.hysteresis_loss, 0.0)


@pytest.mark.parametrize(
    ("length", "time", "worm", "sentence"),
    [
        ([0.2], [0.0], {}, r"length: got shape \(1,\), must be \(T,\) as time, \(1,\), with T at least 2"),
        ([0.2, 0.21], [0.0], {}, r"length: got shape \(2,\), must be"),
        ([0.2, 0.3], [0.0, 1.0], {}, r"length: got 0.2 to 0.3 m, must be above 0 and below 0.223607 m, twice"),
        ([0.2, np.nan], [0.0, 1.0], {}, r"length: got nan to nan m, must be above 0"),
        ([0.2, 0.21], [1.0, 1.0], {}, r"time: must be finite and ascend"),
        ([0.2, 0.21], [1.0, np.inf], {}, r"time: must be finite and ascend"),
        ([0.2, 0.21], [0.0, 1.0], {"actuator": Pneumatic()}, r"actuator: got Pneumatic, must be FirstOrder"),
    ],
)
def test_what_is_wrong_is_said(length: Any, time: Any, worm: Any, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        stretch_segment(Worm(segments=1, length=0.2, **worm), length, time)
