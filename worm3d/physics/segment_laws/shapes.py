"""Segment laws in closed form: the rhombus of links, and the hydrostat of constant volume."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from worm3d.physics.body import Body
from worm3d.physics.part import Symbol, Symbols
from worm3d.physics.segment_laws.law import SegmentLaw, Spring, lengthwise
from worm3d.values.arrays import FloatArray
from worm3d.values.parameters import documented

FLATTENED_HEIGHT = 0.02
"""A rhombus below this fraction of its rest height is flattened, which ends the run."""


@documented
@dataclass(frozen=True, eq=False, kw_only=True)
class Rhombus(SegmentLaw, name="rhombus"):
    """Each chamber is a rhombus of four links, (E2), with the springs (E4): on its length and on its apex hinges."""

    has_links: ClassVar[bool] = True
    bounded_by: ClassVar[str] = "twice the links"

    @classmethod
    def angle(cls, s: Symbols, length: Symbol, bend: Symbol) -> Symbol:
        """Return the angle of the apex hinges."""
        from worm3d.physics.elements import hinge_angle  # parameters do not need casadi

        return hinge_angle(s["link"], length)

    @classmethod
    def springs(cls, s: Symbols) -> tuple[Spring, ...]:
        """Return the spring on the length, and the apex hinges with the damping tau k_apex."""
        from worm3d.physics.elements import hinge_angle, hinge_energy

        def turning(angle: Symbol, commanded: Symbol) -> Symbol:
            return hinge_energy(s["k_apex"], angle, hinge_angle(s["link"], s["l0"]))

        return lengthwise(s), Spring(turning, s["tau"] * s["k_apex"])

    @classmethod
    def outline(cls, s: Symbols, length: Symbol, commanded: Symbol) -> tuple[Symbol, Symbol]:
        """Return the half-height of the rhombus, and the offset plus the half-height."""
        from worm3d.physics.elements import half_height

        h = half_height(s["link"], length)
        return h, s["offset"] + h

    def free_outlines(self, worm: Body, length: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the outlines, which do not depend on the contraction. Chambers as long as two links are flat."""
        height = np.sqrt(np.maximum(worm.link_length[:, None] ** 2 - length**2 / 4.0, 0.0))
        return height, worm.chamber_offset + height

    def reach(self, worm: Body) -> FloatArray:
        """Return the length of the links."""
        return worm.link_length

    def flattened_length(self, worm: Body) -> FloatArray:
        """Return the length of a chamber with the height `FLATTENED_HEIGHT`."""
        length: FloatArray = 2.0 * np.sqrt(worm.link_length**2 - (FLATTENED_HEIGHT * np.asarray(worm.half_height)) ** 2)
        return length

    def flattening_weight(self, worm: Body, contraction: float) -> FloatArray:
        """Return the limit point of each segment (`worm3d.physics.segment_laws.limit_point`)."""
        from worm3d.physics.segment_laws.limit_point import limit_points

        return limit_points(worm, contraction)


@documented
@dataclass(frozen=True, eq=False, kw_only=True)
class Hydrostat(SegmentLaw, name="hydrostat"):
    """Each chamber is a cylinder of constant volume, as in a muscular hydrostat, with the spring (E4) on its length.

    The half-height is h(l) = h0 sqrt(l0/l), so that the volume pi h^2 l is pi h0^2 l0. (W. M. Kier and K. K. Smith,
    Tongues, tentacles and trunks: the biomechanics of movement in muscular-hydrostats, Zool. J. Linn. Soc. 83, 307,
    1985.) There are no links and no apex hinges.
    """

    further_inputs: ClassVar[Mapping[str, int]] = {"rest_height": 1}

    @classmethod
    def outline(cls, s: Symbols, length: Symbol, commanded: Symbol) -> tuple[Symbol, Symbol]:
        """Return the half-height, and the offset plus the half-height."""
        import casadi as ca

        h = s["rest_height"] * ca.sqrt(s["l0"] / length)
        return h, s["offset"] + h

    def values(self, worm: Body) -> Mapping[str, Any]:
        """Return the half-height at rest."""
        return {"rest_height": worm.half_height}
