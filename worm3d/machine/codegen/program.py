"""Content of a kernel: the elementary instructions of a CasADi SX function, checked and named.

An SX function is a list of instructions on a work vector of scalars whose slots are used again and again:
`slot[out] = op(slot[a], slot[b])`, with loads from the inputs and stores to the outputs between them.
"""

from __future__ import annotations

from typing import NamedTuple

import casadi


class UnsupportedError(ValueError):
    """The function cannot become a native kernel; the message names the unsupported operation or kind of function."""


class Instruction(NamedTuple):
    """One elementary operation; `name` is CasADi's name without the prefix, in lower case, such as "if_else_zero"."""

    name: str
    out: int
    """Slot of the result; row of the outputs for "output"."""
    args: tuple[int, ...]
    """Slots of the arguments; (row of the inputs,) for "input"."""
    constant: float = 0.0
    """The value of "const"."""


class Program(NamedTuple):
    """An SX function as a list; rows number the nonzeros of all inputs (outputs), one after the other."""

    name: str
    rows_in: int
    rows_out: int
    instructions: tuple[Instruction, ...]


OPERATION_NAMES = {getattr(casadi, key): key[3:].lower() for key in dir(casadi) if key.startswith("OP_")}


def require_sx(function: casadi.Function) -> None:
    """Raise UnsupportedError unless `function` is an SX function without free variables."""
    if not function.is_a("SXFunction"):
        raise UnsupportedError(
            f"kernel {function.name()!r}: got a {function.class_name()}, need an SXFunction; "
            "write it with SX symbols, or call its expand() first"
        )
    if function.has_free():
        raise UnsupportedError(
            f"kernel {function.name()!r}: the variables {function.get_free()} are no inputs; add them to its inputs"
        )


def read(function: casadi.Function) -> Program:
    """Return the instructions of a function that `require_sx` accepts."""
    first_in = _offsets([function.nnz_in(i) for i in range(function.n_in())])
    first_out = _offsets([function.nnz_out(i) for i in range(function.n_out())])
    listed = tuple(_instruction(function, k, first_in, first_out) for k in range(function.n_instructions()))
    return Program(function.name(), function.nnz_in(), function.nnz_out(), listed)


def _instruction(function: casadi.Function, k: int, first_in: list[int], first_out: list[int]) -> Instruction:
    name = OPERATION_NAMES[function.instruction_id(k)]
    out, args = function.instruction_output(k), function.instruction_input(k)
    if name == "input":
        return Instruction(name, out[0], (first_in[args[0]] + args[1],))
    if name == "output":
        return Instruction(name, first_out[out[0]] + out[1], tuple(args))
    if name == "const":
        return Instruction(name, out[0], (), function.instruction_constant(k))
    return Instruction(name, out[0], tuple(args))


def _offsets(sizes: list[int]) -> list[int]:
    return [sum(sizes[:i]) for i in range(len(sizes))]
