"""Keys of the section [world] for planes, and for the paper's ground."""

from __future__ import annotations

from scenes.language.schema import Pair, Section, Tables, quantity, tables

PLANE, CLAMPED = "plane", "clamped"
PIPE, SLOPE_INTO_PIPE = "pipe", "slope_into_pipe"
PIPES = (PIPE, SLOPE_INTO_PIPE)


class Patch(Section):
    """A rectangle of the plane with another friction."""

    grip: float = quantity(ge=0, title="multiplier of the friction coefficients")
    along_m: Pair | None = quantity(
        unit="m",
        left_out="everywhere",
        title="from where to where along the steepest ascent, from the origin, or along a pipe",
    )
    across_m: Pair | None = quantity(
        unit="m", left_out="everywhere", title="from where to where to the left of it, from the origin"
    )


class PlaneKeys(Section):
    """Keys of a plane."""

    slope_deg: float = quantity(
        0.0, unit="deg", gt=-90, lt=90, only=(PLANE, SLOPE_INTO_PIPE), title="angle, rising towards x"
    )
    heading_deg: float = quantity(
        0.0,
        unit="deg",
        only=(PLANE, PIPE, SLOPE_INTO_PIPE),
        title="azimuth of a plane's steepest ascent, or of a pipe where it starts, if not x",
        aka=("azimuth_deg",),
    )
    patches: Tables[Patch] = tables(
        only=(PLANE, PIPE),
        title="places with another friction, each a table of grip, along_m = [from, to] and (planes only) across_m; "
        "in a pipe along its centre line",
    )


class ClampedKeys(Section):
    """Keys of the paper's ground."""

    velocity_threshold_m_s: float = quantity(
        1e-6, unit="m/s", ge=0, only=CLAMPED, title="no friction (P10) below this speed"
    )
