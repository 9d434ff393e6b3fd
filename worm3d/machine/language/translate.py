"""Translation of Python functions into LLVM's language: a plain part of Python, on the values of `values`.

A function may have assignments, loops over `range`, `enumerate`, arrays and tuples (those are unrolled), `while`,
conditions, calls of functions of the same kind, and returns. A variable keeps the kind of its first value; a whole
number becomes a double where it is assigned to one. Indices are not checked, and count from the end only where they
are constants. There are no exceptions, strings, lists, or objects but tuples.
"""

from __future__ import annotations

import ast
import inspect
import operator
import textwrap
from collections.abc import Callable
from functools import partial
from typing import Any, get_args, get_type_hints

import numpy as np
from llvmlite import ir

from worm3d.machine.language.library import LIBRARY, copied
from worm3d.machine.language.values import (
    BOOL,
    DOUBLE,
    INT,
    Arithmetic,
    Array,
    TranslationError,
    grouped,
    is_known,
    kind_of,
    numbers_of,
    rebuilt,
    structure,
)
from worm3d.machine.writer import Writer, declared

_OPERATORS: dict[Any, Any] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.FloorDiv: operator.floordiv,
    ast.Mod: operator.mod,
    ast.Pow: operator.pow,
    ast.LShift: operator.lshift,
    ast.BitOr: operator.or_,
    ast.BitAnd: operator.and_,
}
_COMPARISONS: dict[Any, tuple[str, Any]] = {
    ast.Eq: ("==", operator.eq),
    ast.NotEq: ("!=", operator.ne),
    ast.Lt: ("<", operator.lt),
    ast.LtE: ("<=", operator.le),
    ast.Gt: (">", operator.gt),
    ast.GtE: (">=", operator.ge),
}


class Unit:
    """A module of LLVM's language, with every function once for each structure of its arguments."""

    def __init__(self) -> None:
        self.module = ir.Module()
        self._made: dict[Any, tuple[Any, Any]] = {}

    def call(self, at: Arithmetic, function: Any, args: Any, named: Any) -> Any:
        """Write the call of a function, which is translated if need be, and return its result."""
        bound, hints = inspect.signature(function).bind(*args, **named), get_type_hints(function)
        bound.apply_defaults()
        values = [fitted(at, value, hints.get(name)) for name, value in bound.arguments.items()]
        code, result = self.made(function, values)
        found = at.builder.call(code, list(numbers_of(tuple(values))))
        numbers = list(numbers_of(result))
        if len(numbers) > 1:
            return rebuilt(result, iter([at.builder.extract_value(found, k) for k in range(len(numbers))]))
        return rebuilt(result, iter([found]))

    def made(self, function: Any, values: list[Any]) -> tuple[Any, Any]:
        """Return the code of a function for such arguments, and a value of the structure of its result."""
        key = function, *map(structure, values)
        if key not in self._made:
            kinds = [each.type for each in numbers_of(tuple(values))]
            name = f"{function.__module__}.{function.__qualname__}.{len(self._made)}"
            code = ir.Function(self.module, ir.FunctionType(ir.VoidType(), kinds), name)
            code.linkage = "internal"
            code.attributes.add("nounwind")
            if getattr(function, "apart", False):
                code.attributes.add("noinline")
            result = Translation(self, function, code, values).result
            kinds_out = [each.type for each in numbers_of(result)]
            kind = ir.VoidType() if not kinds_out else kinds_out[0]
            kind = ir.LiteralStructType(kinds_out) if len(kinds_out) > 1 else kind
            code.ftype = ir.FunctionType(kind, kinds)  # known from here on, and nobody has called it yet
            code.type = code.ftype.as_pointer()
            code.return_value = type(code.return_value)(code, kind)
            self._made[key] = code, result
        return self._made[key]


def fitted(at: Arithmetic, value: Any, hint: Any) -> Any:
    """Return a value of compiled code, converted to what the annotation says, where that names numbers."""
    kind, parts = kind_of(hint), get_args(hint)
    if kind is not None:
        return at.number(value, kind)
    if isinstance(value, np.ndarray):
        return constant(at.builder.module, value)
    if isinstance(value, tuple) and not isinstance(value, Array):
        hints = list(get_type_hints(type(value)).values()) if hasattr(value, "_fields") else list(parts)
        hints = hints if len(hints) == len(value) else [None] * len(value)
        return grouped(value, [fitted(at, each, own) for each, own in zip(value, hints, strict=True)])
    return value if isinstance(value, Array) or value is None else at.number(value)


def constant(module: Any, values: np.ndarray[Any, Any]) -> Array:
    """Return an array of Python as one of compiled code, which must not write to it."""
    kind = DOUBLE if values.dtype.kind == "f" else INT
    held = ir.Constant(ir.ArrayType(kind, values.size), [kind(each.item()) for each in values.ravel()])
    place = ir.GlobalVariable(module, held.type, module.get_unique_name("constant"))
    place.initializer, place.global_constant, place.linkage = held, True, "internal"
    pointer = ir.FormattedConstant(ir.PointerType(), place.get_reference())
    return Array(pointer, tuple(ir.Constant(INT, size) for size in values.shape), kind)


class Translation(Arithmetic):
    """The body of a function, in the making."""

    def __init__(self, unit: Unit, function: Any, code: Any, values: list[Any]) -> None:
        self.unit, self.function = unit, function
        lines, first = inspect.getsourcelines(function)
        (tree,) = ast.parse(textwrap.dedent("".join(lines))).body
        assert isinstance(tree, ast.FunctionDef)
        self._line, self._hints = first - 1, get_type_hints(function)
        self._names: dict[str, tuple[Any, list[Any]]] = {}
        self._loops: list[tuple[Any, Any]] = []
        self.stacked = False
        self._entry = code.append_basic_block()
        self.builder, self.result = ir.IRBuilder(code.append_basic_block()), None
        body = self.builder.block
        arguments = rebuilt(tuple(values), iter(code.args))
        for name, value in zip(inspect.signature(function).parameters, arguments, strict=True):
            self._assign_name(name, value)
        self._run(tree.body)
        if not self.builder.block.is_terminated:
            self.builder.ret_void() if self.result is None else self.builder.unreachable()
        ir.IRBuilder(self._entry).branch(body)

    # Statements

    def _run(self, statements: list[Any]) -> None:
        for node in statements:
            if self.builder.block.is_terminated:
                return
            try:
                getattr(self, "_" + type(node).__name__, self._refuse)(node)
            except TranslationError as error:
                if not hasattr(error, "line"):
                    error.line = node.lineno + self._line  # type: ignore[attr-defined]
                    where = f"{inspect.getsourcefile(self.function)}:{error.line}"  # type: ignore[attr-defined]
                    error.args = (f"{where}: {error}",)
                raise

    def _refuse(self, node: Any) -> Any:
        raise TranslationError(f"{type(node).__name__} is not part of compiled Python")

    def _Expr(self, node: Any) -> None:
        if not isinstance(node.value, ast.Constant):
            self.value(node.value)

    def _Pass(self, node: Any) -> None:
        pass

    def _Assign(self, node: Any) -> None:
        value = self.value(node.value)
        for target in node.targets:
            self._assign(target, value)

    def _AnnAssign(self, node: Any) -> None:
        self._assign(node.target, self.value(node.value))

    def _AugAssign(self, node: Any) -> None:
        op, target = _OPERATORS[type(node.op)], node.target
        if isinstance(target, ast.Name):
            read = ast.copy_location(ast.Name(target.id, ast.Load()), target)
            return self._assign(target, self.computed(op, self.value(read), self.value(node.value)))
        here = self._at(target)
        return self._store(here, self.computed(op, self.load(here), self.value(node.value)))

    def _assign(self, target: Any, value: Any) -> None:
        if isinstance(target, ast.Name):
            self._assign_name(target.id, value)
        elif isinstance(target, ast.Tuple):
            if isinstance(value, Array):
                value = [self.load(self._item(value, k)) for k in range(len(target.elts))]
            if len(value) != len(target.elts):
                raise TranslationError(f"got {len(value)} values for {len(target.elts)} names")
            for each, own in zip(target.elts, value, strict=True):
                self._assign(each, own)
        else:
            self._store(self._at(target), value)

    def _assign_name(self, name: str, value: Any) -> None:
        if name not in self._names:
            value = fitted(self, value, None)
            with self.builder.goto_block(self._entry):
                places = [self.builder.alloca(each.type) for each in numbers_of(value)]
            self._names[name] = value, places
        like, places = self._names[name]
        value = self._like(name, value, like)
        for each, place in zip(numbers_of(value), places, strict=True):
            self.builder.store(each, place)

    def _like(self, name: str, value: Any, like: Any) -> Any:
        """Return a value with the structure of another one."""
        if isinstance(like, tuple) and not isinstance(like, Array) and isinstance(value, tuple):
            return grouped(like, [self._like(name, *each) for each in zip(value, like, strict=True)])
        value = fitted(self, value, None)
        if isinstance(like, ir.Value) and isinstance(value, ir.Value):
            return self.number(value, like.type)
        if structure(value) != structure(like):
            raise TranslationError(f"{name} was of another kind: {structure(like)}, now {structure(value)}")
        return value

    def _Return(self, node: Any) -> None:
        value = None if node.value is None else fitted(self, self.value(node.value), self._hints.get("return"))
        if self.result is None:
            self.result = value
        numbers = list(numbers_of(self._like("the result", value, self.result) if value is not None else None))
        if len(numbers) < 2:
            self.builder.ret(numbers[0]) if numbers else self.builder.ret_void()
            return
        whole = ir.Constant(ir.LiteralStructType([each.type for each in numbers]), ir.Undefined)
        for k, each in enumerate(numbers):
            whole = self.builder.insert_value(whole, each, k)
        self.builder.ret(whole)

    def _If(self, node: Any) -> None:
        test = self.value(node.test)
        if is_known(test):
            return self._run(node.body if test else node.orelse)
        yes, no, after = (self.builder.append_basic_block() for _ in range(3))
        self.builder.cbranch(self.number(test, BOOL), yes, no)
        for block, statements in ((yes, node.body), (no, node.orelse)):
            self.builder.position_at_end(block)
            self._run(statements)
            if not self.builder.block.is_terminated:
                self.builder.branch(after)
        self.builder.position_at_end(after)
        return None

    def _While(self, node: Any) -> None:
        self._loop(lambda: self.number(self.value(node.test), BOOL), lambda: self._run(node.body), lambda: None)

    def _For(self, node: Any) -> None:
        if node.orelse:
            raise TranslationError("a loop cannot have an else")
        over, given = node.iter, node.iter.args if isinstance(node.iter, ast.Call) else []
        called = self.value(over.func) if isinstance(over, ast.Call) else None
        if called is range:
            return self._count(node, [self.value(each) for each in given])
        values = self.value(given[0] if called is enumerate else over)
        if isinstance(values, np.ndarray):
            values = constant(self.builder.module, values)
        if not isinstance(values, Array):
            return self._unroll(node, enumerate(values) if called is enumerate else values)

        def begin(k: Any) -> None:
            value = self.load(self._item(values, k))
            self._assign(node.target, (k, value) if called is enumerate else value)

        return self._counted(node, (0, values.shape[0], 1), begin)

    def _count(self, node: Any, given: list[Any]) -> None:
        limits = (0, *given, 1) if len(given) == 1 else (*given, 1) if len(given) == 2 else tuple(given)
        self._counted(node, limits, lambda k: self._assign(node.target, k))

    def _counted(self, node: Any, limits: tuple[Any, ...], begin: Callable[[Any], None]) -> None:
        first, end, by = limits
        if not isinstance(by, int):
            raise TranslationError("the step of a range must be a constant")
        end = self.number(end, INT)
        with self.builder.goto_block(self._entry):
            place = self.builder.alloca(INT)
        self.builder.store(self.number(first, INT), place)

        def go_on() -> Any:
            return self.compared("<" if by > 0 else ">", self.builder.load(place, typ=INT), end)

        def body() -> None:
            begin(self.builder.load(place, typ=INT))
            self._run(node.body)

        def advance() -> None:
            self.builder.store(self.builder.add(self.builder.load(place, typ=INT), ir.Constant(INT, by)), place)

        self._loop(go_on, body, advance)

    def _loop(self, go_on: Callable[[], Any], body: Callable[[], None], advance: Callable[[], None]) -> None:
        test, inside, last, after = (self.builder.append_basic_block() for _ in range(4))
        self.builder.branch(test)
        self.builder.position_at_end(test)
        self.builder.cbranch(go_on(), inside, after)
        self.builder.position_at_end(inside)
        self._loops.append((last, after))
        outer, self.stacked = self.stacked, False
        body()
        self._loops.pop()
        self._go(last)
        if self.stacked:  # arrays on the stack are given back each time
            self.builder.position_at_start(inside)
            before = self.builder.call(self._stack("save", ir.PointerType()), [])
            self.builder.position_at_end(last)
            self.builder.call(self._stack("restore", ir.VoidType(), ir.PointerType()), [before])
        self.stacked = outer
        advance()
        self._go(test, after)

    def _stack(self, what: str, result: Any, *given: Any) -> Any:
        return declared(self.builder.module, ir.FunctionType(result, given), f"llvm.stack{what}.p0")

    def _unroll(self, node: Any, values: Any) -> None:
        after = self.builder.append_basic_block()
        for value in values:
            following = self.builder.append_basic_block()
            self._loops.append((following, after))
            self._assign(node.target, value)
            self._run(node.body)
            self._loops.pop()
            self._go(following)
        self._go(after)

    def _go(self, to: Any, then: Any = None) -> None:
        if not self.builder.block.is_terminated:
            self.builder.branch(to)
        self.builder.position_at_end(then or to)

    def _Break(self, node: Any) -> None:
        self.builder.branch(self._loops[-1][1])

    def _Continue(self, node: Any) -> None:
        self.builder.branch(self._loops[-1][0])

    # Expressions

    def value(self, node: Any) -> Any:
        """Return the value of an expression."""
        return getattr(self, "_" + type(node).__name__, self._refuse)(node)

    def _Constant(self, node: Any) -> Any:
        return node.value

    def _Name(self, node: Any) -> Any:
        name = node.id
        if name in self._names:
            like, places = self._names[name]
            kinds = (each.type for each in numbers_of(like))
            return rebuilt(like, iter([self.builder.load(place, typ=kind) for place, kind in zip(places, kinds)]))  # noqa: B905
        known = self.function.__globals__
        if name in known:
            return known[name]
        builtins = known["__builtins__"]
        builtins = builtins if isinstance(builtins, dict) else vars(builtins)
        if name not in builtins:
            raise TranslationError(f"{name} is not known here")
        return builtins[name]

    def _Tuple(self, node: Any) -> Any:
        found: list[Any] = []
        for each in node.elts:
            if isinstance(each, ast.Starred):
                found += self.value(each.value)
            else:
                found.append(self.value(each))
        return tuple(found)

    def _Attribute(self, node: Any) -> Any:
        of, name = self.value(node.value), node.attr
        if not isinstance(of, Array):
            return getattr(of, name)
        if name == "size":
            return self._sized(of)
        if name == "ravel":
            return partial(Array, of.pointer, (self._sized(of),), of.kind)
        if name == "data":  # x.ctypes.data
            return self.builder.ptrtoint(of.pointer, INT)
        if name not in ("shape", "ctypes", "copy"):
            raise TranslationError(f"an array has no {name} here")
        return of.shape if name == "shape" else of if name == "ctypes" else partial(copied, self, of)

    def _BinOp(self, node: Any) -> Any:
        return self.computed(_OPERATORS[type(node.op)], self.value(node.left), self.value(node.right))

    def _UnaryOp(self, node: Any) -> Any:
        value = self.value(node.operand)
        if isinstance(node.op, ast.Not):
            return not value if is_known(value) else self.builder.not_(self.number(value, BOOL))
        return self.negated(value) if isinstance(node.op, ast.USub) else self._refuse(node.op)

    def _Compare(self, node: Any) -> Any:
        left, found = self.value(node.left), None
        for op, other in zip(node.ops, node.comparators, strict=True):
            right = self.value(other)
            here = self._compare(op, left, right)
            found = here if found is None else self.builder.and_(self.number(found), self.number(here))
            left = right
        return found

    def _compare(self, op: Any, left: Any, right: Any) -> Any:
        if isinstance(op, ast.In):
            tests = [self.number(self._compare(ast.Eq(), left, each)) for each in right]
            found = tests[0]
            for test in tests[1:]:
                found = self.builder.or_(found, test)
            return found
        how, known = _COMPARISONS[type(op)]
        return known(left, right) if is_known(left) and is_known(right) else self.compared(how, left, right)

    def _BoolOp(self, node: Any) -> Any:
        either, first = isinstance(node.op, ast.Or), self.value(node.values[0])
        for other in node.values[1:]:
            if is_known(first):
                first = first if bool(first) == either else self.value(other)
                continue
            first = self.number(first, BOOL)
            begun, more, after = self.builder.block, *(self.builder.append_basic_block() for _ in range(2))
            self.builder.cbranch(first, *((after, more) if either else (more, after)))
            self.builder.position_at_end(more)
            second, end = self.number(self.value(other), BOOL), self.builder.block
            self.builder.branch(after)
            self.builder.position_at_end(after)
            found = self.builder.phi(BOOL)
            found.add_incoming(first, begun)
            found.add_incoming(second, end)
            first = found
        return first

    def _IfExp(self, node: Any) -> Any:
        test = self.value(node.test)
        if is_known(test):
            return self.value(node.body if test else node.orelse)
        yes, no, after = (self.builder.append_basic_block() for _ in range(3))
        self.builder.cbranch(self.number(test, BOOL), yes, no)
        found, ends = [], []
        for block, expression in ((yes, node.body), (no, node.orelse)):
            self.builder.position_at_end(block)
            found.append(fitted(self, self.value(expression), None))
            ends.append(self.builder.block)
        numbers = [list(numbers_of(each)) for each in found]
        for k, pair in enumerate(zip(*numbers, strict=True)):
            if pair[0].type != pair[1].type:
                kind = DOUBLE if DOUBLE in (pair[0].type, pair[1].type) else INT
                for own, each, end in zip(numbers, pair, ends, strict=True):
                    self.builder.position_at_end(end)
                    own[k] = self.number(each, kind)
        for end in ends:
            self.builder.position_at_end(end)
            self.builder.branch(after)
        self.builder.position_at_end(after)
        joined = []
        for pair in zip(*numbers, strict=True):
            joined.append(self.builder.phi(pair[0].type))
            for each, end in zip(pair, ends, strict=True):
                joined[-1].add_incoming(each, end)
        return rebuilt(found[0], iter(joined))

    def _Call(self, node: Any) -> Any:
        function, args = self.value(node.func), self._Tuple(ast.Tuple(node.args))
        named = {each.arg: self.value(each.value) for each in node.keywords}
        if isinstance(function, type) and hasattr(function, "_fields"):
            return function(*args, **named)
        if isinstance(function, partial):  # a method
            return function(*args, **named)
        own = LIBRARY.get(function)
        if own is not None:
            return own(self, *args, **named)
        write = getattr(function, "write", None)
        if write is not None:
            bound = inspect.signature(function).bind(*args, **named)
            bound.apply_defaults()
            return write(Writer(self.builder), *(fitted(self, each, None) for each in bound.arguments.values()))
        function = getattr(function, "__wrapped__", function)
        if not inspect.isfunction(function):
            raise TranslationError(f"{function} cannot be called by compiled code")
        return self.unit.call(self, function, args, named)

    # Arrays

    def _Subscript(self, node: Any) -> Any:
        return self.load(self._at(node))

    def _at(self, node: Any) -> Any:
        """Return the place of an entry, as an array without axes, some rows of an array, or an item of a group."""
        of = self.value(node.value)
        at = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
        for index in at:
            if isinstance(index, ast.Slice) and index.lower is index.upper is None and isinstance(of, Array):
                continue
            if isinstance(index, ast.Slice):
                first, end = (None if each is None else self.value(each) for each in (index.lower, index.upper))
                if index is not at[-1] or index.step is not None:
                    raise TranslationError("only the last index may be a slice, and without a step")
                return of[slice(first, end)] if not isinstance(of, Array) else self._part(of, first, end)
            k = self.value(index)
            if isinstance(of, np.ndarray) and not is_known(k):
                of = constant(self.builder.module, of)
            if isinstance(of, tuple) and not (isinstance(of, Array) or is_known(k)):
                of = self._row(of)
            of = self._item(of, k) if isinstance(of, Array) else of[k]
        return of

    def _row(self, group: tuple[Any, ...]) -> Array:
        """Return the numbers of a group as an array."""
        numbers, size = self.alike(*group, at_least=INT), ir.Constant(INT, len(group))
        with self.builder.goto_block(self._entry):
            found = Array(self.builder.alloca(numbers[0].type, size), (size,), numbers[0].type)
        for k, each in enumerate(numbers):
            self._store(self._item(found, k), each)
        return found

    def _item(self, of: Array, k: Any) -> Array:
        if not of.shape:
            raise TranslationError("too many indices")
        if is_known(k) and k < 0:
            k = self.computed(operator.add, of.shape[0], k)
        return Array(self._moved(of, k), of.shape[1:], of.kind)

    def _part(self, of: Array, first: Any, end: Any) -> Array:
        first, end = 0 if first is None else first, of.shape[0] if end is None else end
        if is_known(end) and end < 0:
            end = self.computed(operator.add, of.shape[0], end)
        rows = self.number(self.computed(operator.sub, end, first), INT)
        return Array(self._moved(of, first), (rows, *of.shape[1:]), of.kind)

    def _moved(self, of: Array, k: Any) -> Any:
        for size in of.shape[1:]:
            k = self.computed(operator.mul, k, size)
        return self.builder.gep(of.pointer, [self.number(k, INT)], source_etype=of.kind)

    def load(self, here: Any) -> Any:
        """Return the number at a place, and anything else as it is."""
        if not isinstance(here, Array) or here.shape:
            return here
        value = self.builder.load(here.pointer, typ=here.kind)
        wide = INT if isinstance(here.kind, ir.IntType) else DOUBLE
        return self.number(value, wide)

    def _store(self, here: Any, value: Any) -> None:
        if not isinstance(here, Array):
            raise TranslationError("what is known when code is compiled cannot be written")
        if here.shape:
            self._store_all(here, value)
            return
        wide = INT if isinstance(here.kind, ir.IntType) else DOUBLE
        self.builder.store(self.number(self.number(value, wide), here.kind), here.pointer)

    def _store_all(self, here: Array, value: Any) -> None:
        """Write the entries of an array, those of another one or all the same."""
        count = self.number(self._sized(here), INT)
        with Writer(self.builder).loop(count) as k:
            source = Array(value.pointer, (count,), value.kind) if isinstance(value, Array) else None
            each = value if source is None else self.load(self._item(source, k))
            self._store(self._item(Array(here.pointer, (count,), here.kind), k), each)

    def _sized(self, of: Array) -> Any:
        size: Any = 1
        for each in of.shape:
            size = self.computed(operator.mul, size, each)
        return size
