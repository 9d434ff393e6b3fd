"""Viscous media (P8) whose resistance may follow the shape of the worm. A new one is one class.

A medium resists the velocity v_j of a joint by -zeta_j v_j. Each segment brings the share drag/N of the whole worm's
resistance to its two joints, half to each, times a factor r that the medium makes of its strain and strain rate:

    zeta_j = (zeta_{j-1/2} + zeta_{j+1/2})/2,   zeta of a segment = drag/N max(0, r(strain, rate))          (D1)

so that a worm can push where it grips and recover where it slips. Within a time step zeta is constant, and the medium a
damper that never gives energy back: r is that of the shape foreseen for the end of the step from the lengths l of a
segment and their rate at its start, to second order (to first order where there is one instant only),

    l = l_{n-1} + 2 dt l'_n,   l' = 3 l'_n - 2 (l_n - l_{n-1})/dt                                           (D2)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from worm3d.physics.part import Numbers, Part, Symbol, Symbols
from worm3d.values.parameters import documented, parameter

MEDIA: dict[str, type[Medium]] = {}
"""Class of each kind of medium by its name."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Medium(Part, registry=MEDIA):
    """Base of all media, itself one that resists alike whatever the shape.

    A subclass, `class Mud(Medium, name="mud")`, defines `factor`; its fields are parameters, those declared with
    each="segment" may be arrays. `worm3d.Worm(drag=..., medium=...)` uses it.
    """

    known: ClassVar[tuple[str, ...]] = ("strain", "rate")

    @classmethod
    def factor(cls, s: Symbols) -> Symbol:
        """Return r of (D1), as a scalar expression of CasADi; below 0 it counts as 0.

        Parameters
        ----------
        s : mapping of str to SX
            Scalars by name. The parameters, the "strain" l/l0 - 1 of a segment, and its "rate" [1/s].
        """
        return 1.0


MEDIA["uniform"] = Medium


@documented
@dataclass(frozen=True, eq=False, kw_only=True)
class StrainDrag(Medium, name="strain_drag"):
    """Resistance in proportion to 1 + gain strain + rate_gain strain rate, as of bristles that stand up or lie down.

    With the strain A cos(k X - w t) the factor is 1 + B cos(k X - w t + phi), where B cos(phi) = gain A and
    B sin(phi) = -rate_gain A w: the worm swims at (A B/2) (w/k) cos(phi) along the wave, against it where stretched
    segments resist less (Tanaka, Ito, Nakagaki, Kobayashi, J. R. Soc. Interface 9, 2012, 222, control friction so).
    """

    gain: Numbers = parameter(
        1.0, meaning="growth of the factor with strain; below 0 contracted segments resist more", each="segment"
    )
    rate_gain: Numbers = parameter(
        0.0, meaning="growth of the factor with the rate of strain", unit="s", each="segment"
    )

    @classmethod
    def factor(cls, s: Symbols) -> Symbol:
        """Return 1 + gain strain + rate_gain rate."""
        return 1.0 + s["gain"] * s["strain"] + s["rate_gain"] * s["rate"]
