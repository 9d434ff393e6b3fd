"""A study: the cases of a sweep along its axes, with the figures that the scene's section [study] names.

A figure is a number from the summary of a run, such as the speed. A place is an index along an axis.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenes.language.errors import SceneError
from scenes.language.formulas import evaluated
from scenes.language.reading import trusted
from scenes.language.sweep_section import Study
from scenes.models.loading import Scene
from scenes.studies.study.view import Axis, Measure, View, rounded
from scenes.sweep.design import CASE, SAMPLE, Varied
from scenes.sweep.links import given_keys, value_at
from scenes.sweep.table import Table
from scenes.sweep.waves import ALIASED
from worm3d.values.arrays import FloatArray
from worm3d.values.metrics import METRIC_ROUNDING, named
from worm3d.values.spelling import did_you_mean

MOST_CURVES = 5
"""Largest number of values of a second numeric axis that are drawn as curves; with more values the figure is a map. It
is also the largest number of curves that are described one by one."""
RELATIVE_ROUNDING = 1e-9
"""Values of a figure below this fraction of its largest magnitude in the study are rounding errors and count as 0."""
IMAGE = f"the wave is aliased (at most {ALIASED:.1f} segments long)"
"""Mark of cases whose wave is too short for their segments."""
PERIOD = "gait.period_s"
"""Key of the period of the gait. The sentences name the period if it is the same in all cases, because inertia and lags
make the results depend on it."""
DEFAULT: Mapping[str, Any] = {"mean_speed_m_s": "more", "cost_of_transport": "less"}
"""Figures of a study that names none, and whether more or less of each is better."""


def _words(varied: Varied) -> str:
    """Return the last part of a key as words, without its unit."""
    return varied.key.split(".")[-1].removesuffix("_" + varied.unit.replace("/", "_")).replace("_", " ")


@dataclass(frozen=True)
class Grid:
    """Cases of a study along its axes.

    The first axis x has X values. The second axis has C values, which are shown as curves or as rows of a map; C is 1
    if there is no second axis. The optional axis `by` serves to compare cases at equal figures.

    Raises
    ------
    SceneError
        The sweep is not a grid of one or two axes besides `by`, or the study names a key or a figure that does not
        exist.
    """

    scene: Scene
    table: Table

    @cached_property
    def asked(self) -> Study:
        """The section [study]."""
        return trusted(Study, self.scene.study)

    @cached_property
    def measures(self) -> tuple[Measure, ...]:
        """Figures of the study."""
        return tuple(self.measure(name, better) for name, better in (self.asked.measures or DEFAULT).items())

    def measure(self, name: str, better: str = "") -> Measure:
        """Return a figure of the summary by name."""
        self._column(name)
        words, unit = named(name)
        return Measure(name, self.asked.names.get(name, words), unit, better)

    @cached_property
    def by(self) -> Axis | None:
        """The axis along which figures are interpolated to compare cases at equal figures; None if there is none."""
        axis = next((each for each in self._axes if each.varied.key == self.asked.by), None)
        if self.asked.by and axis is None:
            raise SceneError(f"study.by: got '{self.asked.by}', must be one of the varied keys")
        return axis

    @cached_property
    def _axes(self) -> list[Axis]:
        names = self.asked.names
        return [Axis(each, names.get(each.key, _words(each))) for each in self.table.design.varied]

    @cached_property
    def _roles(self) -> tuple[Axis, Axis | None]:
        others = [each for each in self._axes if each is not self.by]
        if any(each.varied.dim in (CASE, SAMPLE) for each in others) or not 1 <= len(others) <= 2:
            raise SceneError(
                f"{self.scene.name}: a study is a grid over one or two keys, and one more key if study.by names it; "
                f"got {', '.join(each.varied.key for each in others) or 'none'}"
            )
        others.sort(key=lambda each: not each.is_number)  # stable: numbers before names
        return others[0], others[1] if len(others) == 2 else None

    @property
    def x(self) -> Axis:
        """The first axis. If one of the two axes is numeric, it is a numeric axis."""
        return self._roles[0]

    @property
    def other(self) -> Axis | None:
        """The second axis; None if there is none."""
        return self._roles[1]

    @property
    def is_map(self) -> bool:
        """Whether the figure is a map: the second axis is numeric and has more than `MOST_CURVES` values."""
        other = self.other
        return other is not None and other.is_number and len(other.varied.values) > MOST_CURVES

    @property
    def curves(self) -> list[str]:
        """Name of each curve; a single empty name if there is no second axis."""
        return [""] if self.other is None else [self._curve(c) for c in range(len(self.other.varied.values))]

    def _curve(self, place: int) -> str:
        assert self.other is not None
        told = self.other.told(place)
        return f"{self.other.words} {told}" if self.other.is_number else told

    def views(self) -> Iterator[View]:
        """Yield the views of the study: first all figures as computed, then costs at equal values of another figure."""
        for measure in self.measures:
            yield self.view(measure)
        for figure, target in self.asked.equal.items():
            equal = self.measure(figure)
            for measure in self.measures:
                if measure.name != figure and measure.better == "less" and self.by is not None:
                    where = f"at equal {equal.words} of {equal.told(target)}, by the {self.by.words}"
                    found = self.equal_values(measure.name, figure, target)
                    yield View(", ".join([where, *self._period]), measure, *found)

    def view(self, measure: Measure, place: int | None = None) -> View:
        """Return a view of a figure; `place` as in `values`."""
        where = self.at(self._own if place is None else place)
        return View(where, measure, self.values(measure.name, place), self.errors(measure.name, place))

    def values(self, name: str, place: int | None = None) -> FloatArray:
        """Return the values of a figure, shape (X, C).

        `place` is a place along `by`; without it, the place of the scene's own value is used. A missing value is NaN,
        and a value that is only a rounding error is 0.
        """
        column = self._column(name)
        return self._at(np.where(np.abs(column) < self._least(name), 0.0, column), place)

    def errors(self, name: str, place: int | None = None) -> FloatArray:
        """Return the errors of `values` that are caused by time steps, shape (X, C); NaN if an error is unknown."""
        column = self._errors(name)
        return rounded(self._at(np.where(column < self._least(name), 0.0, column), place))

    def _errors(self, name: str) -> FloatArray:
        return self.table.errors.get(name, np.full(len(self.table), np.nan))

    def _least(self, name: str) -> float:
        """Return the smallest magnitude of a figure that does not count as a rounding error."""
        known = np.abs(self._column(name))
        largest = float(known[np.isfinite(known)].max(initial=0.0))
        return max(METRIC_ROUNDING.get(named(name)[1], 0.0), RELATIVE_ROUNDING * largest)

    def _at(self, column: NDArray[Any], place: int | None) -> NDArray[Any]:
        """Return a column of the table at a place along `by`, shape (X, C); by default at the scene's own value."""
        return self._cube(column)[..., self._own if place is None else place]

    def equal_values(self, name: str, figure: str, target: float) -> tuple[FloatArray, FloatArray]:
        """Return the figure `name` where another figure has the value `target`, and its errors, each of shape (X, C).

        Both figures are interpolated linearly between neighbouring places along `by`. If the other figure has the
        target value at several places, the smallest value of `name` is returned. If it has the target value nowhere,
        the result is NaN. Let y be interpolated between the cases 1 and 2 with the weights 1 - s and s so that x has
        its target value. The error of y is then at most (1 - s) dy1 + s dy2 + |dy/dx| ((1 - s) dx1 + s dx2).
        """
        given, wanted = self._cube(self._column(figure)), self._cube(self._column(name))
        if given.shape[-1] < 2:
            return np.full(given.shape[:-1], np.nan), np.full(given.shape[:-1], np.nan)
        low, high = given[..., :-1] - target, given[..., 1:] - target
        with np.errstate(invalid="ignore", divide="ignore"):
            share = np.where(low * high <= 0.0, low / (low - high), np.nan)
            slope = np.diff(wanted) / np.diff(given)
        off, given_off = (
            each[..., :-1] + share * np.diff(each) for each in map(self._cube, map(self._errors, (name, figure)))
        )
        at = wanted[..., :-1] + share * np.diff(wanted)
        best = np.argmin(np.where(np.isnan(at), np.inf, at), axis=-1)[..., None]
        found = np.take_along_axis(np.stack([at, off + np.abs(slope) * given_off]), best[None], axis=-1)[..., 0]
        return found[0], rounded(found[1])

    @cached_property
    def failed(self) -> NDArray[np.bool_]:
        """Whether each case failed, shape (X, C)."""
        return self._at(self.table.failed, None)

    def marked(self, place: int | None = None) -> dict[str, NDArray[np.bool_]]:
        """Return, for each property that the study marks, whether each case has it, shape (X, C).

        `place` is as in `values`.
        """
        found = {}
        with np.errstate(invalid="ignore"):
            for name, formula in self.asked.marked.items():
                found[name] = np.asarray(evaluated(formula, partial(self.values, place=place)), dtype=bool)
            aliased = self._at(np.array(self.table.segments_per_wave) <= ALIASED * (1.0 + 1e-9), place)
        return found | ({IMAGE: aliased} if aliased.any() else {})

    def left_out(self, place: int | None = None) -> NDArray[np.bool_]:
        """Return whether each case is marked, so that it cannot be best, shape (X, C). `place` is as in `values`."""
        return np.asarray(np.any([np.zeros_like(self.failed), *self.marked(place).values()], axis=0))

    @cached_property
    def _own(self) -> int:
        """Place of the scene's own value along `by`; the middle place if `by` does not contain this value."""
        if self.by is None:
            return 0
        own, values = value_at(self.scene.settings, self.by.varied.key, None), self.by.varied.values
        return values.index(own) if own in values else len(values) // 2

    @property
    def own(self) -> str:
        """Text with the scene's own value of `by` and the common period of the gait."""
        return self.at(self._own)

    def at(self, place: int) -> str:
        """Return a text with the value of `by` at a place, and with the period of the gait if all cases share it."""
        said = [] if self.by is None else [f"{self.by.words} {self.by.told(place)}"]
        return ", ".join([*said, *self._period])

    @property
    def _period(self) -> list[str]:
        """A text with the period of the gait, in a list that is empty if the period differs between cases."""
        period = None if PERIOD in self._given else value_at(self.scene.settings, PERIOD, None)
        return [] if period is None else [f"period {period:g} s"]

    @property
    def elsewhere(self) -> list[int]:
        """Places along `by` other than the place of the scene's own value."""
        return [] if self.by is None else [k for k in range(len(self.by.varied.values)) if k != self._own]

    @cached_property
    def _given(self) -> set[str]:
        """Keys that the sweep sets: keys that differ between cases, or that follow from such keys by a formula."""
        return {*given_keys(self.scene.sweep), *(each.varied.key for each in self._axes)}

    def _cube(self, column: NDArray[Any]) -> NDArray[Any]:
        """Return a column of the table with the axes x, second axis and `by`; a missing axis has length 1."""
        dims = list(self.table.design.sizes)
        wanted = [axis.varied.dim for axis in (*self._roles, self.by) if axis is not None]
        cube = column.reshape(list(self.table.design.sizes.values())).transpose([dims.index(dim) for dim in wanted])
        if self.other is None:
            cube = cube[:, None]
        return cube if self.by is not None else cube[..., None]

    def _column(self, name: str) -> FloatArray:
        known = self.table.figures
        if name not in known:
            meant = did_you_mean(name, [(each, each) for each in known])
            guess = f"; did you mean '{meant}'?" if meant else ""
            raise SceneError(f"study: no case has a figure '{name}'{guess} sweep.csv names all figures")
        return known[name]
