"""Layouts of the arrays of kernels: the inputs of a CasADi function by name, and the rows that contain them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from itertools import accumulate
from typing import Any, TypeVar, cast

import casadi as ca

from worm3d.values.arrays import FloatArray

F = TypeVar("F", bound=Callable[..., Any])

once: Callable[[F], F] = cast(Any, cache)
"""`functools.cache` for functions with classes as arguments, which mypy does not consider hashable."""


class Layout:
    """Named inputs of a group of functions, and the rows of an array that contain these inputs.

    Parameters
    ----------
    sizes : mapping of str to int
        Number of rows of each input, in order.
    """

    def __init__(self, sizes: Mapping[str, int]) -> None:
        self.sizes = dict(sizes)
        self._firsts = dict(zip(sizes, accumulate(sizes.values(), initial=0), strict=False))
        self.symbols = {name: ca.SX.sym(name, size) for name, size in sizes.items()}

    def extended(self, sizes: Mapping[str, int]) -> Layout:
        """Return a layout with further inputs after the present inputs. The present inputs keep their symbols."""
        longer = Layout({**self.sizes, **sizes})
        longer.symbols |= self.symbols
        return longer

    @property
    def rows(self) -> int:
        """Number of rows of all inputs together."""
        return sum(self.sizes.values())

    def first(self, name: str) -> int:
        """Return the first row of an input."""
        return self._firsts[name]

    def firsts(self, *names: str) -> tuple[int, ...]:
        """Return the first rows of some inputs."""
        return tuple(self.first(name) for name in names)

    def of(self, name: str, array: FloatArray) -> FloatArray:
        """Return a view of the rows of an input in an array."""
        return array[self.first(name) : self.first(name) + self.sizes[name]]

    def function(self, name: str, outputs: Mapping[str, ca.SX | Sequence[ca.SX]]) -> ca.Function:
        """Return a function of all inputs with named, dense outputs. A list of matrices is stacked to one column."""
        dense = [ca.densify(ca.vertcat(*_parts(value))) for value in outputs.values()]
        return ca.Function(name, list(self.symbols.values()), dense, list(self.sizes), [f"to_{key}" for key in outputs])


def _parts(value: ca.SX | Sequence[ca.SX]) -> list[ca.SX]:
    """Return the columns of a matrix, or of all matrices in a list."""
    matrices = [value] if isinstance(value, ca.SX) else list(value)
    return [column for matrix in matrices for column in ca.horzsplit(matrix)]
