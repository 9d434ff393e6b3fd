"""Surrogates, which are polynomials fitted to the motion of a simulated worm, for use with NumPy and CasADi.

A quantity y is a function of amplitude, frequency and steering. Scaled to [-1, 1] over their ranges, they are a, g and
s:

    y = sum_{i+j <= n_k, k} c_ijk a^i g^j S_k(s),   S_k = s^k, k = 0, 2, 4      if y is even in s
                                                    tanh(s/s_0), s^k, k = 1, 3, 5   if it is odd              (I1)

Since left and right are mirror images, the distance is exactly even in the steering, and turn and drift are exactly
odd. Weak steering hardly turns a worm, since the feet still stick. The function s - s_0 tanh(s/s_0) has a similar soft
start. (On the default worm, at an amplitude of 0.3 and 0.8 Hz, hinges of 0.005, 0.01 and 0.02 rad turn the worm by a
sixth, two fifths and six sevenths of the proportional turn. The error of the turn is 0.006 rad a wave without the term
in tanh, and 0.0015 with this term.)

A polynomial c0 that nearly fits can be corrected with fewer values than coefficients. Its error is assumed to be a
smooth random polynomial, whose coefficients decrease by the factor `SMOOTH` with each degree n. The most likely
polynomial c minimises

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
"""Steering s_0 below which feet stick, as a share of the greatest steering."""
MIN_WAVE_FREQUENCY = 0.01
"""Smallest frequency that controllers may use, below the identified range [Hz]."""
DEGREES: dict[Parity, dict[int, int]] = {"even": dict.fromkeys((0, 2, 4), 4), "odd": dict.fromkeys((0, 1, 3, 5), 4)}
"""Powers k of the steering, and for each power the joint degree n_k in amplitude and frequency. For odd quantities, k =
0 is the term tanh(s/s_0)."""
RIDGE = 1e-3
"""Information that is assumed before the first run. It makes the matrix invertible, and is small compared with the
information of one run."""
SMOOTH = 0.7
"""The coefficients of the error decrease by this factor per degree, (I5). Of 0.5, 0.7 and 1, this value has the
smallest error on worms with half the stiffness or with four segments, from 24 to 48 runs."""


@dataclass(frozen=True)
class Ranges:
    """Ranges where a surrogate is valid. They must not be empty."""

    amplitude: tuple[float, float]
    """Smallest and greatest amplitude."""
    frequency: tuple[float, float]
    """Smallest and greatest frequency [Hz]."""
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
        """Return amplitude, frequency and steering scaled to [-1, 1]. They may be numbers, arrays or CasADi symbols."""
        return (_centred(amplitude, self.amplitude), _centred(frequency, self.frequency), steering / self.steering)

    @property
    def middle(self) -> float:
        """Middle of the frequencies [Hz]."""
        return sum(self.frequency) / 2.0

    @property
    def bounds(self) -> FloatArray:
        """Smallest and greatest inputs that a controller may choose, shape (2, 3).

        The frequencies begin at `MIN_WAVE_FREQUENCY`.
        """
        (weak, strong), (_, fast), sharp = self.amplitude, self.frequency, self.steering
        return np.array([[weak, MIN_WAVE_FREQUENCY, -sharp], [strong, fast, sharp]])


@dataclass(frozen=True)
class Polynomial:
    """One quantity as a function of amplitude, frequency and steering, (I1)."""

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
        """Return the quantity. Arguments may be numbers, arrays or CasADi symbols."""
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
        """Return the increase of the quantity from one frequency to another [Hz].

        The result is a polynomial that only depends on amplitude and steering.
        """
        terms, (_, (low, high), _) = exponents(self.parity), self.ranges.scaled(0.0, np.array([begin, end]), 0.0)
        risen = dict.fromkeys(terms, 0.0)
        for c, (i, j, k) in zip(self.coefficients, terms, strict=True):
            risen[i, 0, k] += c * float(high**j - low**j)
        return Polynomial(self.ranges, self.parity, tuple(risen[term] for term in terms))


@dataclass(frozen=True)
class Misfit:
    """Misfit between a surrogate and samples."""

    rms: float
    """Root mean square error, in the unit of the quantity."""
    worst: float
    """Greatest error, in the unit of the quantity."""
    rms_percent: float
    """`rms` divided by the root mean square of the quantity itself [%]."""


def exponents(parity: Parity) -> tuple[tuple[int, int, int], ...]:
    """Return the exponents (i, j, k) of the terms of (I1). For odd quantities, k = 0 is the term tanh(s/s_0)."""
    return tuple(
        (i, n - i, k) for k, degree in DEGREES[parity].items() for n in range(degree + 1) for i in range(n, -1, -1)
    )


def informative(ranges: Ranges, where: ArrayLike, number: int) -> list[int]:
    """Return the indices of the most informative among M places for fitting surrogates of both parities.

    `where` contains the places, shape (M, 3). They are chosen one after the other. Each one increases the
    log-determinants of the two information matrices as much as possible (a D-optimal design, a greedy version of
    Fedorov's exchange).

    Raises
    ------
    ValueError
        There are fewer places than `number`.
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
    """Return the polynomial that fits samples best, by least squares.

    `where` contains amplitude, frequency [Hz] and steering of each sample, shape (M, 3), and `values` has the shape
    (M,).

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
    """Return a polynomial that is corrected by samples, (I5). `where` and `values` are as for `fit`."""
    places, parity = np.asarray(where, dtype=float), polynomial.parity
    degrees = np.array([i + j + (k or 1 if parity == "odd" else k) for i, j, k in exponents(parity)])
    weights = SMOOTH**degrees
    terms = _terms(parity, *polynomial.ranges.scaled(*places.T)) * weights
    missed = np.asarray(values, dtype=float) - polynomial(*places.T)
    change = weights * np.linalg.solve(terms.T @ terms + RIDGE * np.eye(len(weights)), terms.T @ missed)
    return replace(polynomial, coefficients=tuple(map(float, polynomial.coefficients + change)))


def misfit(polynomial: Polynomial, where: ArrayLike, values: Sequence[float] | FloatArray) -> Misfit:
    """Return the misfit between a polynomial and samples. `where` and `values` are as for `fit`."""
    true = np.asarray(values, dtype=float)
    off = polynomial(*np.asarray(where, dtype=float).T) - true
    rms, size = float(np.sqrt(np.mean(off**2))), float(np.sqrt(np.mean(true**2)))
    return Misfit(rms, float(np.abs(off).max()), 100.0 * rms / size if size > 0.0 else 0.0)


def _terms(parity: Parity, a: FloatArray, g: FloatArray, s: FloatArray) -> FloatArray:
    """Return the terms of (I1) at M scaled places, shape (M, terms)."""
    of_steering = _of_steering(parity, s)
    return np.column_stack([a**i * g**j * of_steering[k] for i, j, k in exponents(parity)])


def _of_steering(parity: Parity, s: Any) -> dict[int, Any]:
    """Return the functions S_k of the scaled steering, (I1), by k."""
    powers = {k: s**k for k in DEGREES[parity]}
    if parity == "odd":
        tanh = ca.tanh if isinstance(s, ca.SX) else np.tanh
        powers[0] = tanh(s / STICKING_STEERING)
    return powers


def _centred(value: Any, bounds: tuple[float, float]) -> Any:
    low, high = bounds
    return (2.0 * value - (low + high)) / (high - low)
