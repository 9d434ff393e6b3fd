"""What a controller of this package writes down of each of its decisions, whichever controller it is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from control.estimation.estimate import Estimate
from control.gaits.steering import GaitParameters
from worm3d.values.arrays import FloatArray

Source = Literal["mpc", "shifted plan", "gait", "stop", "pi_los", "open_loop"]
SOURCES: tuple[Source, ...] = get_args(Source)


@dataclass(frozen=True, eq=False)
class Decision:
    """The gait parameters from an instant on, where they are from, and what the controller knew.

    Attributes
    ----------
    time : float
        From when on they are in force [s].
    source : str
        Whose they are: of an accepted plan ("mpc"), of the plan before ("shifted plan"), of the feed-forward or the
        last parameters ("gait"), at rest ("stop"), or of a baseline ("pi_los", "open_loop").
    parameters : GaitParameters
        Asked for.
    estimate : Estimate or None
        With its standard deviations; None for a controller without estimator.
    status : str
        The solver's sentence, or why it was not asked or not followed; empty where nothing is solved.
    failed : bool
        Whether there should have been something better.
    iterations : int
    cost : float
        NaN where nothing is minimised.
    seconds : float
        Wall time of the decision, estimator included [s].
    horizon : ndarray, shape (H + 1, 2), or None
        Predicted way of the centre of mass, from where it is [m].
    """

    time: float
    source: Source
    parameters: GaitParameters
    estimate: Estimate | None
    status: str = ""
    failed: bool = False
    iterations: int = 0
    cost: float = float("nan")
    seconds: float = 0.0
    horizon: FloatArray | None = None
