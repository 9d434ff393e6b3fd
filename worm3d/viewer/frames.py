"""Frames of a picture: the worm at T instants and its surroundings, as plain arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from worm3d.values import arguments
from worm3d.values.arrays import FloatArray
from worm3d.values.period_means import integrals
from worm3d.values.read_only import read_only
from worm3d.viewer.world import WorldMesh

_SHAPES: dict[str, tuple[int | str, ...]] = {
    "time": ("T",),
    "directors": ("T", "N", 3),
    "joints": ("T", "N+1", 3),
    "apexes": ("T", "N", 6, 3),
    "chamber_strain": ("T", "N", 2),
    "faces": ("T", "N", 2, 3),
    "contact_force": ("T", "N", "K", 3),
    "com": ("T", 3),
    "trail": ("T", 3),
    "reference_speed": ("T",),
    "face_radius": (2,),
    "horizon": ("T", "H", 3),
    "path": ("P", 3),
    "centreline": ("C", 3),
}
"""Shapes of the arrays: a letter is a size that is the same everywhere, and "N+1" means N plus one."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Frames:
    """The worm at T instants; frozen, validated, with read-only arrays. N segments, joint 0 is the tail.

    Raises
    ------
    ValueError
        An array of the wrong shape, or a value that is not finite.
    """

    time: FloatArray
    """Shape (T,): instants, increasing [s]."""
    joints: FloatArray
    """Shape (T, N+1, 3): joints, from the tail to the head [m]."""
    apexes: FloatArray
    """Shape (T, N, 6, 3): apexes in the order L-below, L-above, L-outward, R-below, R-above, R-outward [m]."""
    directors: FloatArray
    """Shape (T, N, 3): unit directors d of the segments, normal to them, to the left."""
    chamber_strain: FloatArray
    """Shape (T, N, 2): length of the left and the right chamber over the rest length, less 1; sets the colour."""
    faces: FloatArray | None = None
    """Shape (T, N, 2, 3): contact points of the tail and the head end of each segment [m]."""
    contact_force: FloatArray | None = None
    """Shape (T, N, K, 3): forces of the world on the K contact points of a segment: 6 apexes, and then the faces, if
    given [N]."""
    anchored: NDArray[np.bool_] | None = None
    """Shape (T, N, K): whether a contact point sticks."""
    face_radius: FloatArray | None = None
    """Shape (2,): radii of the discs across tail and head that the worm stands on; None without discs [m]."""
    com: FloatArray | None = None
    """Shape (T, 3): centre of mass [m]; gives the speed."""
    trail: FloatArray | None = None
    """Shape (T, 3): drawn path of the centre of mass, e.g. on the ground; `com` if left out [m]."""
    reference_speed: FloatArray | None = None
    """Shape (T,): speed that the controller had to keep, shown beside the speed [m/s]."""
    period: float | None = None
    """Commanded period [s]: the speed shown is an average over a period, since a wave rocks the centre of mass."""
    path: FloatArray | None = None
    """Shape (P, 3): reference path to draw [m]."""
    centreline: FloatArray | None = None
    """Shape (P, 3): centre line of the pipe, for the camera inside the pipe [m]."""
    horizon: FloatArray | None = None
    """Shape (T, H, 3): points the controller expects to pass [m]."""
    world: tuple[WorldMesh, ...] = ()
    """Surroundings."""

    def __post_init__(self) -> None:
        sizes: dict[int | str, int | str] = {"K": 6 if self.faces is None else 8}
        for name, letters in _SHAPES.items():
            given = getattr(self, name)
            if given is None:
                continue
            shape = tuple(sizes.get(size, size) for size in letters)
            array = arguments.array(name, given, shape, least=2 if name in ("path", "centreline") else 1)
            object.__setattr__(self, name, array)
            sizes |= zip(letters, array.shape, strict=True)
            if name == "directors":
                sizes["N+1"] = array.shape[1] + 1
        if (np.diff(self.time) <= 0.0).any():
            raise ValueError(f"time: got {self.time.tolist()} s, must increase")
        object.__setattr__(self, "anchored", read_only(self.anchored))
        if self.period is not None:
            arguments.number("period", self.period, "s", gt=0.0)

    def __len__(self) -> int:
        return len(self.time)

    @property
    def segments(self) -> int:
        """N."""
        return int(self.directors.shape[1])

    @property
    def contacts(self) -> FloatArray:
        """Contact points of the segments: apexes, and then faces, if given, shape (T, N, K, 3) [m]."""
        return self.apexes if self.faces is None else np.concatenate([self.apexes, self.faces], axis=2)

    @property
    def body_length(self) -> float:
        """Length along the joints in the first frame [m]."""
        return float(np.linalg.norm(np.diff(self.joints[0], axis=0), axis=1).sum())

    @property
    def centre(self) -> FloatArray:
        """Centre of mass, or mean of the joints if the centre of mass is unknown, shape (T, 3) [m]."""
        return self.joints.mean(axis=1) if self.com is None else self.com

    @property
    def way(self) -> FloatArray | None:
        """Drawn path of the centre of mass: `trail`, or else `com`, shape (T, 3) [m]."""
        return self.com if self.trail is None else self.trail

    @property
    def heading(self) -> FloatArray:
        """Horizontal unit direction of the first frame's chord from tail to head, shape (3,); +x if vertical."""
        chord = self.joints[0, -1] - self.joints[0, 0]
        flat = np.array([chord[0], chord[1], 0.0])
        size = float(np.linalg.norm(flat))
        return flat / size if size > 0.05 * float(np.linalg.norm(chord)) else np.array([1.0, 0.0, 0.0])

    @property
    def axes(self) -> FloatArray:
        """Unit vectors along the heading, to the left, and up (z), as rows, shape (3, 3)."""
        ahead = self.heading
        return np.array([ahead, [-ahead[1], ahead[0], 0.0], [0.0, 0.0, 1.0]])

    @property
    def extent(self) -> tuple[FloatArray, FloatArray]:
        """Least and greatest coordinates of the worm in all frames along `axes`, each of shape (3,) [m]."""
        points = np.concatenate([self.joints.reshape(-1, 3), self.apexes.reshape(-1, 3)]) @ self.axes.T
        return points.min(axis=0), points.max(axis=0)

    @property
    def speed(self) -> FloatArray | None:
        """Speed of the centre of mass, a mean over `speed_window`, shape (T,) [m/s]."""
        if self.com is None or len(self) < 2:
            return None
        before, after = self.speed_window
        moved = [np.interp(after, self.time, x) - np.interp(before, self.time, x) for x in self.com.T]
        return np.asarray(np.linalg.norm(moved, axis=0) / (after - before))

    @property
    def speed_window(self) -> tuple[FloatArray, FloatArray]:
        """Begin and end of the interval that `speed` averages over, half a `period` to either side, each (T,) [s]."""
        half = 0.5 * max(self.period or 0.0, 2.0 * float(np.diff(self.time).max(initial=0.0)))
        return np.maximum(self.time - half, self.time[0]), np.minimum(self.time + half, self.time[-1])

    def mean_over_period(self, values: FloatArray) -> FloatArray:
        """Return means of values, shape (T,), over half a `period` to both sides; equally less near the ends."""
        ends = np.minimum(self.time - self.time[0], self.time[-1] - self.time)
        half = np.minimum(ends, 0.5 * (self.period or 0.0))
        if not half.any():
            return values
        after, before = (integrals(values[:, None], self.time, self.time + side * half)[:, 0] for side in (1.0, -1.0))
        return np.where(half > 0.0, (after - before) / np.maximum(2.0 * half, 1e-300), values)

    def take(self, indices: Sequence[int]) -> Frames:
        """Return some of the frames, in the order of `indices`, which must increase."""
        rows = np.asarray(indices, dtype=int)
        names = ["anchored", *(name for name, shape in _SHAPES.items() if shape[0] == "T")]
        return replace(self, **{name: getattr(self, name)[rows] for name in names if getattr(self, name) is not None})


def instants(time: FloatArray, fps: float) -> list[int]:
    """Return the indices nearest to 0, 1/fps, 2/fps, … s after the first, each once; the last always."""
    arguments.number("fps", fps, gt=0.0, allowed="a finite number above 0 of frames a second")
    wanted = np.arange(time[0], time[-1], 1.0 / fps)
    right = np.clip(np.searchsorted(time, wanted), 1, max(len(time) - 1, 1))
    nearest = right - (wanted - time[right - 1] < time[right] - wanted)
    return sorted({*(int(k) for k in nearest), 0, len(time) - 1})
