import numpy as np
import pytest

from control.gaits import GAITS, ExtensionWave, TwoAnchor


def test_waveform_3x1():
    """1 s up, 1 s held, 1 s down, 3 s at rest, the next segment towards the tail 1 s later."""
    gait = ExtensionWave(period=6.0, extension=-1.0)
    times = np.array([0.0, 0.5, 1.0, 1.7, 2.0, 2.5, 3.0, 4.0, 5.9, 6.5])
    head = gait.activations(times, 6)[:, 5]
    np.testing.assert_allclose(head, [1, 0, -1, -1, -1, 0, 1, 1, 1, 0], atol=1e-12)
    for i in range(6):
        np.testing.assert_allclose(gait.activations(times + 5.0 - i, 6)[:, i], head, atol=1e-12)


@pytest.mark.parametrize(("moving", "held"), [(0.5, 1 / 3), (1 / 3, 0.0), (4 / 6, 0.5)])
def test_length_is_constant_where_ramps_take_a_step(moving, held):
    gait = ExtensionWave(period=3.7, moving=moving, held=held, extension=-0.4)
    total = gait.activations(np.linspace(0.0, 8.0, 301), 6).sum(axis=1)
    np.testing.assert_allclose(total, total[0], atol=1e-9)
    assert total[0] < 5.0


def test_directions_mirror_the_body():
    times = np.linspace(0.0, 5.0, 41)
    back, ahead = (ExtensionWave(direction=way, waves=2.0, moving=0.4) for way in ("retrograde", "direct"))
    np.testing.assert_array_equal(back.activations(times, 7), ahead.activations(times, 7)[:, ::-1])


@pytest.mark.parametrize("extension", [-1.0, -0.3, 0.0])
def test_range(extension):
    gait = ExtensionWave(extension=extension, moving=0.9, held=0.7)
    found = gait.activations(np.linspace(0.0, 12.0, 500), 5)
    assert found.max() == 1.0
    assert found.min() == pytest.approx(extension)
    assert gait.lengthens is (extension < 0.0)


@pytest.mark.parametrize(
    "wrong", [{"moving": 0.0}, {"held": 1.0}, {"waves": 0.0}, {"extension": 0.5}, {"period": -1.0}]
)
def test_refused(wrong):
    with pytest.raises(ValueError, match=f"^{next(iter(wrong))}: got"):
        ExtensionWave(**wrong)


def test_registered():
    assert GAITS["extension_wave"] is ExtensionWave


def test_keys_shared_with_other_gaits_have_their_defaults():
    """A key of several gaits has one default in scenes, that of the first."""
    assert ExtensionWave().extension == TwoAnchor().extension
