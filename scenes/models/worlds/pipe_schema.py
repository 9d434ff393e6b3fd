"""Keys of the section [world] for pipes, and for a slope that leads into one."""

from __future__ import annotations

from typing import Literal

from scenes.language.schema import Points, Section, Tables, quantity, setting, tables
from scenes.models.worlds.plane_schema import PIPE, PIPES, SLOPE_INTO_PIPE


class Piece(Section):
    """A straight piece (straight_m) or a bend (bend_deg, bend_radius_m, towards) of a pipe."""

    straight_m: float | None = quantity(unit="m", gt=0, left_out="a bend", title="length of a straight piece")
    bend_deg: float | None = quantity(unit="deg", gt=0, le=360, left_out="a straight piece", title="angle of a bend")
    bend_radius_m: float | None = quantity(
        unit="m", gt=0, left_out="a straight piece", title="radius of a bend's centre line"
    )
    towards: Literal["left", "right", "up", "down"] = setting("left", title="where a bend turns, seen along the pipe")


class Radius(Section):
    """A place along a pipe and its inner radius there; between two places the wall is a cone with rounded edges."""

    at_m: float = quantity(unit="m", title="how far along the pipe")
    radius_m: float = quantity(unit="m", gt=0, title="inner radius there")


class PipeKeys(Section):
    """Keys of a pipe."""

    radius_m: float = quantity(0.12, unit="m", gt=0, only=PIPES, title="inner radius")
    tilt_deg: float = quantity(
        0.0, unit="deg", ge=-90, le=90, only=PIPES, title="angle with the horizontal where it starts, 90: up"
    )
    pieces: Tables[Piece] = tables(
        only=PIPES,
        title="straight pieces and bends one after the other, none: straight, each a table of straight_m, "
        "or of bend_deg, bend_radius_m and towards = left, right, up or down",
    )
    points_m: Points = quantity(
        (),
        unit="m",
        only=PIPE,
        title="instead of tilt_deg and pieces, places [x, y, z] that it goes through",
    )
    radii: Tables[Radius] = tables(
        only=PIPES,
        title="instead of radius_m, places with at_m and radius_m, between them the wall is a cone",
    )
    rounding_m: float | None = quantity(
        unit="m",
        gt=0,
        only=PIPES,
        left_out="as round as there is room",
        title="radius of the edges where the wall's slope changes",
    )
    start_wall: bool = setting(False, only=PIPE, title="whether a wall closes it where it starts")
    end_wall: bool = setting(False, only=PIPE, title="whether a wall closes it where it ends")
    mouth_m: float = quantity(
        1.3, unit="m", only=SLOPE_INTO_PIPE, title="how far up the slope the pipe's bottom starts"
    )
