"""The worm as a MuJoCo model (MJCF).

A segment (MJ1) is two bodies at its end joints, coupled by a slide joint along its axis, and a foot at its middle.
Bodies of neighbouring segments are coupled by three hinges: pitch, yaw and twist, with the stiffness and damping of
the worm's joints. A position actuator with a first-order lag commands the slide: force (k/l0) (l_cmd - l).
Left out in MuJoCo's favour: the bend of the chambers (merged with the yaw of the joints), and contact of the upper and
outward apexes and the end faces, which touch nothing here: 2 contacts a segment instead of 6.

The foot (MJ2) carries the two lower apexes. It slides relative to the far end body along

    (-1/2, 0, s)   per metre of length,   s = (h(l0 (1 - A)) - h(l0))/(l0 A),   h(l) = sqrt(a^2 - l^2/4)

so that it stays at the middle of the segment and moves out as the segment shortens: the secant of the rhombus over
the amplitude A of the gait. An equality constraint ties it to the slide, so that the weight on the foot stretches the
segment as it does in the linkage.

A kinematic tree (MJ3) is rooted in the middle of the worm: the mass matrix couples each joint with all between it and
the root, and factoring it costs the cube of their number. Long worms are cut into several trees, welded together.

Contacts (MJ4) are springs in MuJoCo. Their impedance 1 - 0.0033 (6/N)^0.6 lets the resting worm sink in by 1e-4 (N up
to 6) to 3e-4 (N = 200) of a segment's length; the bound of `worm3d` is 1e-4. Softness is a device of the method, not a
property of the worm: MuJoCo's default is faster, but loses 3 % of the distance at N = 6 and 35 % at N = 20; ten times
less than here adds 0.2 and 2 %.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from xml.etree.ElementTree import Element, SubElement, tostring

import numpy as np
from rivals import Task

TIP_RADIUS = 0.005
"""Radius of the spheres whose lowest points are the apexes [m]."""


def mjcf(task: Task, dt: float, per_tree: int) -> str:
    """Return the model as XML, with so many segments in a kinematic tree at most."""
    root = Element("mujoco")
    SubElement(root, "compiler", angle="radian")
    _options(root, dt)
    world = SubElement(root, "worldbody")
    SubElement(world, "geom", name="floor", type="plane", size="0 0 1", contype="0", conaffinity="0")
    contact, equality, actuator = (SubElement(root, tag) for tag in ("contact", "equality", "actuator"))
    for low, high in _trees(task.worm.segments, per_tree):
        _Tree(task, low, high, equality).grow(world)
    for i in range(task.worm.segments):
        _touch(contact, task, i)
        _actuate(actuator, task, i)
    return tostring(root, encoding="unicode")


def _options(root: Element, dt: float) -> None:
    kinds = {"integrator": "discrete", "solver": "Newton", "cone": "elliptic", "jacobian": "sparse"}
    option = SubElement(root, "option", kinds, timestep=repr(dt), gravity="0 0 -9.81")
    SubElement(option, "flag", island="disable", midphase="disable", autoreset="disable")


def _trees(segments: int, per_tree: int) -> Iterator[tuple[int, int]]:
    """Yield the first segment of each tree and the one after its last."""
    count = -(-segments // per_tree)
    bounds = [round(i * segments / count) for i in range(count + 1)]
    return pairwise(bounds)


def _touch(contact: Element, task: Task, i: int) -> None:
    """Let the feet of segment i touch the floor, with the same friction in all directions."""
    friction, impedance = " ".join(2 * [str(task.friction.backward)]), _impedance(_softness(task))
    for side in "LR":
        ends = {"geom1": "floor", "geom2": f"{side}{i}"}
        SubElement(contact, "pair", ends, condim="3", friction=friction, solimp=impedance)


def _softness(task: Task) -> float:
    """Return how soft the contacts are, (MJ4)."""
    softness: float = 0.0033 * (6.0 / task.worm.segments) ** 0.6
    return softness


def _impedance(softness: float) -> str:
    """Return MuJoCo's constraint impedance, the same at any depth."""
    return f"{1.0 - softness} {1.0 - softness} 0.001"


def _actuate(actuator: Element, task: Task, i: int) -> None:
    """Let a control [m] set the change of length of segment i."""
    stiffness = float(np.asarray(task.worm.k_spring)[i] / task.worm.l0)
    SubElement(
        actuator,
        "general",
        joint=f"length{i}",
        dyntype="filterexact",
        dynprm=repr(task.worm.actuator_lag),
        gainprm=repr(stiffness),
        biastype="affine",
        biasprm=f"0 {-stiffness} 0",
        actearly="true",
    )


@dataclass(frozen=True)
class _Tree:
    """Segments low ... high - 1, rooted in the middle one; the one before low is in another tree."""

    task: Task
    low: int
    high: int
    equality: Element

    def grow(self, world: Element) -> None:
        """Add the tree to the world, and weld it to the one before."""
        i = (self.low + self.high) // 2
        root = SubElement(world, "body", pos=f"{i * self.task.worm.l0} 0 {self._half_height(i)}")
        SubElement(root, "freejoint")
        self._segment(root, i, forward=True)
        self._go_on(root, i - 1, forward=False)

    def _go_on(self, end: Element, i: int, *, forward: bool) -> None:
        """Hang segment i on the end body of its neighbour, or end the tree there."""
        if self.low <= i < self.high:
            near = SubElement(end, "body")
            self._hinges(near, i if forward else i + 1)
            self._segment(near, i, forward=forward)
        elif i == self.low - 1 >= 0:
            self._weld(end)

    def _weld(self, end: Element) -> None:
        """Add a second body for the front end of the segment before this tree, and tie the two together."""
        twin = SubElement(end, "body", name=f"twin{self.low}")
        self._hinges(twin, self.low)
        self._end_mass(twin, self.low - 1, share=0.5)
        ends = {"body1": f"far{self.low - 1}", "body2": f"twin{self.low}"}
        SubElement(self.equality, "weld", ends, solimp=self._tie())

    def _segment(self, near: Element, i: int, *, forward: bool) -> None:
        """Add to its near end body the rest of segment i, and what comes after it."""
        worm, sign = self.task.worm, 1 if forward else -1
        stiffness = float(np.asarray(worm.k_spring)[i] / worm.l0)
        self._end_mass(near, i)
        far = SubElement(near, "body", name=f"far{i}", pos=f"{sign * worm.l0} 0 0")
        damping = repr(worm.kelvin_voigt_time * stiffness)
        SubElement(far, "joint", name=f"length{i}", type="slide", axis=f"{sign} 0 0", damping=damping)
        cut = forward and i == self.high - 1 < worm.segments - 1
        self._end_mass(far, i, share=0.5 if cut else 1.0)
        self._foot(far, i, sign)
        self._go_on(far, i + sign, forward=forward)

    def _foot(self, far: Element, i: int, sign: int) -> None:
        """Add the lower apexes, (MJ2)."""
        worm, s = self.task.worm, self._secant(i)
        b, h, mass = worm.chamber_offset, self._half_height(i), 2.0 * worm.apex_mass[i, 0]
        foot = SubElement(far, "body", pos=f"{-sign * worm.l0 / 2.0} 0 0")
        inertia = mass * b**2
        _inertial(foot, mass, -h, (inertia, 1e-3 * inertia, inertia))  # point masses have none about their line
        SubElement(foot, "joint", name=f"foot{i}", type="slide", axis=f"{-sign / 2.0} 0 {s}")
        for side, y in (("L", b), ("R", -b)):
            position, size = f"0 {y} {TIP_RADIUS - h}", repr(TIP_RADIUS)
            SubElement(foot, "geom", name=f"{side}{i}", size=size, pos=position, mass="0", contype="0", conaffinity="0")
        path = f"0 {np.hypot(0.5, s)} 0 0 0"
        ends = {"joint1": f"foot{i}", "joint2": f"length{i}"}
        SubElement(self.equality, "joint", ends, polycoef=path, solimp=self._tie())

    def _secant(self, i: int) -> float:
        """Return how far the foot of segment i moves out per metre of shortening."""
        worm, amplitude = self.task.worm, self.task.gait.amplitude
        short = worm.l0 * (1.0 - amplitude)
        h = float(np.sqrt(worm.link_length[i] ** 2 - short**2 / 4.0))
        return (h - self._half_height(i)) / (worm.l0 - short)

    def _hinges(self, body: Element, joint: int) -> None:
        """Add the hinges of a joint (1 ... N-1)."""
        task, j = self.task, joint - 1
        for axis, stiffness in (("0 1 0", task.pitch[j]), ("0 0 1", task.yaw[j]), ("1 0 0", task.twist[j])):
            k, damping = repr(float(stiffness)), repr(float(task.worm.kelvin_voigt_time * stiffness))
            SubElement(body, "joint", type="hinge", axis=axis, stiffness=k, damping=damping)

    def _end_mass(self, body: Element, i: int, share: float = 1.0) -> None:
        """Give an end body half of the upper and outward apexes of segment i, and its share of the joint."""
        worm, b, h = self.task.worm, self.task.worm.chamber_offset, self._half_height(i)
        apex = worm.apex_mass[i, 0]
        mass = 2.0 * apex + worm.joint_mass[0]
        up = apex * h / mass
        lift = mass * up**2
        pitch, yaw = apex * h**2 - lift, apex * (b**2 + (b + h) ** 2)
        _inertial(body, share * mass, up, (share * (pitch + yaw) * (1.0 - 1e-9), share * pitch, share * yaw))

    def _tie(self) -> str:
        # A tenth of this softness changes the distance by less than 0.5 %.
        return _impedance(0.1 * _softness(self.task))

    def _half_height(self, i: int) -> float:
        return float(np.asarray(self.task.worm.half_height)[i])


def _inertial(body: Element, mass: float, z: float, inertia: tuple[float, float, float]) -> None:
    """Give a body its mass [kg], height of its centre [m] and moments of inertia [kg m^2]."""
    diagonal = " ".join(repr(float(moment)) for moment in inertia)
    SubElement(body, "inertial", pos=f"0 0 {z}", mass=repr(float(mass)), diaginertia=diagonal)
