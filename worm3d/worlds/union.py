"""Several worlds as one: space that is free in any of the worlds is free.

The kernel of a union evaluates the kernels of the worlds one after the other, and takes the greatest distance at each
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
"""Largest number of worlds in a union: every world is evaluated at each point."""

TOGETHER = 528
"""Number of points evaluated at once: a multiple of every vector length, and no power of 2, which would put rows on the
same lines of the cache. With more points, several points of a worm share the data that a world keeps for a point, which
takes time."""


@dataclass(frozen=True, eq=False)
class Union(World, ReadOnly):
    """The union of the free spaces of worlds: a pipe bored into the ground below a plane, pipes that cross.

    The solid is the intersection of the solids of all worlds. The signed distance is the greatest of the worlds'
    distances. Inside the solid, where forces arise, this distance is exact. In free space, near the edges where the
    worlds meet, it may be less than the true distance; the sign is right everywhere. The normal jumps at such an edge.
    Where a point touches several worlds, the world with the greatest distance sets the friction.

    Attributes
    ----------
    worlds : tuple of World
        At least one world; not the `ClampedGround`, which does not act through a distance. A worm is placed on the
        first world.

    Raises
    ------
    ValueError
        No world, or a world without a distance.
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
        """Whether a worm without friction would slide away under `pressing` alone."""
        return len(self.worlds) > 1 or self.worlds[0].uneven

    def kernel(self) -> WorldKernel:
        """Return the compiled world, with memory for itself only: other kernels may run at the same time."""
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
        """Return gravity, or the part of gravity that presses a worm to a single world, shape (3,) [m/s^2]."""
        return super().pressing(gravity) if len(self.worlds) > 1 else self.worlds[0].pressing(gravity)

    def bumps(self, within: float) -> float:
        """Return the greatest height of bumps narrower than a distance in any of the worlds [m]."""
        return max(world.bumps(within) for world in self.worlds)

    def placed(
        self, along: FloatArray, clearance: float, position: FloatArray, azimuth: float
    ) -> tuple[FloatArray, FloatArray]:
        """Return joints of a worm on the first world, and the directors to the left; see `World.placed`."""
        return self.worlds[0].placed(along, clearance, position, azimuth)


def _kernel(world: World) -> WorldKernel:
    """Return a world's kernel: the whole formula if there is one, as most points may be far from the world."""
    formula = world.symbolic()
    return world.kernel() if formula is None else kernels.compiled(*formula)


@inner
def _ask(member: FloatArray, p: FloatArray, first: int, count: int) -> FloatArray:
    """Return the rows of a world at some points, shape (11, `TOGETHER`).

    The numbers of a world are addresses of the kernel, its inputs and its outputs (2 each), and its number of inputs.
    """
    inputs = kernels.doubles(kernels.address(member[2], member[3]), int(member[6]), TOGETHER)
    outputs = kernels.doubles(kernels.address(member[4], member[5]), kernels.WORLD_ROWS, TOGETHER)
    for d in range(3):
        for k in range(count):
            inputs[d, k] = p[d, first + k]
    evaluate(kernels.address(member[0], member[1]), inputs, outputs, count)
    return outputs


def union(inputs: int, rows_in: int, lanes_in: int, outputs: int, rows_out: int, lanes_out: int, count: int) -> int:
    """Evaluate `count` points; the kernel of `Union`.

    Rows of the inputs after the point: address of the numbers of the worlds (2), and number of worlds.
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
    """Return a slope that leads into a pipe: a hillside with a tunnel.

    The pipe's bottom starts on the slope. The slope continues above the mouth and on both sides, or ends there at a
    steeper face.

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
        Tilt of the pipe's first piece, less than the slope or the face, so that the pipe leads into the hill [rad].
    heading : float
        Azimuth of the slope's steepest ascent and of the pipe [rad].
    face : float, optional
        Slope of the hill above the mouth [rad]; None: the slope continues. The face begins one radius of the pipe
        farther up than the pipe's bottom, so that there is no rim in front of the worm.

    Raises
    ------
    ValueError
        A pipe that would leave the hill, or arguments that `Plane`, `Foot`, `Centreline` or `Pipe` refuse.
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
