"""A module of a user's own with parts of every kind, which tests name in scenes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import casadi as ca
import numpy as np

from control.faults.injected import Injected
from control.gaits import Gait, Reflex
from control.gaits.steering import GaitParameters, WaveGenerator
from control.parts import part
from control.planning.terms import CostTerm
from control.sensing.sensors import Channel, Quantity
from control.tracking.obstacles import Obstacle
from control.tracking.paths import Circle
from worm3d.measures import measure
from worm3d.physics.actuators import Actuator, Response
from worm3d.physics.friction_laws import FrictionLaw
from worm3d.physics.hysteresis import Hysteresis
from worm3d.physics.load import Load, LoadStep
from worm3d.physics.media import Medium
from worm3d.physics.segment_laws.law import SegmentLaw
from worm3d.values.parameters import check, documented, parameter
from worm3d.worlds import World


@documented
@dataclass(frozen=True, kw_only=True)
class Kick(Gait):
    """Every other segment kicks."""

    period: float = parameter(1.0, meaning="duration of a kick", unit="s", gt=0)
    share: float = parameter(0.5, meaning="share of the period in which it kicks", gt=0, lt=1)
    lengthens = False

    def activations(self, times, segments):
        phase = np.multiply.outer(times / self.period, np.ones(segments)) - np.arange(segments) / segments
        return (phase % 1.0 < self.share).astype(float)


@documented
@dataclass(frozen=True, kw_only=True)
class Log(Obstacle):
    """A log that lies along x."""

    x: float = parameter(meaning="x of its middle", unit="m")
    y: float = parameter(meaning="y of its middle", unit="m")
    radius: float = parameter(meaning="distance of its edge from its middle line", unit="m", gt=0)
    half: float = parameter(0.1, meaning="half of its length", unit="m", gt=0)

    def __post_init__(self):
        check(self)

    @property
    def spine(self):
        return np.array([[self.x - self.half, self.y], [self.x + self.half, self.y]])

    def distance(self, x, y):
        return ca.hypot(ca.fmax(ca.fabs(x - self.x) - self.half, 0), y - self.y) - self.radius


@documented
@dataclass(frozen=True, kw_only=True)
class Post(Obstacle):
    """A post at (2 m, 0), which lacks keys that discs have."""

    girth: float = parameter(meaning="circumference", unit="m", gt=0)

    def __post_init__(self):
        check(self)

    @property
    def radius(self):
        return self.girth / (2 * np.pi)

    @property
    def spine(self):
        return np.array([[2.0, 0.0]])

    def distance(self, x, y):
        return ca.hypot(x - 2.0, y) - self.radius


@documented
@dataclass(frozen=True, kw_only=True)
class Ripples(World):
    """Ripples along x."""

    height_m: float = parameter(0.004, meaning="height of the ripples", unit="m", ge=0, key="ripple_m")
    wave: float = parameter(0.5, meaning="distance of the ripples", unit="m", gt=0)

    def __post_init__(self):
        check(self)

    def symbolic(self):
        x, p = ca.SX.sym("x", 3), ca.SX.sym("p", 2)
        k = 2 * np.pi / p[1]
        z = p[0] * ca.sin(k * x[0])
        g = (x[2] - z) / ca.sqrt(1 + (p[0] * k) ** 2)
        H, n = ca.hessian(g, x)
        upper = ca.vertcat(H[0, 0], H[0, 1], H[0, 2], H[1, 1], H[1, 2], H[2, 2])
        return ca.Function("ripples", [x, p], [ca.densify(ca.vertcat(g, n, upper, 1.0))]), np.array(
            [self.height_m, self.wave]
        )

    def height(self, places):
        return self.height_m * np.sin(2 * np.pi / self.wave * places[:, 0])


@documented
@dataclass(frozen=True, eq=False, kw_only=True)
class Late(Actuator):
    """Follows its command through a leaky tank."""

    states: ClassVar = {"tank": "1"}
    tau: float = parameter(0.05, meaning="time constant of the tank", unit="s", gt=0)
    drives_hinges: ClassVar = False

    @classmethod
    def respond(cls, s):
        tank = s["tank_n"] + (1.0 - ca.exp(-s["dt"] / s["tau"])) * (s["command"] - s["tank_n"])
        return Response(command=s["command"], given=tank, force=s["force_command"], states={"tank": tank})

    @classmethod
    def at_rest(cls, s):
        return {"tank": s["command"]}


class Hinged(Late):
    """The same for hinges."""

    drives_hinges: ClassVar = True


@documented
@dataclass(frozen=True, eq=False, kw_only=True)
class Sticky(Hysteresis):
    """One element."""

    elements: ClassVar = 1
    hold: float = parameter(0.004, meaning="moment", unit="N m", ge=0)
    give: float = parameter(1e-4, meaning="give", unit="J", gt=0)

    @classmethod
    def coordinate(cls, s):
        from worm3d.physics.elements import hinge_angle

        return s["hold"] * hinge_angle(s["link"], s["length"])

    @classmethod
    def sliders(cls, s):
        return [(1.0, s["give"])]


@documented
@dataclass(frozen=True, eq=False, kw_only=True)
class Mud(Medium):
    """Mud."""

    grow: float = parameter(0.5, meaning="growth", ge=0)

    @classmethod
    def factor(cls, s):
        return 1.0 + s["grow"] * s["strain"]


@documented
@dataclass(frozen=True, eq=False, kw_only=True)
class Blob(SegmentLaw):
    """A chamber that bulges as it shortens."""

    further_inputs: ClassVar = {"rest_height": 1}
    bulge: float = parameter(0.5, meaning="growth of the height over the shortening", ge=0)

    @classmethod
    def outline(cls, s, length, commanded):
        h = s["rest_height"] * (1.0 + s["bulge"] * (1.0 - length / s["l0"]))
        return h, s["offset"] + h

    def values(self, worm):
        return {"bulge": self.bulge, "rest_height": worm.half_height}


@documented
@dataclass(frozen=True, eq=False, kw_only=True)
class Kite(Load):
    """A kite that lifts the tail."""

    states: ClassVar = {"height": "m"}
    lift: float = parameter(0.02, meaning="force upwards", unit="N", ge=0)

    @classmethod
    def respond(cls, s):
        work = s["lift"] * (s["x"][2] - s["past"][2])
        return LoadStep(-s["lift"] * s["x"][2], {"work_external": work}, {"height": s["x"][2]})


@documented
@dataclass(frozen=True, eq=False)
class Slime(FrictionLaw):
    """Slime."""

    thick: float = parameter(3.0, meaning="thickness", unit="s/m", ge=0, each="segment")

    @staticmethod
    def excess(rate, p):
        return 0.5 * p["thick"] * rate**2


@documented
@dataclass(frozen=True, kw_only=True)
class Shy(Reflex):
    """A segment that is loaded contracts a little less."""

    less: float = parameter(0.1, meaning="how much less", ge=0, lt=1)
    senses = ("contact_load",)

    def start(self, worm):
        return self

    def step(self, t, wanted, felt):
        loaded = felt["contact_load"].sum(axis=1) > 0.2
        return wanted * np.where(loaded, 1.0 - self.less, 1.0)[:, None]


@documented
@dataclass(frozen=True, kw_only=True)
class Weak(Injected):
    """All chambers are weak."""

    share: float = parameter(0.5, meaning="share of the command that they follow", ge=0, le=1)

    def commanded(self, command):
        return replace(command, contraction=self.share * command.contraction)


tail = Quantity(
    "height of the tail",
    "m",
    Channel(noise=0.001),
    true_value=lambda seen: np.array(seen.joints[0, 2]),
    shape=lambda worm: (),
    limits=lambda worm: (-1.0, 1.0),
    mirrored=lambda value: value,
)


@measure("lift_m", "how far the head is above the tail at the end")
def lift(result):
    return float(result.joints[-1, -1, 2] - result.joints[-1, 0, 2])


@dataclass(frozen=True)
class Ring(Circle):
    """A ring."""

    radius: float = parameter(0.6, meaning="radius of the ring", unit="m", gt=0)


@part("controller")
@dataclass
class Blind:
    """Drives a constant wave."""

    stride: float = parameter(0.3, meaning="amplitude of its wave", ge=0, lt=0.5)

    @classmethod
    def of(cls, worm, reference, identified, mechanism, control_period, sensors, stride=0.3):
        made = cls(stride=stride)
        made.generator = WaveGenerator(identified.schedule, worm)
        made.seen = sensors
        return made

    def reset(self):
        self.generator.reset()
        self.t = 0.0

    def step(self, t, measurement):
        before, self.t = self.t, t
        return self.generator.step(t - before, GaitParameters(self.stride, 0.8))


class Feels(Blind):
    """Drives a wave that is the smaller the higher it feels its tail; a quarter of it where it feels nothing."""

    senses = ("tail",)

    def step(self, t, measurement):
        height = measurement["tail"].value
        stride = self.stride / 4 if height is None else np.clip(self.stride - height, 0.0, 0.45)
        before, self.t = self.t, t
        return self.generator.step(t - before, GaitParameters(float(stride), 0.8))


@documented
@dataclass(frozen=True, kw_only=True)
class Off(Injected):
    """The sensor of the tail's height is off."""

    error: float = parameter(0.1, meaning="how much it is off", unit="m")

    def measured(self, measurement, before):
        height, instant = measurement["tail"]
        return measurement if height is None else measurement.changed(tail=(height + self.error, instant))


@documented
@dataclass(frozen=True, kw_only=True)
class Ducks(Reflex):
    """Contracts the less the higher the tail is."""

    gain: float = parameter(5.0, meaning="how much less", unit="1/m", ge=0)
    senses = ("tail",)

    def start(self, worm):
        return self

    def step(self, t, wanted, felt):
        return wanted * np.clip(1.0 - self.gain * float(felt["tail"]), 0.0, 1.0)


@dataclass(frozen=True, eq=False)
class Thrift(CostTerm):
    """Costs of the frequency."""

    tolerance: float = parameter(0.5, meaning="frequency that weighs 1", unit="Hz", gt=0)

    def misses(self, at):
        return at.given.frequency / self.tolerance


class Bare(Gait):
    share: float = parameter(0.5, meaning="a share")
    lengthens = False

    def activations(self, times, segments):
        raise ZeroDivisionError("nothing")


@dataclass(frozen=True, kw_only=True)
class Fails(Bare):
    pass


@dataclass(frozen=True)
class Taken(Circle):
    radius: float = 1.0
    speed: float = parameter(1.0, meaning="a speed", unit="m/s")


HILL = World.from_distance(lambda p: p[:, 2] - 0.002 * p[:, 0], ((-1, -1, -1), (2, 1, 1)), 0.1)
