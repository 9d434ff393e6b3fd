"""Estimated errors of a run that was given an `accuracy`."""

from __future__ import annotations

from dataclasses import dataclass, field, fields

import numpy as np

from worm3d.values.documented import with_fields


@with_fields
@dataclass(frozen=True)
class ErrorEstimate:
    """How far a run with an `accuracy` is expected to be off, from runs with coarser steps."""

    distance: float
    """Error of the distance [m]; of the way of the centre of mass where there is no heading."""
    heading: float
    """Error of the turn from start to end [rad]; NaN without a heading."""
    work: float
    """Error of the net work of the actuators [J]."""
    asked: float
    """Error of the distance that was asked for: accuracy times the distance, or a tenth of the body length [m]."""
    step_error: float
    """Estimated error that was allowed in a step of this run [m]."""
    steps: int
    """Steps that were solved in this run, and `runs` in all."""
    runs: int
    figures: tuple[tuple[str, float], ...] = field(default=(), repr=False)
    """Name and error of each number of the summary, in the unit of the number."""

    def __add__(self, rest: ErrorEstimate) -> ErrorEstimate:
        """Return the estimate of a run and another that went on from its end; it has no `figures`."""
        both = {each.name: getattr(self, each.name) + getattr(rest, each.name) for each in fields(self)}
        return ErrorEstimate(**both | {"step_error": max(self.step_error, rest.step_error), "figures": ()})

    @property
    def met(self) -> bool:
        """Whether the distance is as accurate as was asked for."""
        return self.distance <= self.asked

    @property
    def sentence(self) -> str:
        """One line: what may be off by how much, and whether that was asked for."""
        found = (
            f"{1e3 * self.distance:.2g} mm, turn by {np.rad2deg(self.heading):.2g} degrees, work by {self.work:.2g} J"
        )
        missed = "" if self.met else "; NOT as accurate as asked"
        return f"distance may be off by {found} ({1e3 * self.asked:.2g} mm asked{missed})"
