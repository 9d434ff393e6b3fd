"""Surrogates: the fit recovers what is known, keeps the mirror symmetry, and says how far it is off."""

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

from control.identification.surrogate import (
    DEGREES,
    RIDGE,
    SMOOTH,
    Polynomial,
    Ranges,
    corrected,
    exponents,
    fit,
    misfit,
)

RANGES = Ranges((0.1, 0.4), (0.5, 1.5), 0.2)


def grid(steps: int = 6) -> np.ndarray:
    axes = (np.linspace(0.1, 0.4, steps), np.linspace(0.5, 1.5, steps), np.linspace(0.0, 0.2, steps))
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def known(parity) -> Polynomial:
    coefficients = np.random.default_rng(3).normal(size=len(exponents(parity)))
    return Polynomial(RANGES, parity, tuple(coefficients))


@pytest.mark.parametrize("parity", DEGREES)
def test_the_fit_recovers_a_known_surrogate(parity) -> None:
    truth, where = known(parity), grid()
    found = fit(RANGES, parity, where, truth(*where.T))
    assert_allclose(found.coefficients, truth.coefficients, atol=1e-9)
    error = misfit(found, where, truth(*where.T))
    assert error.rms <= error.worst < 1e-10


def test_the_misfit_is_the_noise() -> None:
    truth, where = known("even"), grid()
    noise = np.random.default_rng(4).normal(scale=0.05, size=len(where))
    values = truth(*where.T) + noise
    error = misfit(truth, where, values)
    assert error.rms == pytest.approx(np.sqrt(np.mean(noise**2)))
    assert error.worst == pytest.approx(np.abs(noise).max())
    assert error.rms_percent == pytest.approx(100.0 * error.rms / np.sqrt(np.mean(values**2)))


@pytest.mark.parametrize(("parity", "sign"), [("even", 1.0), ("odd", -1.0)])
def test_mirror_symmetry_is_exact(parity, sign: float) -> None:
    surrogate = known(parity)
    assert surrogate(0.27, 0.9, -0.13) == sign * surrogate(0.27, 0.9, 0.13)


def test_the_scaling_is_that_of_the_ranges() -> None:
    assert_allclose(RANGES.scaled(0.4, 0.5, -0.1), [1.0, -1.0, -0.5])
    assert_allclose(np.abs(RANGES.scaled(0.1, 1.5, -0.2)), 1.0, atol=1e-9)
    assert RANGES.scaled(0.1, 1.6, 0.0)[1] > 1.0


def test_it_is_the_same_in_casadi() -> None:
    surrogate, symbols = known("odd"), ca.SX.sym("s", 3)
    function = ca.Function("f", [symbols], [surrogate(*ca.vertsplit(symbols))])
    for row in grid(3):
        assert float(function(row)) == pytest.approx(surrogate(*row), rel=1e-12, abs=1e-14)


def test_too_few_samples_are_refused() -> None:
    where = grid(3)
    with pytest.raises(
        ValueError, match=r"fit: the samples determine \d+ of 45 coefficients; give at least 5 amplitudes"
    ):
        fit(RANGES, "even", where, where[:, 0])


@pytest.mark.parametrize(
    ("build", "sentence"),
    [
        (lambda: Ranges((0.4, 0.1), (0.5, 1.5), 0.2), r"amplitude: got \(0.4, 0.1\), must be \(least, greatest\)"),
        (lambda: Ranges((0.1, 0.4), (0.5, 1.5), 0.0), "steering: got 0.0, must be above 0"),
        (lambda: Polynomial(RANGES, "odd", (1.0,)), "coefficients: got 1, must be 60 for odd"),
    ],
)
def test_bad_surrogates(build, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        build()


@pytest.mark.parametrize("parity", DEGREES)
def test_a_correction_is_the_least_of_its_sum(parity) -> None:
    """(I5): no other coefficients have a smaller sum of misses and changes."""
    truth, where = known(parity), grid(2)
    near = Polynomial(RANGES, parity, tuple(np.array(truth.coefficients) * 0.9))
    values = truth(*where.T)
    found = corrected(near, where, values)
    degrees = [i + j + (max(k, 1) if parity == "odd" else k) for i, j, k in exponents(parity)]

    def summed(coefficients: np.ndarray) -> float:
        missed = Polynomial(RANGES, parity, tuple(coefficients))(*where.T) - values
        change = (coefficients - near.coefficients) / SMOOTH ** np.array(degrees)
        return float(missed @ missed + RIDGE * change @ change)

    least, random = summed(np.array(found.coefficients)), np.random.default_rng(1)
    for size in (1e-3, 1e-1):
        for _ in range(10):
            assert summed(found.coefficients + size * random.normal(size=len(degrees))) > least
    assert misfit(found, where, values).rms < 0.1 * misfit(near, where, values).rms
    assert_allclose(corrected(truth, where, values).coefficients, truth.coefficients, atol=1e-12)


@pytest.mark.parametrize("parity", DEGREES)
def test_a_polynomial_over_smaller_ranges_is_the_same_one(parity) -> None:
    surrogate, smaller = known(parity), Ranges((0.15, 0.35), (0.6, 1.4), 0.2)
    assert surrogate.within(RANGES) is surrogate
    where = np.random.default_rng(5).uniform((0.15, 0.6, -0.2), (0.35, 1.4, 0.2), (20, 3))
    assert_allclose(surrogate.within(smaller)(*where.T), surrogate(*where.T), atol=1e-9)
