"""The card of an optimised gait: the gain, the uses of the work, and how much is left under other conditions."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

import worm3d
from control.gaits.periodic import Periodic
from scenes.language.parts import key_of
from scenes.language.toml import value as toml_value
from scenes.records.text import Column
from scenes.running.report import Block, Heading, Items, Picture, Table
from scenes.running.terminal import USES, counted
from scenes.studies.optimise.goals import MOST_ROLL
from scenes.studies.optimise.search import Found
from scenes.studies.optimise.trials import AS_IT_IS, SURE_WAVES, Ground, Trials
from worm3d.running.accuracy import begin
from worm3d.running.problem import Problem
from worm3d.values.parameters import parameters_of

ACCURACY, CONFIRMED = 0.002, 0.05
"""Accuracy of the run that confirms the gain, and greatest relative difference of the value."""
SLOWER, GLIDES = 4.0, 0.85
"""Factor of the period of the run that shows gliding, and least share of the value in a wave of a gait that does not
glide. Inertia carries a gliding worm while the anchors slip."""
SKIPPED_SHOWN = 3
"""Number of reasons for skipped candidates in a card."""
PERIOD, HALF, WEAK = "four times the period", "half the friction", "a quarter of the friction backward and sideways"


@dataclass(frozen=True)
class Condition:
    """Conditions that differ from the scene."""

    name: str
    ground: Ground = AS_IT_IS
    mass: float = 1.0
    """Factor of the mass."""
    period: float = 1.0
    """Factor of the period."""
    waves: int = SURE_WAVES

    def problem(self, trials: Trials, gait: Any, base: Problem) -> Problem:
        """Return a run of a gait under the conditions."""
        heavy = replace(base, worm=replace(base.worm, mass=self.mass * base.worm.mass)) if self.mass != 1.0 else base
        slow = replace(gait, period=self.period * gait.period)
        return trials.problem(slow, self.waves, self.ground, heavy)


CONDITIONS = (
    Condition("as searched"),
    Condition(PERIOD, period=SLOWER),
    Condition(HALF, Ground("", 0.5, 0.5)),
    Condition("double the friction", Ground("", 2.0, 2.0)),
    Condition(WEAK, Ground("", 1.0, 0.25)),
    Condition("three times the friction forward", Ground("", 3.0, 1.0)),
    Condition("a mass 20 % less", mass=0.8),
    Condition("a mass 20 % more", mass=1.2),
    Condition(f"{2 * SURE_WAVES} waves", waves=2 * SURE_WAVES),
)
"""Conditions in the table of a card."""


@dataclass(frozen=True)
class Left:
    """Values of the goal in a wave under some conditions."""

    name: str
    value: float
    """Value of the optimised gait; NaN if the run did not end."""
    kept: float
    """Share of the gait's own value as searched."""
    simple: float
    """Value of the best simple gait."""
    roll: float
    """Greatest roll of the optimised gait [deg]."""
    slip: float
    """Distance that anchors slide per metre."""


LEFT_COLUMNS = {
    "conditions": Column("name"),
    "value in a wave": Column("value", ".4g", none="-"),
    "kept": Column("kept", ".0f", 100.0, none="-"),
    "best simple gait": Column("simple", ".4g", none="-"),
    "greatest roll [deg]": Column("roll", ".1f", none="-"),
    "slip [m/m]": Column("slip", ".3g", none="-"),
}


class Card:
    """Measurements of an optimised gait."""

    def __init__(self, trials: Trials, found: Sequence[Found]) -> None:
        self.trials, self.found = trials, tuple(found)
        self.best = min(found, key=lambda each: each.best.score.cost)
        self.first = min(found, key=lambda each: each.simple.score.cost)
        self.choice = trials.space.choice(self.best.best.at)
        simple = trials.space.choice(self.first.simple.at)
        self._base, self._simple_base = trials.base_of(self.choice), trials.base_of(simple)
        self.gait: Periodic = trials.gait_of(self.choice, self._base)
        """The optimised gait."""
        self._simple = trials.gait_of(simple, self._simple_base)

    @property
    def value(self) -> float:
        """Value of the goal with the optimised gait."""
        return self.best.best.score.value

    @property
    def simple_value(self) -> float:
        """Value of the goal with the best simple gait."""
        return self.first.simple.score.value

    @property
    def gain(self) -> float:
        """How much better the optimised gait is than the best simple gait, as a ratio."""
        return self.trials.goal.gain(self.value, self.simple_value)

    def measure(self, tell: Callable[[int], None] = lambda done: None) -> list[Left]:
        """Return the values under each condition; `tell` is called with the number of finished conditions."""
        rows = list[Left]()
        for done, condition in enumerate(CONDITIONS, start=1):
            own = _run(condition.problem(self.trials, self.gait, self._base))
            simple = _run(condition.problem(self.trials, self._simple, self._simple_base))
            value = self._in_a_wave(own, condition)
            first = rows[0].value if rows else value
            kept = first / value if self.trials.goal.smallest else value / first
            roll, slip = (_measured(own, name) for name in ("roll_max_deg", "slip_per_metre"))
            rows.append(Left(condition.name, value, kept, self._in_a_wave(simple, condition), roll, slip))
            tell(done)
        return rows

    def _in_a_wave(self, result: worm3d.Result | None, condition: Condition) -> float:
        if result is None or result.status is not worm3d.Status.DONE:
            return math.nan
        value = self.trials.goal.value(result)
        return value * condition.period * self.gait.period if self.trials.goal.is_rate else value

    @cached_property
    def confirmed(self) -> worm3d.Result | None:
        """Run of the gait with the accuracy `ACCURACY`."""
        return _run(replace(self.trials.problem(self.gait, SURE_WAVES, base=self._base), accuracy=ACCURACY))

    def blocks(self, rows: Sequence[Left], seconds: float) -> Iterator[Block]:
        """Yield the card."""
        trials, goal = self.trials, self.trials.goal
        own, simple, best = trials.own_value, self.simple_value, self.value
        yield Heading(f"The best gait for {trials.scene.name}: {goal.name}", 1)
        yield f"Goal: {goal.meaning}{_limits(goal.limits)}."
        runs = ", ".join(
            f"seed {each.seed}: {each.best.score.value:.4g} after {len(each.costs)} runs ({each.why})"
            for each in self.found
        )
        yield Table(
            ("gait", "value", "over the best simple gait"),
            (
                ("of the scene", f"{own:.4g}", f"{goal.gain(own, simple):.3f}"),
                ("best simple gait", f"{simple:.4g}", "1.000"),
                ("optimised", f"{best:.4g}", f"{self.gain:.3f}"),
            ),
        )
        yield f"Searches of {seconds:.0f} s together: {runs}."
        if skipped := sum((Counter(each.skipped) for each in self.found), Counter[str]()):
            told = "; ".join(f"{counted(number, 'time')}: {why}" for why, number in skipped.most_common(SKIPPED_SHOWN))
            yield f"Skipped candidates: {skipped.total()}. {told}."
        yield from self.verdicts(rows)
        yield Heading("The gait")
        yield Picture("gait.png", "The activations of the chambers over a period, and the progress of the search.")
        if self.choice.changes:
            yield f"Keys of the scene: {', '.join(self.choice.changes)}."
        yield (
            'The folder `best` has a run of the gait with a film, `viewer.html`. The key `gait = "gait.toml"` of a '
            "scene takes the gait."
        )
        yield Heading("What is left under other conditions")
        yield Table.of(LEFT_COLUMNS, rows)
        yield (
            'The column "kept" is in percent of the value as searched. The values in a wave are from runs of six waves,'
            " with the goal as the measure. There is no row for noise of sensors, since the gait uses no sensors."
        )
        if (result := self.confirmed) is not None:
            yield Heading("Where the work goes")
            yield Table(("use", "work over weight and distance"), list(_work(result)))

    def verdicts(self, rows: Sequence[Left]) -> Iterator[Block]:
        """Yield the verdicts."""
        yield Heading("Whether to believe it")
        yield Items([self.confirmation(rows[0]), *self.verdict_sentences(rows)])

    def verdict_sentences(self, rows: Sequence[Left]) -> Iterator[str]:
        """Yield a sentence for each reason to doubt the gait, or a sentence if there is no reason.

        A run that ends early counts as tipping over.
        """
        by_name = {row.name: row for row in rows}
        found = list[str]()
        if by_name[PERIOD].kept < GLIDES:
            found.append(
                f"**glides**: at {PERIOD} {by_name[PERIOD].kept:.0%} of the value in a wave is left, less than "
                f"{GLIDES:.0%}"
            )
        weak, simple = by_name[WEAK].value, by_name[WEAK].simple
        if self.trials.goal.gain(weak, simple) < 1.0 or weak <= 0.0:
            found.append(
                f"**needs anisotropy**: with {WEAK} the value is {weak:.3g}, the best simple gait has {simple:.3g}"
            )
        if by_name[HALF].value <= 0.0:
            found.append(f"**slides back on less friction**: with {HALF} the value is {by_name[HALF].value:.3g}")
        tips = [row.name for row in rows if not row.roll <= MOST_ROLL]
        if tips:
            found.append(
                f"**tips**: the worm rolls by more than {MOST_ROLL:g} degrees, or the run ends, with {', '.join(tips)}"
            )
        yield from found or ["none of the rules for gliding, anisotropy, sliding back and tipping applies"]

    def confirmation(self, first: Left) -> str:
        """Return the sentence whether an accurate run has the value of the first condition."""
        result = self.confirmed
        if result is None or result.status is not worm3d.Status.DONE:
            return f"**not confirmed**: the run with the accuracy {ACCURACY} did not end"
        value, error = self._in_a_wave(result, CONDITIONS[0]), result.error_estimate
        differs = abs(value - first.value) / abs(first.value)
        met = error is not None and error.met
        word = "confirmed" if differs <= CONFIRMED and met else "**not confirmed**"
        return (
            f"{word}: a run with the accuracy {ACCURACY} has the value {value:.4g} in a wave, {differs:.1%} off; its "
            f"estimated error is {'as asked' if met else 'larger than asked'}"
        )


def _run(problem: Problem) -> worm3d.Result | None:
    """Return the result of a run, or None if the run cannot begin."""
    try:
        return begin(problem)()
    except ValueError:
        return None


def _measured(result: worm3d.Result | None, name: str) -> float:
    if result is None or result.status is not worm3d.Status.DONE:
        return math.nan
    value, _ = worm3d.measures.MEASURES[name](result)
    return value if isinstance(value, float) else math.nan


def _limits(limits: Sequence[object]) -> str:
    return f", with {' and '.join(map(str, limits))}" if limits else ""


def _work(result: worm3d.Result) -> Iterator[tuple[str, str]]:
    summary = result.summary()
    for use in USES:
        value = summary[f"cost_of_transport_{use}"]
        if isinstance(value, float) and value:
            yield use, f"{value:.3g}"
    total = summary["cost_of_transport"]
    yield "all", f"{total:.3g}" if isinstance(total, float) else "-"


def fragment(gait: Periodic, title: str, changes: Sequence[str]) -> str:
    """Return the section [gait] as TOML, with comments about the origin."""
    known = parameters_of(type(gait))
    lines = [f"# {title}", *(f"# with {change}" for change in changes), "", "[gait]", f'kind = "{gait.name}"']
    for name in ("amplitude", "period", "waves", "phase", "duty", "sharpness", "weight"):
        number = np.asarray(getattr(gait, name), dtype=float).tolist()
        lines.append(f"{key_of(known[name])} = {toml_value(number)}")
    return "\n".join(lines) + "\n"
