"""An actuator with one time constant while a chamber fills and another while the chamber vents.

A valve connects the chamber to a supply or to the room. The pressure approaches the pressure of the supply with one
time constant, and the pressure of the room with another. Venting is usually slower, because the pressure drop over the
valve is smaller. The actuator applies the time constants to the free contraction a:

    a' = (command - a)/fill if command > a, else (command - a)/vent                                       (FV1)

For a segment law from finite elements or a test bench, the free contraction determines the pressure. The contraction
follows an exponential, and the pressure does not: with the same time constants, a lag of the pressure would change the
contraction of the shipped barrel by up to 0.021 of 0.216 in steps of 3 kPa. Unlike
`worm3d.physics.pneumatic.Pneumatic`, the time constants do not depend on the volume of the chamber.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from worm3d.physics.actuators import Actuator, Response, lagged
from worm3d.physics.part import Numbers, Symbols
from worm3d.values.parameters import documented, parameter


@documented
@dataclass(frozen=True, eq=False, kw_only=True)
class FillAndVent(Actuator, name="fill_and_vent"):
    """Rest length and force of a chamber follow the commands with one lag to grow and with another lag to fall.

    The command is limited to `least` and `greatest`. The solution of (FV1) is exact for a command that changes linearly
    over the step and stays on one side of the contraction.
    """

    drives_hinges: ClassVar[bool] = False

    fill: Numbers = parameter(0.1, "time constant while the contraction grows", "s", ge=0, each="segment")
    vent: Numbers = parameter(0.3, "time constant while the contraction falls", "s", ge=0, each="segment")
    least: Numbers = parameter(0.0, "least contraction", le=0, each="segment")
    greatest: Numbers = parameter(0.45, "greatest contraction", ge=0, lt=1, each="segment")

    @classmethod
    def respond(cls, s: Symbols) -> Response:
        """Return the contraction and the force after the lag and the limits."""
        import casadi as ca  # parameters do not need casadi

        command = ca.fmin(ca.fmax(s["command"], s["least"]), s["greatest"])
        lag = ca.if_else(command > s["given_n"], s["fill"], s["vent"])
        given = lagged(command, s["command_n"], s["given_n"], lag, s["dt"])
        force = lagged(s["force_command"], s["force_command_n"], s["force_n"], lag, s["dt"])
        return Response(command, given, force)
