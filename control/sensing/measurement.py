"""What a controller gets to know of the worm at an instant."""

from __future__ import annotations

from dataclasses import dataclass

from worm3d.values.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class Measurement:
    """The latest samples that have arrived; a part of which none has since the last measurement is None.

    Attributes
    ----------
    time : float
        Now [s].
    strain : ndarray, shape (N, 2), or None
        l_c/l0 - 1 of each chamber [left, right].
    strain_time : float
        Instant of that sample [s]; of the last one before, where `strain` is None (NaN: there was none).
    com : ndarray, shape (3,), or None
        Centre of mass [m].
    com_time : float
        Likewise.
    heading : float or None
        Azimuth of the tail-to-head chord in (-pi, pi] [rad], of the instant `heading_time`; only with such a sensor.
    heading_time : float
        Likewise.
    """

    time: float
    strain: FloatArray | None
    strain_time: float
    com: FloatArray | None
    com_time: float
    heading: float | None = None
    heading_time: float = float("nan")
