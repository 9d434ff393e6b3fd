"""A segment law with an ensemble, errors on held-out states, and a file."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from importlib import metadata
from itertools import accumulate
from typing import Any

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.spatial import ConvexHull, Delaunay

from scenes.language.errors import SceneError
from scenes.studies.law.fitting import Fit, Scales, drawn, fit_energy, fit_radius, force_weights
from scenes.studies.law.free import BoolArray, Free, States, start
from scenes.studies.law.prepared import EVEN_STEPS, Prepared
from worm3d.physics.segment_laws.learned import Learned
from worm3d.physics.segment_laws.network import ENERGY_SIZES, RADIUS_SIZES, weights_of
from worm3d.values.arrays import FloatArray
from worm3d.values.read_only import ReadOnly

HELD_OUT = 0.2
"""Fraction of the states that is held out. Half of these states is random, and half has the greatest distances."""

HULL_WIDTH = 0.02
"""Greatest distance of states that count as on the convex hull, over half of the ranges of length and input."""

PENALTIES = (1e-4, 1e-5, 1e-6, 1e-7, 1e-8)
"""Weights of the squares of the networks' weights. A fit has them one after another, each from the result of the one
before. Without the first ones, three of five fits of 64 states end in creases, with errors of 12 to 38 %. The last
penalty is chosen; it is small for states without noise."""

MEMBERS = 4
"""Number of further laws in the ensemble, fitted to parts of the states. Together with a law of all states, their
medians smooth the law. With half as many, the error in the working band of a barrel is up to a third larger."""

LEFT_OUT = 0.2
"""Fraction of the states that a law of a part does not see. The errors at these states choose the penalty."""

MEDIAN_POINTS = 500
"""Number of points at which the medians of the laws are taken, before those outside the hull are dropped."""

STATE_WEIGHT = 3
"""Weight of a state, where a point with medians has the weight 1."""

BAND = 0.2
"""Greatest force of the working band, as a fraction of the greatest force in the table."""

HALF_DISC_CENTRE = 4.0 / (3.0 * np.pi)
"""Distance of the centre of half a disc from the centre of the disc, over the radius."""

OFFSETS = 40
"""Number of offsets that are tried before the best one is refined, since the misfit can have several minima."""

SOFT_SHARE = 0.1
"""Stiffness below which the weights of bent states are equal, as a share of the median stiffness of all bent states.
With a third, and with three times this share, the offset of a barrel from 24 bent states changes by 0.7 mm or less."""

SPREAD_RATIO = 3.0
"""Standard deviation between members that counts as known, over its median at the states, if this is more than the
following. Most of the states are below it, also if the table is noisy."""

KNOWN_FORCE, KNOWN_RADIUS = 0.15, 0.02
"""Standard deviations between members that always count as known: the ratio of the deviation of the force to the size
of the force (`Law.size`), and the ratio of the deviation of the radius to the mean radius. At 0.1, some laws
of the shipped table have a domain that ends near the rest length, where the force grows steeply; at 0.2, the domain of
the shipped law is up to 1 mm longer."""

DOMAIN_POINTS = 28
"""Number of contractions at which the file has the bounds of the length. For the shipped law they are 0.01 apart."""

REGION_LENGTHS = 201
"""Number of lengths, from the free length to the farthest one, at which the laws of the ensemble are compared."""

STEEPEST = 1e-3
"""Least share of the length in the normal of an edge of the convex hull that bounds the length. Edges at a constant
input have a share of 0 up to rounding."""

EXTRAPOLATED = 0.05
"""Greatest distance from the convex hull of the states at which a length can be in the domain, over the rest length. At
0.04, the force of the shipped law has an rms error of 0.6 N, in place of 0.01 N in the hull."""

TABLE_SIZE = 41
"""Number of entries of p(a) in the file. The cubic between them differs from the spline by less than 1e-4 of p."""


@dataclass(frozen=True, eq=False)
class Law(ReadOnly):
    """A fitted law."""

    prepared: Prepared
    fit: Fit
    """The law, fitted to all states."""
    members: tuple[Fit, ...]
    """Further laws of the ensemble, fitted to parts of the states."""
    checked: Fit
    """A law that was fitted like `fit`, but without the states that are held out."""
    held_out: BoolArray
    """Whether each state is held out, shape (S,)."""
    penalty: float
    chamber_offset: float
    """Offset b of the chambers [m]."""
    bending: FloatArray
    """Coefficients of the bending stiffness, shape (6,) [N m]."""
    moment_error: float | None
    """Rms error of the moments of bent states over their rms, or None without bent states."""

    @property
    def states(self) -> States:
        """All states."""
        return self.prepared.states

    def errors(self) -> dict[str, float | None]:
        """Return the errors of `checked` on the held-out states."""
        return errors(self.checked, self.states.part(self.held_out), self.states)

    def spread(self) -> dict[str, float]:
        """Return the standard deviations between members that count as known, for the file.

        They are `force_share` of the size of a force, `force_N` of small forces, and `radius_m`.
        """
        at, ensemble = (self.states.length, self.states.input), (self.fit, *self.members)
        force = np.std([each.force(*at) for each in ensemble], axis=0)
        radius = np.std([each.outer_radius(*at) for each in ensemble], axis=0)
        share = max(SPREAD_RATIO * float(np.median(force / self.size(self.states.force))), KNOWN_FORCE)
        return {
            "force_share": share,
            "force_N": share * float(self.size(np.zeros(1))[0]),
            "radius_m": max(SPREAD_RATIO * float(np.median(radius)), KNOWN_RADIUS * float(np.mean(self.states.radius))),
        }

    def size(self, force: FloatArray) -> FloatArray:
        """Return the size of forces, over which errors count as in the fit [N]."""
        return 1.0 / force_weights(force, _rms(self.states.force))


def errors(fit: Fit, states: States, of: States) -> dict[str, float | None]:
    """Return the errors of a law at some states; `of` are all states of the table, which define the working band."""
    miss = fit.force(states.length, states.input) - states.force
    band = np.abs(states.force) < BAND * np.abs(of.force).max()
    volume = None if states.volume is None else _rms(fit.volume(states.length, states.input) - states.volume)
    return {
        "force_rms_N": _rms(miss),
        "force_peak_N": float(np.abs(miss).max()),
        "force_band_rms_N": _rms(miss[band]) if band.any() else None,
        "radius_rms_m": _rms(fit.outer_radius(states.length, states.input) - states.radius),
        "volume_rms_m3": volume,
        "held_out": len(states),
        "force_rms_relative": _rms(miss) / _rms(states.force),
        "force_band_rms_relative": _rms(miss[band]) / _rms(states.force[band]) if band.any() else None,
        "volume_rms_relative": None if states.volume is None or volume is None else volume / _rms(states.volume),
    }


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def make(prepared: Prepared, seed: int, tell: Callable[[int], None] = lambda done: None) -> Law:
    """Fit a law and an ensemble.

    Parameters
    ----------
    prepared : Prepared
    seed : int
        Seed of the random numbers.
    tell : callable
        Function that is called with the number of finished fits, out of `FITS`.

    Raises
    ------
    SceneError
        As in `free.start`, or the offset of the chambers is not below the radius.
    """
    states, rng = prepared.states, np.random.default_rng(seed)
    table = prepared.table
    rest_length, from_least = table.facts.get("rest_length_m"), "least_input" in table.facts
    free = start(states, rest_length, table.input_name, from_least=from_least)
    held_out = _held_out(states, rng)
    fitter = _Fitter(_scales(states, free), rng, tell)
    checked, *_ = fitter.law(states.part(~held_out), free)
    fit, members, penalty = fitter.law(states, free)
    offset = _offset(prepared, fit)
    bending = _bending(prepared, fit, offset)
    return Law(prepared, fit, members, checked, held_out, penalty, offset, *bending)


class _Fitter:
    """Fits from random starts with common scales. Each law without a radius is counted."""

    def __init__(self, scales: Scales, rng: np.random.Generator, tell: Callable[[int], None]) -> None:
        self._scales, self._rng, self._tell, self._done = scales, rng, tell, 0

    def law(self, states: States, free: Free) -> tuple[Fit, tuple[Fit, ...], float]:
        """Return a law without creases, laws of parts of the states, and the penalty of the energy.

        The chosen penalties give the laws of the parts the least errors at held-out states. Errors
        are compared by their medians, since a few states at the edge of the table can have errors a hundred times as
        large.
        """
        seen = [~_drawn_rows(len(states), LEFT_OUT, self._rng) for _ in range(MEMBERS)]

        def chosen(paths: Sequence[Sequence[Fit]], squares: Callable[[Fit, States], FloatArray]) -> int:
            parts = [(path, states.part(~rows)) for path, rows in zip(paths, seen, strict=True)]
            every = range(len(PENALTIES))
            found = [np.concatenate([squares(path[k], unseen) for path, unseen in parts]) for k in every]
            return int(np.argmin(np.median(found, axis=1)))

        paths = [self._energies(states.part(rows), free, PENALTIES) for rows in seen]
        best = chosen(paths, _squares)
        first, parts = self._energies(states, free, PENALTIES[: best + 1])[-1], [path[best] for path in paths]
        smooth = self._counted(fit_energy(first, _with_medians(states, [first, *parts]), PENALTIES[best]))
        paths = [self._radii(part, states.part(rows), PENALTIES) for part, rows in zip(parts, seen, strict=True)]
        own = chosen(paths, _radius_squares)
        fit = self._radii(smooth, states, PENALTIES[: own + 1])[-1]
        return fit, tuple(path[own] for path in paths), PENALTIES[best]

    def _energies(self, of: States, free: Free, penalties: Sequence[float]) -> list[Fit]:
        """Return laws without a radius, one for each penalty."""
        begin = Fit(self._scales, drawn(ENERGY_SIZES, self._rng), np.zeros(weights_of(RADIUS_SIZES)), free)
        *_, last = path = _path(fit_energy, begin, of, penalties)
        self._counted(last)
        return path

    def _radii(self, fit: Fit, of: States, penalties: Sequence[float]) -> list[Fit]:
        """Return laws with the energy of `fit`, one for each penalty of the radius."""
        return _path(fit_radius, replace(fit, radius=drawn(RADIUS_SIZES, self._rng)), of, penalties)

    def _counted(self, fit: Fit) -> Fit:
        self._done += 1
        self._tell(self._done)
        return fit


def _path(fitted: Callable[[Fit, States, float], Fit], begin: Fit, of: States, penalties: Sequence[float]) -> list[Fit]:
    """Return fits with the penalties, each from the result of the one before."""
    return list(accumulate(penalties, lambda fit, penalty: fitted(fit, of, penalty), initial=begin))[1:]


def _with_medians(known: States, fits: Sequence[Fit]) -> States:
    """Return states with the medians of several laws at further points of the convex hull of states.

    A single law may have a crease between the states. The median has none, and fitting it as well removes the crease.
    """
    unit = (0.5 + np.arange(MEDIAN_POINTS)[:, None] * EVEN_STEPS) % 1.0
    corners = [(float(each.min()), float(np.ptp(each))) for each in (known.length, known.input)]
    points = np.array([low for low, _ in corners]) + np.array([span for _, span in corners]) * unit
    hull = Delaunay(np.column_stack([_scaled(known.length), _scaled(known.input)]), qhull_options="QJ")
    inside = hull.find_simplex(2.0 * unit - 1.0) >= 0
    length, level = points[inside].T
    force = np.median([each.force(length, level) for each in fits], axis=0)

    def both(own: FloatArray, more: FloatArray) -> FloatArray:
        return np.concatenate([*[own] * STATE_WEIGHT, more])

    volume = None
    if known.volume is not None:
        volume = both(known.volume, np.median([each.volume(length, level) for each in fits], axis=0))
    unused = both(known.radius, 0.0 * length)
    return States(both(known.length, length), both(known.input, level), both(known.force, force), unused, volume)


FITS = 2 * (MEMBERS + 2)
"""Number of fits for a law."""


def _scales(states: States, free: Free) -> Scales:
    """Return scales from the ranges of the states. The stiffness k is the best k of F = -k s/(1 - a)."""
    a, x = free.contraction(states.input), states.length / free.rest_length
    pull = (x / (1.0 - a) - 1.0) / (1.0 - a)
    k = max(float(pull @ states.force / (pull @ pull)), 1e-9)
    energy = k * free.rest_length / 4.0
    return Scales(free.rest_length, k, *_range(x), *_range(a), energy, *_range(states.radius))


def _range(values: FloatArray) -> tuple[float, float]:
    """Return the middle and half of the range of values. Half of the range is at least 1e-3 of the middle."""
    low, high = float(values.min()), float(values.max())
    middle = (low + high) / 2.0
    return middle, max((high - low) / 2.0, 1e-3 * abs(middle)) or 1.0


def _held_out(states: States, rng: np.random.Generator) -> BoolArray:
    """Return which states are held out: half of them at random, and half by farthest points.

    States on the convex hull of lengths and inputs are not held out, since the law is not valid beyond them.
    """
    points = np.column_stack([_scaled(states.length), _scaled(states.input)])
    planes = ConvexHull(points, "QJ").equations
    inner = np.flatnonzero((points @ planes[:, :2].T + planes[:, 2]).max(axis=1) < -HULL_WIDTH)
    count = min(round(HELD_OUT * len(states)), len(inner) // 2)
    chosen = list(rng.permutation(inner)[: count - count // 2])
    while len(chosen) < count:
        rest = np.setdiff1d(inner, chosen)
        apart = np.linalg.norm(points[rest][:, None] - points[chosen][None], axis=2).min(axis=1)
        chosen.append(rest[int(np.argmax(apart))])
    return np.isin(np.arange(len(states)), chosen)


def _scaled(values: FloatArray) -> FloatArray:
    middle, half = _range(values)
    return (values - middle) / half


def _drawn_rows(count: int, share: float, rng: np.random.Generator) -> BoolArray:
    return np.isin(np.arange(count), rng.permutation(count)[: round(share * count)])


def _squares(fit: Fit, states: States) -> FloatArray:
    """Return the squares of the relative errors at some states."""
    miss = force_weights(states.force) * (fit.force(states.length, states.input) - states.force)
    squares: FloatArray = miss**2
    if states.volume is not None:
        squares += (fit.volume(states.length, states.input) - states.volume) ** 2 / np.var(states.volume)
    return squares


def _radius_squares(fit: Fit, states: States) -> FloatArray:
    squares: FloatArray = (fit.outer_radius(states.length, states.input) - states.radius) ** 2
    return squares


def domain(fit: Fit, states: States) -> tuple[tuple[float, float], float]:
    """Return the range of lengths, and the greatest contraction."""
    lengths = np.append(states.length, fit.free.rest_length)
    return (float(lengths.min()), float(lengths.max())), float(fit.free.contraction(states.input).max())


def region(law: Law, of: Learned) -> tuple[FloatArray, FloatArray]:
    """Return the least and the greatest length at equal steps of the contraction, each of shape (DOMAIN_POINTS,) [m].

    From the free length, the region extends in both directions as far as the laws of the ensemble agree, but at most
    `EXTRAPOLATED` beyond the convex hull of the states and the free lengths. `of` is the law from its file.
    """
    (low, high), most = domain(law.fit, law.states)
    rest, contraction = law.fit.free.rest_length, np.linspace(0.0, most, DOMAIN_POINTS)
    free, limits = rest * (1.0 - contraction), law.spread()
    states = np.column_stack([law.fit.free.contraction(law.states.input), law.states.length / rest])
    planes = ConvexHull(np.vstack([states, np.column_stack([contraction, free / rest])]), qhull_options="QJ").equations
    ends = []
    for side, end in ((-1.0, low), (1.0, high)):
        across = planes[side * planes[:, 1] > STEEPEST]
        hull = np.min(-(across[:, 2] + np.outer(contraction, across[:, 0])) / (side * across[:, 1]), axis=1)
        farthest = side * np.maximum(np.minimum(rest * (hull + EXTRAPOLATED), side * end), side * free)
        length = free + np.linspace(0.0, 1.0, REGION_LENGTHS)[:, None] * (farthest - free)
        force, radius = of.ensemble(length, np.broadcast_to(contraction, length.shape))
        known = np.std(force, axis=0) <= limits["force_share"] * law.size(np.mean(force, axis=0))
        known &= np.std(radius, axis=0) <= limits["radius_m"]
        last = np.logical_and.accumulate(known, axis=0).sum(axis=0) - 1
        ends.append(np.take_along_axis(length, np.maximum(last, 0)[None], axis=0)[0])
    return ends[0], ends[1]


def _offset(prepared: Prepared, fit: Fit) -> float:
    """Return the offset of the chambers.

    Without a given offset, the offset is the best offset for the moments of bent states together with the bending
    stiffness m. Without bent states, the offset is the distance of the centre of half a disc from the axis. There the
    pressure acts in a chamber that fills half of the cross-section. The disc has the least radius in the domain.
    """
    (low, high), most = domain(fit, prepared.states)
    corners = np.meshgrid(np.linspace(low, high, 21), np.linspace(0.0, most, 21))
    least = float(fit.radius_of(*(each.ravel() for each in corners)).min())
    given = prepared.table.facts.get("chamber_offset_m")
    if least <= 0.0 or (given is not None and given >= least):
        raise SceneError(
            f"chamber_offset_m: got {given}, must be below the least radius of the law, {least:.4g} m; give another "
            "one with -o, or leave out states in the corners of the table"
        )
    if given is not None:
        return given
    if not len(prepared.bent):
        return HALF_DISC_CENTRE * least
    tried = least * np.linspace(0.01, 0.99, OFFSETS)
    k = int(np.argmin([_misfit(prepared, fit, offset) for offset in tried]))
    bounds = tried[max(k - 1, 0)], tried[min(k + 1, OFFSETS - 1)]
    return float(minimize_scalar(lambda offset: _misfit(prepared, fit, offset), bounds=bounds).x)


def _misfit(prepared: Prepared, fit: Fit, offset: float) -> float:
    """Return the sum of the squares of the weighted errors of the moments, for the best stiffness m."""
    terms, rest, weight = _bent(prepared, fit, offset)
    return float(np.sum((weight * (terms @ _coefficients(terms, rest, weight) - rest)) ** 2))


def _moment(prepared: Prepared, fit: Fit, offset: float) -> FloatArray:
    """Return the moments b (U'(l + b th) - U'(l - b th)) of the chambers in the bent states [N m]."""
    length, level, bend, _ = prepared.bent.T
    longer, shorter = (fit.force(length + sign * offset * bend, level) / 2.0 for sign in (1.0, -1.0))
    found: FloatArray = offset * (longer - shorter)
    return found


def _bending(prepared: Prepared, fit: Fit, offset: float) -> tuple[FloatArray, float | None]:
    """Return the coefficients of the bending stiffness for the moments of bent states, and the moments' error.

    The moment is b (U'(l + b th) - U'(l - b th)) + m(x, y) th. Without bent states, m is 0.
    """
    if not len(prepared.bent):
        return np.zeros(6), None
    terms, rest, weight = _bent(prepared, fit, offset)
    found = _coefficients(terms, rest, weight)
    return found, _rms(terms @ found - rest) / _rms(prepared.bent[:, 3])


def _bent(prepared: Prepared, fit: Fit, offset: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return terms of m th, moments without the part of the chambers [N m], and weights, for B bent states.

    The shapes are (B, 6), (B,) and (B,). Errors are weighted relative to the moment, or to a share of the median
    stiffness for soft states, since worms bend where they are soft.
    """
    length, level, bend, moment = prepared.bent.T
    s = fit.scales
    x = (length / s.rest_length - s.x_mid) / s.x_half
    y = (fit.free.contraction(level) - s.y_mid) / s.y_half
    terms = np.column_stack([np.ones(len(x)), x, y, x * x, x * y, y * y]) * bend[:, None]
    stiffness = np.abs(moment / bend)
    weight = np.asarray(1.0 / (np.abs(bend) * (SOFT_SHARE * float(np.median(stiffness)) + stiffness)), dtype=float)
    return terms, moment - _moment(prepared, fit, offset), weight


def _coefficients(terms: FloatArray, rest: FloatArray, weight: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.lstsq(terms * weight[:, None], weight * rest, rcond=None)[0], dtype=float)


def content(law: Law) -> dict[str, Any]:
    """Return the content of the law's file.

    Raises
    ------
    SceneError
        The law is not allowed in a file.
    """
    data = _content(law)
    try:
        shortest, longest = region(law, Learned("law", content=json.dumps(data)))
    except ValueError as error:
        raise SceneError(str(error)) from None
    data["domain"] |= {"shortest_m": shortest.tolist(), "longest_m": longest.tolist()}
    return data


def _content(law: Law) -> dict[str, Any]:
    """Return the content of the law's file, with a rectangle as the domain."""
    fit, table, s = law.fit, law.prepared.table, law.fit.scales
    lengths, most = domain(fit, law.states)
    low, high = fit.free.spline.low, fit.free.spline.high
    at = np.linspace(low, high, TABLE_SIZE)
    at, value = (at[::-1], high - at[::-1]) if fit.free.lengthens else (at, at)
    rest_radius = float(fit.radius_of(np.array([s.rest_length]), np.zeros(1))[0])
    return {
        "kind": "worm3d segment law",
        "version": 1,
        "rest_length_m": s.rest_length,
        "chamber_offset_m": law.chamber_offset,
        "plate_radius_m": table.facts.get("plate_radius_m", rest_radius),
        "rest_radius_m": rest_radius,
        "input": {
            "name": table.input_name,
            "unit": {"pressure": "Pa", "cable": "N"}[table.input_name],
            "contraction": fit.free.contraction(at).tolist(),
            "value": value.tolist(),
            "counted_down_from": fit.free.spline.high if fit.free.lengthens else None,
        },
        "free_volume_m3": fit.free.volume(at).tolist() if len(fit.free.volumes) else None,
        "stiffness_N": s.stiffness,
        "scales": {
            **{name: getattr(s, name) for name in ("x_mid", "x_half", "y_mid", "y_half")},
            "energy_J": s.energy,
            "radius_mid_m": s.radius_mid,
            "radius_m": s.radius,
        },
        "energy": {"sizes": list(ENERGY_SIZES), "weights": fit.energy.tolist()},
        "radius": {"sizes": list(RADIUS_SIZES), "weights": fit.radius.tolist()},
        "bending_Nm": law.bending.tolist(),
        "contact_stiffness_N_m": table.facts.get("contact_stiffness_N_m"),
        "domain": {"length_m": list(lengths), "contraction": [0.0, most]},
        "ensemble": [
            {
                "energy": each.energy.tolist(),
                "radius": each.radius.tolist(),
                "bending_Nm": _bending(law.prepared, each, law.chamber_offset)[0].tolist(),
            }
            for each in law.members
        ],
        "spread": law.spread(),
        "errors": law.errors(),
        "source": table.source,
        "table_sha256": table.sha256,
        "made": f"{datetime.now(UTC):%Y-%m-%d}, worm3d {metadata.version('worm3d')}",
    }
