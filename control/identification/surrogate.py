"""Surrogates: polynomials fitted to the motion of a plant, for NumPy and CasADi alike.

A quantity y of amplitude A, frequency f and steering s is, with each of the three scaled to [-1, 1] over the range (s
to s/s_max),

    y = sum_{i+j <= n_k, k} c_ijk a^i g^j S_k(s),   S_k = s^k, k = 0, 2, 4      if y is even in s
                                                    tanh(s/s_0), s^k, k = 1, 3, 5   if it is odd              (I1)

Left and right are mirror images: distance is even in the steering, turn and drift are odd, exactly. Weak steering
hardly turns a worm, since the feet still stick: s - s_0 tanh(s/s_0) starts as softly. (On the default worm, at an
amplitude of 0.3 and 0.8 Hz, hinges of 0.005, 0.01 and 0.02 rad turn the worm by a sixth, two fifths and six sevenths of
the proportional turn. The error of the turn is 0.006 rad a wave without the term in tanh, and 0.0015 with this term.)

A polynomial c0 that nearly fits is corrected with fewer values than coefficients. The error of c0 is assumed to be
smooth: a random polynomial, whose coefficients fall by `SMOOTH` with each degree n. The most likely polynomial
minimises

    sum_m (y_m - p_c(x_m))^2 + RIDGE sum_n (c_n - c0_n)^2 / SMOOTH^(2 n)                                        (I5)

(ridge regression; the mean of a Gaussian process).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from worm3d.values.arrays import FloatArray

Parity = Literal["even", "odd"]

STICKING_STEERING = 0.08
"""Steering below which feet stick, s_0, as a share of the greatest."""
MIN_WAVE_FREQUENCY = 0.01
"""Least frequency of a wave that is slower than all identified waves [Hz]."""
DEGREES: dict[Parity, dict[int, int]] = {"even": dict.fromkeys((0, 2, 4), 4), "odd": dict.fromkeys((0, 1, 3, 5), 4)}
"""Powers of the steering, and the joint degree n_k in amplitude and frequency for each power; in odd quantities the
power 0 stands for tanh(s/s_0)."""
RIDGE = 1e-3
"""Initial information of a design or a correction, which makes the matrix invertible; small beside one run's."""
SMOOTH = 0.7
"""Factor of the error coefficients of a polynomial per degree, (I5): of 0.5, 0.7 and 1 the value with the least error
on worms of half the stiffness or four segments, from 24 to 48 runs."""


@dataclass(frozen=True)
class Ranges:
    """Ranges of validity of a surrogate; none may be empty."""

    amplitude: tuple[float, float]
    """Least and greatest amplitude."""
    frequency: tuple[float, float]
    """Least and greatest frequency [Hz]."""
    steering: float
    """Greatest magnitude of the steering."""

    def __post_init__(self) -> None:
        for name in ("amplitude", "frequency"):
            low, high = getattr(self, name)
            if not low < high:
                raise ValueError(f"{name}: got {(low, high)!r}, must be (least, greatest) with least < greatest")
        if not self.steering > 0.0:
            raise ValueError(f"steering: got {self.steering!r}, must be above 0")

    def scaled(self, amplitude: Any, frequency: Any, steering: Any) -> tuple[Any, Any, Any]:
        """Return the three scaled to [-1, 1]; numbers, arrays or CasADi's symbols."""
        return (_centred(amplitude, self.amplitude), _centred(frequency, self.frequency), steering / self.steering)

    @property
    def middle(self) -> float:
        """Middle of the frequencies [Hz]."""
        return sum(self.frequency) / 2.0

    @property
    def bounds(self) -> FloatArray:
        """Least and greatest inputs a controller may choose, shape (2, 3), frequencies from `MIN_WAVE_FREQUENCY` on."""
        (weak, strong), (_, fast), sharp = self.amplitude, self.frequency, self.steering
        return np.array([[weak, MIN_WAVE_FREQUENCY, -sharp], [strong, fast, sharp]])


@dataclass(frozen=True)
class Polynomial:
    """One quantity over amplitude, frequency and steering, (I1)."""

    ranges: Ranges
    parity: Parity
    """Parity in the steering: "even" or "odd"."""
    coefficients: tuple[float, ...]
    """Coefficients in the order of `exponents(parity)`."""

    def __post_init__(self) -> None:
        wanted = len(exponents(self.parity))
        if len(self.coefficients) != wanted:
            raise ValueError(f"coefficients: got {len(self.coefficients)}, must be {wanted} for {self.parity}")

    def __call__(self, amplitude: Any, frequency: Any, steering: Any) -> Any:
        """Return the quantity; numbers, arrays or CasADi's symbols."""
        a, g, s = self.ranges.scaled(amplitude, frequency, steering)
        plane = dict.fromkeys(DEGREES[self.parity], 0.0)  # separate: a graph of many steerings then has the plane once
        for c, (i, j, k) in zip(self.coefficients, exponents(self.parity), strict=True):
            if c != 0.0:
                plane[k] = plane[k] + c * a**i * g**j
        return sum(plane[k] * of_steering for k, of_steering in _of_steering(self.parity, s).items())

    def within(self, ranges: Ranges) -> Polynomial:
        """Return the nearest polynomial on other ranges, by least squares on a grid of these ranges."""
        spans = (*ranges.amplitude, 9), (*ranges.frequency, 9), (0.0, ranges.steering, 17)
        where = np.column_stack([axis.ravel() for axis in np.meshgrid(*(np.linspace(*span) for span in spans))])
        return self if ranges == self.ranges else fit(ranges, self.parity, where, self(*where.T))

    def rise(self, begin: float, end: float) -> Polynomial:
        """Return the rise from one frequency to another [Hz], as a polynomial of amplitude and steering alone."""
        terms, (_, (low, high), _) = exponents(self.parity), self.ranges.scaled(0.0, np.array([begin, end]), 0.0)
        risen = dict.fromkeys(terms, 0.0)
        for c, (i, j, k) in zip(self.coefficients, terms, strict=True):
            risen[i, 0, k] += c * float(high**j - low**j)
        return Polynomial(self.ranges, self.parity, tuple(risen[term] for term in terms))


@dataclass(frozen=True)
class Misfit:
    """Misfit between a surrogate and samples."""

    rms: float
    """Root mean square of the misses, in the unit of the quantity."""
    worst: float
    """Greatest miss, in the unit of the quantity."""
    rms_percent: float
    """`rms` over the root mean square of the quantity itself [%]."""


def exponents(parity: Parity) -> tuple[tuple[int, int, int], ...]:
    """Return the exponents (i, j, k) of the terms of (I1); an odd quantity's k = 0 is no exponent."""
    return tuple(
        (i, n - i, k) for k, degree in DEGREES[parity].items() for n in range(degree + 1) for i in range(n, -1, -1)
    )


def informative(ranges: Ranges, where: ArrayLike, number: int) -> list[int]:
    """Return the places among (M, 3) to measure, so that few places determine surrogates of both parities.

    The places are chosen one after the other; each adds the most to the logarithms of the determinants of the two
    information matrices (a D-optimal design, Fedorov's exchange without the exchange).

    Raises
    ------
    ValueError
        There are fewer places than the number.
    """
    scaled = ranges.scaled(*np.asarray(where, dtype=float).T)
    if number > len(scaled[0]):
        raise ValueError(f"number: got {number}, must be at most that of the places, {len(scaled[0])}")
    tables = [_terms(parity, *scaled) for parity in DEGREES]
    inverses = [np.eye(table.shape[1]) / RIDGE for table in tables]
    chosen: list[int] = []
    for _ in range(number):
        spans = [
            np.einsum("mi,ij,mj->m", table, inverse, table) for table, inverse in zip(tables, inverses, strict=True)
        ]
        gain = sum(np.log1p(span) for span in spans)
        gain[chosen] = -np.inf
        chosen.append(int(np.argmax(gain)))
        for table, inverse in zip(tables, inverses, strict=True):
            v = inverse @ table[chosen[-1]]
            inverse -= np.outer(v, v) / (1.0 + table[chosen[-1]] @ v)
    return sorted(chosen)


def fit(ranges: Ranges, parity: Parity, where: ArrayLike, values: ArrayLike) -> Polynomial:
    """Return the polynomial nearest to samples, by least squares.

    The samples are values (M,) at amplitudes, frequencies [Hz] and steerings (M, 3).

    Raises
    ------
    ValueError
        The samples do not determine the coefficients.
    """
    columns, degrees = _terms(parity, *ranges.scaled(*np.asarray(where, dtype=float).T)), DEGREES[parity]
    coefficients, _, rank, _ = np.linalg.lstsq(columns, np.asarray(values, dtype=float), rcond=None)
    if rank < columns.shape[1]:
        raise ValueError(
            f"fit: the samples determine {rank} of {columns.shape[1]} coefficients; give at least "
            f"{max(degrees.values()) + 1} amplitudes and frequencies and {len(degrees)} magnitudes of steering"
        )
    return Polynomial(ranges, parity, tuple(map(float, coefficients)))


def corrected(polynomial: Polynomial, where: ArrayLike, values: ArrayLike) -> Polynomial:
    """Return a polynomial, corrected by samples, (I5): values (M,) at places (M, 3)."""
    places, parity = np.asarray(where, dtype=float), polynomial.parity
    degrees = np.array([i + j + (k or 1 if parity == "odd" else k) for i, j, k in exponents(parity)])
    weights = SMOOTH**degrees
    terms = _terms(parity, *polynomial.ranges.scaled(*places.T)) * weights
    missed = np.asarray(values, dtype=float) - polynomial(*places.T)
    change = weights * np.linalg.solve(terms.T @ terms + RIDGE * np.eye(len(weights)), terms.T @ missed)
    return replace(polynomial, coefficients=tuple(map(float, polynomial.coefficients + change)))


def misfit(polynomial: Polynomial, where: ArrayLike, values: Sequence[float] | FloatArray) -> Misfit:
    """Return the misfit of a polynomial to samples; arguments as for `fit`."""
    true = np.asarray(values, dtype=float)
    off = polynomial(*np.asarray(where, dtype=float).T) - true
    rms, size = float(np.sqrt(np.mean(off**2))), float(np.sqrt(np.mean(true**2)))
    return Misfit(rms, float(np.abs(off).max()), 100.0 * rms / size if size > 0.0 else 0.0)


def _terms(parity: Parity, a: FloatArray, g: FloatArray, s: FloatArray) -> FloatArray:
    """Return the terms of (I1) at M scaled places, shape (M, terms)."""
    of_steering = _of_steering(parity, s)
    return np.column_stack([a**i * g**j * of_steering[k] for i, j, k in exponents(parity)])


def _of_steering(parity: Parity, s: Any) -> dict[int, Any]:
    """Return S_k of scaled steering, (I1), by k."""
    powers = {k: s**k for k in DEGREES[parity]}
    if parity == "odd":
        tanh = ca.tanh if isinstance(s, ca.SX) else np.tanh
        powers[0] = tanh(s / STICKING_STEERING)
    return powers


def _centred(value: Any, bounds: tuple[float, float]) -> Any:
    low, high = bounds
    return (2.0 * value - (low + high)) / (high - low)
