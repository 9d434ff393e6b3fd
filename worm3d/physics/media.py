"""Viscous media, (P8), whose resistance may depend on the shape of the worm. A new medium is a subclass of `Medium`.

A medium resists the velocity v_j of joint j by the force -zeta_j v_j. Each segment has the share drag/N of the
resistance of the whole worm, multiplied by a factor r that the medium computes from the strain and the strain rate of
the segment. Each of the two joints of a segment gets half of the segment's resistance:

    zeta_j = (zeta_{j-1/2} + zeta_{j+1/2})/2,   zeta of a segment = drag/N max(0, r(strain, rate))          (D1)

A worm can therefore push with segments of large resistance and recover with segments of small resistance. Within a time
step zeta is constant, so that the medium is a linear damper and never returns energy. r is evaluated for the predicted
shape at the end of the step. The prediction is second-order. It uses the segment's lengths l and length rates l' at the
last two instants,

    l = l_{n-1} + 2 dt l'_n,   l' = 3 l'_n - 2 (l_n - l_{n-1})/dt                                           (D2)

If only one instant is known (in the first step), the prediction is first-order.
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
    """Base class of all media. The resistance of the base class does not depend on the shape.

    A subclass, for example `class Mud(Medium, name="mud")`, defines `factor`. Its fields are parameters; a field
    declared with each="segment" may be an array. The argument `medium` of `worm3d.Worm` selects the medium.
    """

    known: ClassVar[tuple[str, ...]] = ("strain", "rate")

    @classmethod
    def factor(cls, s: Symbols) -> Symbol:
        """Return the factor r of (D1) as a scalar CasADi expression. Negative values are replaced by 0.

        Parameters
        ----------
        s : mapping of str to SX
            Scalars by name: the parameters, the strain "strain" = l/l0 - 1 of a segment, and its strain rate "rate"
            [1/s].
        """
        return 1.0


MEDIA["uniform"] = Medium


@documented
@dataclass(frozen=True, eq=False, kw_only=True)
class StrainDrag(Medium, name="strain_drag"):
    """Resistance proportional to 1 + gain strain + rate_gain strain rate, as of bristles that rise and lie down.

    With the strain A cos(k X - w t) the factor is 1 + B cos(k X - w t + phi), where B cos(phi) = gain A and B
    sin(phi) = -rate_gain A w. The worm then swims at the speed (A B/2) (w/k) cos(phi). A positive speed is in the
    direction of the wave; the worm swims against the wave if stretched segments resist less. Friction is controlled in
    this way by Tanaka, Ito, Nakagaki, Kobayashi, J. R. Soc. Interface 9, 2012, 222.
    """

    gain: Numbers = parameter(
        1.0, "growth of the factor with strain; below 0 contracted segments resist more", each="segment"
    )
    rate_gain: Numbers = parameter(0.0, "growth of the factor with the rate of strain", "s", each="segment")

    @classmethod
    def factor(cls, s: Symbols) -> Symbol:
        """Return 1 + gain strain + rate_gain rate."""
        return 1.0 + s["gain"] * s["strain"] + s["rate_gain"] * s["rate"]
