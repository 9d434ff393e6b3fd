"""Frames of a picture: the worm at T instants and its surroundings, as plain arrays."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from worm3d.values.arrays import FloatArray
from worm3d.viewer.world import WorldMesh

Shape = tuple[int | str, ...]
"""Shape of an array: a letter is a size that is the same everywhere, and "N+1" means N plus one."""

_ARRAYS: dict[str, Shape] = {
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
}
_SIDE = np.array([1.0, -1.0])
"""Sign of the left and of the right side."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Frames:
    """The worm at T instants; frozen, validated, with read-only arrays. N segments, joint 0 is the tail.

    Raises
    ------
    ValueError
        An array of the wrong shape, a value that is not finite, directors or apexes that cannot belong to the joints.
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
    """Surroundings; plain tuples (name, vertices, faces, colour, opacity) are also accepted."""

    def __post_init__(self) -> None:
        sizes = {"K": 6 if self.faces is None else 8}
        for name, shape in _ARRAYS.items():
            if getattr(self, name) is not None:
                self._set(name, _frozen(name, getattr(self, name), shape, sizes))
        if min(sizes["T"], sizes["N"]) < 1:
            raise ValueError(f"frames: got {sizes['T']} frames of {sizes['N']} segments, must be at least 1 of each")
        self._set_anchored(sizes)
        self._set_line("path")
        self._set_line("centreline")
        self._set("world", tuple(_as_mesh(mesh) for mesh in self.world))
        self._check_time()
        self._check_face_radius()
        self._check_frame()
        self._check_apexes()

    def _set(self, name: str, value: object) -> None:
        object.__setattr__(self, name, value)

    def _set_anchored(self, sizes: dict[str, int]) -> None:
        if self.anchored is None:
            return
        anchored = np.array(self.anchored)
        _check_shape("anchored", anchored.shape, ("T", "N", "K"), sizes)
        if anchored.dtype != np.bool_:
            raise ValueError(f"anchored: got {anchored.dtype}, must be bool: which contact points stick")
        anchored.setflags(write=False)
        self._set("anchored", anchored)

    def _set_line(self, name: str) -> None:
        if getattr(self, name) is None:
            return
        line = _frozen(name, getattr(self, name), ("P", 3), {})
        if len(line) < 2:
            raise ValueError(f"{name}: got {len(line)} points, must be at least 2")
        self._set(name, line)

    def _check_time(self) -> None:
        if (np.diff(self.time) <= 0.0).any():
            k = int(np.argmax(np.diff(self.time) <= 0.0))
            raise ValueError(f"time: got {self.time[k]:g} s and then {self.time[k + 1]:g} s, must increase")
        if self.period is not None and not (np.isfinite(self.period) and self.period > 0.0):
            raise ValueError(f"period: got {self.period!r}, must be finite and above 0 [s]")

    def _check_face_radius(self) -> None:
        if self.face_radius is not None and not (self.face_radius > 0.0).all():
            raise ValueError(f"face_radius: got {self.face_radius}, must be above 0, or None without end faces [m]")

    def _check_frame(self) -> None:
        edges = np.diff(self.joints, axis=1)
        length = np.linalg.norm(edges, axis=2)
        if (length <= 0.0).any():
            raise ValueError(f"joints: segment {_where(length <= 0.0)} has no length")
        size = np.linalg.norm(self.directors, axis=2)
        if (np.abs(size - 1.0) > 1e-3).any():
            raise ValueError(f"directors: segment {_where(np.abs(size - 1.0) > 1e-3)}: must be unit vectors")
        slant = np.abs(np.einsum("tni,tni->tn", edges, self.directors)) / length
        if (slant > 1e-2).any():
            raise ValueError(f"directors: segment {_where(slant > 1e-2)}: must be normal to the segment (joints)")

    def _check_apexes(self) -> None:
        """Check the order of the apexes: above and below, left and right, outward and inward."""
        below, above, outward = (self.apexes[:, :, k::3] for k in range(3))
        edges = np.diff(self.joints, axis=1)
        up = np.cross(edges, self.directors)[:, :, None]
        left = self.directors[:, :, None] * _SIDE[:, None]
        centre, middle = 0.5 * (below + above), 0.5 * (self.joints[:, 1:] + self.joints[:, :-1])
        slack = 1e-6 * np.linalg.norm(edges, axis=2)[:, :, None]
        offsets = {
            "below and above": np.einsum("tnci,tnci->tnc", above - below, up / np.linalg.norm(up, axis=3)[..., None]),
            "left and right": np.einsum("tnci,tnci->tnc", centre - middle[:, :, None], left),
            "inward and outward": np.einsum("tnci,tnci->tnc", outward - centre, left),
        }
        for what, offset in offsets.items():
            wrong = (offset < -slack).any(axis=2)
            if wrong.any():
                raise ValueError(
                    f"apexes: segment {_where(wrong)}: {what} are exchanged; the order must be L-below, L-above, "
                    "L-outward, R-below, R-above, R-outward, with `directors` to the left"
                )

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
        inside = half > 0.0
        if not inside.any():
            return values
        steps = 0.5 * (values[1:] + values[:-1]) * np.diff(self.time)
        integral = np.concatenate([[0.0], np.cumsum(steps)])
        after, before = (np.interp(self.time + side * half, self.time, integral) for side in (1.0, -1.0))
        return np.where(inside, (after - before) / np.where(inside, 2.0 * half, 1.0), values)

    def take(self, indices: Sequence[int]) -> Frames:
        """Return some of the frames, in the order of `indices`, which must increase."""
        rows = np.asarray(indices, dtype=int)
        names = [f.name for f in fields(self) if "T" in _ARRAYS.get(f.name, ()) or f.name == "anchored"]
        return replace(self, **{name: getattr(self, name)[rows] for name in names if getattr(self, name) is not None})

    def at_rate(self, fps: float) -> Frames:
        """Return at most `fps` frames a second, as evenly spaced as the available frames allow."""
        return self.take(instants(self.time, fps)) if len(self) > 1 else self


def instants(time: FloatArray, fps: float) -> list[int]:
    """Return the indices nearest to 0, 1/fps, 2/fps, … s after the first, each once; the last always."""
    if not (np.isfinite(fps) and fps > 0.0):
        raise ValueError(f"fps: got {fps!r}, must be a finite number above 0 of frames a second")
    wanted = np.arange(time[0], time[-1], 1.0 / fps)
    right = np.clip(np.searchsorted(time, wanted), 1, max(len(time) - 1, 1))
    nearest = right - (wanted - time[right - 1] < time[right] - wanted)
    return sorted({*(int(k) for k in nearest), 0, len(time) - 1})


def _as_mesh(mesh: WorldMesh | Iterable[object]) -> WorldMesh:
    if isinstance(mesh, WorldMesh):
        return mesh
    parts = tuple(mesh)
    if len(parts) != 5:
        raise ValueError(f"world: got a mesh of {len(parts)} parts, must be (name, vertices, faces, colour, opacity)")
    return WorldMesh(*parts)  # type: ignore[arg-type]  # checked by the constructor


def _where(wrong: NDArray[np.bool_]) -> str:
    frame, segment = np.argwhere(wrong)[0]
    return f"{segment} in frame {frame}"


def _frozen(name: str, value: ArrayLike, shape: Shape, sizes: dict[str, int]) -> FloatArray:
    """Return a checked, read-only copy of an array; enter sizes of new letters in the shape into `sizes`."""
    try:
        array = np.array(value, dtype=float)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name}: got {type(value).__name__}, must be numbers of shape {_written(shape)}") from error
    _check_shape(name, array.shape, shape, sizes)
    if not np.isfinite(array).all():
        first = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        raise ValueError(
            f"{name}: got {array[first]} at index {first}, must be finite: show only the frames before a run diverged"
        )
    array.setflags(write=False)
    return array


def _check_shape(name: str, got: tuple[int, ...], shape: Shape, sizes: dict[str, int]) -> None:
    """Raise ValueError unless `got` is `shape`; enter sizes of new letters into `sizes`."""
    fits = len(got) == len(shape)
    for size, want in zip(got, shape, strict=False):
        if isinstance(want, str) and not want.endswith("+1"):
            want = sizes.setdefault(want, size)
        elif isinstance(want, str):
            want = sizes[want.removesuffix("+1")] + 1
        fits = fits and size == want
    if not fits:
        known = ", ".join(f"{key} = {sizes[key]}" for key in sizes if any(key in str(want) for want in shape))
        raise ValueError(f"{name}: got shape {got}, must be {_written(shape)}" + (f" with {known}" if known else ""))


def _written(shape: Shape) -> str:
    """Return a shape as written in documentation, e.g. "(T, N+1, 3)"."""
    return "(" + ", ".join(str(size) for size in shape) + ("," if len(shape) == 1 else "") + ")"
