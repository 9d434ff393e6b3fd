"""A study: what a scene's section [study] asks of its sweep, and the figures of the cases along its axes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenes.language.errors import SceneError
from scenes.language.formulas import evaluated
from scenes.language.sweep_section import Study
from scenes.models.loading import Scene
from scenes.sweep.design import CASE, SAMPLE, Varied
from scenes.sweep.links import value_at
from scenes.sweep.table import Table, cell, is_numeric
from worm3d.metrics import ROUNDING, named, written
from worm3d.values.arrays import FloatArray
from worm3d.values.spelling import did_you_mean

MOST_CURVES = 5
"""Largest number of values of a second number that are drawn as curves, and of curves that are told one by one; more
numbers make a map."""
NOTHING = 1e-9
"""Magnitude of a figure, over its largest in the study, that is rounding."""
DEFAULT: Mapping[str, Any] = {"mean_speed_m_s": "more", "cost_of_transport": "less"}
"""Figures of a study that names none, and which is better."""


@dataclass(frozen=True)
class Axis:
    """A varied key as people read it."""

    varied: Varied
    words: str

    @property
    def unit(self) -> str:
        """Unit, empty for a pure number and for names."""
        return "" if self.varied.unit == "1" else self.varied.unit

    @property
    def label(self) -> str:
        """Words and unit."""
        return f"{self.words} [{self.unit}]" if self.unit else self.words

    @property
    def is_number(self) -> bool:
        """Whether its values are numbers."""
        return is_numeric(self.varied)

    def told(self, place: int) -> str:
        """Return a value with its unit."""
        value = cell(self.varied.values[place])
        return f"{value:.3g} {self.unit}".strip() if isinstance(value, int | float) else str(value)


@dataclass(frozen=True)
class Measure:
    """A figure of the summary as people read it."""

    name: str
    words: str
    unit: str
    better: str
    """`more` or `less`, whichever is better; empty if neither is."""

    @property
    def label(self) -> str:
        """Words and unit."""
        return f"{self.words} [{self.unit}]" if self.unit else self.words

    def told(self, value: float) -> str:
        """Return a value with its unit."""
        return f"{written(value, self.unit, 3)} {self.unit}".strip()


@dataclass(frozen=True)
class Grid:
    """Cases of a study along an axis x (X values), a second one (C curves, or rows of a map), and perhaps a third.

    Raises
    ------
    SceneError
        The sweep is no grid of one or two axes (three with `by`), or the study names what there is not.
    """

    scene: Scene
    table: Table

    @cached_property
    def asked(self) -> Study:
        """The section [study]."""
        return Study.model_validate(self.scene.study)

    @cached_property
    def measures(self) -> tuple[Measure, ...]:
        """Figures that the study is about."""
        return tuple(self.measure(name, better) for name, better in (self.asked.measures or DEFAULT).items())

    def measure(self, name: str, better: str = "") -> Measure:
        """Return a figure of the summary by name."""
        self._column(name)
        words, unit = named(name)
        return Measure(name, self.asked.names.get(name, words), unit, better)

    @cached_property
    def by(self) -> Axis | None:
        """Axis along which cases are brought to equal figures."""
        axis = next((each for each in self._axes if each.varied.key == self.asked.by), None)
        if self.asked.by and axis is None:
            raise SceneError(f"study.by: got '{self.asked.by}', must be one of the varied keys")
        return axis

    @cached_property
    def _axes(self) -> list[Axis]:
        def words(key: str) -> str:
            return key.split(".")[-1].removesuffix("_" + unit.replace("/", "_")).replace("_", " ")

        axes = []
        for varied in self.table.design.varied:
            unit = varied.unit
            axes.append(Axis(varied, self.asked.names.get(varied.key, words(varied.key))))
        return axes

    @cached_property
    def _roles(self) -> tuple[Axis, Axis | None]:
        others = [each for each in self._axes if each is not self.by]
        if any(each.varied.dim in (CASE, SAMPLE) for each in others) or not 1 <= len(others) <= 2:
            raise SceneError(
                f"{self.scene.name}: a study is a grid over one or two keys, and one more that study.by names; "
                f"got {', '.join(each.varied.key for each in others) or 'none'}"
            )
        others.sort(key=lambda each: not each.is_number)  # stable: numbers before names
        return others[0], others[1] if len(others) == 2 else None

    @property
    def x(self) -> Axis:
        """The first axis: a number, if there is one."""
        return self._roles[0]

    @property
    def other(self) -> Axis | None:
        """The second axis."""
        return self._roles[1]

    @property
    def is_map(self) -> bool:
        """Whether both axes are numbers with many values."""
        other = self.other
        return other is not None and other.is_number and len(other.varied.values) > MOST_CURVES

    @property
    def curves(self) -> list[str]:
        """Name of each curve; one without a name if there is no second axis."""
        return [""] if self.other is None else [self._curve(c) for c in range(len(self.other.varied.values))]

    def _curve(self, place: int) -> str:
        assert self.other is not None
        told = self.other.told(place)
        return f"{self.other.words} {told}" if self.other.is_number else told

    def values(self, name: str) -> FloatArray:
        """Return a figure at the scene's own value of `by`, shape (X, C); NaN where a case has none, 0 for rounding."""
        column = self._column(name)
        known = np.abs(column[np.isfinite(column)])
        least = max(ROUNDING.get(named(name)[1], 0.0), NOTHING * float(known.max(initial=0.0)))
        return self._cube(np.where(np.abs(column) < least, 0.0, column))[..., self._own]

    def equal_values(self, name: str, figure: str, target: float, better: str) -> FloatArray:
        """Return a figure where another one has a given value, on straight lines along `by`, shape (X, C).

        Of several such places the best counts; NaN where it is nowhere reached.
        """
        given, wanted = self._cube(self._column(figure)), self._cube(self._column(name))
        low, high = given[..., :-1] - target, given[..., 1:] - target
        with np.errstate(invalid="ignore", divide="ignore"):
            share = np.where(low * high <= 0.0, low / (low - high), np.nan)
        at = wanted[..., :-1] + share * (wanted[..., 1:] - wanted[..., :-1])
        worst = np.inf if better == "less" else -np.inf
        best = (np.min if better == "less" else np.max)(np.where(np.isnan(at), worst, at), axis=-1, initial=worst)
        found: FloatArray = np.where(np.isinf(best), np.nan, best)
        return found

    @cached_property
    def failed(self) -> NDArray[np.bool_]:
        """Whether each case failed, shape (X, C)."""
        failed: NDArray[np.bool_] = self._cube(self.table.failed)[..., self._own]
        return failed

    def marked(self) -> dict[str, NDArray[np.bool_]]:
        """Return which cases have each property that the study marks, shape (X, C)."""
        found = {}
        with np.errstate(invalid="ignore"):
            for name, formula in self.asked.marked.items():
                found[name] = np.asarray(evaluated(formula, self.values), dtype=bool)
        return found

    @cached_property
    def _own(self) -> int:
        """Place of the scene's own value along `by`; the middle one if it is not among them."""
        if self.by is None:
            return 0
        own, values = value_at(self.scene.settings, self.by.varied.key, None), self.by.varied.values
        return values.index(own) if own in values else len(values) // 2

    @property
    def own(self) -> str:
        """Value of `by` for the curves that are not at equal figures."""
        return "" if self.by is None else f"{self.by.words} {self.by.told(self._own)}"

    def _cube(self, column: NDArray[Any]) -> NDArray[Any]:
        """Return a column of the table along x, the second axis, and `by`; each of length 1 if there is none."""
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
