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
    "chamber_length": ("T", "N", 2),
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
"""Shapes of the arrays. A letter is a size that is the same in all arrays, and "N+1" means N plus one."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Frames:
    """A worm of N segments at T instants; frozen, validated, with read-only arrays. Joint 0 is the tail.

    Raises
    ------
    ValueError
        An array has the wrong shape, or a value is not finite.
    """

    time: FloatArray
    """Increasing times, shape (T,) [s]."""
    joints: FloatArray
    """Joints from the tail to the head, shape (T, N+1, 3) [m]."""
    apexes: FloatArray
    """Apexes in the order L-below, L-above, L-outward, R-below, R-above, R-outward, shape (T, N, 6, 3) [m]."""
    directors: FloatArray
    """Directors d of the segments, which are unit vectors normal to the segments, to the left, shape (T, N, 3)."""
    chamber_strain: FloatArray
    """Strain (length over rest length, minus 1) of the left and the right chambers, shape (T, N, 2). It sets their
    colours."""
    chamber_length: FloatArray | None = None
    """Lengths of chambers without links, shape (T, N, 2) [m]. None if the chambers are rhombi of links, which are then
    drawn."""
    faces: FloatArray | None = None
    """Contact points at the tail end and the head end of each segment, shape (T, N, 2, 3) [m]."""
    contact_force: FloatArray | None = None
    """Forces of the world on the K contact points of a segment, shape (T, N, K, 3) [N]. The contact points are the 6
    apexes, and then the 2 points of `faces` if they are given."""
    anchored: NDArray[np.bool_] | None = None
    """Whether each contact point sticks, shape (T, N, K)."""
    face_radius: FloatArray | None = None
    """Radii of the end faces of the worm, discs with contact points, at tail and head, shape (2,) [m]. None if the worm
    has no end faces."""
    com: FloatArray | None = None
    """Centre of mass, shape (T, 3) [m]. The displayed speed is computed from it."""
    trail: FloatArray | None = None
    """Drawn path of the centre of mass, for example on the ground, shape (T, 3) [m]. The default is `com`."""
    reference_speed: FloatArray | None = None
    """Speed that the controller had to keep, shown beside the speed, shape (T,) [m/s]."""
    period: float | None = None
    """Commanded period [s]. The displayed speed is averaged over a period because the centre of mass oscillates with
    each wave."""
    path: FloatArray | None = None
    """Reference path to draw, shape (P, 3) [m]."""
    centreline: FloatArray | None = None
    """Centre line of the pipe, for the camera inside the pipe, shape (C, 3) [m]."""
    horizon: FloatArray | None = None
    """Points through which the controller expects the centre of mass to move, shape (T, H, 3) [m]."""
    world: tuple[WorldMesh, ...] = ()
    """Meshes of the surroundings."""

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
        """Number of segments N."""
        return int(self.directors.shape[1])

    @property
    def contacts(self) -> FloatArray:
        """Contact points of the segments, shape (T, N, K, 3) [m]. They are the apexes, and then `faces` if given."""
        return self.apexes if self.faces is None else np.concatenate([self.apexes, self.faces], axis=2)

    @property
    def body_length(self) -> float:
        """Length of the line through the joints in the first frame [m]."""
        return float(np.linalg.norm(np.diff(self.joints[0], axis=0), axis=1).sum())

    @property
    def centre(self) -> FloatArray:
        """Centre of mass, or mean of the joints if the centre of mass is unknown, shape (T, 3) [m]."""
        return self.joints.mean(axis=1) if self.com is None else self.com

    @property
    def way(self) -> FloatArray | None:
        """Drawn path of the centre of mass, `trail` if given and otherwise `com`, shape (T, 3) [m]."""
        return self.com if self.trail is None else self.trail

    @property
    def heading(self) -> FloatArray:
        """Horizontal unit vector from tail to head in the first frame, or +x if the worm is vertical, shape (3,)."""
        chord = self.joints[0, -1] - self.joints[0, 0]
        flat = np.array([chord[0], chord[1], 0.0])
        size = float(np.linalg.norm(flat))
        return flat / size if size > 0.05 * float(np.linalg.norm(chord)) else np.array([1.0, 0.0, 0.0])

    @property
    def axes(self) -> FloatArray:
        """Unit vectors along `heading`, to the left, and up (z), as rows, shape (3, 3)."""
        ahead = self.heading
        return np.array([ahead, [-ahead[1], ahead[0], 0.0], [0.0, 0.0, 1.0]])

    @property
    def extent(self) -> tuple[FloatArray, FloatArray]:
        """Smallest and largest coordinates of the worm in all frames along `axes`, each of shape (3,) [m]."""
        points = np.concatenate([self.joints.reshape(-1, 3), self.apexes.reshape(-1, 3)]) @ self.axes.T
        return points.min(axis=0), points.max(axis=0)

    @property
    def speed(self) -> FloatArray | None:
        """Mean speed of the centre of mass over `speed_window`, shape (T,) [m/s]."""
        if self.com is None or len(self) < 2:
            return None
        before, after = self.speed_window
        moved = [np.interp(after, self.time, x) - np.interp(before, self.time, x) for x in self.com.T]
        return np.asarray(np.linalg.norm(moved, axis=0) / (after - before))

    @property
    def speed_window(self) -> tuple[FloatArray, FloatArray]:
        """Begin and end of the interval for the mean of `speed`, each of shape (T,) [s].

        The interval extends by half a `period` to both sides, and is cut at the start and the end of the run.
        """
        half = 0.5 * max(self.period or 0.0, 2.0 * float(np.diff(self.time).max(initial=0.0)))
        return np.maximum(self.time - half, self.time[0]), np.minimum(self.time + half, self.time[-1])

    def mean_over_period(self, values: FloatArray) -> FloatArray:
        """Return the means of values over half a `period` to both sides, shape (T,).

        Near the start and the end of the run, the interval is shorter on both sides by the same amount.
        """
        ends = np.minimum(self.time - self.time[0], self.time[-1] - self.time)
        half = np.minimum(ends, 0.5 * (self.period or 0.0))
        if not half.any():
            return values
        after, before = (integrals(values[:, None], self.time, self.time + side * half)[:, 0] for side in (1.0, -1.0))
        return np.where(half > 0.0, (after - before) / np.maximum(2.0 * half, 1e-300), values)

    def take(self, indices: Sequence[int]) -> Frames:
        """Return the frames with the given indices, which must increase."""
        rows = np.asarray(indices, dtype=int)
        names = ["anchored", *(name for name, shape in _SHAPES.items() if shape[0] == "T")]
        return replace(self, **{name: getattr(self, name)[rows] for name in names if getattr(self, name) is not None})


def instants(time: FloatArray, fps: float) -> list[int]:
    """Return the indices of the instants nearest to 0, 1/fps, 2/fps, … s after the first instant.

    No index is repeated, and the last instant is always included.
    """
    arguments.number("fps", fps, gt=0.0, allowed="a finite number above 0 of frames a second")
    wanted = np.arange(time[0], time[-1], 1.0 / fps)
    right = np.clip(np.searchsorted(time, wanted), 1, max(len(time) - 1, 1))
    nearest = right - (wanted - time[right - 1] < time[right] - wanted)
    return sorted({*(int(k) for k in nearest), 0, len(time) - 1})
