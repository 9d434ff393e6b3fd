"""Actuators, which turn a command into the rest length, force or pressure of a chamber, or into the angle of a hinge.

An actuator is a dataclass. Its fields are its parameters, and its method `respond` returns the response in a time step
in CasADi symbols. The kernels of the segments, with all derivatives, are generated from `respond` and compiled once per
class. A force that depends on the unknown length of the chamber at the end of the step is written as a potential:

    force on the chamber = - d Psi(length; states at the start, command, dt) / d length

The states at the end of the step also depend on this length; they are eliminated within `respond`. For example, an
actuator with a state p' = f(p, length) solves p_{n+1} = p_n + dt f(p_{n+1}, length) for p_{n+1}(length) and integrates
the force over the length. The step then remains the minimum of a potential. `worm3d.physics.pneumatic.Pneumatic` is an
example to start from.

Importing a module that defines an actuator registers the actuator's name. `worm3d/physics/actuator_names.py` imports
the modules of the actuators that come with worm3d.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from worm3d.physics.body import Body
from worm3d.physics.part import Numbers, Part, Symbol, Symbols
from worm3d.values.arrays import FloatArray
from worm3d.values.documented import with_fields
from worm3d.values.parameters import documented, parameter, parameters_of

COMMANDS = ("command", "command_n", "given_n", "force_command", "force_command_n", "force_n")
"""Inputs of an actuator: the commands at the end and at the start of a step, and the outputs at its start."""

RESPONSE_INPUTS = (*COMMANDS, "dt", "span", "length", "length_n", "l0", "link", "k")
"""Names of the inputs of `Actuator.respond` other than parameters and states."""


@with_fields
class Response(NamedTuple):
    """Response of an actuator in a time step.

    `command`, `force` and `spring` must not depend on "length", "span" and "<state>_hat", and without `spring` neither
    must `given`. The other attributes may. For a hinge, `force` and `spring` have no effect, and the actuator must have
    neither a potential nor energies.
    """

    command: Symbol
    """The command after the limits: contraction of a chamber, or angle of a hinge [rad]."""
    given: Symbol
    """Output of the actuator, which a run records: contraction of a chamber, or angle of a hinge [rad]."""
    force: Symbol = 0.0
    """Force along the chamber [N]; a positive force contracts the chamber."""
    spring: Symbol | None = None
    """Contraction of the rest length of the chamber's spring. None means the same as `given`."""
    potential: Symbol = 0.0
    """Potential Psi [J]. The force on the chamber is minus the derivative of Psi with respect to the length."""
    states: Symbols = {}  # noqa: RUF012  # never changed
    """The states at the end of the step, by name."""
    work: Symbol = 0.0
    """Energy supplied by the source during the step, in addition to the work on the spring's rest length [J]."""
    stored: Symbol = 0.0
    """Change of the energy stored in the actuator [J]."""
    lost: Symbol = 0.0
    """Energy lost within the actuator [J]."""


ACTUATORS: dict[str, type[Actuator]] = {}
"""Class of each actuator by name."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Actuator(Part, registry=ACTUATORS):
    """Base class of all actuators: a frozen dataclass with fields made by `worm3d.values.parameters.parameter`.

    A subclass defines `respond`. A field declared with each="segment" may be an array. The argument `actuator` of
    `worm3d.Worm` selects the actuator of the chambers, and `hinge_actuator` the actuator of the hinges.

    A subclass with states declares them by the class attribute `states`, a mapping from the name of each state to the
    unit of the state, for example `states: ClassVar = {"charge": "C"}`. The unit of a pure number is "1". `respond`
    returns the states at the end of a step in `Response.states`, and `at_rest` returns the states at the start of a
    run. `Result.actuator_states` contains the recorded states.

    A class needs a name only if scenes or `worm3d.ACTUATORS` shall find the class by a short name: `class
    Valve(Actuator, name="valve")`. Scenes find a class without a name as `module:NAME`.
    """

    known: ClassVar[tuple[str, ...]] = RESPONSE_INPUTS
    told: ClassVar[tuple[str, ...]] = ("states", "drives_hinges", "has_source", "needs_links")
    drives_hinges: ClassVar[bool] = True
    """Whether the actuator may drive a hinge. Such an actuator has no potential and no energy, and uses no length."""
    has_source: ClassVar[bool] = False
    """Whether `Response.work` is the energy drawn from a source. The rest lengths of the springs are then constant."""

    @classmethod
    def compiled(cls) -> type[Actuator]:
        """Return the class from which the kernels are made. Classes that differ only in numbers can share a class."""
        return cls

    @classmethod
    def respond(cls, s: Symbols) -> Response:
        """Return the response of the actuator in a time step.

        All inputs are scalar CasADi expressions without values. Use `ca.if_else` for choices, and `ca.fmin` and
        `ca.fmax` for limits. Python's `if`, `min` and `max` raise errors on such expressions. NumPy's functions may
        work, but warn (`np.clip` prints a FutureWarning).

        Parameters
        ----------
        s : mapping of str to SX
            Scalars by name. All actuators: the parameters; "command" and "command_n", the commanded contraction (of a
            hinge: angle [rad]) at the end and at the start of the step; "force_command" and "force_command_n", the
            commanded force at the same instants [N]; "given_n" and "force_n", the outputs at the start of the step;
            "dt" and "span" [s]. For each state: its value "<state>_n" at the start of the step, and "<state>_hat", with
            which the integrator approximates d(state)/dt = (state - state_hat)/span. span is dt for implicit Euler, and
            2/3 dt for BDF2 at equal steps. Actuators of chambers also: the unknown "length" at the end of the step and
            "length_n" at its start [m], the rest length "l0" and the link length "link" of the segment [m], and the
            stiffness "k" of the segment's springs [N]. A chamber has half of this stiffness.
        """
        raise NotImplementedError

    @classmethod
    def at_rest(cls, s: Symbols) -> Symbols:
        """Return the states, by name, of a chamber that rests at "length" under the constant command "command"."""
        return dict.fromkeys(cls.states, 0.0)

    def values(self, worm: Body, *, hinge: bool) -> Mapping[str, float | FloatArray]:
        """Return the parameters by name: a number, or a number for each chamber or hinge of the worm."""
        return {name: getattr(self, name) for name in parameters_of(type(self))}


@documented
@dataclass(frozen=True, eq=False, kw_only=True)
class FirstOrder(Actuator, name="first_order"):
    """Rest length, force and hinge angle follow the commands with a first-order lag. Stroke and rate are limited.

    The contraction c obeys c' = (command - c)/lag. The solution is exact for a command that changes linearly over the
    step. Afterwards the change of c in the step is limited to rate_limit dt.
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
        """Return the contraction or angle, and the force, after the lag and the limits."""
        import casadi as ca  # parameters do not need casadi

        command = ca.fmin(ca.fmax(s["command"], s["least"]), s["greatest"])
        most = s["rate_limit"] * s["dt"]
        free = lagged(command, s["command_n"], s["given_n"], s["lag"], s["dt"])
        given = ca.fmin(ca.fmax(free, s["given_n"] - most), s["given_n"] + most)
        force = lagged(s["force_command"], s["force_command_n"], s["force_n"], s["lag"], s["dt"])
        return Response(command, given, force)

    def values(self, worm: Body, *, hinge: bool) -> Mapping[str, float | FloatArray]:
        """Return the parameters. The worm supplies omitted values, but omitted limits of hinges are infinite."""
        unlimited = {"least": -np.inf, "greatest": np.inf, "rate_limit": np.inf}
        limits = {"least": worm.stroke[0], "greatest": worm.stroke[1], "rate_limit": worm.rate_limit}
        left_out = {"lag": worm.actuator_lag, **(unlimited if hinge else limits)}
        given = super().values(worm, hinge=hinge)
        return {name: left_out[name] if value is None else value for name, value in given.items()}


def lagged(command: Symbol, command_n: Symbol, given_n: Symbol, lag: Symbol, dt: Symbol) -> Symbol:
    """Return the first-order response, at the end of a step, to a command that changes linearly over the step."""
    import casadi as ca

    ramp = lag * (command - command_n) / dt
    late = command - ramp + (given_n - command_n + ramp) * ca.exp(-dt / lag)
    return ca.if_else(lag > 0.0, late, command)
