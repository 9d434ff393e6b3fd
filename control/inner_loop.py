"""The inner loop, which adapts the command of each chamber to the measured response of the chamber.

The command of a weak chamber is enlarged, and the command of a slow chamber is advanced. Let g and d be the estimated
gain and phase of a chamber, (CG1) of `control.estimation.chamber_gains`, and `doubt` the standard deviation of each.
Ideally, the command of the chamber would be the wave times 1/g, ahead by -d. Only significant differences of log g and
of d from the deviation that all chambers of the worm share are corrected:

    told = exp(-c r(D(log g))) wave(psi - c r(D(d))),   r(e) = e e^4/(e^4 + e_0^4),                           (IL1)
    e_0^2 = dead_band^2 + (surely doubt)^2,             c = fits^8/(fits^8 + misfit^8),
    D(e) = e - min(max(0, min e), max e),               min and max over all chambers

Here psi is the phase of the wave, and `told` is the resulting command. D(e) = e if a chamber is healthy, or if some
chambers have positive and others have negative e. Otherwise the chamber nearest to a healthy one keeps its command, and
the others are made like this chamber. A deviation that all chambers share is a difference between the worm and its map,
which the estimator and the planner take into account as another speed per wave. An example is a worm with `magnetic`
actuators and the default map (gain 0.69 and phase 0.35 rad in all chambers). When the shared part was corrected too,
the rms offset from a straight path was 0.080 body lengths instead of 0.002.

The correction is small if gain and phase do not explain the strains, for example if the chambers of a segment work
against each other.

The gains are estimated by comparing the strains with the commands actually sent, not from a remaining control error.
Therefore neither delay nor noise of the strains can make the loop unstable. Commands are limited to the stroke of the
worm. An alternative, a planner limited to the amplitude of the weakest chamber, made the worm 10 % slower. Such a
planner uses faster waves, and these make slow chambers contract even less.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from control.estimation.chamber_gains import ChamberGains
from control.gaits.steering import Correction
from worm3d.values.arrays import FloatArray
from worm3d.values.parameters import documented, parameter
from worm3d.values.spelling import Checked


@documented
@dataclass(frozen=True, kw_only=True)
class InnerLoop(Checked):
    """Law that enlarges and advances the commands of the chambers, (IL1)."""

    dead_band: float = parameter(0.03, "relative error of a gain, and phase in rad, that is half corrected", gt=0)
    surely: float = parameter(1.5, "standard deviations of gain or phase that count like the dead band", ge=0)
    least: float = parameter(0.4, "least gain that is corrected in full", gt=0, le=1)
    most: float = parameter(2.0, "greatest gain that is corrected in full", ge=1)
    fits: float = parameter(0.13, "median misfit of the chambers at which half is corrected", gt=0)
    latest: float = parameter(1.2, "greatest phase that is corrected in full", "rad", gt=0)

    def correction(self, gains: ChamberGains) -> Correction:
        """Return the correction of the chambers."""
        band = np.hypot(self.dead_band, self.surely * gains.doubt)
        error = _unshared(np.log(np.clip(gains.gain, self.least, self.most)))
        late = _unshared(np.clip(gains.phase, -self.latest, self.latest))
        fit = self.fits**8 / (self.fits**8 + float(np.median(gains.misfit)) ** 8)
        return Correction(np.exp(-fit * _real(error, band)), -fit * _real(late, band))


def _unshared(error: FloatArray) -> FloatArray:
    """Return D(e) of (IL1): errors without the part that all chambers share."""
    return np.asarray(error - np.clip(0.0, error.min(), error.max()))


def _real(error: FloatArray, band: FloatArray) -> FloatArray:
    """Return r(e) of (IL1): errors well inside the band become small, and errors well outside it are unchanged."""
    return np.asarray(error * error**4 / (error**4 + band**4))
