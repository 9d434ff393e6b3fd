"""What writes straight code on vectors of doubles for intrinsics of Numba.

Vectors are of eight doubles; LLVM splits them where the processor has shorter ones.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba.core import cgutils

LANES = 8
"""Doubles in a vector."""
INT, DOUBLE = ir.IntType(64), ir.DoubleType()
KIND = ir.VectorType(DOUBLE, LANES)
ZERO, ONE = (ir.Constant(KIND, [value] * LANES) for value in (0.0, 1.0))
_NUMBERS = ir.VectorType(INT, LANES)
_ALIGN = ir.Constant(ir.IntType(32), 8)
_ODD = [0, 8, 2, 10, 4, 12, 6, 14], [1, 9, 3, 11, 5, 13, 7, 15]
_HALVES = [0, 1, 2, 3, 8, 9, 10, 11], [4, 5, 6, 7, 12, 13, 14, 15]
_QUARTERS = [0, 1, 4, 5, 8, 9, 12, 13], [2, 3, 6, 7, 10, 11, 14, 15]
"""Lanes of two vectors that are added to each other, to sum them up."""


class Writer:
    """Writes code on vectors of 8 doubles; places are addresses and doubles from there."""

    def __init__(self, builder: Any) -> None:
        self.builder = builder

    def place(self, address: Any, shift: int, kind: Any = KIND) -> Any:
        """Return the pointer to a vector, or to something else."""
        return self.builder.inttoptr(self.builder.add(address, ir.Constant(INT, 8 * shift)), kind.as_pointer())

    def load(self, address: Any, shift: int) -> Any:
        """Return a vector."""
        return self.builder.load(self.place(address, shift), align=8)

    def load_some(self, address: Any, count: Any) -> Any:
        """Return the first numbers, at most so many, and zeros."""
        return self._masked("load", KIND, [self.place(address, 0), _ALIGN, self._first(count), ZERO])

    def store_some(self, value: Any, address: Any, count: Any) -> None:
        """Store the first numbers, at most so many."""
        self._masked("store", ir.VoidType(), [value, self.place(address, 0), _ALIGN, self._first(count)])

    def _first(self, count: Any) -> Any:
        counts = self.spread_number(count, _NUMBERS)
        return self.builder.icmp_signed("<", ir.Constant(_NUMBERS, list(range(LANES))), counts)

    def _masked(self, what: str, to: Any, args: list[Any]) -> Any:
        insert: Any = cgutils.get_or_insert_function
        kind = ir.FunctionType(to, [arg.type for arg in args])
        return self.builder.call(insert(self.builder.module, kind, f"llvm.masked.{what}.v{LANES}f64.p0"), args)

    def store(self, value: Any, address: Any, shift: int) -> None:
        """Put a vector down."""
        self.builder.store(value, self.place(address, shift), align=8)

    def lanes(self, x: Any, y: Any, lanes: list[int]) -> Any:
        """Return a vector of these lanes of two, of which the second one's count from 8 on."""
        return self.builder.shuffle_vector(x, y, ir.Constant(ir.VectorType(ir.IntType(32), LANES), lanes))

    def exchanged(self, x: Any, y: Any, lane: int) -> Any:
        """Return x with one lane of y."""
        return self.lanes(x, y, [k + LANES if k == lane else k for k in range(LANES)])

    def totals(self, rows: list[Any], rest: Any) -> Any:
        """Return the sums of the lanes of five vectors, and the first three lanes of another one."""
        a, b, c = (self._folded(x, y, _ODD) for x, y in ((rows[0], rows[1]), (rows[2], rows[3]), (rows[4], rows[4])))
        low = self.lanes(c, self.lanes(rest, ZERO, [8, 0, 8, 8, 1, 2, 8, 8]), [0, 9, 2, 11, 12, 13, 14, 15])
        c = self.builder.fadd(low, self.lanes(c, ZERO, [4, 8, 6, 8, 8, 8, 8, 8]))
        return self._folded(self._folded(a, b, _HALVES), c, _QUARTERS)

    def _folded(self, x: Any, y: Any, parts: tuple[list[int], list[int]]) -> Any:
        """Return the sum of two choices of lanes."""
        return self.builder.fadd(*(self.lanes(x, y, part) for part in parts))

    def spread(self, x: Any, lane: int) -> Any:
        """Return a lane in every lane."""
        return self.lanes(x, x, [lane] * LANES)

    def spread_number(self, number: Any, kind: Any = KIND) -> Any:
        """Return a number in every lane."""
        one = self.builder.insert_element(ir.Constant(kind, ir.Undefined), number, ir.Constant(ir.IntType(32), 0))
        return self.spread(one, 0)

    def number(self, address: Any, shift: int) -> Any:
        """Return a single number."""
        return self.builder.load(self.place(address, shift, DOUBLE), align=8)

    def lane(self, x: Any, lane: int) -> Any:
        """Return the number in a lane."""
        return self.builder.extract_element(x, ir.Constant(ir.IntType(32), lane))

    def plus(self, value: Any, x: Any, y: Any) -> Any:
        """Return value + x y."""
        return self._call("fma", [x, y, value])

    def less(self, value: Any, x: Any, y: Any) -> Any:
        """Return value - x y."""
        return self.plus(value, self.builder.fneg(x), y)

    def less_sum(self, value: Any, numbers: list[Any], vectors: list[Any]) -> Any:
        """Return value - the sum of five products, in two chains that do not wait for each other."""
        for x, y in zip(numbers[:2], vectors[:2], strict=True):
            value = self.less(value, x, y)
        return self.builder.fsub(value, self.sum(numbers[2:], vectors[2:]))

    def sum(self, numbers: list[Any], vectors: list[Any]) -> Any:
        """Return a sum of products."""
        value = self.builder.fmul(numbers[0], vectors[0])
        for x, y in zip(numbers[1:], vectors[1:], strict=True):
            value = self.plus(value, x, y)
        return value

    def size(self, x: Any) -> Any:
        """Return |x|."""
        return self._call("fabs", [x])

    def _call(self, name: str, args: list[Any]) -> Any:
        """Call one of LLVM's functions of numbers, or of vectors of them."""
        insert: Any = cgutils.get_or_insert_function
        kind = args[0].type
        size = f"v{LANES}f64" if kind == KIND else "f64"
        function = insert(self.builder.module, ir.FunctionType(kind, [kind] * len(args)), f"llvm.{name}.{size}")
        return self.builder.call(function, args)
