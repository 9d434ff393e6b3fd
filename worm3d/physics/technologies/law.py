"""The law of an actuator technology: a slow drive, a spring moved by the drive, a limited force, and the energy used.

Drive. The command c is the commanded contraction of the chamber. It corresponds to the share u = c/s of the free stroke
s = strain lever. A lag (`delay`) delays the command. The drive d is, for example, the heat of a wire, the charge of a
film, the pressure of a muscle or the angle of a motor. It follows the delayed command by first order, with different
time constants up and down and a limited rate:

    d' = (target - d)/tau,   tau = rise where |target| > |d|, else fall,   |d'| <= rate                 (T1)

rise and fall hold for an actuator with the cross-section `gauge`. A wire that is heated by a current and cooled by air
becomes slower with increasing thickness. Its times up and down depend on its cross-section (area) in the same way:

    rise, fall, 1/leak  ~  (area/gauge)^(THICKNESS_POWER/2)                                             (T1a)

The active share a of the actuator follows the drive with hysteresis, as the phase of a shape memory alloy follows the
temperature. The drive can change by the width w = `hysteresis` of a band before a changes (a play operator, which also
describes minor loops):

    (1 + w) d - w <= a <= (1 + w) d,   0 <= a <= 1                                                      (T2)

The target of (T1) is the drive at which a equals u, on that edge of the band where a moves towards u. Actuators that
are driven both ways have no band, and -1 <= d = a <= 1.

Force. Let z = 1 - l/l0 be the contraction of the actuator (z = l/l0 - 1 for an actuator that lengthens the chamber),
x = z/s, and F_b = stress area/lever the blocking force. The actuator pulls with the force F = F_b f, where f is limited
by the largest push and the largest pull:

    f = max(-push, min(kappa (q - x), A (1 - droop max(x, 0)))),   kappa = `series`                     (T3)

A drive that moves the free end of a spring (alloys, films, bellows, motors) has q = a and A = 1. With kappa = 1, f is
then the line from the blocking force to the free stroke, moved by the drive. With a stiffer spring, the actuator sets
the position with a limited force. A drive that scales the force (`scales`: the pressure of braided muscles, the
activation of natural muscles) has q = 1 and A = a. Since f never grows with x, the potential
Psi = - F_b l0 s (integral of f dx) is convex in the length.

Energy. The end of the spring moves by dy = s l0 dx + (1 - scales) dF/K, K = kappa F_b/(s l0). The drive does the work
W = F dy. The spring stores (1 - scales) F^2/(2 K) of this work, and the rest goes to the chamber. The other energies
are

    stored in the drive     E |d|,   E = charge area l0          (heat, field, compressed air)           (T4)
    leaking from it         leak E |d|                           (cooling, leakage)
    holding                 stall F^2 lever/F_b                  (the current of a motor)
    idling                  `idle`                               (the current of electronics, in every step)
    drawn from the source   D+/charging + W+/efficiency + holding + idling,   D = E |d|' + leak E |d|
    lost                    leak + D+ (1/charging - 1) + D- + W+ (1/efficiency - 1) + W- + holding + idling

D+ and D- are the positive and negative parts of D, and W+ and W- those of W. A drive that is released loses all of its
energy that does not leak away. The work that the chamber does on the drive is also lost, and nothing returns to the
source. The energy drawn is the sum of the energies stored, lost and transferred to the chamber. `idle` is the power of
the drive of one chamber at any size. In a step, W and the holding energy are computed by the trapezoidal rule, and the
leak follows from the exponential of the drive. The energy transferred to the chamber is then the mean pull times the
shortening. The remainder is numerical loss in the ledger.

Heat. The temperature T above the room temperature is the sum of hot |d| and the warming T_l of a body by all losses
except idling. The body has the heat capacity C = heat_capacity stress area, and cools with the time constant `cooling`.
Near `hottest` the command is reduced to zero:

    T = hot |d| + T_l,   C T_l' = lost - C T_l/cooling,   |u| <= 10 (1 - T/hottest)                     (T5)
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from worm3d.physics.actuators import Actuator, Response, lagged
from worm3d.physics.body import Body
from worm3d.physics.part import Numbers, Symbol, Symbols
from worm3d.values.arrays import FloatArray
from worm3d.values.parameters import documented, parameter

MOST_STROKE = 0.9
"""Largest free stroke, as a fraction of the chamber's rest length."""

NO_LIMIT = float("inf")

THICKNESS_POWER = 1.75
"""Exponent of the thickness of a wire in its time constants, (T1a).

With this exponent, and 1.85 s for a wire of 0.15 mm, the times of wires of 0.10 to 0.38 mm agree with the published
times, 1 to 10 s, within 10 %. A wire of half the thickness takes 0.30 of the time. The exponent 2 (heat conduction in
air only) would give 0.25, and the exponent 1 (a constant coefficient of heat transfer) 0.5.
"""


@documented
@dataclass(frozen=True, eq=False, kw_only=True)
class Technology(Actuator):
    """Base class of the actuator technologies, (T1) to (T5). They differ in numbers, and change the chambers' lengths.

    The springs of the chambers keep their rest lengths and pull the chambers back. An actuator that can only pull
    (push = 0) shortens the chamber. With `lengthens`, it lengthens the chamber, as hoops that squeeze a mesh do. The
    recorded states are "asked" (the delayed command), "drive" and "active", all as shares of the full drive, "warmth",
    and "pull", the force on the chamber, which is positive for contraction.
    """

    states: ClassVar[Mapping[str, str]] = {"asked": "1", "drive": "1", "active": "1", "warmth": "K", "pull": "N"}
    drives_hinges: ClassVar[bool] = False
    has_source: ClassVar[bool] = True

    strain: float = parameter(0.2, "free strain of the active material", gt=0)
    stress: float = parameter(1e5, "blocking stress on its cross-section", "Pa", gt=0)
    lever: Numbers = parameter(
        1.0, "transmission: the stroke is so many times larger, the force smaller", gt=0, each="segment"
    )
    area: Numbers | None = parameter(
        None, "cross-section of the actuator of a chamber", "m^2", gt=0, each="segment", left_out="by reserve and room"
    )
    reserve: float = parameter(
        2.0,
        "default size: blocking force over the half of what stretches a segment's springs by the stroke and of the "
        "worm's weight",
        gt=0,
    )
    room: float = parameter(
        0.2, "default size: largest share of the chamber's cross-section 2 h0 (b + h0) that it may fill", gt=0, le=1
    )
    series: float = parameter(1.0, "stiffness kappa of its spring, over blocking force per free stroke", ge=1, le=1e3)
    droop: float = parameter(1.0, "share of the blocking force that is gone at the full stroke", ge=0, le=1)
    push: float = parameter(0.0, "largest force against its sense, over the blocking force", ge=0, le=1)
    both_ways: bool = parameter(False, "whether it is driven both ways, also against its sense")
    lengthens: bool = parameter(False, "whether it lengthens its chamber instead of shortening it")
    scales: bool = parameter(False, "whether the drive scales the force; else it moves the free end of the spring")
    delay: float = parameter(0.0, "mean delay of the command", "s", ge=0)
    rise: float = parameter(0.1, "time constant while the drive grows", "s", ge=0)
    fall: float = parameter(0.1, "time constant while it falls", "s", ge=0)
    rate: float = parameter(NO_LIMIT, "greatest speed of the drive", "1/s", gt=0, infinite=True, left_out="no limit")
    gauge: Numbers | None = parameter(
        None,
        "cross-section with these values of rise, fall and leak, (T1a); for a bundle, the total of all wires",
        "m^2",
        gt=0,
        each="segment",
        left_out="the times hold for every cross-section",
    )
    hysteresis: float = parameter(0.0, "width w of the band between drive and active share", ge=0, le=10)
    charge: float = parameter(0.0, "energy kept at full drive in its volume, area times l0", "J/m^3", ge=0)
    leak: float = parameter(0.0, "share of that energy that leaks away", "1/s", ge=0)
    charging: float = parameter(1.0, "efficiency of charging the drive", gt=0, le=1)
    efficiency: float = parameter(1.0, "efficiency of the work", gt=0, le=1)
    stall: float = parameter(0.0, "power that holds the blocking force, over that force at lever 1", "W/N", ge=0)
    idle: float = parameter(0.0, "power that the drive of a chamber draws all the time, whatever its size", "W", ge=0)
    hot: float = parameter(0.0, "temperature above the room's at full drive", "K", ge=0)
    heat_capacity: float = parameter(
        NO_LIMIT,
        "heat capacity of the body that losses warm, over the blocking force at lever 1",
        "J/(K N)",
        gt=0,
        infinite=True,
        left_out="no warming",
    )
    cooling: float = parameter(
        NO_LIMIT, "time constant of its cooling", "s", gt=0, infinite=True, left_out="no cooling"
    )
    hottest: float = parameter(
        NO_LIMIT,
        "temperature above the room's at which it is switched off",
        "K",
        gt=0,
        infinite=True,
        left_out="no limit",
    )
    sources: ClassVar[Mapping[str, str]] = {}
    """Source of each number of the technology, by name of the parameter."""
    uncounted: ClassVar[str] = ""
    """Energy that the energy drawn does not include, so that the technology cannot be compared with others; empty if
    nothing is missing."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.both_ways and self.scales:
            raise ValueError("both_ways: got True, must be False where the drive scales the force (scales)")
        if self.both_ways and self.hysteresis > 0.0:
            raise ValueError(f"hysteresis: got {self.hysteresis!r}, must be 0 in an actuator that is driven both ways")

    @classmethod
    def compiled(cls) -> type[Actuator]:
        """Return the class from which the kernels are made, which is the same for all technologies."""
        return Technology

    @classmethod
    def respond(cls, s: Symbols) -> Response:
        """Return the response according to (T1) to (T5)."""
        import casadi as ca  # parameters do not need casadi

        asked, drive, active, time = _driven(s)
        now, before = _Shape(s, active, "length"), _Shape(s, s["active_n"], "length_n")
        blocking, path = s["stress"] * s["area"] / s["lever"], _stroke(s) * s["l0"]
        pull, pull_n = blocking * now.force, blocking * before.force
        soft = (1.0 - s["scales"]) * path / (s["series"] * blocking)  # 1/K, 0 where there is no spring
        worked = (pull + pull_n) / 2.0 * (path * (now.x - before.x) + soft * (pull - pull_n))
        held = s["charge"] * s["area"] * s["l0"]
        charged, leaked = held * (ca.fabs(drive) - ca.fabs(s["drive_n"])), s["leak"] * held * time
        into, out = ca.fmax(charged + leaked, 0.0), ca.fmax(-charged - leaked, 0.0)
        given, taken = ca.fmax(worked, 0.0), ca.fmax(-worked, 0.0)
        holding = s["stall"] * s["lever"] / blocking * s["dt"] * (pull**2 + pull_n**2) / 2.0
        heating = into * (1.0 / s["charging"] - 1.0) + out + given * (1.0 / s["efficiency"] - 1.0) + taken + holding
        kept = ca.exp(-s["dt"] / (2.0 * s["cooling"]))  # over half a step: the losses come in the middle
        warmed = (leaked + heating) / (s["heat_capacity"] * s["stress"] * s["area"])
        left = ((s["warmth_n"] - s["hot"] * ca.fabs(s["drive_n"])) * kept + warmed) * kept
        warmth, idle = s["hot"] * ca.fabs(drive) + left, s["idle"] * s["dt"]
        return Response(
            command=_command(s),
            given=_sense(s) * _stroke(s) * active,
            force=s["force_command"],
            spring=0.0,
            potential=-blocking * path * now.integral,
            states={"asked": asked, "drive": drive, "active": active, "warmth": warmth, "pull": _sense(s) * pull},
            work=into / s["charging"] + given / s["efficiency"] + holding + idle,
            stored=charged + soft * (pull**2 - pull_n**2) / 2.0,
            lost=leaked + heating + idle,
        )

    @classmethod
    def at_rest(cls, s: Symbols) -> Symbols:
        """Return the states under a command that has been constant for a long time."""
        import casadi as ca

        share = _share(s, s["command"])
        drive = ca.if_else(share > 0.0, (share + s["hysteresis"]) / (1.0 + s["hysteresis"]), share)
        blocking = s["stress"] * s["area"] / s["lever"]
        pull = _sense(s) * blocking * _Shape(s, share, "length").force
        return {"asked": share, "drive": drive, "active": share, "warmth": s["hot"] * ca.fabs(drive), "pull": pull}

    def values(self, worm: Body, *, hinge: bool) -> Mapping[str, float | FloatArray]:
        """Return the parameters. An omitted size is computed from the worm, and the times depend on the size, (T1a)."""
        given = super().values(worm, hinge=hinge)
        area = self.size(worm) if self.area is None else self.area
        if self.gauge is None:
            return {**given, "area": area, "gauge": area}
        slower = self.slower(np.asarray(area))
        times = {"rise": self.rise * slower, "fall": self.fall * slower, "leak": self.leak / slower}
        return {**given, "area": area, **times}

    def slower(self, area: FloatArray) -> FloatArray:
        """Return the factor by which `rise` and `fall` are longer with a given cross-section [m^2], (T1a)."""
        return (area / (area if self.gauge is None else self.gauge)) ** (THICKNESS_POWER / 2.0)

    def size(self, worm: Body) -> FloatArray:
        """Return the default cross-section of the actuator of each chamber, shape (N,) [m^2].

        The actuator is as large as the worm needs, but fills at most a share `room` of the chamber's cross-section.
        """
        h0 = np.asarray(worm.half_height)
        return np.minimum(self.needed(worm), self.room * 2.0 * h0 * (worm.chamber_offset + h0))

    def needed(self, worm: Body) -> FloatArray:
        """Return the cross-section of the actuator of each chamber that the worm needs, shape (N,) [m^2].

        The blocking force is `reserve` times the sum of two forces. The first is the force of a chamber's springs (half
        of a segment's springs) at the stroke. The second is half of the worm's weight on earth.
        """
        wanted = -worm.stroke[0] if self.lengthens else worm.stroke[1]
        stroke = np.minimum(np.minimum(self.strain * np.asarray(self.lever), MOST_STROKE), wanted or MOST_STROKE)
        force = self.reserve * (np.asarray(worm.k_spring) * stroke + worm.mass * 9.81) / 2.0
        return np.broadcast_to(force * self.lever / self.stress, (worm.segments,)).copy()


class _Shape:
    """Stroke x, force f as a fraction of the blocking force, and the integral of f dx, at an active share, (T3)."""

    def __init__(self, s: Symbols, active: Symbol, length: str) -> None:
        import casadi as ca

        kappa, m = s["series"], s["scales"]
        at, top = m + (1.0 - m) * active, 1.0 - m + m * active
        self.x = x = _sense(s) * (1.0 - s[length] / s["l0"]) / _stroke(s)
        early = at - top / kappa  # where the spring takes over from the limit, if before x = 0
        slack = ca.fmax(kappa - top * s["droop"], 1e-9)
        turn = ca.if_else(early < 0.0, early, (kappa * at - top) / slack)
        droop = ca.if_else(early < 0.0, 0.0, top * s["droop"])
        ramps = ((-droop, x), (droop - kappa, x - turn), (kappa, x - at - s["push"] / kappa))
        self.force = top + sum(slope * ca.fmax(by, 0.0) for slope, by in ramps)
        self.integral = top * x + sum(slope * ca.fmax(by, 0.0) ** 2 / 2.0 for slope, by in ramps)


def _sense(s: Symbols) -> Symbol:
    """Return 1 for an actuator that shortens its chamber, and -1 for an actuator that lengthens its chamber."""
    return 1.0 - 2.0 * s["lengthens"]


def _stroke(s: Symbols) -> Symbol:
    """Return the free stroke as a fraction of the chamber's rest length."""
    import casadi as ca

    return ca.fmin(s["strain"] * s["lever"], MOST_STROKE)


def _share(s: Symbols, command: Symbol) -> Symbol:
    """Return the commanded share of the full drive."""
    import casadi as ca

    return ca.fmin(ca.fmax(_sense(s) * command / _stroke(s), -s["both_ways"]), 1.0)


def _command(s: Symbols) -> Symbol:
    return _sense(s) * _stroke(s) * _share(s, s["command"])


def _driven(s: Symbols) -> tuple[Symbol, Symbol, Symbol, Symbol]:
    """Return the delayed command, drive and active share at the end of the step, and the time integral of |drive|.

    They follow (T1) and (T2). The target of the drive is constant in the step. The integral is exact unless the drive
    changes sign.
    """
    import casadi as ca

    asked = lagged(_share(s, s["command"]), _share(s, s["command_n"]), s["asked_n"], s["delay"], s["dt"])
    cool = ca.fmin(ca.fmax(10.0 * (1.0 - s["warmth_n"] / s["hottest"]), 0.0), 1.0)
    wanted, w = ca.fmax(ca.fmin((asked + s["asked_n"]) / 2.0, cool), -cool), s["hysteresis"]
    above, below = (wanted + w) / (1.0 + w), wanted / (1.0 + w)
    target = ca.if_else(s["active_n"] > wanted, below, ca.if_else(s["active_n"] < wanted, above, s["drive_n"]))
    lag = ca.if_else(ca.fabs(target) > ca.fabs(s["drive_n"]), s["rise"], s["fall"])
    free = target + (s["drive_n"] - target) * ca.exp(-s["dt"] / lag)
    most = s["rate"] * s["dt"]
    drive = ca.fmin(ca.fmax(free, s["drive_n"] - most), s["drive_n"] + most)
    active = ca.fmin(ca.fmax(s["active_n"], (1.0 + w) * drive - w), (1.0 + w) * drive)
    line = s["dt"] * (ca.fabs(drive) + ca.fabs(s["drive_n"])) / 2.0
    curve = ca.fabs(target * s["dt"] - lag * (drive - s["drive_n"]))
    follows = ca.logic_and(drive == free, drive * s["drive_n"] >= 0.0)
    return asked, drive, ca.fmin(ca.fmax(active, -s["both_ways"]), 1.0), ca.if_else(follows, curve, line)
