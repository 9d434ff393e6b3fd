"""Writes LLVM's intermediate language: vectors of doubles, one instance of the kernel in each lane."""

from __future__ import annotations

import struct
from collections.abc import Sequence


class Writer:
    """The body of one LLVM function; every method appends an instruction and returns the name of its result.

    What has been written already is not written again: CasADi's derivatives repeat many subexpressions.

    Parameters
    ----------
    width : int
        Lanes of a vector.
    flags : str
        Fast-math flags of the arithmetic, as "contract arcp".
    """

    def __init__(self, width: int, flags: str = "") -> None:
        self.width, self.flags = width, flags
        self.lines: list[str] = []
        self._known: dict[str, str] = {}
        self.calls: set[str] = set()
        """Operations (`worm3d.machine.codegen.lanes`) that are called."""

    @property
    def vector(self) -> str:
        """Type of a vector."""
        return f"<{self.width} x double>"

    @property
    def mask_type(self) -> str:
        """Type of a vector of truth values."""
        return f"<{self.width} x i1>"

    def new(self, text: str) -> str:
        """Write what is right of the "=", unless it stands already."""
        if text not in self._known:
            self._known[text] = f"%v{len(self.lines)}"
            self.lines.append(f"  {self._known[text]} = {text}")
        return self._known[text]

    def do(self, text: str) -> None:
        """Write an instruction without result."""
        self.lines.append(f"  {text}")

    def label(self, name: str) -> None:
        """Begin another basic block."""
        self.lines.append(f"{name}:")
        self._known.clear()  # a value of another block need not exist here

    def splat(self, value: float) -> str:
        """Return a constant in all lanes."""
        return splat(value, self.width)

    def arithmetic(self, op: str, *args: str) -> str:
        """Apply LLVM's `op`, with the flags."""
        return self.new(f"{op} {self.flags} {self.vector} {', '.join(args)}")

    def add(self, a: str, b: str) -> str:
        """Return a + b."""
        return self.arithmetic("fadd", *sorted((a, b)))

    def sub(self, a: str, b: str) -> str:
        """Return a - b."""
        return self.arithmetic("fsub", a, b)

    def mul(self, a: str, b: str) -> str:
        """Return a b."""
        return self.arithmetic("fmul", *sorted((a, b)))

    def div(self, a: str, b: str) -> str:
        """Return a / b."""
        return self.arithmetic("fdiv", a, b)

    def neg(self, a: str) -> str:
        """Return -a."""
        return self.arithmetic("fneg", a)

    def compare(self, how: str, a: str, b: str) -> str:
        """Return a mask; `how` is LLVM's, "o.." is false and "u.." true where an argument is NaN."""
        return self.new(f"fcmp {how} {self.vector} {a}, {b}")

    def logic(self, op: str, a: str, b: str) -> str:
        """Combine masks by "and", "or", "xor"."""
        return self.new(f"{op} {self.mask_type} {a}, {b}")

    def invert(self, mask: str) -> str:
        """Return the opposite mask."""
        return self.logic("xor", mask, f"<{', '.join(['i1 true'] * self.width)}>")

    def select(self, mask: str, a: str, b: str) -> str:
        """Return a where the mask is true, else b."""
        return self.new(f"select {self.mask_type} {mask}, {self.vector} {a}, {self.vector} {b}")

    def intrinsic(self, name: str, *args: str) -> str:
        """Call one of LLVM's own functions, as "sqrt"."""
        return self._call(f"@llvm.{name}.v{self.width}f64", args)

    def fma(self, a: str, b: str, c: str) -> str:
        """Return a b + c, rounded once."""
        return self.intrinsic("fma", a, b, c)

    def horner(self, x: str, coefficients: Sequence[float]) -> str:
        """Return a polynomial in x; coefficients from the highest power down."""
        value = self.splat(coefficients[0])
        for c in coefficients[1:]:
            value = self.fma(value, x, self.splat(c))
        return value

    def lanes(self, name: str, *args: str) -> str:
        """Call a function of `worm3d.machine.codegen.lanes`."""
        self.calls.add(name)
        return self._call(f"@lanes_{name}", args)

    def sincos(self, x: str) -> tuple[str, str]:
        """Return sine and cosine, which derivatives always need together."""
        self.calls.add("sincos")
        pair = f"{{{self.vector}, {self.vector}}}"
        both = self.new(f"call {pair} @lanes_sincos({self.vector} {x})")
        return self.new(f"extractvalue {pair} {both}, 0"), self.new(f"extractvalue {pair} {both}, 1")

    def _call(self, function: str, args: Sequence[str]) -> str:
        return self.new(f"call {self.vector} {function}({', '.join(f'{self.vector} {a}' for a in args)})")

    def body(self) -> str:
        """Return all lines."""
        return "\n".join(self.lines)


def number(value: float) -> str:
    """Return a double, exactly, as LLVM reads it."""
    return f"0x{struct.unpack('<Q', struct.pack('<d', value))[0]:016X}"


def splat(value: float, width: int) -> str:
    """Return a vector with `value` in all lanes."""
    return f"<{', '.join([f'double {number(value)}'] * width)}>"
