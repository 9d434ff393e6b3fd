"""The inner loop: each command is increased and advanced to compensate the measured weakness and delay of the chamber.

With the gain g and phase d of a chamber, (CG1) of `control.estimation.chamber_gains`, and the standard deviation of
both, the command of the chamber is the wave times 1/g and ahead by -d. The correction is limited to the significant
differences of g and d from 1 and 0:

    told = exp(-c r(log g)) wave(psi - c r(d)),   r(e) = e e^4/(e^4 + e_0^4),                                 (IL1)
    e_0^2 = dead_band^2 + (surely doubt)^2,       c = fits^8/(fits^8 + misfit^8)

If gain and phase do not explain the strains, as with stiff actuators, whose two chambers fight, the correction is
small. The gains are identified from the given commands instead of a remaining error, so that neither delay nor noise of
the strains makes the loop unstable. Commands are limited to the stroke of the worm. A planner that was limited to the
amplitude of the weakest chamber was slower by 10 %: such a planner uses faster waves, in which slow chambers contract
even less.
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
    """Law that increases and advances the commands of the chambers, (IL1)."""

    dead_band: float = parameter(0.03, "relative error of a gain, and phase in rad, that is half corrected", gt=0)
    surely: float = parameter(1.5, "standard deviations of gain or phase that count like the dead band", ge=0)
    least: float = parameter(0.4, "least gain that is corrected in full", gt=0, le=1)
    most: float = parameter(2.0, "greatest gain that is corrected in full", ge=1)
    fits: float = parameter(0.13, "median misfit of the chambers at which half is corrected", gt=0)
    latest: float = parameter(1.2, "greatest phase that is corrected in full", "rad", gt=0)

    def correction(self, gains: ChamberGains) -> Correction:
        """Return the correction of the chambers."""
        band = np.hypot(self.dead_band, self.surely * gains.doubt)
        error = np.log(np.clip(gains.gain, self.least, self.most))
        late = np.clip(gains.phase, -self.latest, self.latest)
        fit = self.fits**8 / (self.fits**8 + float(np.median(gains.misfit)) ** 8)
        return Correction(np.exp(-fit * _real(error, band)), -fit * _real(late, band))


def _real(error: FloatArray, band: FloatArray) -> FloatArray:
    """Return errors, attenuated inside and near a band."""
    return np.asarray(error * error**4 / (error**4 + band**4))
