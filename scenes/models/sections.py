"""Sections that the scenes of several models share."""

from __future__ import annotations

from typing import Literal

from control import gaits
from scenes.language.schema import Section, quantity, setting

LARGEST_SEED = 2**63 - 1

WAVE, SEGMENTS, TWO_ANCHOR = "travelling_wave", "segment_driven", "two_anchor"

_SEGMENTS = gaits.ContractionEngine_segmentdriven()
_TWO_ANCHOR = gaits.TwoAnchor()


class Run(Section):
    """How long, in what steps, and how much of it is stored."""

    duration_s: float = quantity(
        10.0, unit="s", gt=0, title="simulated time, rounded to whole steps", aka=("time_s", "t_end_s")
    )
    dt_s: float = quantity(0.01, unit="s", gt=0, title="time step", aka=("step_s", "time_step_s"))
    record_every: int = quantity(
        1, ge=1, title="store the state after every so many steps, a divisor of their number", aka=("every",)
    )

    @property
    def steps(self) -> int:
        """Number of time steps."""
        return max(1, round(self.duration_s / self.dt_s))


class Gait(Section):
    """A pattern of contraction: a travelling wave or segment after segment (the paper's two schemes), or two anchors.

    A model adds how strong it is, and the length of the wave in its unit.
    """

    kind: Literal["travelling_wave", "segment_driven", "two_anchor"] = setting(
        "travelling_wave",
        title="the wave A = sin(kx - wt), one segment after the other, or (in pipes) two anchors in turn",
        aka=("type",),
    )
    period_s: float = quantity(
        2.0, unit="s", gt=0, title="T_wave: time between two contractions of a segment", aka=("T_wave_s",)
    )
    direction: Literal["direct", "retrograde", "standing"] = setting(
        "retrograde", title="direct runs tail to head, retrograde head to tail; standing: travelling_wave only"
    )
    rectified: bool = setting(True, only=WAVE, title="whether segments contract, never lengthen")
    contract_time_s: float = quantity(
        _SEGMENTS.T_contract,
        unit="s",
        gt=0,
        only=SEGMENTS,
        title="T_contract, duration of a contraction",
    )
    pulse: Literal["gaussian", "square", "dirac"] = setting(
        _SEGMENTS.contractType,
        only=SEGMENTS,
        title="shape of a contraction (dirac: one time step)",
    )
    alternating: bool = setting(_SEGMENTS.alternating, only=SEGMENTS, title="whether odd segments lengthen instead")
    extension: float = quantity(
        _TWO_ANCHOR.extension,
        ge=-1,
        le=0,
        only=TWO_ANCHOR,
        title="activation of an extended segment, -0.5 lengthens it by half the amplitude",
    )
    anchors: int = quantity(_TWO_ANCHOR.anchors, ge=1, only=TWO_ANCHOR, title="segments of each anchor")


class Settings(Section):
    """What every scene has, whatever its model; a model's schema adds sections."""

    model: str = setting(title="which simulation the scene is for")
    title: str = setting("", title="name of the scene for people")
    says: str = setting("", title="what to look for, in one line; `worm3d list` prints it")
    seed: int = quantity(0, ge=0, le=LARGEST_SEED, title="seed of everything random")
    run: Run = Run()

    @property
    def steps(self) -> int:
        """Number of time steps of all that the scene runs."""
        return self.run.steps
