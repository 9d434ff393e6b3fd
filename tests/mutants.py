"""Mutations drawn by a seed over solver, friction, estimator, planner, sweep and fit: which of them fail a test.

    python tests/mutants.py --seed 1 --count 30          # tries each in a copy of the tree, and prints a table
    python tests/mutants.py --seed 1 --count 30 --list   # only says which they are
    python tests/mutants.py --seed 1 --count 30 --pick 4 9   # tries these of them alone, as after a test was added

Each area and each operator has the same share. A mutation is tried against the tests of its area up to the first that
fails. One that hangs is killed too: by a limit of thrice the time of the unmutated tests and two minutes more, in which
mutations of solver and friction compile.

Left out are mutations that change no behaviour by one of these rules:

* text: messages, assertions, annotations, decorators, and the files that write or draw for people (`TEXT`);
* the same mathematics: swapped arguments of `SYMMETRIC` functions, and what reads the same after the mutation;
* equality: `<=` in place of `<`, which differs where both sides are the same to the last bit;
* rounding: terms and factors within 1e-9 of 0 or of 1;
* work: counters and clocks (`COUNTED`), which say how much was done.
"""

from __future__ import annotations

import argparse
import ast
import contextlib
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
PHYSICS = [f"worm3d/physics/{name}.py" for name in ("contact", "friction*", "kernels/point", "kernels/regime")]
OF_SOLVER = "newton segment_law fronts time_step series free_flight impact friction symmetry energy_ledger media "
OF_SOLVER += "step_derivatives planar_case violence resume settling bad_arguments pneumatic accuracy locomotion"
OF_FRICTION = "point_kernels friction_laws kernel_derivatives fronts friction small_coefficients"
OF_ESTIMATOR = "reduced kalman turning input_history ground terms body_wave estimator noise"
OF_PLANNER = "gauss_newton constraints terms prediction feedforward suited mpc"
AREAS = {
    "solver": (["worm3d/solver"], "tests/worm3d", OF_SOLVER),
    "friction": (PHYSICS, "tests/worm3d", OF_FRICTION),
    "estimator": (["control/estimation"], "tests/control", OF_ESTIMATOR),
    "planner": (["control/planning"], "tests/control", OF_PLANNER),
    "sweep": (["scenes/sweep"], "tests/scenes/sweep", "vary plan limit links job engine outputs workers command"),
    "fit": (["scenes/studies/fit"], "tests/scenes/studies/fit", "fit_numbers fit_scenes"),
}
"""Files of each area, and the folder and names of its tests, in the order in which they are tried."""
TEXT = re.compile(r"/(__init__|command|report|figures?|progress)\.py$")
SYMMETRIC = {"min", "max", "fmin", "fmax", "minimum", "maximum", "hypot", "dot", "isclose", "logic_and", "logic_or"}
TYPED = {"isinstance", "issubclass", "getattr", "hasattr", "cast", "field", "parameter", "get", "setdefault"}
"""Functions whose arguments are of different kinds: swapped ones only crash."""
COUNTED = {"count", "perf_counter", "process_time", "monotonic"}


PAIRS = ["left", "right", "forward", "backward", "low", "high", "lower", "upper", "first", "last"]
SIDES = dict(zip(PAIRS, (PAIRS[k ^ 1] for k in range(len(PAIRS))), strict=True))
ENDS = ["min", "max", "fmin", "fmax", "minimum", "maximum", "argmin", "argmax"]
LIMITS = dict(zip(ENDS, (ENDS[k ^ 1] for k in range(len(ENDS))), strict=True))
TURNED = {ast.Lt: ast.Gt, ast.Gt: ast.Lt, ast.LtE: ast.GtE, ast.GtE: ast.LtE}
SIGNS = {ast.Add: ast.Sub, ast.Sub: ast.Add}
ORDERED = (ast.Sub, ast.Div, ast.FloorDiv, ast.Mod, ast.Pow, ast.MatMult)
OPERATORS = ("sign", "limit", "order", "swapped sides", "dropped term")
Changes = Iterator[tuple[str, ast.AST]]


class Mutation(NamedTuple):
    """A piece of a file, by bytes, and what takes its place."""

    area: str
    operator: str
    path: str
    line: int
    begin: int
    end: int
    old: str
    new: str

    def __str__(self) -> str:
        old, new = (code if len(code) <= 60 else f"{code[:57]}..." for code in (self.old, self.new))
        return f"{self.operator:13} {self.path}:{self.line}  {old}  ->  {new}"


def _named(node: ast.expr) -> str:
    return node.attr if isinstance(node, ast.Attribute) else node.id if isinstance(node, ast.Name) else ""


def _joins(node: ast.expr) -> bool:
    """Return whether a sum with this is one of texts or lists."""
    text = isinstance(node, ast.Constant) and isinstance(node.value, str)
    return text or isinstance(node, ast.List | ast.Tuple | ast.ListComp | ast.JoinedStr)


def _negligible(node: ast.expr) -> bool:
    number = node.value if isinstance(node, ast.Constant) else None
    return isinstance(number, int | float) and min(abs(number), abs(number - 1)) <= 1e-9


def changes(node: ast.AST) -> Changes:  # noqa: C901 - a case for each kind of node
    """Yield operator and replacement of each mutation of a node, what is in it left alone."""
    match node:
        case ast.BinOp(left, op, right) if not _joins(left) and not _joins(right):
            if type(op) in SIGNS:
                yield "sign", ast.BinOp(left, SIGNS[type(op)](), right)
            if isinstance(op, ORDERED):
                yield "swapped sides", ast.BinOp(right, op, left)
            if isinstance(op, ast.Add | ast.Sub | ast.Mult | ast.Div) and not _negligible(right):
                yield "dropped term", left
            if isinstance(op, ast.Add | ast.Mult) and not _negligible(left):
                yield "dropped term", right
        case ast.AugAssign(target, op, value):
            if type(op) in SIGNS:
                yield "sign", ast.AugAssign(target, SIGNS[type(op)](), value)
            yield "dropped term", ast.Pass()
        case ast.UnaryOp(ast.USub(), operand):
            yield "sign", operand
        case ast.UnaryOp(ast.Not(), operand):
            yield "dropped term", operand
        case ast.BoolOp(op, values):
            for k in range(len(values)):
                rest = values[:k] + values[k + 1 :]
                yield "dropped term", rest[0] if len(rest) == 1 else ast.BoolOp(op, rest)
        case ast.Compare(left, [op], [right]) if type(op) in TURNED:
            yield "limit", ast.Compare(left, [TURNED[type(op)]()], [right])
        case ast.IfExp(test, body, other):
            yield "swapped sides", ast.IfExp(test, other, body)
        case ast.Tuple([one, other], ast.Load()) if not isinstance(one, ast.Slice):
            yield "swapped sides", ast.Tuple([other, one], ast.Load())
        case ast.Subscript(value, place, ast.Load()) if ast.unparse(place) == "::-1":
            yield "order", value
        case ast.Subscript(value, place, ast.Load()) if ast.unparse(place) in {"0", "-1"}:
            yield "order", ast.Subscript(value, ast.Constant(-1 if ast.unparse(place) == "0" else 0), ast.Load())
        case ast.Attribute(value, name, ast.Load()) if name in SIDES:
            yield "swapped sides", ast.Attribute(value, SIDES[name], ast.Load())
        case ast.Call():
            yield from _of_call(node)


def _of_call(node: ast.Call) -> Changes:
    func, args, name = node.func, node.args, _named(node.func)
    if name in LIMITS:
        other = ast.Attribute(func.value, LIMITS[name]) if isinstance(func, ast.Attribute) else ast.Name(LIMITS[name])
        yield "limit", ast.Call(other, args, node.keywords)
    if name in {"sorted", "reversed", "sort"} and len(args) == 1:
        yield "order", ast.Call(ast.Name("list"), args, [])
    if name == "clip" and len(args) == 3:
        yield "limit", args[0]
    if name == "range" and len(args) == 1:
        yield "limit", ast.Call(func, [ast.BinOp(args[0], ast.Sub(), ast.Constant(1))], [])
    if any(isinstance(arg, ast.Starred) for arg in args):
        return
    if len(args) == 2 and name not in SYMMETRIC | TYPED:
        yield "swapped sides", ast.Call(func, args[::-1], node.keywords)
    if len(args) == 3 and name in {"where", "if_else"}:
        yield "swapped sides", ast.Call(func, [args[0], args[2], args[1]], node.keywords)


def visited(node: ast.AST) -> Iterator[ast.AST]:
    """Yield a node and those in it, but for text and work."""
    counts = isinstance(node, ast.Call) and _named(node.func) in COUNTED
    if counts or isinstance(node, ast.Raise | ast.Assert | ast.JoinedStr | ast.Import | ast.ImportFrom | ast.arg):
        return
    yield node
    for name, value in ast.iter_fields(node):
        if name not in {"annotation", "returns", "decorator_list", "bases"}:
            for child in value if isinstance(value, list) else [value]:
                if isinstance(child, ast.AST):
                    yield from visited(child)


def in_file(area: str, path: str) -> Iterator[Mutation]:
    """Yield all mutations of a file."""
    text = (ROOT / path).read_bytes()
    starts, tree = [0, *(match.end() for match in re.finditer(b"\n", text))], ast.parse(text)
    sides = {node.attr for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
    for node in visited(tree):
        for operator, changed in changes(node):
            old, new = ast.unparse(node), ast.unparse(ast.fix_missing_locations(changed))
            if old != new and getattr(changed, "attr", "") in sides | {""}:
                begin, end = (
                    starts[node.lineno - 1] + node.col_offset,
                    starts[node.end_lineno - 1] + node.end_col_offset,
                )
                new = f"({new})" if isinstance(node, ast.expr) else new
                yield Mutation(area, operator, path, node.lineno, begin, end, old, new)


def drawn(seed: int, count: int) -> list[Mutation]:
    """Return mutations: each area and operator in turn, and a place of theirs at random."""
    rng, known, chosen = random.Random(seed), {}, []
    for area, (patterns, *_) in AREAS.items():
        found = sorted(path for each in patterns for path in [*(ROOT / each).rglob("*.py"), *ROOT.glob(f"{each}")])
        for path in (str(each.relative_to(ROOT)) for each in found if each.is_file() and not TEXT.search(str(each))):
            for each in in_file(area, path):
                known.setdefault((area, each.operator), []).append(each)
    cells = [(area, operator) for operator in OPERATORS for area in AREAS]
    while len(chosen) < count:
        rng.shuffle(cells)
        chosen += [rng.choice(known[cell]) for cell in cells]
    return sorted(chosen[:count], key=lambda each: (list(AREAS).index(each.area), each))


def copied(folder: Path) -> Path:
    """Copy the files of the working tree that git knows, and return the folder."""
    names = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, check=True, text=True).stdout
    for name in filter(lambda name: (ROOT / name).is_file(), names.splitlines()):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / name, folder / name)
    return folder


def tests_of(mutation: Mutation, tree: Path) -> list[str]:
    """Return the tests of an area in a tree, after those of its folder that are named after the file."""
    _, folder, names = AREAS[mutation.area]
    stem = Path(mutation.path).stem
    known = {path.stem.removeprefix("test_") for path in (tree / folder).glob("test_*.py")} if stem else set()
    tried = sorted(name for name in known if stem in name)
    tried += sorted(names.split(), key=lambda name: name not in stem)
    return [place for name in dict.fromkeys(tried) if (tree / (place := f"{folder}/test_{name}.py")).exists()]


def failing(tree: Path, tests: list[str], cache: str, limit_s: float) -> str:
    """Return the first test that fails in a tree, or that it hangs; an empty text where all pass."""
    command = [sys.executable, "-m", "pytest", "-n", "0", "-x", "-rfE", "-p", "no:cacheprovider", "--tb=no", *tests]
    places = {**os.environ, "PYTHONPATH": str(tree), "XDG_CACHE_HOME": cache, "PYTHONDONTWRITEBYTECODE": "1"}
    pipe = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
    run = subprocess.Popen(command, cwd=tree, env=places, start_new_session=True, **pipe)
    try:
        said, _ = run.communicate(timeout=limit_s)
    except subprocess.TimeoutExpired:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(run.pid, signal.SIGKILL)
        return f"a time limit of {limit_s:.0f} s"
    found = re.search(r"^(?:FAILED|ERROR) (?:tests/)?(\S+)", said, re.MULTILINE)
    return "" if run.returncode == 0 else found[1] if found else f"exit code {run.returncode}: {said[-200:]}"


def main() -> int:
    """Try the mutations that are drawn; return how many survive."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--count", type=int, default=30)
    parser.add_argument("--limit", type=float, default=900.0, help="longest time limit of the tests of a mutation [s]")
    parser.add_argument("--only", nargs="*", default=list(AREAS), choices=AREAS, help="areas, of all that are drawn")
    parser.add_argument("--list", action="store_true", help="only list the mutations")
    parser.add_argument("--pick", nargs="+", type=int, help="numbers of mutations in the list: these alone")
    given = parser.parse_args()
    listed, survived = enumerate(drawn(given.seed, given.count), 1), 0
    chosen = {k: each for k, each in listed if each.area in given.only and k in (given.pick or [k])}
    with tempfile.TemporaryDirectory() as scratch:
        tree, cache = copied(Path(scratch) / "tree"), os.environ.get("XDG_CACHE_HOME", f"{scratch}/cache")
        limits: dict[str, float] = {}
        for area in () if given.list else dict.fromkeys(each.area for each in chosen.values()):
            began = time.monotonic()
            wrong = failing(tree, tests_of(Mutation(area, "", "", 0, 0, 0, "", ""), tree), cache, given.limit)
            if wrong:
                raise SystemExit(f"{area}: without any mutation {wrong} fails; mend that first")
            limits[area] = min(given.limit, 120.0 + 3.0 * (time.monotonic() - began))
        for k, each in chosen.items():
            sys.stdout.write(f"{k:3} {each}\n")
            if given.list:
                continue
            began, source = time.monotonic(), (tree / each.path).read_bytes()
            (tree / each.path).write_bytes(source[: each.begin] + each.new.encode() + source[each.end :])
            killer = failing(tree, tests_of(each, tree), cache, limits[each.area])
            (tree / each.path).write_bytes(source)
            survived += not killer
            sys.stdout.write(
                f"    {f'killed by {killer}' if killer else 'SURVIVED'}, {time.monotonic() - began:.0f} s\n"
            )
            sys.stdout.flush()
    sys.stdout.write("" if given.list else f"seed {given.seed}: {len(chosen) - survived} of {len(chosen)} killed\n")
    return survived


if __name__ == "__main__":
    sys.exit(main())
