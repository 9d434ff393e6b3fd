"""Periodic gaits with a separate phase and shape for each segment, or for each side of a segment.

With x = (i + 1/2)/N, the phase of segment i, in periods, is

    phi = t/period + waves x + phase     retrograde, as in earthworms
    phi = t/period - waves x + phase     direct                                                                   (PG1)

`Periodic` is a sine whose half-waves have unequal durations, duty and 1 - duty, and flattened crests. With the elapsed
part tau = phi mod 1 of the period,

    theta = pi tau/duty                              while tau < duty
    theta = pi (1 + (tau - duty)/(1 - duty))         after that
    A     = weight tanh(sharpness sin theta)/tanh(sharpness),   weight sin theta for sharpness 0                 (PG2)

With a small duty, the activation is a train of pulses. `waves` = 0 with explicit phases gives any pattern of phases,
such as equal steps from segment to segment, or a pattern that is symmetric about the middle of the body (Fang, Li,
Wang, Xu: Phase coordination and phase-velocity relationship in metameric robot locomotion, Bioinspiration &
Biomimetics, 2015, where the latter is the fastest).

`Spline` interpolates values at equal intervals of the period by the periodic cubic spline with a continuous second
derivative: with M values y_j, the second derivatives m_j (in intervals) solve

    (m_{j-1} + 4 m_j + m_{j+1})/6 = y_{j-1} - 2 y_j + y_{j+1}                                                    (PG3)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from control.gaits.gait import Direction, Gait, direction_of_waves, for_segments, joined
from worm3d.values.arrays import FloatArray
from worm3d.values.parameters import documented, parameter


@documented
@dataclass(frozen=True, kw_only=True)
class _Shaped(Gait):
    """Base class of waves whose segments have the same shape, each with its own phase (PG1)."""

    period: float = parameter(2.0, meaning="duration after which the gait repeats", unit="s", gt=0, aka=("T_wave_s",))
    waves: float = parameter(1.0, meaning="number of waves on the body", ge=0, aka=("number_of_waves",))
    direction: Direction = direction_of_waves()
    phase: float | FloatArray = parameter(
        0.0, meaning="phase of a segment ahead of the first one, in periods", each="side"
    )
    rectified: bool = parameter(True, meaning="whether segments only contract, max(0, A), never lengthen")

    def _phase(self, times: FloatArray, segments: int) -> FloatArray:
        """Return the phase (PG1), in periods, at K times [s], shape (K, N, 1) or (K, N, 2)."""
        x = (np.arange(segments) + 0.5) / segments
        along = self.waves * (x if self.direction == "retrograde" else -x)
        phase = along[:, None] + for_segments("phase", self.phase, segments)
        return times[:, None, None] / self.period + phase


@documented
@dataclass(frozen=True, kw_only=True)
class Periodic(_Shaped, name="periodic"):
    """Wave with a separate phase, duty, sharpness and weight for each segment and side, (PG2)."""

    duty: float | FloatArray = parameter(
        0.5, meaning="share of the period while a segment is contracted", gt=0, lt=1, each="side"
    )
    sharpness: float | FloatArray = parameter(
        0.0, meaning="flatness of the crests: 0 is a sine, 10 nearly a square wave", ge=0, le=100, each="side"
    )
    weight: float | FloatArray = parameter(
        1.0, meaning="share of the amplitude that each has, below 0 to lengthen", ge=-1, le=1, each="side"
    )

    @property
    def lengthens(self) -> bool:
        """Whether the activation falls below 0 at some time."""
        return bool(np.any(np.less(self.weight, 0.0) if self.rectified else self.weight))

    def activations(self, times: FloatArray, segments: int) -> FloatArray:
        """Return the activation of each segment at K times [s], in [-1, 1]; shape as of `Gait.activations`."""
        duty, sharpness, weight = (
            for_segments(name, getattr(self, name), segments) for name in ("duty", "sharpness", "weight")
        )
        tau = np.mod(self._phase(times, segments), 1.0)
        theta = np.pi * np.where(tau < duty, tau / duty, 1.0 + (tau - duty) / (1.0 - duty))
        flat = np.maximum(sharpness, 1e-6)  # there the tangent equals the sine's to 1e-12
        wave = np.tanh(flat * np.sin(theta)) / np.tanh(flat)
        return joined(weight * (np.maximum(0.0, wave) if self.rectified else wave))


@documented
@dataclass(frozen=True, kw_only=True)
class Spline(_Shaped, name="spline"):
    """Wave of any shape: a smooth curve through values at equal intervals of the period, (PG3), clipped to [-1, 1]."""

    values: tuple[float, ...] | FloatArray = parameter(
        (0.0, 0.7, 1.0, 0.7, 0.0, 0.0),
        meaning="activation at equal intervals of the period, at least 3 numbers",
        ge=-1,
        le=1,
        each="sample",
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        shape = np.shape(self.values)
        if not (shape and shape[-1] >= 3):
            raise ValueError(
                f"values: got shape {shape}, must be a list of at least 3 numbers, or such a list or a pair of them, "
                "left and right, for each segment"
            )

    @property
    def lengthens(self) -> bool:
        """Whether the activation falls below 0 at some time."""
        count = np.shape(self.values)[-1]
        places = np.linspace(0.0, 1.0, 64 * count + 1)  # 64 from value to value
        curves = np.reshape(self.values, (-1, count))
        return not self.rectified and bool((_periodic_spline(curves, places[:, None]) < 0.0).any())

    def activations(self, times: FloatArray, segments: int) -> FloatArray:
        """Return the activation of each segment at K times [s], in [-1, 1]; shape as of `Gait.activations`."""
        values = np.asarray(self.values)
        curves = values if values.ndim == 3 else values[..., None, :]
        if len(curves) not in (1, segments):
            raise ValueError(f"values: got {len(curves)} lists, must be one for each of the worm's {segments} segments")
        phase = self._phase(times, segments)
        return joined(np.clip(_periodic_spline(curves, phase), 0.0 if self.rectified else -1.0, 1.0))


def _periodic_spline(values: FloatArray, phase: FloatArray) -> FloatArray:
    """Return periodic cubic splines (PG3) at phases in periods.

    `values` has the shape (..., M) and `phase` the shape (K, ...). Their other axes broadcast to the shape of the
    result.
    """
    count = values.shape[-1]
    turn = np.cos(2.0 * np.pi * np.arange(count // 2 + 1) / count)
    bends = np.fft.irfft(np.fft.rfft(values) * 6.0 * (turn - 1.0) / (turn + 2.0), count)
    place = np.mod(phase, 1.0) * count
    first = np.minimum(place.astype(int), count - 1)
    after = place - first
    before = 1.0 - after

    def at(table: FloatArray, knot: NDArray[np.int64]) -> FloatArray:
        """Return the number of each curve's table at a knot."""
        wide, knots = np.broadcast_arrays(table, knot[..., None])
        return np.take_along_axis(wide, knots[..., :1], axis=-1)[..., 0]

    second = (first + 1) % count
    straight = before * at(values, first) + after * at(values, second)
    curved = (before**3 - before) * at(bends, first) + (after**3 - after) * at(bends, second)
    return np.asarray(straight + curved / 6.0)
