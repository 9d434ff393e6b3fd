"""The way of a worm that climbs, and the pace for a wanted speed.

The centre of mass is averaged over each period of the gait. With the stride d from mean to mean, along the path or,
without a path, in space, and the mean d_bar of this stride and the previous stride,

    pace = V_ref period / d_bar   [periods of the gait's own], at least PACES[0], at most PACES[1]            (PC1)

and the pace is 0 for a reference speed of 0.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from control.tracking.paths import Path
from worm3d.values.arrays import FloatArray

PACES = (0.25, 1.5)
"""Least and greatest pace. At twice the pace the default actuators, with a lag of 0.1 s, leave out half of each change;
below a quarter a period takes more than 8 s, and the worm may as well stop and wait."""
LEAST_STRIDE = 0.01
"""Stride below which a worm counts as standing [body lengths]; noise of 5 mm makes strides of 1 mm."""
STUCK = 4
"""Number of periods without way in a row after which a worm is stuck."""


@dataclass
class Way:
    """Progress of a worm of the given length [m] and gait period [s], along a path if there is one."""

    path: Path | None
    length: float
    period: float
    stride: float = math.nan
    """Mean of the last two strides [m]; NaN before the first."""
    idle: int = 0
    """Number of periods without way in a row."""
    _samples: list[FloatArray] = field(default_factory=list)
    _means: list[FloatArray] = field(default_factory=list)
    _strides: list[float] = field(default_factory=list)
    _phase: float = 0.0
    _near: float | None = None

    def take(self, phase: float, com: FloatArray | None) -> None:
        """Take a sample of the centre of mass (3,) [m], if there is one, at a phase of the gait [periods]."""
        if math.floor(phase) > math.floor(self._phase) and self._samples:
            self._means.append(np.mean(self._samples, axis=0))
            self._samples.clear()
            self._stride()
        self._phase = phase
        if com is not None and np.isfinite(com).all():
            self._samples.append(np.asarray(com, dtype=float))

    def pace(self, speed: float) -> float:
        """Return the pace for a speed [m/s], (PC1); the gait's own pace before the first stride."""
        if not speed > 0.0:
            return 0.0
        if math.isnan(self.stride):
            return 1.0
        return float(np.clip(speed * self.period / max(self.stride, LEAST_STRIDE * self.length), *PACES))

    @property
    def fastest(self) -> float:
        """Speed from the longest of the last strides at the greatest pace [m/s]; infinite before the first strides."""
        last = self._strides[-3:]
        return PACES[1] * max(last) / self.period if len(last) == 3 else math.inf

    def _stride(self) -> None:
        if len(self._means) < 2:
            return
        step = self._means[-1] - self._means[-2]
        made = float(np.linalg.norm(step))
        if self.path is not None:
            before = float(self.path.project(self._means[-2][:2], self._near))
            self._near = float(self.path.project(self._means[-1][:2], before))
            made = math.copysign(made, self._near - before)
        self.idle = self.idle + 1 if made < LEAST_STRIDE * self.length else 0
        self._strides.append(made)
        self.stride = float(np.mean(self._strides[-2:]))
