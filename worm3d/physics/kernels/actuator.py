"""Kernels of the actuators of chambers and hinges, generated from `worm3d.physics.actuators.Actuator.respond`.

The inputs of a kernel are the inputs of the segment or joint, followed by commands, past states (at t_n, then at
t_{n-1}) and parameters of its actuators. The inputs of the segment law, if there are any, follow the commands. In the
chambers, the joint friction (`worm3d.physics.hysteresis`) is part of these kernels, and its states and parameters are
among the inputs.

The kernel `start` computes, at the start of a step, what does not depend on the lengths at the end of the step. The
kernels `gradient` and `hessian` are used while the step is solved. The kernel `end` computes the new states and the
terms of the energy ledger, if the actuator has any.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import Any

import casadi as ca

from worm3d.physics.actuators import COMMANDS, Actuator, FirstOrder, Response
from worm3d.physics.expressions import answer, scalar
from worm3d.physics.hysteresis import HYSTERESIS_PREFIX, Hysteresis, chamber_states
from worm3d.physics.kernels import hysteresis, joint, losses, segment
from worm3d.physics.kernels.layout import Layout, once
from worm3d.physics.kernels.segment import ACTUATOR_PREFIX, CHAMBERS, Law
from worm3d.physics.segment_laws.shapes import Rhombus
from worm3d.values.parameters import parameters_of

Kind = type[Actuator]
"""Class of the actuators."""
Own = type[Hysteresis]
"""Class of the joint friction of the chambers."""

HASTE = "haste"
"""Name of the input that multiplies the time step for the actuators. It is 1, except while a worm is brought to rest
before a run."""

ACTUATORS_PER_SEGMENT = CHAMBERS
"""Number of actuators of a segment: one for each chamber, left and right."""


@once
def chambers(kind: Kind, own: Own = Hysteresis, law: Law = Rhombus) -> Layout:
    """Return the layout of the segments' inputs, followed by the inputs of the actuators and the joint friction."""
    more, before = [HYSTERESIS_PREFIX + name for name in parameters_of(own)], segment.layout(law)
    sizes = _sizes(chamber_states(kind, own), [*parameters_of(kind), *more], ACTUATORS_PER_SEGMENT)
    return before.extended({name: size for name, size in sizes.items() if name not in before.sizes})


@once
def hinges(kind: Kind) -> Layout:
    """Return the layout of the joints' inputs, followed by the inputs of the actuators."""
    return joint.JOINT_LAYOUT.extended(_sizes(kind.states, parameters_of(kind), 1))


CHAMBER_COMMANDS = tuple(segment.SEGMENT_LAYOUT.rows + ACTUATORS_PER_SEGMENT * k for k in range(len(COMMANDS)))
"""First row of each of `COMMANDS` in the layout `chambers`. It is the same for all classes of actuators."""
HINGE_COMMANDS = tuple(joint.JOINT_LAYOUT.rows + k for k in range(len(COMMANDS)))
"""Row of each of `COMMANDS` in the layout `hinges`."""


def _sizes(states: Iterable[str], parameters: Iterable[str], count: int) -> dict[str, int]:
    past = {f"{state}_{at}": count for at in "nm" for state in states}
    sizes = {**dict.fromkeys(COMMANDS, count), **past, HASTE: 1, **dict.fromkeys(parameters, 1)}
    return {ACTUATOR_PREFIX + name: size for name, size in sizes.items()}


def _known(kind: Kind, layout: Layout, side: int) -> dict[str, ca.SX]:
    """Return the inputs that `respond` gets for a chamber or hinge, by name; `side` is 0 (left, or hinge) or 1."""
    s = layout.symbols
    known = {name: s[ACTUATOR_PREFIX + name][side] for name in COMMANDS}
    known |= {name: s[ACTUATOR_PREFIX + name] for name in parameters_of(kind)}
    known |= {name: s[name] * s[ACTUATOR_PREFIX + HASTE] for name in ("dt", "span")}
    for state in kind.states:
        n, m = (s[f"{ACTUATOR_PREFIX}{state}_{at}"][side] for at in "nm")
        known |= {f"{state}_n": n, f"{state}_hat": s["weights"][0] * n + s["weights"][1] * m}
    return known


def _of_chamber(kind: Kind, own: Own, law: Law, side: int) -> Callable[[ca.SX], Response]:
    """Return a function from the chamber's length at the end of the step to the response of its actuator."""
    layout = chambers(kind, own, law)
    s, known = layout.symbols, _known(kind, layout, side)
    known |= {"length_n": s["length_n"][side], **_sizes_of(law, s)}
    return lambda length: _respond(kind, {**known, "length": length})


def _sizes_of(law: Law, s: Mapping[str, ca.SX]) -> dict[str, ca.SX]:
    """Return the sizes and stiffness of a segment that an actuator gets; only rhombi have links."""
    return {name: s[name] for name in ("l0", "link", "k") if name != "link" or law.has_links}


def _slid(own: Own, law: Law, layout: Layout, side: int) -> Callable[[ca.SX], hysteresis.Slid]:
    """Return a function from the chamber's length at the end of the step to the response of its joint friction.

    While a worm is brought to rest before a run (`HASTE` differs from 1), the joints have no friction.
    """
    s = layout.symbols
    known = {"length_n": s["length_n"][side], **_sizes_of(law, s), "k_apex": s["k_apex"]}
    known |= {HYSTERESIS_PREFIX + name: s[ACTUATOR_PREFIX + HYSTERESIS_PREFIX + name] for name in parameters_of(own)}
    for state in own.states:
        name = f"{HYSTERESIS_PREFIX}{state}_n"
        known[name] = s[ACTUATOR_PREFIX + name][side]
    acts = s[ACTUATOR_PREFIX + HASTE] == 1.0
    return lambda length: hysteresis.slide(own, {**known, "length": length}, partial(segment.joints, law), acts)


def _of_hinge(kind: Kind) -> Response:
    """Return the response of a hinge's actuator.

    It must not depend on the end of the step, so that the kernel for the start of the step can compute all of it.
    """
    known = _known(kind, hinges(kind), 0) | {name: ca.SX(0.0) for name in COMMANDS if name.startswith("force")}
    response = _respond(kind, known)
    if _has_energy(response):
        raise ValueError(f"hinge_actuator: got {kind.__name__} with a potential or energy, must have none in a hinge")
    made = response._replace(force=ca.vertcat(*response.states.values()))
    _require_known("hinge_actuator", made, hinges(kind).symbols["span"])
    return response


def _respond(kind: Kind, known: dict[str, ca.SX]) -> Response:
    """Return the response from `Actuator.respond`.

    Raises
    ------
    ValueError
        `respond` uses an input that does not exist, returns an invalid response, or does not return all states.
    """
    try:
        response = answer(kind, "respond", known)
    except ValueError as error:
        cause = error.__cause__
        if isinstance(cause, KeyError):
            what = f"{cause} is not an input"
        elif isinstance(cause, NotImplementedError) and not cause.args:
            what = "the method is missing, must be defined"
        else:
            raise
        raise ValueError(f"{kind.__name__}.respond: {what}; the inputs are {', '.join(known)}") from error
    if not isinstance(response, Response):
        wrong = type(response).__name__
        raise ValueError(
            f"{kind.__name__}.respond: got {wrong}, must be a Response with the states {list(kind.states)}"
        )
    states = _states(kind, "respond", response.states)
    parts = {name: part for name, part in response._asdict().items() if name not in ("spring", "states")}
    if response.spring is not None:
        parts["spring"] = response.spring
    for name, part in parts.items():
        scalar(f"{kind.__name__}.respond, {name}", part)
    return response._replace(states=states)


def _states(kind: Kind, method: str, given: Any) -> Mapping[str, Any]:
    """Return `given`, the states that a method of an actuator returned, after checks.

    Raises
    ------
    ValueError
        `given` does not contain exactly the actuator's states, or a state is not a scalar expression.
    """
    if not isinstance(given, Mapping) or set(given) != set(kind.states):
        got = sorted(given) if isinstance(given, Mapping) else type(given).__name__
        raise ValueError(f"{kind.__name__}.{method}: got {got}, must be the states {list(kind.states)}")
    for name, part in given.items():
        scalar(f"{kind.__name__}.{method}, {name}", part)
    return given


def _has_energy(response: Response) -> bool:
    parts = (response.potential, response.work, response.stored, response.lost)
    return not all(ca.SX(part).is_zero() for part in parts)


def start(kind: Kind = FirstOrder, own: Own = Hysteresis, law: Law = Rhombus) -> ca.Function:
    """Return the kernel of what is known at the start of a step: command, rest length, force and contraction, each (2).

    The command is within the actuator's limits. The contraction (`Response.given`) is evaluated with the chamber's
    length at the start of the step.
    """
    layout = chambers(kind, own, law)
    s, outputs = layout.symbols, []
    for side in range(ACTUATORS_PER_SEGMENT):
        length = ca.SX.sym("length")
        response = _of_chamber(kind, own, law, side)(length)
        _require_known("actuator", response, ca.vertcat(length, s["span"]))
        spring = response.given if response.spring is None else response.spring
        given = ca.substitute(response.given, length, s["length_n"][side])
        outputs.append((response.command, s["l0"] * (1.0 - spring), response.force, given))
    names = ("command", "commanded", "force", "given")
    by_name = {name: [of[k] for of in outputs] for k, name in enumerate(names)}
    return layout.function("actuator_start", by_name)


START_ROWS = 4 * ACTUATORS_PER_SEGMENT
"""Number of outputs of `start`."""


def _require_known(name: str, response: Response, unknown: ca.SX) -> None:
    """Raise ValueError if a quantity that must be known at the start of a step depends on the end of the step."""
    spring = response.given if response.spring is None else response.spring
    for part, value in (("command", response.command), ("spring", spring), ("force", response.force)):
        if ca.depends_on(ca.SX(value), unknown):
            what = "given (also used as its spring)" if part == "spring" and response.spring is None else part
            raise ValueError(
                f"{name}: its {what} must not depend on length, span or ..._hat. Use dt and the values at the start of "
                "the step instead, or write a force as a potential"
            )


@once
def rest(kind: Kind = FirstOrder, own: Own = Hysteresis, law: Law = Rhombus) -> ca.Function | None:
    """Return the kernel of the rest lengths (2) and states (2 each) of chambers at rest.

    The chambers are at rest with the coordinates q and under constant commands. Return None if this kernel is not
    needed, because there are no states and the rest lengths follow directly from the commands.
    """
    layout, lengths, springs, states = chambers(kind, own, law), segment.lengths(), [], []
    for side in range(ACTUATORS_PER_SEGMENT):
        known = _known(kind, layout, side) | _sizes_of(law, layout.symbols)
        known |= {"length": lengths[side], "length_n": lengths[side]}
        # At rest the command has been constant for a long time, so that the time step (not known yet) has no effect.
        spring = _respond(kind, {**known, **_constant(known), "dt": ca.SX(1.0), "span": ca.SX(1.0)}).spring
        if spring is None and not chamber_states(kind, own):
            return None
        springs.append(known["l0"] * (1.0 - (known["command"] if spring is None else spring)))
        states.append(_states(kind, "at_rest", answer(kind, "at_rest", known)))
    outputs = {"commanded": springs} | {name: [of[name] for of in states] for name in kind.states}
    outputs |= {HYSTERESIS_PREFIX + name: [ca.SX(0.0)] * ACTUATORS_PER_SEGMENT for name in own.states}
    return layout.function("actuator_rest", outputs)


def _constant(known: dict[str, ca.SX]) -> dict[str, ca.SX]:
    """Return the inputs for past commands and outputs if the commands have always been constant."""
    force = known["force_command"]
    return {"command_n": known["command"], "given_n": known["command"], "force_command_n": force, "force_n": force}


@once
def _potential(kind: Kind, own: Own, law: Law) -> segment.Energy:
    """Return a function from the lengths of the chambers to their potential Psi, of actuators and friction [J]."""
    layout = chambers(kind, own, law)
    parts = [
        (_of_chamber(kind, own, law, side), _slid(own, law, layout, side)) for side in range(ACTUATORS_PER_SEGMENT)
    ]
    return lambda lengths: sum(
        (part(length).potential for length, both in zip(ca.vertsplit(lengths), parts, strict=True) for part in both),
        ca.SX(0.0),
    )


def gradient(kind: Kind = FirstOrder, own: Own = Hysteresis, law: Law = Rhombus) -> ca.Function:
    """Return the kernel of the segment's potential and gradient, including actuators and joint friction."""
    return segment.gradient(chambers(kind, own, law), _potential(kind, own, law), law)


def hessian(kind: Kind = FirstOrder, own: Own = Hysteresis, law: Law = Rhombus) -> ca.Function:
    """Return the kernel of the segment's potential, gradient and Hessian, including actuators and joint friction."""
    return segment.hessian(chambers(kind, own, law), _potential(kind, own, law), law)


LEDGER_TERMS = (
    "work_contract",
    "actuator",
    "actuator_loss",
    "numerical_loss",
    "work_contract_p11",
    "elastic",
    "hysteresis_loss",
)
"""Terms of the energy ledger that `end` computes."""
LEDGER_ROWS = segment.LEDGER_ROWS
"""Number of outputs of `end` for the terms and unused values. The contractions and the states follow."""


def _has_end(kind: Kind, own: Own, law: Law) -> bool:
    """Return whether the kernel `end` is needed.

    It is needed if there are states or energies, or if the contraction depends on the length at the end of the step.
    """
    length = ca.SX.sym("length")
    response = _of_chamber(kind, own, law, 0)(length)
    has_states = bool(chamber_states(kind, own))
    return has_states or _has_energy(response) or bool(ca.depends_on(ca.SX(response.given), length))


def end(kind: Kind = FirstOrder, own: Own = Hysteresis, law: Law = Rhombus) -> ca.Function | None:
    """Return the kernel of the terms of the energy ledger, the contractions (2) and the new states (2 each).

    Return None if the actuators and the joint friction have neither states nor energies. The work of actuator and joint
    friction in a step is dPsi/dl times the first-order change of the length. Its difference from the change of the
    energies is the numerical loss.
    """
    if not _has_end(kind, own, law):
        return None
    layout, terms = chambers(kind, own, law), ca.SX.zeros(len(LEDGER_TERMS))
    given: list[Any] = []
    states: list[Mapping[str, Any]] = []
    for side in range(ACTUATORS_PER_SEGMENT):
        respond, slide = _of_chamber(kind, own, law, side), _slid(own, law, layout, side)
        length, first = segment.lengths()[side], segment.stretches()[side]
        response, slid = respond(length), slide(length)
        pulled, rubbed = (
            losses.slope(lambda at, part=part: part(at).potential, length) * first  # type: ignore[misc]
            for part in (respond, slide)
        )
        energy = response.stored + response.lost - response.work
        numerical = pulled - energy + rubbed - slid.stored - slid.lost
        terms += ca.vertcat(response.work, response.stored, response.lost, numerical, -pulled, slid.stored, slid.lost)
        given.append(response.given)
        states.append({**response.states, **slid.states})
    outputs: dict[str, Any] = {"terms": terms, "nothing": ca.SX.zeros(LEDGER_ROWS - len(LEDGER_TERMS)), "given": given}
    outputs |= {name: [of[name] for of in states] for name in chamber_states(kind, own)}
    return layout.function("actuator_end", outputs)


def hinge_start(kind: Kind = FirstOrder) -> ca.Function:
    """Return the kernel of a hinge's actuator: the command within the limits, the hinge angle, and the new states.

    All are values for the end of the step.
    """
    response = _of_hinge(kind)
    outputs = {"command": response.command, "given": response.given}
    return hinges(kind).function("hinge_start", outputs | {name: response.states[name] for name in kind.states})


HINGE_ROWS = 2
"""Number of outputs of `hinge_start` before the states."""
