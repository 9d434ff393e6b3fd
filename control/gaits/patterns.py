"""The two waves of the paper that this project follows, and the breathing of a single actuator.

`ContractionEngine_segmentdriven` is the paper's first scheme, and `TravellingWave` its second (section III.C).

`Breathing` is a gait for a single actuator: all segments contract and lengthen again in unison. The worm crawls if
friction is directional. A slow, uniform contraction moves the rear forward and the front backward, against the
coefficients f and b, about the place x (from the tail, in body lengths) with x f = (1 - x) b; lengthening moves both
about the place with x b = (1 - x) f. In a period with the contraction c the centre of mass of a body of length L moves
by

    d = c L (b - f)/(b + f)                                                                                   (GB1)

(Gidoni, Noselli, DeSimone: Crawling on directional surfaces, International Journal of Non-Linear Mechanics 61, 2014,
65-73, "breathing-like" shape changes).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from control.gaits.anchoring import TwoAnchor as TwoAnchor
from control.gaits.gait import GAITS as GAITS
from control.gaits.gait import Body as Body
from control.gaits.gait import BoundGait as BoundGait
from control.gaits.gait import Direction as Direction
from control.gaits.gait import Gait as Gait
from control.gaits.gait import direction_of_waves
from control.gaits.gait import half_cosine as half_cosine
from worm3d.values import time_steps
from worm3d.values.arrays import FloatArray
from worm3d.values.parameters import documented, parameter

WaveDirection = Literal["direct", "retrograde", "standing"]
Pulse = Literal["gaussian", "square", "dirac"]

GAUSSIAN_WIDTH = 0.15
"""Standard deviation of the Gaussian pulse as a fraction of the duration of a contraction."""


@documented
@dataclass(frozen=True, kw_only=True)
class TravellingWave(Gait, name="travelling_wave"):
    """The paper's wave A = sin(k x - w t), x = (i + 1/2)/N, and its variants."""

    period: float = parameter(
        2.0,
        meaning="T_wave: time between two contractions of a segment, w = 2 pi / period",
        unit="s",
        gt=0,
        aka=("T_wave_s",),
    )
    wavelength: float = parameter(
        1.0,
        meaning="length of the wave, k = 2 pi / wavelength",
        unit="body lengths",
        gt=0,
        aka=("wavelength_m", "lambda", "wave_length"),
    )
    direction: WaveDirection = parameter(
        "retrograde",
        meaning="direct runs tail to head, sin(kx - wt), the paper's wave in our numbering; retrograde head to tail, "
        "as in earthworms, sin(kx + wt); standing is the mean of the two, sin(kx) cos(wt)",
    )
    rectified: bool = parameter(True, meaning="whether segments only contract, max(0, A), never lengthen")

    @property
    def lengthens(self) -> bool:
        """Whether the activation falls below 0 at some time."""
        return not self.rectified

    def activations(self, times: FloatArray, segments: int) -> FloatArray:
        """Return the activation of each segment at K times [s], shape (K, segments), in [-1, 1]."""
        kx = 2.0 * np.pi / self.wavelength * (np.arange(segments) + 0.5) / segments
        wt = 2.0 * np.pi / self.period * times[:, None]
        if self.direction == "standing":
            wave = np.sin(kx) * np.cos(wt)
        else:
            wave = np.sin(kx - wt if self.direction == "direct" else kx + wt)
        return np.maximum(0.0, wave) if self.rectified else wave


@documented
@dataclass(frozen=True, kw_only=True)
class ContractionEngine_segmentdriven(Gait, name="segment_driven"):  # noqa: N801 - the paper's name
    """The paper's segment-by-segment contraction, its four steps as a pure function of time.

    1. Wave-based activation: one segment after the other is activated, one every T_wave/N.
    2. Phase update: the segment's contraction phase rises from 0 to 1 over T_contract; then the segment deactivates and
       resets.
    3. Pulse generation: a pulse of unit height as a function of this phase.
    4. Force computation: signs alternate along the body, + on even segments; inactive segments give zero.
    """

    T_wave: float = parameter(
        2.0, meaning="time after which a segment is activated again", unit="s", gt=0, key="period_s", aka=("T_wave_s",)
    )
    T_contract: float = parameter(
        0.25,
        meaning="duration of one contraction, at most T_wave; beyond T_wave/N the contractions of neighbours overlap",
        unit="s",
        gt=0,
        key="contract_time_s",
    )
    contractType: Pulse = parameter(
        "gaussian",
        meaning="shape of a contraction: exp(-((phase - 1/2)/0.15)^2 / 2), 1 throughout, or 1 for `impulse` seconds "
        "(in a scene one time step)",
        key="pulse",
    )
    alternating: bool = parameter(True, meaning="whether odd segments lengthen instead (step 4)")
    direction: Direction = direction_of_waves("direct", ", the paper's order")
    impulse: float = parameter(
        0.01, meaning="duration of the dirac pulse: the time step, so that it acts in one step", unit="s", gt=0
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.T_contract > self.T_wave:
            raise ValueError(
                f"T_contract: got {self.T_contract!r} s, must be at most T_wave ({self.T_wave!r} s): "
                "a segment must end its contraction before it is activated again"
            )

    def require_steps(self, dt: float) -> None:
        """Raise ValueError for time steps [s] that are too long for the gait."""
        time_steps.require_period(dt, "T_wave", self.T_wave)
        time_steps.require_fit(dt, "T_contract", self.T_contract, time_steps.CONTRACTION_MISSED)
        if self.contractType == "dirac":
            time_steps.require_fit(dt, "impulse", self.impulse, time_steps.CONTRACTION_MISSED)

    @property
    def lengthens(self) -> bool:
        """Whether the activation falls below 0 at some time."""
        return self.alternating

    def activations(self, times: FloatArray, segments: int) -> FloatArray:
        """Return the activation of each segment at K times [s], shape (K, segments), in [-1, 1]."""
        order = np.arange(segments) if self.direction == "direct" else np.arange(segments)[::-1]
        since = times[:, None] - order * self.T_wave / segments
        # Times within 1e-9 periods count as equal, so that rounding errors do not change which segments are active.
        elapsed = np.mod(since + 1e-9 * self.T_wave, self.T_wave)
        active = (since > -1e-9 * self.T_wave) & (elapsed < self.T_contract)
        sign = np.where(np.arange(segments) % 2 == 0, 1.0, -1.0) if self.alternating else np.ones(segments)
        return np.where(active, sign * self._pulse(elapsed), 0.0)

    def _pulse(self, elapsed: FloatArray) -> FloatArray:
        match self.contractType:
            case "gaussian":
                phase = elapsed / self.T_contract
                return np.exp(-0.5 * ((phase - 0.5) / GAUSSIAN_WIDTH) ** 2)
            case "square":
                return np.ones_like(elapsed)
            case "dirac":
                return np.where(elapsed < self.impulse, 1.0, 0.0)


@documented
@dataclass(frozen=True, kw_only=True)
class Breathing(Gait, name="breathing"):
    """All segments contract together and then lengthen together, each along half a cosine wave, (GB1)."""

    period: float = parameter(2.0, meaning="duration of a contraction and the lengthening after it", unit="s", gt=0)
    contracting: float = parameter(0.5, meaning="share of the period in which the body contracts", gt=0, lt=1)
    lengthens = False

    def activations(self, times: FloatArray, segments: int) -> FloatArray:
        """Return the activation of each segment at K times [s], shape (K, segments), in [0, 1]."""
        tau, share = np.mod(times / self.period, 1.0), self.contracting
        half_waves = np.where(tau < share, tau / share, 1.0 + (tau - share) / (1.0 - share))
        return np.tile((1.0 - np.cos(np.pi * half_waves))[:, None] / 2.0, (1, segments))
