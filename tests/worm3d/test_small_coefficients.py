"""Coefficients of friction of 0 and close to 0: the law has a limit there, and the worm that of the ideal ratchet."""

from itertools import product
from typing import Any

import numpy as np
import pytest
from kernel_states import AT_REST, COUNT, run, some_point, with_pull_of_the_law
from numpy.testing import assert_allclose, assert_array_equal
from test_locomotion import PERIOD, STEPS, quantile, slow_crawl

import worm3d
from control.gaits import TravellingWave
from worm3d import Friction, Patch, Plane, Status, Worm
from worm3d.physics.friction import BREAKAWAY, WEIGHTLESS, ContactConstants, natural_time
from worm3d.physics.kernels import point
from worm3d.solver.regimes import EXCESS, Y

BOTH = pytest.mark.parametrize("integrator", ["bdf2", "implicit_euler"])
SOME = [each for each in product((False, True), repeat=3) if not all(each)]
"""Which of the coefficients forward, backward and lateral there are; the others are 0."""


def crawl(mu: Any, integrator: str = "bdf2", bias: float = 0.0, **more: Any) -> worm3d.Result:
    """Crawl 8 s, straight or turning."""
    ground = mu if isinstance(mu, Friction) else Friction(*mu, static_ratio=1.0)
    gait = TravellingWave(amplitude=0.3 if bias else 0.2, bias=bias)
    result = worm3d.simulate(
        Worm(), more.get("world", Plane()), ground, actuation=gait, duration=8.0, integrator=integrator
    )
    assert result.status is Status.DONE
    return result


@BOTH
@pytest.mark.parametrize("bias", [0.0, 0.3], ids=["straight", "turning"])
@pytest.mark.parametrize("some", SOME, ids=str)
def test_a_coefficient_of_0_is_the_limit_of_small_ones(some: tuple[bool, ...], bias: float, integrator: str) -> None:
    """All subsets of directions without friction: the whole path agrees with that of 1e-9, and the ledger closes.

    At 1e-9 friction itself takes 1e-9 g t^2/2 = 3e-7 m. Once a frictionless contact dragged its anchor along, and the
    straight worm went 0.564 m instead of 0.684; turning ones differed by 8 to 29 %, and two did not converge.
    """
    none, little = (crawl([0.2 if there else mu for there in some], integrator, bias) for mu in (0.0, 1e-9))
    assert_allclose(none.com, little.com, rtol=0, atol=1e-6)
    assert_allclose(none.joints[-1], little.joints[-1], rtol=0, atol=2e-6)
    assert none.energy.balance_error < 1e-12


@BOTH
def test_the_path_has_a_slope_at_0(integrator: str) -> None:
    """Twice as small a coefficient makes half of the difference to none."""
    distance = [crawl((mu, 0.2, 0.2), integrator).distance for mu in (0.0, 1e-6, 2e-6)]
    once, twice = distance[0] - distance[1], distance[0] - distance[2]
    assert 1e-5 < once < 1e-3
    assert_allclose(twice, 2.0 * once, rtol=0.02)


@BOTH
def test_without_forward_friction_it_glides(integrator: str) -> None:
    """Nothing pulls it back: forward momentum never falls, to the rounding of places, and is greatest at the end."""
    result = crawl((0.0, 0.2, 0.2), integrator)
    momentum = result.momentum[:, 0]
    assert np.diff(momentum).min() > -2.0 * np.spacing(1.0) * result.worm.mass / result.dt
    assert momentum[-1] == pytest.approx(momentum.max(), rel=1e-12)
    assert result.distance > 0.6


def test_zeros_of_single_segments_and_of_the_world() -> None:
    """Each segment has its own coefficients, and a patch without grip has none in any direction."""
    some = np.array([0.0, 0.2, 0.0, 0.0, 0.2, 0.1])
    ice = Plane(patches=(Patch(0.0, along=(0.4, 0.8)),))
    runs = [
        crawl(Friction(np.maximum(some, mu), np.maximum(some[::-1], mu), 0.2, static_ratio=1.2), bias=0.3, world=ice)
        for mu in (0.0, 1e-9)
    ]
    assert_allclose(runs[0].com, runs[1].com, rtol=0, atol=1e-6)
    assert runs[0].energy.balance_error < 1e-12


@pytest.mark.parametrize("direction", ["retrograde", "direct"])
@pytest.mark.parametrize("mu_forward", [1e-3, 1e-4, 1e-5])
def test_small_coefficients_follow_the_quantile_law(
    mu_forward: float, direction: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As in `test_locomotion`, so slowly that speeds are a thousandth of mu_forward g T: nearly the ideal ratchet."""
    period = 3.0 / mu_forward
    monkeypatch.setattr("test_locomotion.PERIOD", period)
    result = slow_crawl(Friction(mu_forward, 0.2, 0.2, static_ratio=1.0), direction)
    assert result.status is Status.DONE
    feet, loads = result.apexes[:, :, 0, 0], result.normal_load[1:, :, 0] + result.normal_load[1:, :, 3]
    relative = np.diff(feet - feet[:, :1], axis=0) / result.dt
    assert np.abs(relative).max() < 1e-3 * mu_forward * 9.81 * period
    level = mu_forward / (mu_forward + 0.2)
    law = np.array([-quantile(w, p, level) for w, p in zip(relative, loads, strict=True)])
    assert_allclose(feet[-1, 0] - feet[STEPS, 0], law[STEPS:].sum() * result.dt, rtol=2e-3)
    assert PERIOD == 30.0


def hard_states(seed: int) -> dict[str, np.ndarray]:
    """Return contacts of which some directions are hard: their coefficients are a tenth to a billionth."""
    values = some_point(coupled=True, inside=False, seed=seed)
    rng = np.random.default_rng(seed)
    hardness = np.where(rng.random((3, COUNT)) < 0.5, 1.0, 10.0 ** rng.uniform(1.0, 9.0, (3, COUNT)))
    values |= {"mu": values["mu"] / hardness, "hardness": hardness}
    return values | {"regime": np.full((1, COUNT), point.FREE)}


def friction_of(values: dict[str, np.ndarray]) -> np.ndarray:
    """Return friction per unit of normal load, along and to the left, shape (2, COUNT)."""
    own = with_pull_of_the_law(values | {"regime": np.full((1, COUNT), point.SLIDING)})
    force = run("point_force", point.POINT_LAYOUT, own)
    without = run("point_force", point.POINT_LAYOUT, own | {"hold": np.zeros((1, COUNT))})
    along = own["tangent"].reshape(2, 3, COUNT)
    return np.einsum("idk,dk->ik", along, force[:3] - without[:3]) / (own["hold"] * force[4])


def test_friction_of_hard_contacts_is_inside_the_ellipse_and_on_it_far_out() -> None:
    """The friction is also that of (C3), written out here."""
    for reach in (1.0, 1e6):
        v = hard_states(3)
        v |= {"anchor": v["x"] - reach * (v["x"] - v["anchor"])}
        y = run("point_yielding", point.POINT_LAYOUT, v | AT_REST)[Y : Y + 2]
        mu, H = (np.array([np.where(y[0] > 0.0, v[name][0], v[name][1]), v[name][2]]) for name in ("mu", "hardness"))
        rho, eta, c_0, r = np.hypot(*(mu * y)), np.hypot(*(H * mu * y)), v["limit_ratio"][0], v["r"][0]
        f = friction_of(v)
        slides = eta > c_0 * r
        P = r + H * np.where(slides, rho * (1.0 / c_0 - r / eta), 0.0)
        assert_allclose(f, mu**2 * H * y / P, rtol=1e-6, atol=1e-9)
        share = np.hypot(*(f / mu)) / c_0
        assert (share < 1.0 + 1e-5).all()
        assert (share[slides] > 0.5).sum() > 20
    coulomb = c_0 * mu**2 * y / rho
    assert_allclose(f[:, slides], coulomb[:, slides], rtol=1e-2, atol=1e-6)


def test_a_contact_without_friction_along_the_segment_holds_sideways() -> None:
    """While it glides forward: force rises with the way sideways, a multiple m of what yields alone, to its limit.

    It is between that of a contact that does not glide, min(1, m), and m/(1 + m).
    """
    v = some_point(coupled=True, inside=False, seed=4)
    mu = np.tile([[1e-14], [0.2], [0.2]], COUNT)
    hardness = np.tile([[1e12], [1.0], [1.0]], COUNT)
    v |= {"mu": mu, "hardness": hardness, "slide_n": np.zeros((2, COUNT)), "centre": np.zeros((2, COUNT))}
    multiple = np.linspace(0.0, 50.0, COUNT)
    sideways = multiple * v["r"][0] * v["limit_ratio"][0] / 0.2
    v["anchor"] = v["x"] - 5.0 * v["tangent"][:3] - sideways * v["tangent"][3:]
    along, across = friction_of(v | {"regime": np.full((1, COUNT), point.FREE)})
    limit = 0.2 * v["limit_ratio"][0]
    assert np.abs(along).max() < 1e-9
    assert (across <= limit * np.minimum(1.0, multiple) + 1e-3).all()
    assert (across >= limit * multiple / (1.0 + multiple) - 1e-3).all()
    assert (run("point_yielding", point.POINT_LAYOUT, v | AT_REST)[EXCESS] > 0.0).all(), "the anchor follows"


@pytest.mark.parametrize("factor", [0.2, 5.0])
def test_contacts_of_other_coefficients_in_proportion_differ_by_their_size_alone(factor: float) -> None:
    """Yield gauge in proportion, hardness alike; coefficients of 0 stand for a tiny part of the largest."""
    worm = Worm(segments=4)
    for seed in range(5):
        mu = np.random.default_rng(seed).uniform(0.1, 0.9, (3, 4)) * [[1.0], [10.0 ** -(seed % 3)], [1.0]]
        mu[seed % 3, 1] = 0.0
        one, other = (ContactConstants.of(worm, Friction(*each), 9.81) for each in (mu, factor * mu))
        assert_allclose(other.mu, factor * one.mu)
        assert_allclose(other.hardness, one.hardness)
        assert_allclose(other.yield_gauge, factor * one.yield_gauge)
        assert_allclose(other.gauge_damping, one.gauge_damping * factor**-1.5)
        assert_array_equal([other.stiffness, other.damping], [one.stiffness, one.damping])
        assert_allclose(one.mu[mu > 0.0], mu[mu > 0.0])
        assert 0.0 < one.mu[seed % 3, 1] < 1e-12
    alike = {
        name: ContactConstants.of(worm, Friction(0.0, 0.0, 0.0), g).yield_gauge for name, g in (("g", 9.81), ("0", 0.0))
    }
    assert alike["g"] == alike["0"] > 0.0


@pytest.mark.parametrize(
    ("mu", "least"),
    [
        ((0.5, 0.3, 0.4), 0.3),
        ((0.5, 0.0051, 0.4), 0.0051),
        ((0.5, 0.0049, 0.4), 0.05),
        ((0.5, 0.0049, 0.04), 0.04),
        ((0.5, 0.0, 0.0), 0.05),
    ],
)
def test_the_least_coefficient_that_is_no_hundredth_of_the_largest_sets_where_contacts_yield(
    mu: tuple[float, float, float], least: float
) -> None:
    """Beside smaller ones a tenth of the largest does, where none is below; smaller ones are as hard as that one."""
    worm = Worm()
    found = ContactConstants.of(worm, Friction(*mu), 9.81)
    assert_allclose(found.yield_gauge, least * BREAKAWAY * worm.l0)
    assert_allclose(found.hardness * found.mu, np.maximum(found.mu, least))


@pytest.mark.parametrize("length", [0.5, 1.0, 2.0])
def test_the_natural_time_is_that_of_a_fall_by_half_the_body(length: float) -> None:
    worm = Worm(length=length)
    for gravity in (1.6, 9.81):
        assert 0.5 * gravity * natural_time(worm, gravity) ** 2 == pytest.approx(0.5 * length)
    light = WEIGHTLESS * float(np.mean(worm.k_spring)) / worm.mass
    assert natural_time(worm, 0.0) == pytest.approx(natural_time(worm, light))
