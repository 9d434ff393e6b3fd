"""Runs of candidates: gaits on the worm and the ground of a scene, and their costs for a goal."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

import worm3d
from control.gaits.gait import Gait
from control.gaits.periodic import Periodic
from scenes.language.errors import SceneError
from scenes.models.loading import Scene, load_scene
from scenes.models.worm.build import gait_of, problem_of
from scenes.models.worm.schema import WormScene
from scenes.studies.optimise.goals import BROKEN, FAILED, Goal
from scenes.studies.optimise.unknowns import Choice, Free, Space
from worm3d.running.problem import Problem

WAVES, SURE_WAVES = 2, 6
"""Waves of a run, of which the second half counts, and waves of a repeated run. Of a worm that is tipping over, the
first two waves say nothing about the later ones."""
ROLLS, SETTLES_SLOWLY = 0.5, 0.5
"""A run is repeated with more waves if the roll is above this share of the greatest roll of a limit, or if the shape
changes between the two waves by more than this share of the change before."""
GAIT_KEYS = ("gait.amplitude", "gait.period_s")
"""Keys of the section [gait] that can be searched. All others belong to the shape of a gait."""
UNREACHED = 0.01
"""Least value by which the values of other gaits on a ground are divided, relative to the value of the gait of the
scene on its own ground."""


class Ground(NamedTuple):
    """Factors of the coefficients of friction of a scene."""

    name: str
    forward: float = 1.0
    anchoring: float = 1.0
    """Factor of the coefficients backward and lateral."""

    def of(self, friction: worm3d.Friction) -> worm3d.Friction:
        """Return friction with the factors."""
        factors = {"forward": self.forward, "backward": self.anchoring, "lateral": self.anchoring}
        given: Any = {name: factor * np.asarray(getattr(friction, name)) for name, factor in factors.items()}
        return replace(friction, **given)


AS_IT_IS = Ground("the ground of the scene")
GROUNDS = (AS_IT_IS, Ground("half the friction", 0.5, 0.5), Ground("a quarter of the anchoring", 1.0, 0.25))
"""Grounds of a robust goal."""


@dataclass(frozen=True)
class Score:
    """Result of a candidate."""

    cost: float
    """Number that the search makes small."""
    value: float
    """Value of the goal; NaN if the run has none."""


class Trials:
    """Runs of candidates in a scene.

    Raises
    ------
    SceneError
        The scene is wrong, or does not have a 3D worm with a periodic gait.
    """

    def __init__(self, scene: str, overrides: Sequence[str], goal: Goal, free: Sequence[Free] = ()) -> None:
        self.scene: Scene = load_scene(scene, overrides)
        settings = self.scene.settings
        if not isinstance(settings, WormScene):
            raise SceneError(
                f"{scene}: must be a scene of the model 'worm', with a gait; is of {self.scene.model.name!r}"
            )
        self.goal, self._source, self._overrides = goal, scene, tuple(overrides)
        self.base = problem_of(settings)
        own = gait_of(settings)
        period = getattr(own, "period", None)
        if period is None or not isinstance(own, Gait):
            raise SceneError(f"{scene}: its gait has no period; choose a periodic one, such as travelling_wave")
        if wrong := [each.key for each in free if each.key.startswith("gait.") and each.key not in GAIT_KEYS]:
            raise SceneError(f"--over: got '{wrong[0]}', must be {' or '.join(GAIT_KEYS)}, or a key of another section")
        self.space = Space(self.base.worm.segments, own.amplitude, float(period), goal.turns, tuple(free))

    @property
    def settings(self) -> dict[str, Any]:
        """Scene, goal, limits and free keys, which determine the scores."""
        limits, free = list(map(str, self.goal.limits)), list(map(str, self.space.free))
        return {"scene": self.scene.to_toml(), "goal": self.goal.name, "limits": limits, "over": free}

    @cached_property
    def own(self) -> tuple[float, ...]:
        """Values of the goal with the gait of the scene on the grounds of the goal."""
        problems = [self.problem(self.base.actuation, SURE_WAVES, ground) for ground in self.grounds]
        return tuple(math.nan if each is None else self.goal.value(each) for each in self._results(problems))

    @property
    def own_value(self) -> float:
        """Value of the goal with the gait of the scene; 1 for a robust goal."""
        return 1.0 if self.goal.robust else self.own[0]

    def require_value(self) -> None:
        """Raise SceneError if the goal has no value in a run of the scene, or a free key cannot be changed."""
        problem = self.problem(self.base.actuation, SURE_WAVES)
        (result,) = self._results([problem])
        if result is None or result.status is not worm3d.Status.DONE:
            raise SceneError(
                f"{self.scene.name}: the gait of the scene does not run for {SURE_WAVES} waves; mend it first"
            )
        value, reason = self.goal.measure(result)
        if value is None:
            raise SceneError(f"--goal: '{self.goal.name}' has no value in {self.scene.name}: {reason}")
        for end in (0.0, 1.0):
            self._changed(self.space.changes(np.full(len(self.space.free), end)))

    @property
    def grounds(self) -> tuple[Ground, ...]:
        """Grounds of the goal."""
        return GROUNDS if self.goal.robust else (AS_IT_IS,)

    def problem(self, gait: Any, waves: float, ground: Ground = AS_IT_IS, base: Problem | None = None) -> Problem:
        """Return a run of a gait for a number of waves."""
        base = base or self.base
        period = float(gait.period)
        steps = max(1, round(waves * period / base.dt))
        return replace(
            base,
            actuation=gait,
            ground=ground.of(base.friction),
            duration=steps * base.dt,
            record_every=1,
        )

    def scores(self, choices: Sequence[Choice]) -> list[Score]:
        """Return the scores of candidates."""
        bases = [self._base_or_none(each) for each in choices]
        given = [(self.gait_of(each, base), base) for each, base in zip(choices, bases, strict=True)]
        first = self._scored(given, WAVES)
        again = [k for k, (_, unsure) in enumerate(first) if unsure]
        scores = [score for score, _ in first]
        sure = self._scored([given[k] for k in again], SURE_WAVES)
        for k, (score, _) in zip(again, sure, strict=True):
            scores[k] = score
        return scores

    def gait_of(self, choice: Choice, base: Problem | None) -> Periodic:
        """Return the gait of a candidate with amplitude and period of the scene with the changes of the candidate."""
        own: Any = self.base.actuation if base is None else base.actuation
        return replace(choice.gait, amplitude=own.amplitude, period=own.period)

    def base_of(self, choice: Choice) -> Problem:
        """Return the run of the scene with the changes of a candidate; SceneError if the scene is impossible."""
        return self._changed(choice.changes)

    def _changed(self, changes: Sequence[str]) -> Problem:
        return problem_of(load_scene(self._source, (*self._overrides, *changes)).settings) if changes else self.base

    def _base_or_none(self, choice: Choice) -> Problem | None:
        try:
            return self.base_of(choice)
        except (SceneError, ValueError):
            return None

    def _scored(self, given: Sequence[tuple[Any, Problem | None]], waves: int) -> list[tuple[Score, bool]]:
        """Return the score of each gait, and whether more waves are needed to be sure."""
        problems = [
            self.problem(gait, waves, ground, base)
            for gait, base in given
            if base is not None
            for ground in self.grounds
        ]
        results = iter(self._results(problems))
        found = []
        for _, base in given:
            own = [next(results) for _ in self.grounds] if base is not None else []
            found.append((self._score(own), any(map(self._is_unsure, own))))
        return found

    def _results(self, problems: Sequence[Problem]) -> list[worm3d.Result | None]:
        """Return the results of runs, or None for a run that cannot begin."""
        if not problems:
            return []
        one, each = problems[0], ("worm", "world", "ground", "actuation", "external_force", "state")
        alike = ("dt", "duration", "integrator", "settle_first", "tolerance", "accuracy", "gravity")
        if not all(np.array_equal(getattr(p, name), getattr(one, name)) for p in problems for name in alike):
            return [result for problem in problems for result in self._results([problem])]
        given: Any = {name: [getattr(problem, name) for problem in problems] for name in each}
        given |= {name: getattr(one, name) for name in alike}
        try:
            return list(worm3d.simulate_batch(**given, threads=os.cpu_count() or 1))
        except ValueError:
            if len(problems) == 1:
                return [None]
            return [result for problem in problems for result in self._results([problem])]

    def _score(self, results: Sequence[worm3d.Result | None]) -> Score:
        ended = [each for each in results if each is not None and each.status is worm3d.Status.DONE]
        if not ended or len(ended) < len(results):
            return Score(FAILED, math.nan)
        values = [self.goal.value(each) for each in ended]
        if self.goal.robust:
            least = UNREACHED * abs(self.own[0])
            values = [value / max(own, least) for value, own in zip(values, self.own, strict=True)]
        value = max(values) if self.goal.smallest else min(values)
        if math.isnan(value) or any(map(math.isnan, values)):
            return Score(FAILED, math.nan)
        violation = max(self.goal.violation(each) for each in ended)
        broken = min(BROKEN + violation, FAILED) if violation else 0.0
        return Score(broken or (value if self.goal.smallest else -value), value)

    def _is_unsure(self, result: worm3d.Result | None) -> bool:
        """Return whether a run is too short to tell how the gait goes on."""
        if result is None or result.status is not worm3d.Status.DONE:
            return False
        rolled = result.rolled.largest
        bound = min((each.bound for each in self.goal.limits if each.measure == "roll_max_deg"), default=math.inf)
        if rolled is not None and math.degrees(rolled) > ROLLS * bound:
            return True
        radius, _ = worm3d.measures.MEASURES["return_map_radius"](result)
        return isinstance(radius, float) and radius > SETTLES_SLOWLY
