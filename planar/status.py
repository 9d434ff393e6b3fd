"""How a planar run ended: an enumeration whose values are sentences for the user."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class Status(Enum):
    """How a run ended; the value is a sentence for the user."""

    DONE = "the run reached its end"
    INTERRUPTED = "the run was interrupted; the steps computed so far are kept"
    NOT_FINITE = "the state became infinite or not a number; the steps before are kept"
    SINGULAR = "Newton's matrix is singular; the steps before are kept"
    NO_CONVERGENCE = "Newton did not converge, not even with a 64th of the time step; the steps before are kept"
    UNSETTLED = (
        "the worm could not be brought to rest on the ground before the run: it is too soft, or its joints are too "
        "weak for its weight"
    )
    FLATTENED = "the rhombus of a segment was pressed flat (limit point); the steps before are kept"
    OUTSIDE = (
        "a segment left the domain of the segment law, which has no such lengths or contractions; the steps before are "
        "kept"
    )
    FOLDED = "two neighbouring segments folded by 90 degrees or more; the steps before are kept"
    SUNK = "a joint came down to the ground, where only apexes can stand; the steps before are kept"
    BAD_COMMAND = (
        "the gait or the external force returned an invalid value, must be one finite value per segment (contractions "
        "below 1); the steps before are kept"
    )

    @property
    def diverged(self) -> bool:
        """Whether the run stopped early because of a failure, and not because it was done or interrupted."""
        return self not in (Status.DONE, Status.INTERRUPTED)


@dataclass(frozen=True)
class Stop:
    """When, where and why a run ended."""

    status: Status
    step: int
    """Number of the last step that was attempted; the number of finished steps if the run is done."""
    time: float
    """Time at the end of this step [s]."""
    residual: float
    """Norm of the residual force in the last tested iterate of Newton's method, without the constrained directions
    [N]."""
    segment: int
    """Number of the segment with the largest residual, 0 at the tail."""

    @property
    def sentence(self) -> str:
        """How the run ended; after a failure also when and where. One line."""
        if not self.status.diverged:
            return self.status.value
        return (
            f"{self.status.value} (step {self.step}, t = {self.time:.4g} s, residual {self.residual:.3g} N, "
            f"worst in segment {self.segment})"
        )
