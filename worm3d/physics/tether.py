"""Tether: a cable that the worm drags from its tail (`worm3d.physics.load`).

A cable with the weight w per length [N/m] comes off a reel at the initial position of the tail, and lies along the path
of the tail. Let s be the length of the cable on the ground, T the tension, and theta the tilt of the path, which is
positive if the path rises towards the worm. The cable does not stretch, so that the whole cable slides when its end
slides. An element of the cable that slides forward (+) or back (-) is in balance if

    dT/ds = w sin(theta) +- mu w cos(theta),   T = 0 at the reel                                        (X2)

The integral, with the climb h = (integral of sin(theta) ds) and the resistance R = mu w (integral of cos(theta) ds), is

    T = w h +- R                                                                                        (X3)

On level ground T is mu w s, up a slope w s (sin(theta) + mu cos(theta)), and in an upright pipe the weight w s of the
hanging cable. If the worm pulls the length ds off the reel, the potential energy of the whole cable increases by
w h ds, and friction dissipates R ds. Static friction holds up to static_ratio R. A cable cannot push, so that a
negative limit is replaced by 0. (The reel then holds back cable that would slide off by itself, and the energy is
lost.) The cable therefore sticks at every tension between

    T_low = max(0, w h - R)   and   T_high = max(0, w h + R)                                            (X4)

The piece of cable between the tail's joint x and the end a of the laid cable is free. Its length is c. The free piece
pulls along the line from x to a, projected on the tangent plane of the world. (A joint that rises because its chambers
widen does not climb.) The end follows the joint as a trailer follows a drawbar. The stretch is y = |x - a| - c. As in a
contact that sticks (`worm3d.physics.contact`), a stiff spring with a parallel damper, k y + b y', yields at the limits:
the end moves by D towards x so that

    T = k (y - D) + b (y - D - y_n)/dt,   T_low <= T <= T_high + rho D,   y_n >= 0                      (X5)
    rho = dT_high/ds = w sin(theta) + mu w cos(theta), for the direction at the start of the step

If D > 0, cable comes off the reel, and s, h and R grow. If D < 0, a hanging cable slides back. This is possible only if
T_low > 0. If T_low = 0, the end does not move, and the cable is slack until the joint has come back. If the joint has
passed the end of the cable, so that the end lies ahead in the direction of the segment, the cable does not pull, and
the end does not move.

In a bent pipe the free piece is a chord, and the end rises when the tail moves sideways. Tensions then deviate by up to
8 % from mu w s, with a free length of 0.1 m.

T(y) is piecewise linear with two kinks. Newton's method uses the line of one piece, the *regime*, until an iterate lies
on another piece. Between slack and sliding, the regime always becomes sticking first, so that the method does not
cycle.

The model leaves out four effects: the inertia of the cable, which has the mass w s/g; the pressure on the
inside of a bend, which multiplies T by exp(mu angle); the stiffness of the cable; and a path across a slope, where the
load of the cable on the ground is less than w cos(theta).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np

from worm3d.physics.load import LOAD_FREE, LOAD_HIGH, LOAD_LOW, LOAD_STICKING, Load, LoadStep
from worm3d.physics.part import Symbols
from worm3d.values.arrays import FloatArray
from worm3d.values.parameters import documented, parameter

if TYPE_CHECKING:
    from worm3d.physics.body import Body

NEAREST = 0.01
"""Displacement of the end in a step, as a fraction of the free length, up to which no limit of the tension becomes 0.

The slope of a limit near 0 is reduced for this purpose, so that such a limit reaches 0 only between steps. With half or
twice this value, the tension near 0 changes by less than w times the displacement.
"""


@documented
@dataclass(frozen=True, eq=False, kw_only=True)
class Tether(Load, name="tether"):
    """A cable that the worm drags from its tail, (X2) to (X5).

    `Result.actuator_states` contains its states, with the prefix "load_".
    """

    states: ClassVar[Mapping[str, str]] = {
        "tension": "N",
        "laid": "m",
        "climb": "m",
        "resistance": "N",
        "end_x": "m",
        "end_y": "m",
        "end_z": "m",
    }

    acts_at_rest: ClassVar[bool] = False
    """False: the reel is at the position where the tail comes to rest."""

    weight: float = parameter(0.1, "weight of the cable per length", "N/m", ge=0)
    friction: float = parameter(0.3, "kinetic coefficient of friction between the cable and the world", ge=0)
    static_ratio: float = parameter(1.0, "static over kinetic coefficient of the cable", ge=1)
    free_length: float | None = parameter(
        None, "length of the cable between the tail and where it lies", "m", gt=0, left_out="the length of a segment"
    )

    @classmethod
    def respond(cls, s: Symbols) -> LoadStep:
        """Return the response of the cable in a step."""
        return _Cable(s).step()

    def values(self, worm: Body) -> Mapping[str, float]:
        """Return the parameters by name."""
        length = worm.l0 if self.free_length is None else self.free_length
        return {**super().values(worm), "free_length": length}

    def begin(self, worm: Body, place: FloatArray, tangent: FloatArray) -> Mapping[str, float]:
        """Return the states of a cable of which nothing is laid yet. Its end lies straight behind the worm."""
        end = place - self.values(worm)["free_length"] * np.asarray(tangent)
        return {**dict.fromkeys(self.states, 0.0), **dict(zip(("end_x", "end_y", "end_z"), end, strict=True))}


class _Line(NamedTuple):
    """T as a linear function of y on one side of a kink, where T is a limit of (X4) that changes as the end slides."""

    limit: Any
    """Tension at the kink [N]."""
    kink: Any
    """y at the kink [m]."""
    rate: Any
    """Change of the limit per displacement of the end, rho [N/m]."""
    slope: Any
    """dT/dy [N/m]."""


class _Cable:
    """A tether in a time step, in CasADi symbols."""

    def __init__(self, s: Symbols) -> None:
        import casadi as ca

        self.s, self.end = s, ca.vertcat(*(s[f"end_{axis}_n"] for axis in "xyz"))
        self.down = s["gravity"] / ca.sqrt(ca.sumsqr(s["gravity"]) + 1e-30)  # 0 without gravity
        self.normal = s["normal"] / ca.sqrt(ca.sumsqr(s["normal"]) + 1e-30)
        self.y, self.along = self._reach(s["x"])
        y_n, along_n = self._reach(s["past"][:3])
        self.climbs, ahead = -ca.dot(along_n, self.down), ca.dot(along_n, s["tangent"])
        self.pulls = ahead > 0.0  # else the joint has passed the end
        self.y_n = ca.if_else(self.pulls, ca.fmax(0.0, y_n), 0.0)
        rubs = s["friction"] * ca.sqrt(ca.fmax(0.0, ca.sumsqr(self.down) - self.climbs**2))
        self.rubs = s["weight"] * rubs  # dR/ds
        self.stiffness = s["stiffness"] + s["damping"] / s["dt"]
        self.rest = s["damping"] / s["dt"] * self.y_n / self.stiffness
        grip = ca.fmin(1.0, 2.0 * ahead)  # if the cable lies across the pull, only a part of the friction acts
        self.low, self.high = self._limits(self.pulls, ca.fmax(0.0, grip))

    def _reach(self, x: Any) -> tuple[Any, Any]:
        """Return the stretch of the free piece and its direction.

        The unit vector points from the end to the joint, in the tangent plane of the world.
        """
        import casadi as ca

        reach = x - self.end
        reach -= ca.dot(reach, self.normal) * self.normal
        distance = ca.sqrt(ca.sumsqr(reach) + 1e-30)
        return distance - self.s["free_length"], reach / distance

    def _limits(self, pulls: Any, grip: Any) -> tuple[_Line, _Line]:
        """Return both limits of (X4) as lines of y; `grip` is the fraction of the friction that acts."""
        import casadi as ca

        s, weight = self.s, self.s["weight"] * self.s["climb_n"]
        slid = ca.logic_and(s["regime_n"] != LOAD_STICKING, s["tension_n"] > 0.0)
        resistance = grip * s["resistance_n"] * ca.if_else(slid, 1.0, s["static_ratio"])
        rising, falling = (s["weight"] * self.climbs + sign * grip * self.rubs for sign in (1.0, -1.0))
        low, high, most = weight - resistance, weight + resistance, 1.0 / (NEAREST * s["free_length"])
        return (  # neither limit passes through 0 within a step
            self._line(ca.logic_and(pulls, low > 0.0), low, ca.fmin(falling, most * low)),
            self._line(ca.logic_and(pulls, high >= 0.0), high, ca.fmax(rising, -most * high)),
        )

    def _line(self, acts: Any, limit: Any, rate: Any) -> _Line:
        """Return the line of a limit that changes as the end moves. If `acts` is false, the limit is 0."""
        import casadi as ca

        k, limit, rate = self.stiffness, ca.if_else(acts, limit, 0.0), ca.if_else(acts, rate, 0.0)
        return _Line(limit, self.rest + limit / k, rate, k * rate / (k + rate))

    def _chosen(self, low: Any, sticking: Any, high: Any) -> Any:
        """Return one of three values, selected by the regime, or by y if the regime is `LOAD_FREE`."""
        import casadi as ca

        regime = self.s["regime"]
        own = ca.if_else(
            self.y > self.high.kink, LOAD_HIGH, ca.if_else(self.y < self.low.kink, LOAD_LOW, LOAD_STICKING)
        )
        regime = ca.if_else(regime == LOAD_FREE, own, regime)
        return ca.if_else(regime == LOAD_HIGH, high, ca.if_else(regime == LOAD_LOW, low, sticking))

    def _potential(self, line: _Line) -> Any:
        beyond = self.y - line.kink
        return line.limit**2 / (2.0 * self.stiffness) + line.limit * beyond + line.slope / 2.0 * beyond**2

    def _next(self) -> Any:
        """Return the next regime. Sticking comes between the other two regimes.

        The regime changes if the tension exceeds a kink by 1e-9 of the limit, which is more than rounding.
        """
        import casadi as ca

        regime, tie = self.s["regime"], 1e-9 * (self.high.limit / self.stiffness + 1e-12)
        above, below = self.y > self.high.kink + tie, self.y < self.low.kink - tie
        stays = ca.if_else(above, LOAD_HIGH, ca.if_else(below, LOAD_LOW, LOAD_STICKING))
        of_high = ca.if_else(self.y < self.high.kink - tie, LOAD_STICKING, LOAD_HIGH)
        of_low = ca.if_else(self.y > self.low.kink + tie, LOAD_STICKING, LOAD_LOW)
        return ca.if_else(regime == LOAD_HIGH, of_high, ca.if_else(regime == LOAD_LOW, of_low, stays))

    def step(self) -> LoadStep:
        """Return the response of the cable in the step."""
        import casadi as ca

        s, k, low, high = self.s, self.stiffness, self.low, self.high
        beyond = self.y - self.rest
        potential = self._chosen(self._potential(low), k / 2.0 * beyond**2, self._potential(high))
        tensions = [line.limit + line.slope * (self.y - line.kink) for line in (low, high)]
        ways = [k * (self.y - line.kink) / (k + line.rate) for line in (low, high)]
        back = ca.if_else(low.limit > 0.0, ca.fmax(ways[0], -s["laid_n"]), 0.0)  # a slack cable does not slide back
        tension = self._chosen(tensions[0], k * beyond, tensions[1])
        way = ca.if_else(self.pulls, self._chosen(back, 0.0, ways[1]), 0.0)
        rate = self._chosen(low.rate, 0.0, high.rate)
        climbs = -ca.dot(self.along, self.down)
        raised = s["weight"] * (s["climb_n"] + climbs * way / 2.0) * way
        elastic = ca.if_else(self.pulls, ca.fmax(0.0, self.y - way), 0.0)
        gave = elastic - self.y_n
        level = ca.dot(s["x"] - self.end, self.normal) * self.normal
        laid = s["laid_n"] + way
        end = self.end + way * self.along + ca.fmin(1.0, ca.fabs(way) / s["free_length"]) * level
        states = {
            "tension": tension,
            "laid": ca.fmax(0.0, laid),
            "climb": ca.if_else(laid > 0.0, s["climb_n"] + climbs * way, 0.0),
            "resistance": ca.if_else(laid > 0.0, ca.fmax(0.0, s["resistance_n"] + self.rubs * way), 0.0),
            **{f"end_{axis}": end[d] for d, axis in enumerate("xyz")},
        }
        terms = {
            "potential": raised,
            "friction_loss": (tension - rate * way / 2.0) * way - raised,
            "anchor": s["stiffness"] / 2.0 * (elastic**2 - self.y_n**2),
            "viscous_loss": (tension - s["stiffness"] * elastic) * gave,
        }
        return LoadStep(potential, terms, states, self._next())
