"""Task of the training of a policy: the scene, the durations and the number of worms."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from scenes.language.errors import SceneError
from worm3d.values import arguments


@dataclass(frozen=True, eq=False)
class Task:
    """Task of the training, and its duration.

    Raises
    ------
    SceneError
        A duration is not above 0, or the seed is below 0.
    """

    scene: str
    minutes: float
    """Wall time with the worm of the scene."""
    practice: float = 0.0
    """Wall time [min] of prior practice in a reduced model (`practice` beside this file); for actions by "course"."""
    seed: int = 0
    overrides: Sequence[str] = ()
    vary: Mapping[str, str] = field(default_factory=dict)
    worms: int = 16
    threads: int = 1
    acts: str = "course"

    def __post_init__(self) -> None:
        try:
            arguments.number("minutes", self.minutes, "min", gt=0.0)
            arguments.number("practice", self.practice, "min", ge=0.0)
            arguments.whole("seed", self.seed, ge=0)
        except ValueError as error:
            raise SceneError(str(error)) from error
