"""Estimated errors of a run with a requested `accuracy`."""

from __future__ import annotations

from dataclasses import dataclass, field, fields

import numpy as np

from worm3d.values.documented import with_fields


@with_fields
@dataclass(frozen=True)
class ErrorEstimate:
    """Expected errors of a run with a requested `accuracy`, estimated by comparison with runs with coarser steps."""

    distance: float
    """Error of the distance [m], or of the displacement of the centre of mass if there is no heading."""
    heading: float
    """Error of the turn from start to end [rad]; NaN without a heading."""
    work: float
    """Error of the net work of the actuators [J]."""
    asked: float
    """Requested error of the distance: `accuracy` times the larger of |distance| and a tenth of the body length [m]."""
    step_error: float
    """Limit of the estimated error of each step of this run [m]."""
    steps: int
    """Number of steps solved in this run."""
    runs: int
    """Number of runs, including the coarser runs."""
    figures: tuple[tuple[str, float], ...] = field(default=(), repr=False)
    """Name and estimated error of each number in the summary, in the unit of the number."""

    def __add__(self, rest: ErrorEstimate) -> ErrorEstimate:
        """Return the estimate for a run followed by its continuation, without `figures`."""
        both = {each.name: getattr(self, each.name) + getattr(rest, each.name) for each in fields(self)}
        return ErrorEstimate(**both | {"step_error": max(self.step_error, rest.step_error), "figures": ()})

    @property
    def met(self) -> bool:
        """Whether the distance has the requested accuracy."""
        return self.distance <= self.asked

    @property
    def sentence(self) -> str:
        """A line with the estimated errors, which says whether the requested accuracy is reached."""
        found = (
            f"{1e3 * self.distance:.2g} mm, turn by {np.rad2deg(self.heading):.2g} degrees, work by {self.work:.2g} J"
        )
        missed = "" if self.met else "; NOT as accurate as asked"
        return f"distance may be off by {found} ({1e3 * self.asked:.2g} mm asked{missed})"
