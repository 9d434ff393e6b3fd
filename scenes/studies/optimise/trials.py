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
from scenes.language import toml
from scenes.language.errors import SceneError
from scenes.language.overrides import apply_overrides
from scenes.language.schema import key_at
from scenes.models.loading import Scene, draft_of, trusted_scene
from scenes.models.worm.build import gait_of, problem_of
from scenes.models.worm.schema import WormScene
from scenes.studies.optimise.goals import BROKEN, FAILED, Goal
from scenes.studies.optimise.unknowns import Choice, Free, Space
from worm3d.measures import Measure
from worm3d.running.problem import Problem
from worm3d.values.arrays import FloatArray

WAVES, SURE_WAVES = 2, 6
"""Waves of a run, whose second half counts, and waves of a repeated run. If a worm is tipping over, the
first two waves say nothing about the later ones."""
ROLLS, SETTLES_SLOWLY = 0.5, 0.5
"""A run is repeated with more waves if the roll is above this share of the greatest roll of a limit, or if the shape
changes between the two waves by more than this share of the change before."""
GAIT_KEYS = ("gait.amplitude", "gait.period_s")
"""Keys of the section [gait] that can be searched. All others belong to the shape of a gait."""
UNREACHED = 0.01
"""Least divisor of the values of other gaits on a ground, relative to the value of the gait of the
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
    why: str = ""
    """Reason why the candidate has no value."""


class Trials:
    """Runs of candidates in a scene.

    Raises
    ------
    SceneError
        The scene is wrong, or does not have a 3D worm with a periodic gait.
    """

    def __init__(self, scene: str, overrides: Sequence[str], goal: Goal, free: Sequence[Free] = ()) -> None:
        self._draft = draft_of(scene, overrides)
        self.scene: Scene = self._draft.checked()
        settings = self.scene.settings
        if not isinstance(settings, WormScene):
            raise SceneError(
                f"{scene}: must be a scene of the model 'worm', with a gait; is of {self.scene.model.name!r}"
            )
        self.goal = goal
        self.base = problem_of(settings)
        self._data = toml.parse(self.scene.to_toml())
        own = gait_of(settings)
        period = getattr(own, "period", None)
        if period is None or not isinstance(own, Gait):
            raise SceneError(f"{scene}: its gait has no period; choose a periodic one, such as travelling_wave")
        if wrong := [each.key for each in free if each.key.startswith("gait.") and each.key not in GAIT_KEYS]:
            raise SceneError(f"--over: got '{wrong[0]}', must be {' or '.join(GAIT_KEYS)}, or a key of another section")
        keys = [(each, key_at(WormScene, toml.path_of(each.key))) for each in free]
        known = tuple(replace(each, whole=key is not None and key.hint is int) for each, key in keys)
        self.space = Space(self.base.worm.segments, own.amplitude, float(period), goal.turns, known)

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
            self.base_of(self.space.choice(np.full(len(self.space.neighbourly), end)))

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
        return self._allowed(choices, scores)

    def _allowed(self, choices: Sequence[Choice], scores: list[Score]) -> list[Score]:
        """Return the scores, with the best of the candidates replaced until the scene of the best one is valid."""
        for k in sorted(range(len(scores)), key=lambda k: scores[k].cost):
            try:
                self.base_of(choices[k])
                break
            except (SceneError, ValueError) as error:
                scores[k] = Score(FAILED, math.nan, f"impossible scene: {error}")
        return scores

    def measured(self, choices: Sequence[Choice], measures: Sequence[Measure], waves: int = WAVES) -> FloatArray:
        """Return measures of those candidates that break no limit, shape (K, len(measures)); NaN without a value."""
        bases = [self._base_or_none(each) for each in choices]
        runs = [(each, base) for each, base in zip(choices, bases, strict=True) if base is not None]
        results = self._results([self.problem(self.gait_of(each, base), waves, base=base) for each, base in runs])
        valid = [each for each in results if each is not None and self.goal.violation(each) == 0.0]
        values = [[measure(each)[0] for measure in measures] for each in valid]
        return np.array([[x if isinstance(x, float) else math.nan for x in row] for row in values])

    def gait_of(self, choice: Choice, base: Problem | None) -> Periodic:
        """Return the gait of a candidate with amplitude and period of the scene with the changes of the candidate."""
        own: Any = self.base.actuation if base is None else base.actuation
        return replace(choice.gait, amplitude=own.amplitude, period=own.period)

    def base_of(self, choice: Choice) -> Problem:
        """Return the run of the scene with the changes of a candidate; SceneError if the scene is impossible."""
        return problem_of(self._draft.checked(choice.changes).settings) if choice.changes else self.base

    def _base_or_none(self, choice: Choice) -> Problem | None:
        """Return the run of a candidate, or None if it is impossible, without the checks of a scene.

        The checks take as long as the run.
        """
        if not choice.changes:
            return self.base
        data, _, _ = apply_overrides(self._data, choice.changes)
        try:
            return problem_of(trusted_scene(data, self.scene.name).settings)
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
            half = len(problems) // 2
            return [*self._results(problems[:half]), *self._results(problems[half:])] if half else [None]

    def _score(self, results: Sequence[worm3d.Result | None]) -> Score:
        ended = [each for each in results if each is not None and each.status is worm3d.Status.DONE]
        if not ended or len(ended) < len(results):
            status = next((each.status.value for each in results if each and each not in ended), "the run cannot begin")
            return Score(FAILED, math.nan, status)
        values, reasons = zip(*map(self.goal.value_or_why, ended), strict=True)
        if any(reasons):
            return Score(FAILED, math.nan, max(reasons))
        if self.goal.robust:
            least = UNREACHED * abs(self.own[0])
            # `least` comes first, so that it also replaces an own value that is NaN
            values = tuple(value / max(least, own) for value, own in zip(values, self.own, strict=True))
        value = max(values) if self.goal.smallest else min(values)
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
