"""The steered wave as a separate gait: how fast a worm can turn on level ground without falling over.

`control.gaits.steering` defines equations (S1) and (S2), and explains why a bending wave longer than the contraction
turns a worm. Results of the longer bending wave of this gait on the default worm, at amplitude 0.3 and 0.8 Hz:

    steering               turn [deg a wave]   radius [body lengths]   greatest roll [deg]
    hinge 0.15 rad         31                  0.25                    3.1
    bias 0.08              27                  0.29                    4.6
    hinge 0.08, bias 0.04  30                  0.26                    3.5

The phases were chosen for a margin against tipping, not for the greatest turn: with phases 10 degrees later the worm
turns a little faster, and tips at hinges of 0.18 rad instead of more than 0.21 rad. Of twenty similar worms (standard
deviations of 15 % in mass and springs, 7 % in height, 10 % in the chambers' offset, 30 to 40 % in joints and friction)
none tips: hinges of 0.15 rad turn these worms by 28 to 32 degrees a wave and roll them by 6 degrees at most. Unequal
chambers, which make one side stand taller, turn them by 22 to 34 degrees and roll them by up to 17. The study
`worm3d study turning_map` shows which steering tips the worm.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from control.gaits.gait import Body, Gait
from control.gaits.steering import GaitParameters, Schedule
from worm3d import Commands
from worm3d.values.arrays import FloatArray
from worm3d.values.parameters import documented, parameter


@documented
@dataclass(frozen=True, kw_only=True)
class Steered(Schedule, Gait, name="steered"):
    """A wave that steers by a bending wave longer than the contraction, (S1) and (S2).

    Positive hinge and bias turn to the left.
    """

    period: float = parameter(1.25, meaning="duration of a wave", unit="s", gt=0)
    hinge: float = parameter(0.0, meaning="steering by hinges, the amplitude of their bending wave (S2)", unit="rad")
    bias: float = parameter(
        0.0,
        meaning="steering by unequal chambers, the amplitude of their bending wave (S1) as a fraction of the amplitude",
        ge=-1,
        le=1,
        allowed="a number in [-1, 1]",
    )
    steering_wavelength: float = parameter(
        2.5, unit="body lengths", gt=0, meaning="wavelength of the bending wave; 1e9 bends all joints alike"
    )
    hinge_phase: float = parameter(
        float(np.deg2rad(125.0)), unit="rad", meaning="phase of bending by hinges ahead of the contraction at f -> 0"
    )
    bias_phase: float = parameter(
        float(np.deg2rad(140.0)), unit="rad", meaning="phase of bending by bias ahead of the contraction at f -> 0"
    )

    turning = (*Gait.turning, "steering_wavelength", "hinge_phase", "bias_phase", "lead")

    @property
    def lengthens(self) -> bool:
        """Whether a chamber is longer than at rest at some time, which happens with unequal chambers."""
        return self.bias != 0.0

    def activations(self, times: FloatArray, segments: int) -> FloatArray:
        """Return the activation of each segment at K times [s], without steering, shape (K, segments), in [0, 1]."""
        return self.pulse(2.0 * np.pi * times[:, None] / self.period, segments)

    def commands(self, times: FloatArray, worm: Body) -> Commands:
        """Return the commands to `worm` at K times [s], including the steering commands."""
        wave = GaitParameters(self.amplitude, 1.0 / self.period, self.bias, self.hinge)
        given = self.commands_at(2.0 * np.pi * times / self.period, np.tile(wave.row(), (len(times), 1)), worm)
        force = np.repeat(self.force * self.activations(times, worm.segments)[..., None], 2, axis=-1)
        return given._replace(force=force)
