"""A wave with additional commands to chambers and hinges, and the effect of a bent body on turning.

A body that is bent by the angle B from tail to head, and crawls by d body lengths per wave, turns in each wave by

    omega_bend = GUIDED B d                                                                                   (CP1)

since the standing feet hold the body on its arc. The rest of the requested turn is produced by steering the wave. With
the identified map omega(A, f, s), the steering s_wave follows from

    omega(A, f, s_wave) = omega(A, f, s) - omega_bend                                                         (CP2)

A controller that commands the steering s, and estimates with s, therefore does not have to know about the bend. A bent
body also moves sideways. Its motion points to the left of the chord by the angle

    crab = ASIDE B + c(A, f, s_wave)/d - c(A, f, s)/d                                                         (CP3)

in addition to the drift c(A, f, s) of the map for the commanded steering s.
"""

from __future__ import annotations

import numpy as np

from control.gaits.steering import GaitParameters, WaveGenerator
from control.identification.identified import SteeringMap
from worm3d import Command, Worm
from worm3d.values.arrays import FloatArray

GUIDED = 0.7
"""Turn of a bent body, divided by its bend and the distance, (CP1). On the default worm it is 0.65 to 0.73, at
amplitude 0.3 and 0.8 Hz, for bends of 0.56 to 1.1 rad in an arc, at both ends, or at the head."""
ASIDE = 0.05
"""Angle of a bent body's motion to the left of the chord, divided by the bend, (CP3). It is 0.046 to 0.049 on circles
of 0.6 and 1.5 body lengths with the bend of `control.chambers.controller` (seed 10), and up to 0.07 for bends of 1.2
rad."""


class BodyWave(WaveGenerator):
    """A wave generator that adds the commands `beyond` to chambers and hinges.

    `beyond` consists of the contractions of all left chambers, then of all right chambers, and the hinges [rad], shape
    (3 N - 1,). After a change of `beyond`, the commands follow exponentially, by 63 % within half a wave.

    Parameters
    ----------
    wave : WaveGenerator
        Generator whose schedule and blend are used.
    found : SteeringMap
        Identified map of the wave.
    worm : Worm
    """

    def __init__(self, wave: WaveGenerator, found: SteeringMap, worm: Worm) -> None:
        self._found, self._worm, greatest = found, worm, found.ranges.steering
        self._steerings = np.linspace(-greatest, greatest, 65)
        super().__init__(wave.schedule, worm, wave.blend)

    def reset(self) -> None:
        """Return to the initial state, without additional commands."""
        super().reset()
        self.beyond: FloatArray = np.zeros(3 * self._worm.segments - 1)
        self.given: FloatArray = self.beyond
        self.bend = self.crab = 0.0

    def step(self, dt: float, target: GaitParameters) -> Command:
        """Return the command `dt` [s] after the previous one, on the way to `target` and `beyond`."""
        n, left_over = self._worm.segments, np.exp(-dt * target.frequency / 0.5)
        self.given = self.beyond + (self.given - self.beyond) * left_over
        hinge, contraction = self.given[2 * n :], self.given[: 2 * n].reshape(2, n).T
        bends = self._worm.l0 * (contraction[:, 0] - contraction[:, 1]) / (2.0 * self._worm.chamber_offset)
        self.bend = float(hinge.sum() + bends.sum() - (bends[0] + bends[-1]) / 2.0)
        wave = super().step(dt, self.allotted(target))
        return Command(np.clip(wave.contraction + contraction, *self._worm.stroke), wave.hinge + hinge)

    def allotted(self, target: GaitParameters) -> GaitParameters:
        """Return the wave for the part of the target's turn that the bend does not produce, (CP2)."""
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
