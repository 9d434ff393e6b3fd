"""Measured cycles of a segment: the elastic force and the friction of the joints, fitted together.

The force along a segment is the elastic force P(l) at each input, a cubic spline of the length, plus the friction of
`worm3d.physics.hysteresis.Jenkins`. In the notation of that module, both chambers together have

    dy/dl = 2 M/h + rho |P(l)|,   r_k = 2 give spread^place_k                                          (LB1)

where M is the moment in the hinges, rho the load ratio, h the half-height of a rhombus with the radius and length of
the segment at rest, and P(l) the elastic force at the least input. The elastic force is the mean of both directions
where the joints slide.

A hoop cable around the segment has the length u taken in and the force T. With the links a of the rhombus, and the
cable kappa that shortens per diameter, the segment's force along its axis has the lever du/dl:

    h = h0 - u/(2 kappa),   l = 2 sqrt(a^2 - h^2),   du/dl = kappa l/(2 h),   F = P(l) - T du/dl       (LB2)

A cable along the axis has F = P(l) + T. A record at a single input therefore gives the law at all cable forces.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.optimize import least_squares

from scenes.language.errors import SceneError
from scenes.studies.law.free import BoolArray
from scenes.studies.law.surface import Spline
from scenes.studies.law.table import Table
from worm3d.physics.hysteresis import Jenkins
from worm3d.values.arrays import FloatArray
from worm3d.values.read_only import ReadOnly

REVERSAL = 0.05
"""Least motion back that counts as a reversal, as a fraction of the range of lengths. Smaller motions are noise or
creep. At half and at double, the load frame of the mesh segment has the same two ways."""

ROWS_PER_WAY = 20
"""Least mean number of rows between reversals in a record of cycles. States in random order have two or three."""

ELASTIC_COEFFICIENTS = 7
"""Number of coefficients of the elastic force at each input."""

MOST_ROWS = 1500
"""Largest number of rows in the fit of the friction, which takes about 10 s. Longer records are thinned out."""

ROUGHNESS = 1e-2
"""Weight of second differences of the elastic force's coefficients beside errors of the force."""

REST_WEIGHT = 30.0
"""Weight of the elastic force at the rest length, where it must be 0, beside errors of the force. At half and at
double, this force stays below 0.1 % of the peak."""

LEAST_STEP = 0.05
"""Least growth of the elastic force over the range of lengths, as a fraction of the peak of the measured force. With no
growth, the free length would jump with the input."""

LEVEL_WIDTH = 0.02
"""Largest difference of inputs that count as one, as a fraction of the greatest input."""

HELD_OUT_EVERY = 5
"""In a record with one cycle, every row of this number is left out of the fit, and measures its error."""


@dataclass(frozen=True, eq=False)
class Record(ReadOnly):
    """Rows of a measurement in their order, arrays of shape (T,)."""

    length: FloatArray
    """Length [m]."""
    force: FloatArray
    """Measured force, along the axis or in the hoop cable [N]."""
    level: FloatArray
    """Number of the input in `inputs`."""
    inputs: FloatArray
    """Inputs in ascending order, shape (L,)."""
    link: float | None
    """Length of the links of the rhombus [m], or None if the radius at rest is unknown."""
    ways: tuple[slice, ...]
    """Rows between reversals."""
    rest_length: float | None
    cable_per_diameter: float | None
    """kappa of (LB2), or None if the force was measured along the axis."""

    def lever(self, length: FloatArray) -> FloatArray:
        """Return the force along the axis over the measured force at the given lengths, shape (T,)."""
        if self.link is None or self.cable_per_diameter is None:
            return np.ones(len(length))
        found: FloatArray = self.cable_per_diameter * length / (2.0 * self.height(length))
        return found

    def height(self, length: FloatArray) -> FloatArray:
        """Return the half-height of the rhombus at the given lengths, shape (T,) [m]."""
        found: FloatArray = np.sqrt(float(self.link or 0.0) ** 2 - length**2 / 4.0)
        return found

    @property
    def cycles(self) -> list[tuple[slice, ...]]:
        """Pairs of ways, there and back. A last way without a way back is left out."""
        return [self.ways[k : k + 2] for k in range(0, len(self.ways) - 1, 2)]


class Way(NamedTuple):
    """Error of a model on a way between two reversals."""

    number: int
    use: str
    rows: int
    error: float
    """Rms error over the peak of the measured force."""


@dataclass(frozen=True, eq=False)
class Cycle(ReadOnly):
    """Elastic force and friction of a record."""

    record: Record
    spline: Spline
    elastic: FloatArray
    """Coefficients of the elastic force, in the direction of the measured force, shape (L, coefficients) [N]."""
    moment: float
    """Friction M of each of a segment's two apex hinges, both chambers together [N m]."""
    load_ratio: float
    give: float
    """[J]."""
    spread: float
    fitted: BoolArray
    """Whether each row was used in the fit, shape (T,)."""

    def predicted(self, elastic: FloatArray) -> FloatArray:
        """Return the measured force with other coefficients of the elastic force, shape (T,) [N]."""
        parameters = np.array([self.moment, self.load_ratio, np.log(self.give), np.log(self.spread)])
        return predicted(self.record, self.spline, elastic, parameters)

    def errors(self, elastic: FloatArray) -> list[Way]:
        """Return the errors on each way, with other coefficients of the elastic force, shape (L, coefficients)."""
        miss = self.predicted(elastic) - self.record.force
        peak, rows, found = float(np.abs(self.record.force).max()), np.arange(len(miss)), []
        for number, way in enumerate(self.record.ways, start=1):
            inside = (rows >= way.start) & (rows < way.stop)
            for use, own in (("fitted", inside & self.fitted), ("held out", inside & ~self.fitted)):
                if own.any():
                    found.append(Way(number, use, int(own.sum()), float(np.sqrt(np.mean(miss[own] ** 2))) / peak))
        return found

    @property
    def half_width(self) -> float:
        """Greatest friction along the segment [N]."""
        length = np.linspace(self.spline.low, self.spline.high, 100)
        return float(_slope(self.record, length, self.force(length, 0), self.moment, self.load_ratio).max())

    def force(self, length: FloatArray, level: int) -> FloatArray:
        """Return the elastic force along the axis at the input with the given number, shape (T,) [N]."""
        found: FloatArray = self.record.lever(length) * (self.spline.matrix(length) @ self.elastic[level])
        return found

    def scene_keys(self) -> list[str]:
        """Return the friction as lines of a scene."""
        values = {"moment_N_m": self.moment, "load_ratio": self.load_ratio, "give_J": self.give, "spread": self.spread}
        return ["[hysteresis]", 'kind = "jenkins"', *(f"{key} = {value:.4g}" for key, value in values.items())]


def record_of(table: Table) -> Record | None:
    """Return the cycles in a table, or None if its rows are states in no order.

    Raises
    ------
    SceneError
        A fact about the hoop cable is missing, or more cable is taken in than the segment has.
    """
    if not table.ordered or len(table) < 2 * ROWS_PER_WAY:
        return None
    columns, link = table.columns, _link(table)
    hoop = "length" not in columns
    length = _under_hoop(table) if hoop else columns["length"]
    ways = ways_of(length)
    if len(ways) < 2 or len(length) < ROWS_PER_WAY * len(ways):
        return None
    thin = slice(None, None, -(-len(length) // MOST_ROWS))
    length, force, ways = length[thin], columns["force"][thin], ways_of(length[thin])
    inputs, level = _levels(table.input[thin])
    rest, kappa = table.facts.get("rest_length_m"), table.facts["cable_per_diameter"] if hoop else None
    return Record(length, force, level, inputs, link, ways, rest, kappa)


def _link(table: Table) -> float | None:
    """Return the length of the links of a rhombus with the segment's radius and length at rest, if it reaches."""
    if not {"rest_radius_m", "rest_length_m"} <= table.facts.keys():
        return None
    link = float(np.hypot(table.facts["rest_radius_m"], table.facts["rest_length_m"] / 2.0))
    longest = table.columns["length"].max() if "length" in table.columns else 0.0
    return link if longest < 1.9 * link else None


def _under_hoop(table: Table) -> FloatArray:
    """Return the lengths of a segment with a hoop cable, (LB2), shape (T,) [m]."""
    h0, l0, kappa = (table.fact(name) for name in ("rest_radius_m", "rest_length_m", "cable_per_diameter"))
    link = np.hypot(h0, l0 / 2.0)
    height = h0 - table.columns["taken_in"] / (2.0 * kappa)
    if not ((height > 0.0) & (height < link)).all():
        least, most = 2.0 * kappa * (h0 - link), 2.0 * kappa * h0
        taken = table.columns["taken_in"]
        raise SceneError(
            f"column 'cable': got {taken.min():.4g} to {taken.max():.4g} m, must be from {least:.4g} to {most:.4g} m; "
            "correct its unit, rest_radius_m or cable_per_diameter"
        )
    return np.asarray(2.0 * np.sqrt(link**2 - height**2))


def ways_of(length: FloatArray) -> tuple[slice, ...]:
    """Return the rows between reversals of the motion."""
    least, turns, extreme, way = REVERSAL * np.ptp(length), [0], 0, 0.0
    for k, value in enumerate(length):
        moved = value - length[extreme]
        if way == 0.0 and abs(moved) > least:
            way = np.sign(moved)
        if way * moved > 0.0:
            extreme = k
        elif way * moved < -least:
            turns.append(extreme)
            way, extreme = -way, k
    return tuple(slice(a, b) for a, b in zip(turns, [*turns[1:], len(length)], strict=True))


def _levels(values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the distinct inputs in ascending order, and the number of each row's input."""
    ordered = np.sort(values)
    starts = np.flatnonzero(np.diff(ordered, prepend=-np.inf) > LEVEL_WIDTH * max(float(ordered[-1]), 1e-300))
    inputs = np.array([group.mean() for group in np.split(ordered, starts[1:])])
    return inputs, np.abs(values[:, None] - inputs).argmin(axis=1)


def _slope(record: Record, length: FloatArray, passive: FloatArray, moment: float, ratio: float) -> FloatArray:
    """Return dy/dl of (LB1)."""
    hinge = 0.0 if record.link is None else 2.0 * moment / record.height(length)
    found: FloatArray = hinge + ratio * np.abs(passive)
    return found


def predicted(record: Record, spline: Spline, elastic: FloatArray, parameters: FloatArray) -> FloatArray:
    """Return the measured force of a model, shape (T,) [N].

    `elastic` are the coefficients of the elastic force, shape (L, coefficients), and `parameters` are M, rho, log(give)
    and log(spread).
    """
    moment, ratio, log_give, log_spread = parameters
    grid = np.linspace(spline.low, spline.high, 400)
    slope = _slope(record, grid, record.lever(grid) * (spline.matrix(grid) @ elastic[0]), moment, ratio)
    y = cumulative_trapezoid(slope, grid, initial=0.0)
    places = [2.0 * k / (Jenkins.elements - 1) - 1.0 for k in range(Jenkins.elements)]
    give = 2.0 * np.exp(log_give + log_spread * np.array(places))
    loads = _stretches(np.interp(record.length, grid, y), give).mean(axis=1)
    own = np.einsum("tc,tc->t", spline.matrix(record.length), elastic[record.level])
    found: FloatArray = own + loads * np.interp(record.length, grid, slope) / record.lever(record.length)
    return found


def _stretches(y: FloatArray, give: FloatArray) -> FloatArray:
    """Return the stretches e_k of the elements along a motion from rest, (H3), shape (T, elements)."""
    found, e = np.zeros((len(y), len(give))), np.zeros(len(give))
    for t, moved in enumerate(np.diff(y, prepend=y[0])):
        e = np.minimum(np.maximum(e + moved / give, -1.0), 1.0)
        found[t] = e
    return found


def fit_cycle(record: Record) -> Cycle:
    """Fit elastic force and friction to the first cycle of a record.

    If the record has one cycle, every fifth row is left out.

    Raises
    ------
    SceneError
        The record has more inputs than its first cycles show.
    """
    chosen, rest = _chosen(record), _rest(record)
    covered = np.append(record.length, rest)
    spline = Spline(float(covered.min()), float(covered.max()), ELASTIC_COEFFICIENTS)
    count, levels = ELASTIC_COEFFICIENTS, len(record.inputs)
    peak = float(np.abs(record.force).max())
    at_rest, rough = spline.matrix(rest), np.diff(np.eye(count), n=2, axis=0)

    def split(unknowns: FloatArray) -> tuple[FloatArray, FloatArray]:
        return peak * np.cumsum(unknowns[:-4].reshape(levels, count), axis=1), unknowns[-4:]

    def residuals(unknowns: FloatArray) -> FloatArray:
        elastic, parameters = split(unknowns)
        miss = (predicted(record, spline, elastic, parameters) - record.force)[chosen]
        smooth = ROUGHNESS * elastic @ rough.T
        return np.concatenate([miss, smooth.ravel(), REST_WEIGHT * at_rest @ elastic[0]]) / peak

    energy = peak * np.ptp(record.length)
    least = LEAST_STEP / (count - 1)
    first = np.tile([-0.25, *[0.5 / (count - 1)] * (count - 1)], levels)
    begin = np.concatenate([first, [0.01 * energy, 0.2, np.log(0.01 * energy), np.log(3.0)]])
    low = np.tile([-np.inf, *[least] * (count - 1)], levels)
    low = np.concatenate([low, [0.0, 0.0, np.log(1e-6 * energy), 0.0]])
    high = np.concatenate([np.full(len(first), np.inf), [energy, 0.99, np.log(energy), np.log(30.0)]])
    found = least_squares(residuals, begin, bounds=(low, high), x_scale="jac", max_nfev=80, ftol=1e-6)
    elastic, (moment, ratio, log_give, log_spread) = split(found.x)
    parameters = (0.0 if record.link is None else float(moment), float(ratio), float(np.exp(log_give)))
    return Cycle(record, spline, elastic, *parameters, float(np.exp(log_spread)), chosen)


def _rest(record: Record) -> FloatArray:
    """Return the rest length at which the elastic force must be 0, or nothing if it is unknown, shape (1,) or (0,)."""
    rest, span = record.rest_length, np.ptp(record.length)
    if rest is None or record.inputs[0] != 0.0:
        return np.zeros(0)
    near = record.length.min() - REVERSAL * span <= rest <= record.length.max() + REVERSAL * span
    return np.array([rest] if near else [])


def _chosen(record: Record) -> BoolArray:
    """Return which rows are used in the fit."""
    rows = np.arange(len(record.length))
    if len(record.inputs) > 1 or len(record.cycles) < 2:
        return np.asarray(rows % HELD_OUT_EVERY != HELD_OUT_EVERY - 1)
    return np.asarray(rows < record.cycles[0][-1].stop)
