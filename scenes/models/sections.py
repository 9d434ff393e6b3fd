"""Sections that are used in the scenes of several models."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

from control.gaits import Gait
from control.parts import GAIT
from scenes.language.parts import Keys, keys_of, meanings, part_named
from scenes.language.schema import Section, setting

WAVE = "travelling_wave"

BODY_BOUNDS: Mapping[str, Mapping[str, float]] = {"segments": {"ge": 1, "le": 200}, "length": {"gt": 0, "le": 100}}
"""Ranges of parameters of the body, which are narrower in a scene than in Python."""


class Run(Section):
    """Duration and time step of a run, and which steps are stored."""

    duration_s: float = setting(
        10.0, unit="s", gt=0, meaning="simulated time, rounded to whole steps", aka=("time_s", "t_end_s")
    )
    dt_s: float = setting(0.01, unit="s", gt=0, meaning="time step", aka=("step_s", "time_step_s"))
    record_every: int = setting(
        1, ge=1, meaning="store the state after every so many steps, a divisor of their number", aka=("every",)
    )

    @property
    def steps(self) -> int:
        """Number of time steps."""
        return max(1, round(self.duration_s / self.dt_s))


def gait_keys(registry: Mapping[str, Any], without: Collection[str] = (), **defaults: Any) -> Keys:
    """Return the keys of the gaits in a registry.

    The parameters `without` and the length of an impulse have no key; an impulse lasts one time step (`gait_from`). The
    default gait is the paper's wave. If the default of a key differs between gaits, it is that of the chosen gait.
    """
    return keys_of(
        {WAVE: registry[WAVE], **registry} if WAVE in registry else registry,
        by="kind",
        meaning=f"pattern of contraction; {meanings(registry)}",
        without=("impulse", *without),
        defaults=defaults,
        own_defaults=True,
        own=True,
        bounds={"amplitude": {"ge": 0, "lt": 1}, "hinge": {"gt": -180, "lt": 180}, "waves": {"ge": 0}},
    )


def planar_gait_keys(registry: Mapping[str, Any], without: Collection[str] = (), **defaults: Any) -> Keys:
    """Return the keys of gaits for a worm that cannot turn; the parameters `without` have no key."""
    turning = {name for gait in registry.values() for name in getattr(gait, "turning", ())}
    return gait_keys(registry, (*turning, *without), **defaults)


def gait_from(section: Any, dt: float, **given: Any) -> Gait:
    """Return the gait of a section; `given` are parameters that are not in the section, and dt is the time step [s]."""
    gait: Gait = part_named(GAIT, section.kind, section, impulse=dt, **given)
    return gait


class Settings(Section):
    """Keys of every scene; the schema of a model adds sections."""

    model: str = setting(meaning="which simulation the scene is for")
    title: str = setting("", meaning="name of the scene for people")
    says: str = setting("", meaning="description in one line, which `worm3d list` prints")
    seed: int = setting(0, ge=0, le=2**63 - 1, meaning="seed of all random numbers")
    run: Run = Run()

    @property
    def steps(self) -> int:
        """Total number of time steps in the scene."""
        return self.run.steps
