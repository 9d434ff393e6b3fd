"""Actuators: from a command to the rest length, the force or the pressure of a chamber, or the angle of a hinge.

An actuator is a dataclass. Its fields are its parameters, and its method `respond` returns the response in a time step,
in CasADi symbols. The kernels of the segments are generated from `respond`, with all derivatives, and compiled once per
class. A force that depends on the unknown length of the chamber at the end of the step is written as a potential:

    force on the chamber = - d Psi(length; states at the start, command, dt) / d length

so that the states, which are implicit in the step, are eliminated where they are defined. An actuator with a state
p' = f(p, length) solves p_{n+1} = p_n + dt f(p_{n+1}, length) for p_{n+1}(length) and integrates the force over the
length; the step remains the minimum of one potential. `Pneumatic` is an example to start from.

An actuator is found by name once the module that defines the actuator has been imported, as
`worm3d/physics/actuator_names.py` imports `Pneumatic`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from worm3d.physics.body import Body
from worm3d.physics.part import Numbers, Part, Symbol, Symbols
from worm3d.values.arrays import FloatArray
from worm3d.values.parameters import documented, parameter, parameters_of

COMMANDS = ("command", "command_n", "given_n", "force_command", "force_command_n", "force_n")
"""Commands to an actuator at the end and at the start of a step, and outputs at the start of the step."""

RESPONSE_INPUTS = (*COMMANDS, "dt", "span", "length", "length_n", "l0", "link", "k")
"""Names of the inputs of `Actuator.respond` beside parameters and states."""


class Response(NamedTuple):
    """Response of an actuator in a step. Only fields marked * may depend on "length", "span" and "..._hat"."""

    command: Symbol
    """The command within the limits: contraction of a chamber, or angle of a hinge [rad]."""
    given: Symbol
    """* Output of the actuator: contraction, or angle [rad]. A run records this output."""
    force: Symbol = 0.0
    """Force along the chamber [N]; a positive force contracts the chamber."""
    spring: Symbol | None = None
    """Contraction of the rest length of the chamber's spring; None: the same as `given`."""
    potential: Symbol = 0.0
    """* Potential Psi: the force on the chamber is minus the derivative of Psi in the length [J]."""
    states: Symbols = {}  # noqa: RUF012  # never changed
    """* The states at the end of the step, by name."""
    work: Symbol = 0.0
    """* Energy supplied by the source during the step, beside the work on the spring's rest length [J]."""
    stored: Symbol = 0.0
    """* Change of the energy stored in the actuator [J]."""
    lost: Symbol = 0.0
    """* Energy lost within the actuator [J]."""


ACTUATORS: dict[str, type[Actuator]] = {}
"""Class of each actuator by name."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Actuator(Part, registry=ACTUATORS):
    """Base of all actuators; a frozen dataclass with `worm3d.values.parameters.parameter` fields.

    A subclass gets a name in the class statement, `class Valve(Actuator, name="valve")`, and defines `respond`; fields
    declared with each="segment" may be arrays. `worm3d.Worm(actuator=...)` sets the actuator of the chambers, and
    `hinge_actuator` sets the actuator of the hinges.
    """

    known: ClassVar[tuple[str, ...]] = RESPONSE_INPUTS
    told: ClassVar[tuple[str, ...]] = ("states", "drives_hinges", "has_source")
    drives_hinges: ClassVar[bool] = True
    """Whether the actuator may drive a hinge: such an actuator has no potential and no energy, and needs no length."""
    has_source: ClassVar[bool] = False
    """Whether `Response.work` is the energy drawn from a source; the rest lengths of the springs then stay the same."""

    @classmethod
    def compiled(cls) -> type[Actuator]:
        """Return the class from which the kernels are made; classes that differ only in numbers share one."""
        return cls

    @classmethod
    def respond(cls, s: Symbols) -> Response:
        """Return the response of the actuator in a time step.

        All inputs are scalar CasADi expressions without values: use `ca.if_else` for choices, and `ca.fmin` and
        `ca.fmax` for limits. Python's `if`, `min` and `max` raise errors on such expressions; numpy's functions may
        work, but warn (`np.clip` prints a FutureWarning).

        Parameters
        ----------
        s : mapping of str to SX
            Scalars by name. The parameters. "command", "command_n": commanded contraction (of a hinge: angle [rad]) at
            the end and at the start of the step; "force_command", "force_command_n" [N]; "given_n", "force_n": outputs
            at the start. For each state: the value "<state>_n" at the start of the step, and the reference
            "<state>_hat" of the integrator, d(state)/dt = (state - state_hat)/span with span = dt (implicit Euler) or
            2/3 dt (BDF2 at equal steps) [s]. For a chamber also: the unknown "length" and "length_n" [m], the rest
            length "l0" and the link length "link" of the segment [m], and the stiffness "k" of the segment's springs
            [N]; a chamber has half of this stiffness.
        """
        raise NotImplementedError

    @classmethod
    def at_rest(cls, s: Symbols) -> Symbols:
        """Return the states of a chamber that rests at "length" under the constant "command", by name."""
        return dict.fromkeys(cls.states, 0.0)

    def values(self, worm: Body, *, hinge: bool) -> Mapping[str, float | FloatArray]:
        """Return the parameters by name for the chambers or the hinges of a worm, a number or one number for each."""
        return {name: getattr(self, name) for name in parameters_of(type(self))}


@documented
@dataclass(frozen=True, eq=False, kw_only=True)
class FirstOrder(Actuator, name="first_order"):
    """Rest length, force and hinge angle follow the commands with a first-order lag; stroke and rate are limited.

    c' = (command - c)/lag, solved exactly for a command that changes linearly over the step; the contraction then moves
    by at most rate_limit dt.
    """

    lag: Numbers | None = parameter(
        None, "time constant", "s", ge=0, each="segment", left_out="the worm's actuator_lag"
    )
    least: Numbers | None = parameter(
        None, "least contraction or hinge angle", le=0, each="segment", left_out="the worm's stroke; hinges: none"
    )
    greatest: Numbers | None = parameter(
        None, "greatest contraction or hinge angle", ge=0, each="segment", left_out="the worm's stroke; hinges: none"
    )
    rate_limit: Numbers | None = parameter(
        None,
        "greatest speed of contraction or of the hinge angle",
        "1/s",
        gt=0,
        each="segment",
        left_out="the worm's rate_limit; hinges: none",
    )

    @classmethod
    def respond(cls, s: Symbols) -> Response:
        """Return the contraction or angle, and the force, after lag and limits."""
        import casadi as ca  # parameters do not need casadi

        command = ca.fmin(ca.fmax(s["command"], s["least"]), s["greatest"])
        most = s["rate_limit"] * s["dt"]
        free = lagged(command, s["command_n"], s["given_n"], s["lag"], s["dt"])
        given = ca.fmin(ca.fmax(free, s["given_n"] - most), s["given_n"] + most)
        force = lagged(s["force_command"], s["force_command_n"], s["force_n"], s["lag"], s["dt"])
        return Response(command, given, force)

    def values(self, worm: Body, *, hinge: bool) -> Mapping[str, float | FloatArray]:
        """Return the parameters; the worm supplies the values left out, but limits of hinges are then infinite."""
        unlimited = {"least": -np.inf, "greatest": np.inf, "rate_limit": np.inf}
        limits = {"least": worm.stroke[0], "greatest": worm.stroke[1], "rate_limit": worm.rate_limit}
        left_out = {"lag": worm.actuator_lag, **(unlimited if hinge else limits)}
        given = super().values(worm, hinge=hinge)
        return {name: left_out[name] if value is None else value for name, value in given.items()}


def lagged(command: Symbol, command_n: Symbol, given_n: Symbol, lag: Symbol, dt: Symbol) -> Symbol:
    """Return the first-order response at the end of a step to a command that changes linearly over the step."""
    import casadi as ca

    ramp = lag * (command - command_n) / dt
    late = command - ramp + (given_n - command_n + ramp) * ca.exp(-dt / lag)
    return ca.if_else(lag > 0.0, late, command)
