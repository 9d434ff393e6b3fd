"""Progress of a climbing worm, and the pace for a requested speed.

The centre of mass is averaged over each period of the gait. The stride is the distance between two successive means,
along the path or, without a path, in space. With the mean d_bar of the last two strides,

    pace = V_ref period / d_bar,   limited to [PACES[0], PACES[1]]                                            (PC1)

in units of the gait's own pace. The pace is 0 for a reference speed of 0.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from control.tracking.paths import Path
from worm3d.values.arrays import FloatArray

PACES = (0.25, 1.5)
"""Smallest and greatest pace. At a pace of 2 the default actuators, with a lag of 0.1 s, would follow only half of each
change. At a pace below 0.25 a period would take more than 8 s, and the worm may just as well stop and wait."""
LEAST_STRIDE = 0.01
"""Stride below which the worm counts as standing [body lengths]. Sensor noise of 5 mm causes strides of 1 mm."""
STUCK = 4
"""Number of consecutive periods without progress after which the worm counts as stuck."""


@dataclass
class Way:
    """Progress of a worm of a given length [m] and gait period [s], along a path if there is one."""

    path: Path | None
    length: float
    period: float
    stride: float = math.nan
    """Mean of the last two strides [m]. NaN before the first stride."""
    idle: int = 0
    """Number of consecutive periods without progress."""
    _samples: list[FloatArray] = field(default_factory=list)
    _means: list[FloatArray] = field(default_factory=list)
    _strides: list[float] = field(default_factory=list)
    _phase: float = 0.0
    _near: float | None = None

    def take(self, phase: float, com: FloatArray | None) -> None:
        """Add a sample of the centre of mass, shape (3,) [m], if there is one, at a phase of the gait [periods]."""
        if math.floor(phase) > math.floor(self._phase) and self._samples:
            self._means.append(np.mean(self._samples, axis=0))
            self._samples.clear()
            self._stride()
        self._phase = phase
        if com is not None and np.isfinite(com).all():
            self._samples.append(np.asarray(com, dtype=float))

    def pace(self, speed: float) -> float:
        """Return the pace (PC1) for a speed [m/s]. Before the first stride it is 1, the gait's own pace."""
        if not speed > 0.0:
            return 0.0
        if math.isnan(self.stride):
            return 1.0
        return float(np.clip(speed * self.period / max(self.stride, LEAST_STRIDE * self.length), *PACES))

    @property
    def fastest(self) -> float:
        """Speed with the longest of the last three strides at the greatest pace [m/s].

        Infinite before the third stride.
        """
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
