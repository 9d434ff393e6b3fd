"""Densities of rubber and fibres: closed forms, principal stretches, and messages for wrong values."""

from __future__ import annotations

import re

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

from worm3d.fem.material import TENSION_ONSET, Fibres, NeoHookean, Ogden, Rubber, Yeoh, power_trace

YEOH = Yeoh(c1_Pa=3e4, c2_Pa=-1e3, c3_Pa=2e2)
OGDEN = Ogden(moduli_Pa=(6.3e5, 1.2e3, -1e4), exponents=(1.3, 5.0, -2.0))


def uniaxial(rubber: Rubber, stretch: float) -> float:
    """Return the nominal stress dW/d(stretch) of incompressible rubber [Pa]."""
    x = ca.SX.sym("x")
    W = rubber.density(ca.diag(ca.vertcat(x**2, 1.0 / x, 1.0 / x)))
    return float(ca.Function("stress", [x], [ca.gradient(W, x)])(stretch))


@pytest.mark.parametrize("x", [0.6, 1.0, 1.3, 2.2])
def test_uniaxial_stress_is_the_closed_form(x: float) -> None:
    assert_allclose(uniaxial(NeoHookean(shear_modulus_Pa=1e5), x), 1e5 * (x - x**-2), atol=1e-6)
    slope = 3e4 - 2.0 * 1e3 * (x**2 + 2.0 / x - 3.0) + 3.0 * 2e2 * (x**2 + 2.0 / x - 3.0) ** 2
    assert_allclose(uniaxial(YEOH, x), 2.0 * slope * (x - x**-2), atol=1e-6)
    terms = zip(OGDEN.moduli_Pa, OGDEN.exponents, strict=True)
    assert_allclose(uniaxial(OGDEN, x), sum(m * (x ** (a - 1.0) - x ** (-a / 2.0 - 1.0)) for m, a in terms), atol=1e-3)


@pytest.mark.parametrize("power", [-2.5, -1.0, -0.65, 0.3, 0.65, 1.0, 2.0, 2.5, 4.7])
def test_power_trace_is_the_sum_of_powers_of_the_eigenvalues(power: float) -> None:
    rng = np.random.default_rng(1)
    for _ in range(50):
        stretches = np.exp(rng.uniform(-0.5, 0.5, 2))
        x = np.append(stretches, 1.0 / stretches.prod()) ** 2
        found = float(ca.DM(power_trace(ca.DM(x.sum()), ca.DM((1.0 / x).sum()), power)))
        assert_allclose(found, (x**power).sum(), rtol=1e-9)


@pytest.mark.parametrize("rubber", [NeoHookean(shear_modulus_Pa=1e5), YEOH, OGDEN])
def test_second_derivative_at_rest_is_finite_and_the_shear_modulus(rubber: Rubber) -> None:
    F = ca.SX.sym("F", 3, 3)
    W = rubber.density(F.T @ F)
    hessian = ca.Function("hessian", [F], [ca.hessian(W, ca.vec(F))[0]])(ca.DM.eye(3)).full()
    assert np.isfinite(hessian).all()
    assert_allclose(hessian[3, 3], rubber.shear_modulus, rtol=1e-12)  # entry F[0, 1]


def test_density_does_not_depend_on_volume_or_rotation() -> None:
    rng = np.random.default_rng(2)
    F = np.eye(3) + 0.2 * rng.normal(size=(3, 3))
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    C = F.T @ F
    for rubber in (YEOH, OGDEN):
        expected = float(ca.DM(rubber.density(ca.DM(C))))
        assert_allclose(float(ca.DM(rubber.density(ca.DM(1.3 * C)))), expected, rtol=1e-9)
        assert_allclose(float(ca.DM(rubber.density(ca.DM(turn @ C @ turn.T)))), expected, rtol=1e-9)


def energy(fibres: Fibres, stretches: tuple[float, float], narrowing: float = 1.0) -> float:
    """Return the energy of fibres per area, for stretches along the meridian and around the axis."""
    C = ca.DM(np.diag([stretches[0] ** 2, stretches[1] ** 2, 1.0]))
    return float(fibres.area_energy(C, ca.DM([1, 0, 0]), ca.DM([0, 1, 0]), narrowing))


def test_fibres_resist_stretch_along_their_direction_only() -> None:
    meridional, hoop = (Fibres(stiffness_N=2.0, per_m=100.0, angle_deg=angle) for angle in (0.0, 90.0))
    full = 2.0 * 100.0 / 2.0 * 0.1**2
    lost = TENSION_ONSET * 0.1 / 2.0 - TENSION_ONSET**2 / 6.0
    assert_allclose(energy(meridional, (1.1, 1.0)), full - 200.0 * lost, rtol=1e-9)
    assert_allclose(energy(meridional, (1.0, 1.1)), 0.0, atol=1e-12)
    assert_allclose(energy(hoop, (1.0, 1.1)), full - 200.0 * lost, rtol=1e-9)
    assert_allclose(energy(hoop, (1.1, 1.0)), 0.0, atol=1e-12)
    assert_allclose(energy(meridional, (1.1, 1.0), 0.5), 2.0 * energy(meridional, (1.1, 1.0)))
    assert_allclose(energy(hoop, (1.0, 1.1), 0.5), energy(hoop, (1.0, 1.1)))


def test_fibres_carry_compression_only_if_asked() -> None:
    slack = Fibres(stiffness_N=2.0, per_m=100.0)
    stiff = Fibres(stiffness_N=2.0, per_m=100.0, tension_only=False)
    assert energy(slack, (0.9, 1.0)) == 0.0
    assert_allclose(energy(stiff, (0.9, 1.0)), 2.0 * 100.0 / 2.0 * 0.1**2)


def test_force_of_fibres_has_no_jump() -> None:
    fibres, x = Fibres(stiffness_N=2.0, per_m=1.0), ca.SX.sym("x")
    force = ca.gradient(fibres.energy(ca.diag(ca.vertcat(x**2, 1.0, 1.0)), ca.DM([1, 0, 0])), x)
    values = np.array([float(ca.Function("force", [x], [force])(1.0 + e)) for e in np.linspace(-1e-3, 3e-3, 401)])
    assert np.abs(np.diff(values)).max() <= 2.0 * 1.01e-5  # stiffness times the step of the strain


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: NeoHookean(shear_modulus_Pa=-1.0), "shear_modulus_Pa: got -1.0 Pa, must be finite and above 0"),
        (lambda: Yeoh(c1_Pa=1e4, c2_Pa=-1e3), "c2_Pa: got -1000.0 Pa, must be above -sqrt(3 c1 c3)"),
        (lambda: Ogden(moduli_Pa=(1e5, 1e4), exponents=(1.3,)), "exponents: got 1 exponents, must be as many as"),
        (lambda: Ogden(moduli_Pa=(-1e5,), exponents=(1.3,)), "moduli_Pa: got -100000.0 Pa with the exponent 1.3"),
        (lambda: Ogden(moduli_Pa=(1e5,), exponents=(0.0,)), "exponents: got 0.0, must be in [-10, 10] and not 0"),
        (lambda: Fibres(stiffness_N=1.0, per_m=1.0, angle_deg=91.0), "angle_deg: got 91.0 deg, must be"),
    ],
)
def test_wrong_values_get_a_sentence(make: object, message: str) -> None:
    with pytest.raises(ValueError, match=re.escape(message)):
        make()  # type: ignore[operator]
