"""Axisymmetric elements: closed forms, patch test, order of convergence, forces as derivatives of the potential."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import quad
from scipy.optimize import brentq

pytest.importorskip("skfem", reason="scikit-fem is not installed (extra 'fem')")

from tests.worm3d.fem.segments import MU, cable, sphere, tube
from worm3d.fem.axisymmetric import RESIDUAL_TOLERANCE, State, Wall, rest, solved
from worm3d.fem.description import Segment, parse
from worm3d.fem.material import Fibres
from worm3d.fem.sweep import free_length
from worm3d.values.arrays import FloatArray

BARREL = parse((Path(__file__).parents[3] / "scenes" / "data" / "barrel.toml").read_text(encoding="utf-8"))


def follow(wall: Wall, *targets: tuple[float, float], steps: int = 4) -> State:
    """Return the equilibrium after straight paths to stretches of the length and pressures."""
    state = rest(wall)
    for stretch, value in targets:
        begin, end = (state.length, state.input), (stretch * wall.segment.rest_length, value)
        for t in np.linspace(0.0, 1.0, steps + 1)[1:]:
            found = solved(state, *[float((1.0 - t) * a + t * b) for a, b in zip(begin, end, strict=True)])
            assert found is not None
            state = found
    return state


@pytest.fixture(scope="module")
def barrel() -> State:
    """Return a shortened barrel under pressure, on a coarse mesh."""
    return follow(Wall(BARREL, 8, 1), (1.0, 2000.0), (0.88, 3000.0))


class Distorted(Segment):
    """Segment whose elements are distorted."""

    def wall(self, s: FloatArray, depth: FloatArray) -> FloatArray:
        bent = s + 0.06 * np.sin(2.0 * np.pi * s) * (1.0 + depth)
        return super().wall(bent, depth + 0.2 * np.sin(3.0 * np.pi * s) * (1.0 - depth**2))


def test_patch_of_distorted_elements_stretches_uniformly() -> None:
    """A tube that slides on the plates: force A mu (x - x^-2), for any mesh."""
    plain = tube()
    names = ("profile", "thickness_m", "rubber", "load")
    wall = Wall(Distorted(**{name: getattr(plain, name) for name in names}), 4, 2, held="z")
    area = 2.0 * np.pi * 0.03 * 0.01
    for x in (0.9, 1.3):
        state = follow(wall, (x, 0.0))
        assert_allclose(state.force, area * MU * (x - x**-2), rtol=1e-9)
        assert_allclose(state.radius, 0.035 / np.sqrt(x), rtol=1e-9)
        assert_allclose(state.volume, np.pi * 0.025**2 * 0.1, rtol=1e-9)


def tube_pressure(inner: float, stretch: float) -> float:
    """Return the pressure in a neo-Hookean tube (radii 25 and 35 mm at rest) of an inner radius [m]."""
    hoop = lambda r: r / np.sqrt(0.025**2 + stretch * (r**2 - inner**2))  # noqa: E731
    outer = np.sqrt(inner**2 + (0.035**2 - 0.025**2) / stretch)
    found: float = quad(lambda r: MU * (hoop(r) ** 2 - (stretch * hoop(r)) ** -2) / r, inner, outer, epsrel=1e-12)[0]
    return found


def test_thick_tube_under_pressure_is_the_closed_form_with_order_four() -> None:
    """The radius converges with the fourth power of the size of biquadratic elements."""
    stretch, pressure = 1.1, 2e4
    inner = brentq(lambda a: tube_pressure(a, stretch) - pressure, 0.02, 0.05, xtol=1e-14)
    outer = np.sqrt(inner**2 + (0.035**2 - 0.025**2) / stretch)
    errors = [abs(follow(Wall(tube(), 2, n, held="z"), (stretch, pressure)).radius - outer) for n in (1, 2, 4)]
    assert errors[0] < 2e-5 * outer
    assert np.log2(errors[0] / errors[1]) > 3.5
    assert np.log2(errors[1] / errors[2]) > 3.5


def test_thin_sphere_under_pressure_is_the_closed_form() -> None:
    """The exact pressure is the integral of 2 mu (x^2 - x^-4)/r through the wall, with the hoop stretch x."""
    state, (a, b) = follow(Wall(sphere(), 16, 1, held="r"), (1.0, 1500.0)), (0.0495, 0.0505)
    inner = (state.volume * 3.0 / (4.0 * np.pi)) ** (1.0 / 3.0)
    outer = (inner**3 + b**3 - a**3) ** (1.0 / 3.0)
    stretch = lambda r: r / (r**3 - inner**3 + a**3) ** (1.0 / 3.0)  # noqa: E731
    pressure = quad(lambda r: 2.0 * MU * (stretch(r) ** 2 - stretch(r) ** -4) / r, inner, outer)[0]
    assert_allclose(pressure, 1500.0, rtol=2e-5)
    assert_allclose(state.radius, outer, rtol=2e-5)
    assert state.unstable_directions == 0


def test_first_and_second_derivatives_of_energy_and_volume(barrel: State) -> None:
    wall, rng, h = barrel.wall, np.random.default_rng(3), 1e-5
    step = wall.scale * rng.normal(size=wall.size)
    for function in (wall.energy, wall.volume):
        _, gradient, tangent = function(barrel.x)
        (ahead, g_ahead, _), (behind, g_behind, _) = function(barrel.x + h * step), function(barrel.x - h * step)
        assert_allclose((ahead - behind) / (2.0 * h), gradient @ step, rtol=1e-6)
        change = tangent @ step
        assert_allclose((g_ahead - g_behind) / (2.0 * h), change, atol=1e-5 * np.abs(change).max())
        assert abs(tangent - tangent.T).max() <= 1e-12 * abs(tangent).max()


def test_force_and_volume_are_derivatives_of_the_potential(barrel: State) -> None:
    for h, along in ((1e-5 * barrel.length, "length"), (1.0, "input")):
        ends = [
            solved(barrel, *(barrel.length + d * (along == "length"), barrel.input + d * (along == "input")))
            for d in (h, -h)
        ]
        assert ends[0] is not None
        assert ends[1] is not None
        slope = (ends[0].potential - ends[1].potential) / (2.0 * h)
        assert_allclose(slope, barrel.force if along == "length" else -barrel.volume, rtol=1e-6)


def test_gradient_of_the_force_gives_the_stiffness(barrel: State) -> None:
    h = 1e-5 * barrel.length
    ends = [solved(barrel, barrel.length + d, barrel.input) for d in (h, -h)]
    assert ends[0] is not None
    assert ends[1] is not None
    row, by_length = barrel.force_gradient
    free = barrel.wall.free
    stiffness = row @ (ends[0].x[free] - ends[1].x[free]) / (2.0 * h) + by_length
    assert_allclose(stiffness, (ends[0].force - ends[1].force) / (2.0 * h), rtol=1e-6)


def test_newton_converges_in_few_steps(barrel: State) -> None:
    found = solved(barrel, 0.99 * barrel.length, barrel.input)
    assert found is not None
    assert found.residual <= RESIDUAL_TOLERANCE
    assert found.iterations <= 6


@pytest.mark.parametrize(("angle", "shortens"), [(0.0, True), (90.0, False)])
def test_meridional_fibres_shorten_a_tube_under_pressure_and_hoop_fibres_lengthen_it(
    angle: float, shortens: bool
) -> None:
    segment = tube(thickness=0.002, fibres=(Fibres(stiffness_N=50.0, per_m=500.0, angle_deg=angle),))
    free: State | None = rest(Wall(segment, 8, 1))
    for pressure in (1000.0, 2000.0, 3000.0):
        assert free is not None
        free = free_length(free, pressure)
    assert free is not None
    assert (free.length < segment.rest_length) is shortens
    assert abs(free.force) < 1e-6


def test_cable_adds_its_tension_to_the_force() -> None:
    short = follow(Wall(cable(tube()), 6, 1), (0.99, 3.0))
    bare = follow(Wall(tube(), 6, 1), (0.99, 0.0))
    assert_allclose(short.force, bare.force + 3.0, rtol=1e-9)
    assert_allclose(short.potential, bare.potential + 3.0 * short.length, rtol=1e-9)


def test_compressed_thin_tube_becomes_unstable() -> None:
    """Classical theory: a tube buckles at the strain 2/3 of thickness over radius (incompressible), here 2 %."""
    wall = Wall(tube(thickness=0.0009, length=0.04), 16, 1, held="z")
    assert follow(wall, (0.99, 0.0)).unstable_directions == 0
    assert follow(wall, (0.96, 0.0)).unstable_directions > 0


def test_bulk_modulus_lets_the_volume_change() -> None:
    soft = replace(tube(), rubber=replace(tube().rubber, bulk_modulus_Pa=10.0 * MU))
    x, state = 1.2, follow(Wall(soft, 2, 1, held="z"), (1.2, 0.0))
    volume = np.pi * ((state.radius) ** 2) * x * 0.1
    assert volume > 1.01 * np.pi * 0.035**2 * 0.1  # the outside grows more than at constant volume
