"""Settings of the training of a policy: the scene, the durations and the number of worms."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from scenes.language.errors import SceneError
from scenes.studies.learn.named import named
from worm3d.values import arguments


@dataclass(frozen=True, eq=False)
class Task:
    """Settings of the training of a policy.

    If the scene is the name of an environment, such as "worm3d/Slope-v0", the task has its scene, and its overrides and
    varied keys in addition to the given ones.

    Raises
    ------
    SceneError
        A duration is not above 0, or the seed is below 0.
    """

    scene: str
    minutes: float
    """Duration of the training with the worm of the scene [min of wall time]."""
    practice: float = 0.0
    """Duration of the training in the reduced model of `scenes.studies.learn.practice`, which comes first [min of wall
    time]. It must be 0 unless `acts` is "course"."""
    seed: int = 0
    overrides: Sequence[str] = ()
    """Changes of the scene, each of the form `section.key=value`."""
    vary: Mapping[str, str] = field(default_factory=dict)
    """Keys that have a random value in each episode, with their ranges; see `scenes.gym_env.WormEnv`."""
    worms: int = 16
    """Number of worms of the scene that are trained at once."""
    threads: int = 1
    acts: str = "course"
    """Meaning of an action, "course" or "wave"; see `scenes.gym_env.WormEnv`."""

    def __post_init__(self) -> None:
        try:
            arguments.number("minutes", self.minutes, "min", gt=0.0)
            arguments.number("practice", self.practice, "min", ge=0.0)
            arguments.whole("seed", self.seed, ge=0)
        except ValueError as error:
            raise SceneError(str(error)) from error
        found = named(self.scene)
        if found is not None:
            object.__setattr__(self, "scene", found.scene)
            object.__setattr__(self, "overrides", (*found.overrides, *self.overrides))
            object.__setattr__(self, "vary", {**found.vary, **self.vary})
