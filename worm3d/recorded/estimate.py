"""Estimated errors of a run with the option `accuracy`."""

from __future__ import annotations

from dataclasses import dataclass, field, fields

import numpy as np

from worm3d.values.documented import with_fields


@with_fields
@dataclass(frozen=True)
class ErrorEstimate:
    """Estimated errors of a run with the option `accuracy`, by comparison with runs with coarser time steps."""

    distance: float
    """Error of the distance, or of the displacement of the centre of mass if the worm has no heading [m]."""
    heading: float
    """Error of the change of the heading from start to end [rad]; NaN if the worm has no heading."""
    work: float
    """Error of the net work of the actuators [J]."""
    asked: float
    """Requested error of the distance: accuracy times the larger of |distance| and a tenth of the body length [m]."""
    step_error: float
    """Maximum error per time step [m]; the run chooses its time steps so that the estimated error is below it."""
    steps: int
    """Number of time steps solved in this run."""
    runs: int
    """Total number of runs, including the runs with coarser steps."""
    figures: tuple[tuple[str, float], ...] = field(default=(), repr=False)
    """Name and estimated error of each number in the summary, in the unit of the number."""

    def __add__(self, rest: ErrorEstimate) -> ErrorEstimate:
        """Return the estimate for a run followed by its continuation.

        All fields are summed, except two: `step_error` is the larger of both values, and `figures` is empty.
        """
        both = {each.name: getattr(self, each.name) + getattr(rest, each.name) for each in fields(self)}
        return ErrorEstimate(**both | {"step_error": max(self.step_error, rest.step_error), "figures": ()})

    @property
    def met(self) -> bool:
        """Whether the estimated error of the distance is at most the requested error."""
        return self.distance <= self.asked

    @property
    def sentence(self) -> str:
        """One line with the estimated errors, and whether the requested accuracy is reached."""
        found = (
            f"distance {1e3 * self.distance:.2g} mm, turn {np.rad2deg(self.heading):.2g} deg, work {self.work:.2g} J"
        )
        missed = "" if self.met else "; NOT as accurate as requested"
        return f"estimated errors: {found} ({1e3 * self.asked:.2g} mm requested for the distance{missed})"
