"""Sections of a scene in which a controller drives the 3D worm: the controller, its sensors and its reference."""

from __future__ import annotations

import math
from typing import Literal

from control.sensing import sensors
from scenes.language.schema import Pair, Section, Tables, quantity, setting, tables
from scenes.models.worm.schema import SpatialScene

MPC, PI_LOS, OPEN_LOOP = "mpc", "pi_los", "open_loop"

HEADING, LINE, CIRCLE, S_CURVE, SPLINE, WAY_POINTS = "heading", "line", "circle", "s_curve", "spline", "way_points"
BEGUN = (LINE, CIRCLE, S_CURVE)
"""Kinds of paths that have a start and a direction there; others are where their points are."""

HEADING_NOISE_DEG = round(math.degrees(sensors.HEADING.noise), 9)


class Controller(Section):
    """What drives the worm."""

    kind: Literal["mpc", "pi_los", "open_loop"] = setting(
        MPC,
        title="mpc: model predictive control of the gait's parameters; pi_los: PI control of the speed and "
        "line-of-sight steering; open_loop: the wave that the identified map says, without looking",
        aka=("type",),
    )
    mechanism: Literal["hinge", "bias"] = setting("hinge", title="what steers: hinges, or unequal chambers")
    period_s: float = quantity(0.2, unit="s", gt=0, title="time between two decisions", aka=("control_period_s",))
    map: Literal["own", "default"] = setting(
        "own",
        title="which identified map it goes by: that of this worm on this friction, or the default worm's, whatever "
        "the worm is",
    )


class Sensor(Section):
    """How good the sensors are; every bias is drawn once a run, with this standard deviation."""

    strain_noise: float = quantity(sensors.STRAIN.noise, ge=0, title="standard deviation of a chamber's strain")
    strain_bias: float = quantity(sensors.STRAIN.bias, ge=0, title="of its constant error")
    strain_delay_s: float = quantity(sensors.STRAIN.delay, unit="s", ge=0, title="until a strain arrives")
    strain_dropout: float = quantity(sensors.STRAIN.dropout, ge=0, le=1, title="probability that a strain is lost")
    strain_rate_Hz: float | None = quantity(unit="Hz", gt=0, left_out="at every time step", title="strains a second")
    com_noise_m: float = quantity(
        sensors.COM.noise, unit="m", ge=0, title="standard deviation of each coordinate of the centre of mass"
    )
    com_bias_m: float = quantity(sensors.COM.bias, unit="m", ge=0, title="of their constant errors")
    com_delay_s: float = quantity(sensors.COM.delay, unit="s", ge=0, title="until a place arrives")
    com_dropout: float = quantity(sensors.COM.dropout, ge=0, le=1, title="probability that a place is lost")
    com_rate_Hz: float = quantity(sensors.COM.rate, unit="Hz", gt=0, title="places a second")
    heading: bool = setting(False, title="whether there is a sensor of the heading")
    heading_noise_deg: float = quantity(
        HEADING_NOISE_DEG, unit="deg", ge=0, title="standard deviation of the heading, where there is such a sensor"
    )
    heading_bias_deg: float = quantity(0.0, unit="deg", ge=0, title="of its constant error")
    heading_delay_s: float = quantity(sensors.HEADING.delay, unit="s", ge=0, title="until a heading arrives")
    heading_dropout: float = quantity(sensors.HEADING.dropout, ge=0, le=1, title="probability that a heading is lost")
    heading_rate_Hz: float | None = quantity(unit="Hz", gt=0, left_out="at every time step", title="headings a second")


class SpeedStep(Section):
    """From when on which speed is asked for."""

    at_s: float = quantity(unit="s", gt=0, title="when")
    speed_m_s: float = quantity(unit="m/s", ge=0, title="speed from then on")


class HeadingStep(Section):
    """From when on which heading is asked for."""

    at_s: float = quantity(unit="s", gt=0, title="when")
    heading_deg: float = quantity(unit="deg", title="heading from then on")


class Point(Section):
    """A point of a path."""

    x_m: float = quantity(unit="m", title="x")
    y_m: float = quantity(unit="m", title="y")


class Reference(Section):
    """What the worm is asked to do: how fast to go, and where to."""

    kind: Literal["none", "heading", "line", "circle", "s_curve", "spline", "way_points", "pipe"] = setting(
        LINE, title="what to keep to: nothing, a heading, a path, or the centre line of the pipe", aka=("path", "type")
    )
    speed_m_s: float = quantity(0.08, unit="m/s", ge=0, title="speed forward, at first")
    speed_steps: Tables[SpeedStep] = tables(title="steps of the speed, each a table of at_s and speed_m_s")
    speed_sine_m_s: float = quantity(0.0, unit="m/s", ge=0, title="amplitude of a sine that is added to the speed")
    speed_sine_period_s: float = quantity(20.0, unit="s", gt=0, title="its period")
    heading_deg: float = quantity(0.0, unit="deg", only=HEADING, title="heading only: at first")
    heading_steps: Tables[HeadingStep] = tables(
        only=HEADING, title="heading only: steps of the heading, each a table of at_s and heading_deg"
    )
    start_m: Pair | None = quantity(
        unit="m",
        only=BEGUN,
        left_out="the middle of the worm as it starts",
        title="line, circle, s_curve only: where the path begins: x, y",
    )
    azimuth_deg: float | None = quantity(
        unit="deg",
        only=BEGUN,
        left_out="where the worm looks as it starts",
        title="line, circle, s_curve only: direction of the path where it begins",
    )
    radius_m: float = quantity(
        1.5, unit="m", gt=0, only=(CIRCLE, WAY_POINTS), title="circle, way_points only: radius, or that of the corners"
    )
    towards: Literal["left", "right"] = setting(
        "left", only=(CIRCLE, S_CURVE), title="circle, s_curve only: to which side it turns first"
    )
    amplitude_m: float = quantity(0.4, unit="m", gt=0, only=S_CURVE, title="s_curve only: amplitude of its sine")
    wavelength_m: float = quantity(4.0, unit="m", gt=0, only=S_CURVE, title="s_curve only: wavelength of its sine")
    points: Tables[Point] = tables(
        only=(SPLINE, WAY_POINTS), title="spline, way_points only: points of the path, each a table of x_m and y_m"
    )
    closed: bool = setting(False, only=SPLINE, title="spline only: whether it goes on from its last point to its first")


class ControlScene(SpatialScene):
    """A whole scene."""

    model: Literal["worm_control"] = setting(title="which simulation the scene is for")
    controller: Controller = Controller()
    sensor: Sensor = Sensor()
    reference: Reference = Reference()
