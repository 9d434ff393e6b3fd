"""Viscous media (P8) whose resistance may follow the shape of the worm. A new medium is one class.

A medium resists the velocity v_j of a joint by -zeta_j v_j. Each segment has the share drag/N of the whole worm's
resistance, times a factor r that the medium computes from the strain and strain rate of the segment. Each of the two
joints takes half:

    zeta_j = (zeta_{j-1/2} + zeta_{j+1/2})/2,   zeta of a segment = drag/N max(0, r(strain, rate))          (D1)

so that a worm can push with the parts that grip and recover with the parts that slip. Within a time step zeta is
constant, and the medium is a damper that never returns energy. r is evaluated for the shape predicted for the end of
the step. The prediction uses the lengths l of a segment and their rate at the start, to second order (to first order if
only one instant is known),

    l = l_{n-1} + 2 dt l'_n,   l' = 3 l'_n - 2 (l_n - l_{n-1})/dt                                           (D2)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from worm3d.physics.part import Numbers, Part, Symbol, Symbols
from worm3d.values.parameters import documented, parameter

MEDIA: dict[str, type[Medium]] = {}
"""Class of each kind of medium by name."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Medium(Part, registry=MEDIA):
    """Base of all media; the resistance of the base does not depend on the shape.

    A subclass, `class Mud(Medium, name="mud")`, defines `factor`; the fields are parameters, and fields declared with
    each="segment" may be arrays. `worm3d.Worm(drag=..., medium=...)` sets the medium.
    """

    known: ClassVar[tuple[str, ...]] = ("strain", "rate")

    @classmethod
    def factor(cls, s: Symbols) -> Symbol:
        """Return r of (D1), as a scalar expression of CasADi; negative values count as 0.

        Parameters
        ----------
        s : mapping of str to SX
            Scalars by name. The parameters, the "strain" l/l0 - 1 of a segment, and the "rate" of strain [1/s].
        """
        return 1.0


MEDIA["uniform"] = Medium


@documented
@dataclass(frozen=True, eq=False, kw_only=True)
class StrainDrag(Medium, name="strain_drag"):
    """Resistance in proportion to 1 + gain strain + rate_gain strain rate, like bristles that stand up or lie down.

    With the strain A cos(k X - w t) the factor is 1 + B cos(k X - w t + phi), where B cos(phi) = gain A and B
    sin(phi) = -rate_gain A w: the worm swims at (A B/2) (w/k) cos(phi) along the wave, and against the wave if
    stretched segments resist less (Tanaka, Ito, Nakagaki, Kobayashi, J. R. Soc. Interface 9, 2012, 222, control
    friction in this way).
    """

    gain: Numbers = parameter(
        1.0, "growth of the factor with strain; below 0 contracted segments resist more", each="segment"
    )
    rate_gain: Numbers = parameter(0.0, "growth of the factor with the rate of strain", "s", each="segment")

    @classmethod
    def factor(cls, s: Symbols) -> Symbol:
        """Return 1 + gain strain + rate_gain rate."""
        return 1.0 + s["gain"] * s["strain"] + s["rate_gain"] * s["rate"]
