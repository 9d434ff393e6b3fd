"""In other units of length, mass and time a worm does the same: no constant of the program has a size of its own."""

import numpy as np
import pytest
import rescaled
from numpy.testing import assert_allclose
from rescaled import WORLDS, Scales

from control.gaits import TravellingWave
from planar import linkage
from worm3d import Friction, Jenkins, Pneumatic, Status, Viscous, Worm

FOUR = [Scales(time=0.25), Scales(0.3, 0.05, 1.7), Scales(7.0, 20.0, 0.2), Scales(0.02, 1e-3, 4.0)]
"""Scales in which each world is looked at."""

SAME = 1e-10
"""Largest difference, as a fraction of the body length."""


def random_scales(rng: np.random.Generator) -> Scales:
    return Scales(*(10.0 ** rng.uniform(-2.0, 2.0, 3)))


def random_worm(rng: np.random.Generator) -> Worm:
    n = int(rng.integers(3, 11))
    return Worm(
        segments=n,
        half_height=rng.uniform(0.04, 0.06, n),
        mass=float(10.0 ** rng.uniform(-1.5, -0.7)),
        k_spring=10.0 ** rng.uniform(1.5, 2.5, n),
        k_torsion=10.0 ** rng.uniform(-1.0, 1.0, n - 1),
        k_yaw=10.0 ** rng.uniform(-1.0, 1.0, n - 1),
        payload=float(rng.choice([0.0, 0.005])),
        drag=float(rng.choice([0.0, 0.05])),
    )


def assert_same(name: str, worm: Worm, scales: list[Scales], steps: int = 1, **more: object) -> None:
    runs = [rescaled.run(name, worm, each, steps, **more) for each in [Scales(), *scales]]
    assert len({run.status for run in runs}) == 1
    assert runs[0].settled or steps > 1
    for run, each in zip(runs[1:], scales, strict=True):
        assert_allclose(run.joints / each.length, runs[0].joints, rtol=0, atol=SAME, err_msg=str(each))


@pytest.mark.parametrize("name", WORLDS)
def test_a_worm_comes_to_rest_in_the_same_pose(name: str) -> None:
    assert_same(name, Worm(k_spring=100.0 if name == "steep" else 13.0), FOUR)


@pytest.mark.parametrize("name", ["rubble", "bend"])
@pytest.mark.parametrize("seed", range(4))
def test_so_does_any_worm(name: str, seed: int) -> None:
    rng = np.random.default_rng([seed, 17])
    assert_same(name, random_worm(rng), [random_scales(rng) for _ in range(4)])


def test_so_does_a_wedged_worm_without_weight() -> None:
    assert_same("steep", Worm(k_spring=100.0), FOUR, gravity=0.0)


@pytest.mark.parametrize("part", [{"actuator": Pneumatic()}, {"hysteresis": Jenkins()}], ids=["pneumatic", "jenkins"])
def test_so_does_a_worm_with_other_parts(part: dict[str, object]) -> None:
    assert_same("rubble", Worm(**part), FOUR)


def test_mass_and_time_in_powers_of_two_change_no_bit() -> None:
    first, other = (rescaled.run("bend", Worm(), each, 20) for each in (Scales(), Scales(1.0, 4.0, 0.25)))
    np.testing.assert_array_equal(other.joints, first.joints)


@pytest.mark.parametrize("name", ["plane", "rubble", "bend", "steep"])
def test_it_crawls_alike(name: str) -> None:
    """Fifty steps of a wave that turns it, with friction that grows with speed."""
    worm = Worm(k_spring=100.0 if name == "steep" else 13.0)
    runs = []
    for each in [Scales(), *FOUR]:
        gait = TravellingWave(period=1.0 * each.time, amplitude=0.2, bias=0.2, hinge=0.1)
        law = each.part(Viscous(viscosity=2.0))
        ground = Friction(0.3, 0.6, 0.6, law=law)
        runs.append(rescaled.run(name, worm, each, 50, actuation=gait, ground=ground))
    assert runs[0].status is Status.DONE
    assert np.ptp(runs[0].joints, axis=0).max() > 0.01
    for run, each in zip(runs[1:], FOUR, strict=True):
        assert_allclose(run.joints / each.length, runs[0].joints, rtol=0, atol=SAME)


@pytest.mark.parametrize("gravity", [9.81, 0.0])
def test_so_does_the_planar_linkage(gravity: float) -> None:
    runs = []
    for each in [Scales(), *FOUR]:
        worm = linkage.Linkage(
            segments=4,
            length=each.length,
            half_height=0.07 * each.length,
            mass=0.1 * each.mass,
            k_spring=13.0 * each.of("N"),
            k_torsion=10.0 * each.of("J"),
            k_apex=0.0,
            kelvin_voigt_time=0.05 * each.time,
        )
        runs.append(
            linkage.simulate(
                worm,
                lambda t, each=each: 0.2 * np.sin(2.0 * np.pi * (np.arange(4) / 4.0 - t / each.time)),
                duration=0.3 * each.time,
                dt=0.01 * each.time,
                gravity=gravity * each.length / each.time**2,
                start=linkage_start(worm),
            )
        )
    for run, each in zip(runs[1:], FOUR, strict=True):
        assert run.status is runs[0].status
        assert_allclose(run.joints / each.length, runs[0].joints, rtol=0, atol=SAME)


def linkage_start(worm: linkage.Linkage) -> np.ndarray:
    """Return the worm laid on the ground with its feet as deep in it as a start may be."""
    return worm.rest() + np.array([0.0, float(worm.rest_half_height.max()) - 5e-5 * worm.l0])
