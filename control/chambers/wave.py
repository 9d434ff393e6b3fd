"""Wave with additional commands to chambers and hinges, and the share of the body's bend in a turn.

A body that is bent by the angle B from tail to head, and crawls by d body lengths a wave, turns by

    omega_bend = GUIDED B d                                                                                   (CP1)

a wave, since the standing feet hold the body on its arc. Steering the wave produces the rest of the wanted turn, by the
identified map omega(A, f, s):

    omega(A, f, s_wave) = omega(A, f, s) - omega_bend,                                                        (CP2)

so that a controller which commands the steering s, and estimates with s, need not know of the bend. A bent body also
moves aside, to the left of the chord by the angle

    crab = ASIDE B + c(A, f, s_wave)/d - c(A, f, s)/d                                                         (CP3)

in addition to the drift of the map for the commanded steering s.
"""

from __future__ import annotations

import numpy as np

from control.gaits.steering import GaitParameters, WaveGenerator
from control.identification.identified import SteeringMap
from worm3d import Command, Worm
from worm3d.values.arrays import FloatArray

GUIDED = 0.7
"""Turn of a bent body over bend times distance, (CP1): 0.65 to 0.73 on the default worm at amplitude 0.3 and 0.8 Hz,
bent by 0.56 to 1.1 rad in an arc, at both ends, or at the head."""
ASIDE = 0.05
"""Angle of a bent body's motion to the left of the chord, over the bend, (CP3): 0.046 to 0.049 on circles of 0.6 and
1.5 body lengths with the bend of `control.chambers.controller` (seed 10), up to 0.07 for bends of 1.2 rad."""


class BodyWave(WaveGenerator):
    """Wave at run time, with the commands of `beyond` added to chambers and hinges.

    `beyond` holds contractions, left before right, and hinges [rad], shape (3 N - 1,); after half a wave the commands
    have covered 63 % of a change of `beyond`.

    Parameters
    ----------
    wave : WaveGenerator
        Wave with the schedule and blend to use.
    found : SteeringMap
        Effect of the wave on the worm.
    worm : Worm
    """

    def __init__(self, wave: WaveGenerator, found: SteeringMap, worm: Worm) -> None:
        self._found, self._worm, greatest = found, worm, found.ranges.steering
        self._steerings = np.linspace(-greatest, greatest, 65)
        super().__init__(wave.schedule, worm, wave.blend)

    def reset(self) -> None:
        """Restart with no commands beside the wave."""
        super().reset()
        self.beyond: FloatArray = np.zeros(3 * self._worm.segments - 1)
        self.given: FloatArray = self.beyond
        self.bend = self.crab = 0.0

    def step(self, dt: float, target: GaitParameters) -> Command:
        """Return the command after another `dt` [s] of approaching `target` and `beyond`."""
        n, left_over = self._worm.segments, np.exp(-dt * target.frequency / 0.5)
        self.given = self.beyond + (self.given - self.beyond) * left_over
        hinge, contraction = self.given[2 * n :], self.given[: 2 * n].reshape(2, n).T
        bends = self._worm.l0 * (contraction[:, 0] - contraction[:, 1]) / (2.0 * self._worm.chamber_offset)
        self.bend = float(hinge.sum() + bends.sum() - (bends[0] + bends[-1]) / 2.0)
        wave = super().step(dt, self.allotted(target))
        return Command(np.clip(wave.contraction + contraction, *self._worm.stroke), wave.hinge + hinge)

    def allotted(self, target: GaitParameters) -> GaitParameters:
        """Return the wave that produces the part of a target's turn that the bend leaves, (CP2)."""
        self.crab = 0.0
        if self.bend == 0.0:
            return target
        mechanism, ranges = self._found.mechanism, self._found.ranges
        way_sign = -1.0 if target.amplitude < 0.0 else 1.0
        wave = max(abs(target.amplitude), ranges.amplitude[0]), target.frequency
        asked = float(np.clip(target.steering(mechanism), -ranges.steering, ranges.steering))
        turns = np.asarray(self._found.turn(*wave, self._steerings))
        way = float(self._found.distance(*wave, asked))
        turned = GUIDED * self.bend * way_sign * way
        left = float(np.interp(np.interp(asked, self._steerings, turns) - turned, turns, self._steerings))
        aside = float(self._found.drift(*wave, left)) - float(self._found.drift(*wave, asked))
        self.crab = ASIDE * self.bend + (aside / way if way > 0.0 else 0.0)
        return target.steered(mechanism, left)
