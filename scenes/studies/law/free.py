"""States of a straight segment, and their free contraction: the contraction without axial force at each input."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from scenes.language.errors import SceneError
from scenes.studies.law.surface import Spline, Surface
from worm3d.values.arrays import FloatArray
from worm3d.values.read_only import ReadOnly

BoolArray = NDArray[np.bool_]

CONTRACTION_KNOTS = 12
"""Largest number of coefficients of the free contraction and of the free volume over the input. Half as many leave
errors of 0.5 % of the force near the free length of a membrane; twice as many need more than 100 states."""

SMALLEST_STEP = 1e-3
"""Smallest step between two coefficients of the free contraction at the start, as a fraction of the mean step."""

FREE_INPUTS = 25
"""Number of inputs at which the free length is sought before the fit."""

NEAR_INPUT = 0.15
"""Greatest distance of an input from the inputs of the states between which a free length is sought, as a fraction of
the range of inputs. Farther states may have lengths at which the segment crumples at this input."""

LEAST_FOUND = 0.5
"""Least fraction of the inputs with a free length within the table. With fewer, most of p(a) would be extrapolated."""

MOST_RETURN = 0.02
"""Largest change of the free length against its main direction, as a fraction of the rest length. Noise of 1 % of the
force changes free lengths by less."""

MAXWELL_RATIO = (0.5, 2.0)
"""Allowed ratio of the two sides of dF/du = -dV/dl. Other ratios mean a wrong unit or sign. The smooth surfaces through
50 states meet the relation within 10 %."""


@dataclass(frozen=True, eq=False)
class States(ReadOnly):
    """Equilibria of a straight segment, arrays of shape (S,)."""

    length: FloatArray
    """Length l [m]."""
    input: FloatArray
    """Input u, pressure [Pa] or cable force [N]."""
    force: FloatArray
    """Axial force, positive if it pulls the ends apart [N]."""
    radius: FloatArray
    """Greatest outer radius [m]."""
    volume: FloatArray | None
    """Enclosed volume [m^3], or None if it is unknown."""

    def __len__(self) -> int:
        return len(self.length)

    def part(self, rows: BoolArray | NDArray[np.integer]) -> States:
        """Return the states with the given row numbers or flags."""
        volume = None if self.volume is None else self.volume[rows]
        return States(self.length[rows], self.input[rows], self.force[rows], self.radius[rows], volume)


@dataclass(frozen=True, eq=False)
class Free(ReadOnly):
    """Free contraction a(u) and free volume V_free(u) over the input u, cubic splines.

    The coefficients of a(u) begin with 0 and ascend; their steps are exponentials. If the input lengthens the segment,
    the contraction is counted from the free length at the greatest input, and the splines are functions of the distance
    to the greatest input.
    """

    rest_length: float
    """Length at the contraction 0 [m]."""
    spline: Spline
    lengthens: bool
    """Whether the input lengthens the segment."""
    log_steps: FloatArray
    """Logarithms of the steps of the coefficients of a(u), shape (count - 1,)."""
    volumes: FloatArray
    """Coefficients of V_free [m^3], shape (count,), or (0,) without volumes."""

    def basis(self, at: FloatArray, derivative: int = 0) -> FloatArray:
        """Return the basis functions, or their derivatives with respect to u, shape (S, count)."""
        if not self.lengthens:
            return self.spline.matrix(at, derivative)
        return (-1.0) ** derivative * self.spline.matrix(self.spline.low + self.spline.high - at, derivative)

    def sums(self, at: FloatArray, derivative: int = 0) -> FloatArray:
        """Return the factors of the steps in a(u), or in its derivative, shape (S, count - 1)."""
        return np.cumsum(self.basis(at, derivative)[:, :0:-1], axis=1)[:, ::-1]

    def contraction(self, at: FloatArray, derivative: int = 0) -> FloatArray:
        """Return a(u), or its derivative with respect to u, shape (S,)."""
        found: FloatArray = self.sums(at, derivative) @ np.exp(self.log_steps)
        return found

    def volume(self, at: FloatArray) -> FloatArray:
        """Return V_free(u), shape (S,) [m^3]."""
        found: FloatArray = self.basis(at) @ self.volumes
        return found


def start(states: States, rest_length: float | None, what: str = "input", *, from_least: bool = False) -> Free:
    """Return a first estimate of the functions of the input, from smooth surfaces through forces and volumes.

    Parameters
    ----------
    states : States
    rest_length : float or None
        Free length without input [m]. None: the estimate from the states.
    what : str
        Name of the input in messages.
    from_least : bool
        Whether the contraction is counted from the free length at the least input of the states.

    Raises
    ------
    SceneError
        The force does not grow with the length, too few free lengths are within the table, the free length changes its
        direction, or forces and volumes contradict each other.
    """
    surfaces = _surfaces(states)
    _require_consistent(states, surfaces)
    at, length = _free_lengths(states, surfaces[0], what)
    low, high = float(states.input.min()) if from_least else 0.0, float(states.input.max())
    at_rest = _at_rest(at - low, length, None if from_least else rest_length)
    _require_one_way(at, length, at_rest, what)
    lengthens = bool(length[-1] > at_rest)
    base = float(length[-1]) if lengthens else at_rest
    count = int(min(CONTRACTION_KNOTS, len(np.unique(states.input)) + 1, max(len(states) // 5, 4)))
    free = Free(base, Spline(low, high, count), lengthens, np.zeros(count - 1), np.zeros(0))
    known_at, known = np.append(at, low), 1.0 - np.append(length, at_rest) / base
    least = SMALLEST_STEP * np.abs(known).max() / (count - 1)
    steps = lsq_linear(free.sums(known_at), known, bounds=(least, np.inf)).x
    free = replace(free, log_steps=np.log(np.maximum(steps, least)))
    if states.volume is None:
        return free
    volume = surfaces[1].at(length, at) * _size(states.volume)
    return replace(free, volumes=np.asarray(np.linalg.lstsq(free.basis(at), volume, rcond=None)[0], dtype=float))


def _size(values: FloatArray) -> float:
    return float(np.std(values)) or 1.0


def _surfaces(states: States) -> list[Surface]:
    """Return the smooth force, and the volume if it is known, each over its standard deviation."""
    count = max(4, min(10, len(states) // 6))
    along = Spline(float(states.length.min()), float(states.length.max()), count)
    levels = len(np.unique(states.input))
    across = Spline(float(states.input.min()), float(states.input.max()), min(7, levels))
    known = [each for each in (states.force, states.volume) if each is not None]
    return [Surface.fitted(along, across, states.length, states.input, each / _size(each)) for each in known]


def _require_consistent(states: States, surfaces: list[Surface]) -> None:
    """Raise SceneError if the force falls with the length, or if dF/du = -dV/dl does not hold at all."""
    span = np.ptp(states.length)
    rising = surfaces[0].at(states.length, states.input, along=1)
    if np.median(rising) <= 0.0:
        raise SceneError(
            f"column 'force': falls by {-np.median(rising) * span * _size(states.force):.3g} N over the range of "
            "lengths, must grow; change its sign, so that it is positive if it pulls the ends apart"
        )
    if states.volume is None or states.input.max() == states.input.min():
        return
    left = surfaces[0].at(states.length, states.input, across=1) * _size(states.force)
    right = -surfaces[1].at(states.length, states.input, along=1) * _size(states.volume)
    ratio = float(left @ right / (left @ left))
    if not MAXWELL_RATIO[0] < ratio < MAXWELL_RATIO[1]:
        raise SceneError(
            f"column 'volume': its change with the length is {ratio:.3g} times the change that the forces imply "
            "(dF/dp = -dV/dl), must be about 1; correct a unit, or the sign of the force"
        )


def _free_lengths(states: States, force: Surface, what: str) -> tuple[FloatArray, FloatArray]:
    """Return inputs and the free lengths there, for those of `FREE_INPUTS` inputs whose free length is in the table."""
    low, high = float(states.input.min()), float(states.input.max())
    inputs = np.linspace(low, high, FREE_INPUTS if high > low else 1)
    found = [_free_length(states, force, u, NEAR_INPUT * (high - low)) for u in inputs]
    known = np.isfinite(found)
    if known.sum() < LEAST_FOUND * len(inputs):
        raise SceneError(
            f"column 'force': changes its sign at {known.sum()} of {len(inputs)} inputs from {low:g} to {high:g}, must "
            f"at {LEAST_FOUND:.0%} or more; add states on both sides of the free length, or leave out values of the "
            f"{what} without them"
        )
    return inputs[known], np.array(found)[known]


def _free_length(states: States, force: Surface, at: float, near: float) -> float:
    """Return the length at which the smooth force is 0 and rising, or NaN if there is none near the states."""
    lengths = states.length[np.abs(states.input - at) <= near]
    if not len(lengths):
        return np.nan
    tried = np.linspace(lengths.min(), lengths.max(), 200)
    values = force.at(tried, np.full(len(tried), at))
    rises = np.flatnonzero((values[:-1] < 0.0) & (values[1:] >= 0.0))
    if not len(rises):
        return np.nan
    k = rises[-1]
    return float(tried[k] - values[k] * (tried[k + 1] - tried[k]) / (values[k + 1] - values[k]))


def _at_rest(at: FloatArray, length: FloatArray, given: float | None) -> float:
    """Return the free length without input."""
    if given is not None:
        return given
    if at[0] > SMALLEST_STEP * at[-1]:
        raise SceneError(
            f"rest_length_m: got none, and the first free length is {at[0]:.4g} above the least input, must be given "
            "or follow from states with the least input; give it with -o rest_length_m=VALUE"
        )
    return float(length[0])


def _require_one_way(at: FloatArray, length: FloatArray, at_rest: float, what: str) -> None:
    """Raise SceneError if the free length does not change in one direction with the input."""
    way = np.sign(length[-1] - at_rest) or 1.0
    back = way * (np.maximum.accumulate(way * length) * way - length) / at_rest
    k = int(np.argmax(back))
    if back[k] > MOST_RETURN:
        best = at[int(np.argmax(way * length[: k + 1]))]
        raise SceneError(
            f"the free length changes its direction: {1e3 * length[at == best][0]:.4g} mm at {what} {best:.4g} and "
            f"{1e3 * length[k]:.4g} mm at {at[k]:.4g}, must change in one direction; leave out rows beyond {best:.4g}"
        )
