"""How a run of the 3D worm ended: an enumeration whose value is the sentence to print."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from worm3d.values.documented import with_fields


class Status(Enum):
    """Outcome of a run; the value is a sentence for the user."""

    DONE = "the run reached its end"
    INTERRUPTED = "the run was interrupted; the steps computed so far are kept"
    NOT_FINITE = "the state became infinite or not a number; the steps before are kept"
    NO_CONVERGENCE = "Newton did not converge, not even with a 64th of the time step; the steps before are kept"
    UNSETTLED = (
        "the worm does not come to rest on its world before the run: too soft or too heavy for its joints, or nothing "
        "holds it in a steep place (contract it, or start with settle_first=False)"
    )
    FLATTENED = "a chamber was pressed flat (limit point); the steps before are kept"
    FOLDED = (
        "two neighbouring segments were bent by 90 degrees or more, or asked to bend so far; the steps before are kept"
    )
    SUNK = "a joint was pressed deep into the world; the steps before are kept"
    OUTSIDE = "a chamber left the domain of the segment law, whose table has no such states; the steps before are kept"
    BAD_COMMAND = (
        "the actuation (or the external force) failed, or did not return a Command for as many segments as "
        "the worm has (finite forces of shape (N+1, 3)); the steps before are kept"
    )
    OBSERVER_FAILED = "the observer raised an error; the steps so far are kept"

    @property
    def diverged(self) -> bool:
        """Whether the run failed: it did not reach the end, and no user or observer stopped it."""
        return self not in (Status.DONE, Status.INTERRUPTED, Status.OBSERVER_FAILED)


@with_fields
@dataclass(frozen=True)
class Stop:
    """End of a run: how, when and where."""

    status: Status
    """How the run ended."""
    step: int
    """Last attempted step, which is the number of finished steps if the run is done."""
    time: float
    """Time at the end of this step [s]."""
    residual: float = 0.0
    """Norm of the residual of the last Newton iterate [N]."""
    segment: int = 0
    """Segment with the largest residual, or the folded, flattened or sunk segment. Joint j counts as segment j."""
    reason: str = ""
    """Error of a command, a force or the observer, or the part that was bent or pressed too far, with advice."""

    @property
    def sentence(self) -> str:
        """A line with the outcome, and with the time and place if the run failed."""
        if self.status in (Status.DONE, Status.INTERRUPTED):
            return str(self.status.value)
        where = f"step {self.step}, t = {self.time:.4g} s"
        if self.status is Status.NO_CONVERGENCE:
            where += f", residual {self.residual:.3g} N, worst in segment {self.segment}"
        return f"{self.status.value} ({where})" + (f": {self.reason}" if self.reason else "")
