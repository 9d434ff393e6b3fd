"""The resistance of a medium to a segment, (D1), generated from the factor of a `worm3d.physics.media.Medium`."""

from __future__ import annotations

import casadi as ca

from worm3d.physics.expressions import answer, scalar
from worm3d.physics.kernels.layout import Layout, once
from worm3d.physics.media import Medium
from worm3d.values.parameters import parameters_of

MEDIUM_PREFIX = "medium_"
"""Prefix of the names of the medium's parameters among the inputs."""

STRAIN, RATE, SHARE = range(3)
"""First rows of the inputs: strain, rate of strain [1/s], and resistance of a segment if the factor is 1 [N s/m]."""


@once
def layout(kind: type[Medium]) -> Layout:
    """Return the layout of the inputs. It has no rows for a uniform medium."""
    if kind.factor.__func__ is Medium.factor.__func__:  # type: ignore[attr-defined]
        return Layout({})
    return Layout({"strain": 1, "rate": 1, "share": 1, **{MEDIUM_PREFIX + name: 1 for name in parameters_of(kind)}})


@once
def resistance(kind: type[Medium] = Medium) -> ca.Function | None:
    """Return the resistance of a segment [N s/m]; None for a uniform medium.

    Raises
    ------
    ValueError
        The factor of the class is not a scalar expression.
    """
    rows = layout(kind)
    if not rows.rows:
        return None
    s = rows.symbols
    known = {name: s[MEDIUM_PREFIX + name] for name in parameters_of(kind)} | {name: s[name] for name in kind.known}
    factor = scalar(f"{kind.__name__}.factor", answer(kind, "factor", known))
    return rows.function("medium_resistance", {"resistance": s["share"] * ca.fmax(0.0, factor)})
