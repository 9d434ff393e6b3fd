"""Union of worlds: space is free if it is free in at least one of the worlds.

The kernel of a union evaluates the kernels of the worlds one after the other, and takes the largest distance at each
point.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from worm3d.machine.codegen import evaluate
from worm3d.machine.codegen.emit import SHAPES_FIT, WRONG_SHAPE
from worm3d.machine.compiled import inner
from worm3d.values import arguments
from worm3d.values.arrays import FloatArray
from worm3d.values.read_only import ReadOnly
from worm3d.values.spelling import spelled
from worm3d.worlds import kernels
from worm3d.worlds.base import World
from worm3d.worlds.centreline import Bend, Centreline, Straight
from worm3d.worlds.foot import Foot
from worm3d.worlds.kernels import WorldKernel
from worm3d.worlds.pipe import Pipe
from worm3d.worlds.plane import Plane
from worm3d.worlds.profile import Profile

MOST_WORLDS = 100
"""Largest number of worlds in a union. The number is limited because every world is evaluated at each point."""

TOGETHER = 528
"""Number of points evaluated at once. It is a multiple of every vector length, but not a power of 2, because the rows
of the arrays would then use the same lines of the cache. If a worm has more points, several points share the memory of
a lane. A pipe, for example, keeps the last piece of the point of each lane, and then has to search more often."""


@dataclass(frozen=True, eq=False)
class Union(World, ReadOnly):
    """The union of the free spaces of worlds, for example a pipe bored into the ground below a plane.

    The solid is the intersection of the solids of all worlds. The signed distance is the largest of the worlds'
    distances. This distance is exact inside the solid, where contact forces act. In free space, near the edges where
    the worlds meet, it may be less than the true distance. The sign is correct everywhere. The normal jumps at such an
    edge. Where a point touches several worlds, the world with the largest distance sets the friction.

    Attributes
    ----------
    worlds : tuple of World
        At least one world. The `ClampedGround` is not allowed because it does not act through a distance. A worm is
        placed on the first world.

    Raises
    ------
    ValueError
        There is no world, there are too many, or a world has no distance.
    """

    worlds: tuple[World, ...]

    def __init__(self, worlds: Sequence[World]) -> None:
        arguments.instance("worlds", worlds, list | tuple, "a list of worlds")
        object.__setattr__(self, "worlds", tuple(worlds))
        if not 0 < len(self.worlds) <= MOST_WORLDS:
            got = len(self.worlds) or "none"
            raise ValueError(f"worlds: got {got}, must be at least one (and at most {MOST_WORLDS})")
        for world in self.worlds:
            if not isinstance(world, World) or world.clamped:
                raise ValueError(
                    f"worlds: got {type(world).__name__}, must be worlds with a distance: Plane, Pipe, Heightfield, "
                    "Mesh, Union"
                )

    @property
    def uneven(self) -> bool:
        """Whether a worm without friction could slide away under the load of `pressing`."""
        return len(self.worlds) > 1 or self.worlds[0].uneven

    def kernel(self) -> WorldKernel:
        """Return the compiled world. It has its own memory, so that other kernels may run at the same time."""
        several = [_kernel(world) for world in self.worlds]
        memory = [kernels.inputs_of(kernel, TOGETHER) for kernel in several]
        outputs = np.zeros((kernels.WORLD_ROWS, TOGETHER))
        members = np.empty((len(several), 7))
        for member, kernel, inputs in zip(members, several, memory, strict=True):
            member[:] = *kernels.halves(kernel.address, inputs.ctypes.data, outputs.ctypes.data), len(inputs)
        parameters = [*kernels.halves(members.ctypes.data), len(members)]
        return kernels.kernel_by_hand(union, parameters, (members, memory, outputs, several))

    def distance(self, points: FloatArray) -> FloatArray:
        """Return the signed distance of points of shape (..., 3), shape (...,) [m]."""
        return np.asarray(np.max([world.distance(points) for world in self.worlds], axis=0))

    def pressing(self, gravity: FloatArray) -> FloatArray:
        """Return gravity, or the result of a single world's `pressing`, shape (3,) [m/s^2]."""
        return super().pressing(gravity) if len(self.worlds) > 1 else self.worlds[0].pressing(gravity)

    def bumps(self, within: float) -> float:
        """Return the largest height of bumps narrower than `within` in any of the worlds [m]."""
        return max(world.bumps(within) for world in self.worlds)

    def placed(
        self, along: FloatArray, clearance: float, position: FloatArray, azimuth: float
    ) -> tuple[FloatArray, FloatArray]:
        """Return joints of a worm on the first world, and the directors to the left; see `World.placed`."""
        return self.worlds[0].placed(along, clearance, position, azimuth)


def _kernel(world: World) -> WorldKernel:
    """Return the kernel of a world in a union, the whole formula if there is one.

    Looking up pieces in a table is slow for points far from the world, and in a union most points may be far away.
    """
    formula = world.symbolic()
    return world.kernel() if formula is None else kernels.compiled(*formula)


@inner
def _ask(member: FloatArray, p: FloatArray, first: int, count: int) -> FloatArray:
    """Return the rows of a world at `count` points of `p` from `first` on, shape (11, `TOGETHER`).

    `member` has the addresses of the world's kernel, of its inputs and of its outputs (2 numbers each), and the number
    of its input rows.
    """
    inputs = kernels.doubles(kernels.address(member[2], member[3]), int(member[6]), TOGETHER)
    outputs = kernels.doubles(kernels.address(member[4], member[5]), kernels.WORLD_ROWS, TOGETHER)
    for d in range(3):
        for k in range(count):
            inputs[d, k] = p[d, first + k]
    evaluate(kernels.address(member[0], member[1]), inputs, outputs, count)
    return outputs


def union(inputs: int, rows_in: int, lanes_in: int, outputs: int, rows_out: int, lanes_out: int, count: int) -> int:
    """Evaluate `count` points. This function is the kernel of `Union`.

    The rows of the inputs after the point are the address of the table with a `member` row for each world (2 rows), and
    the number of worlds.
    """
    if rows_in != 6 or rows_out != kernels.WORLD_ROWS or not 0 <= count <= min(lanes_in, lanes_out):
        return WRONG_SHAPE
    if count == 0:
        return SHAPES_FIT
    p, out = kernels.doubles(inputs, rows_in, lanes_in), kernels.doubles(outputs, rows_out, lanes_out)
    members = kernels.table(p, 3, int(p[5, 0]), 7)
    for first in range(0, count, TOGETHER):
        some = min(TOGETHER, count - first)
        for m in range(len(members)):
            rows = _ask(members[m], p, first, some)
            for k in range(some):
                if m == 0 or rows[0, k] > out[0, first + k]:
                    for r in range(kernels.WORLD_ROWS):
                        out[r, first + k] = rows[r, k]
    return SHAPES_FIT


@spelled
def slope_into_pipe(
    slope: float,
    mouth: float,
    pieces: Sequence[Straight | Bend],
    radius: float | Profile,
    tilt: float = 0.0,
    heading: float = 0.0,
    face: float | None = None,
) -> Union:
    """Return a slope that leads into a pipe, like a hillside with a tunnel.

    The bottom of the pipe starts on the slope. The slope continues above and beside the mouth of the pipe, or it ends
    at a steeper face.

    Parameters
    ----------
    slope : float
        Slope of the plane through the origin [rad].
    mouth : float
        Distance up the slope from the origin to the start of the pipe's bottom [m].
    pieces : sequence of Straight and Bend
        Pieces of the pipe.
    radius : float or Profile
        Inner radius of the pipe [m].
    tilt : float
        Angle of the pipe's first piece with the horizontal [rad]. It is less than the slope, or than `face` if given,
        so that the pipe leads into the hill.
    heading : float
        Azimuth of the slope's steepest ascent and of the pipe [rad].
    face : float, optional
        Slope of the hill above the mouth [rad]. If it is None, `slope` continues. The face begins one radius of the
        pipe farther up the slope than the bottom of the pipe, so that there is no rim in front of the worm.

    Raises
    ------
    ValueError
        The pipe would not lead into the hill, or `Plane`, `Foot`, `Centreline` or `Pipe` refuse an argument.
    """
    plane = Plane(slope, heading)
    mouth, tilt = arguments.number("mouth", mouth, "m"), arguments.number("tilt", tilt, "rad")
    wide = float(radius.at(0.0)) if isinstance(radius, Profile) else arguments.number("radius", radius, "m", gt=0.0)
    name, steepest = ("slope", slope) if face is None else ("face", arguments.number("face", face, "rad"))
    if not tilt < steepest:
        raise ValueError(
            f"tilt: got {tilt!r} rad, must be less than the {name} ({steepest!r} rad): the pipe leads into the hill"
        )
    ahead = np.array([np.cos(heading), np.sin(heading), 0.0])
    up = np.cos(tilt) * np.array([0.0, 0.0, 1.0]) - np.sin(tilt) * ahead
    hill = plane if face is None else Foot(slope, face, mouth + wide, heading)
    line = Centreline.of(pieces, start=mouth * plane.axes[0] + wide * up, heading=heading, tilt=tilt)
    return Union([hill, Pipe(line, radius)])
