"""Iterations of the solver with each tuned constant at half and at double its value: the table of its README.

    python tests/benchmarks/tuned_constants.py [CONSTANT ...] [--seconds 6]

The solver is compiled once: its constants, of which compiled code takes the value for good, are replaced by reads of an
array when their modules are imported. Prints the mean number of Newton's iterations of each scene, of the evaluations
of the residual in all of them together, and falls back to descent; "!" marks a run that did not reach its end.
"""

from __future__ import annotations

import argparse
import ast
import importlib
import importlib.abc
import importlib.machinery
import importlib.util
import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType
from typing import Any

import numpy as np

SCENES = ("flat", "pipe_bend", "slope_15", "rubble")

COMPILED = {
    "worm3d.solver.newton": (
        "DIVERGED STRAY_STEP MAX_STRAYS CONTRACTION CURVATURE DOUBT EARLY_RELEASE_MARGIN "
        "SLIDE_AT_ONCE KEPT_JACOBIAN_MOTION STAGNATION"
    ),
    "worm3d.solver.descent": "MAX_ITERATIONS SMALL_STEP SUFFICIENT",
    "worm3d.solver.regimes": "PRESSED",
    "worm3d.solver.fronts": "SMOOTH",
}
"""Constants of compiled modules."""

SYMBOLIC = {
    "worm3d.physics.kernels.regime": "MAX_SWING STICK_SHARE SIDE_TOLERANCE",
    "worm3d.physics.contact": "YIELD_TOLERANCE BREAKAWAY_TOLERANCE",
    "worm3d.physics.friction": "RESTING_PENETRATION BREAKAWAY TANGENTIAL_DAMPING_RATIO",
}
"""Constants of kernels, which are made anew, and of Python code."""

VALUES = np.zeros(64)
"""What compiled code reads in place of the constants of `COMPILED`."""

PLACES = {name: k for k, name in enumerate(name for names in COMPILED.values() for name in names.split())}


class _Reads(ast.NodeTransformer):
    """Replaces the constants of a module, inside its functions, by reads of `VALUES`."""

    inside = 0

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.FunctionDef:
        self.inside += 1
        self.generic_visit(node)
        self.inside -= 1
        return node

    def visit_Name(self, node: ast.Name) -> ast.expr:
        return _read(node.id) if self.inside and node.id in PLACES else node

    def visit_Attribute(self, node: ast.Attribute) -> ast.expr:
        return _read(node.attr) if self.inside and node.attr in PLACES else node


def _read(name: str) -> ast.expr:
    read = f"_tuned({VALUES.ctypes.data + 8 * PLACES[name]})"
    return ast.parse(f"int({read})" if name.startswith("MAX_") else read, mode="eval").body


class _Finder(importlib.abc.MetaPathFinder, importlib.abc.InspectLoader):
    """Imports the modules of `COMPILED` with their constants replaced."""

    def find_spec(self, name: str, path: Any, target: Any = None) -> importlib.machinery.ModuleSpec | None:
        if name not in COMPILED:
            return None
        found = importlib.machinery.PathFinder.find_spec(name, path)
        assert found is not None
        return importlib.util.spec_from_file_location(name, found.origin, loader=self)

    def get_source(self, fullname: str) -> str:
        raise NotImplementedError

    def exec_module(self, module: ModuleType) -> None:
        from worm3d.machine.compiled import inner
        from worm3d.machine.later import carray
        from worm3d.machine.vectors import doubles_at

        @inner
        def _tuned(place: int) -> float:
            return carray(doubles_at(place), (1,))[0]

        assert module.__file__
        with open(module.__file__, encoding="utf-8") as file:
            tree = ast.parse(file.read())
        module.__dict__["_tuned"] = _tuned
        names = COMPILED[module.__name__].split()
        tree = ast.fix_missing_locations(_Reads().visit(tree))
        exec(compile(tree, module.__file__, "exec"), module.__dict__)
        for name in names:
            VALUES[PLACES[name]] = getattr(module, name)


@contextmanager
def changed(module: str, name: str, factor: float) -> Iterator[None]:
    """Multiply a constant for a while."""
    home = importlib.import_module(module)
    value = getattr(home, name)
    try:
        _set(home, name, value * factor)
        yield
    finally:
        _set(home, name, value)


def _set(home: ModuleType, name: str, value: float) -> None:
    setattr(home, name, value)
    if name in PLACES:
        VALUES[PLACES[name]] = value
        return
    from worm3d.physics.kernels import point
    from worm3d.running import plant

    for made in (plant._kernel, point.contact_of, point._force):
        made.cache_clear()  # type: ignore[attr-defined]


def measured(seconds: float) -> str:
    """Return a row: iterations of each scene, evaluations and falls back of all, distances."""
    import worm3d
    from scenes.models.loading import load_scene
    from scenes.models.worm.build import problem_of

    cells, evaluations, fallbacks, distances = [], [], 0, []
    for name in SCENES:
        problem: Any = problem_of(load_scene(name, [f"run.duration_s={seconds}"]).settings)
        fields = "worm world ground actuation duration dt integrator gravity external_force state held"
        given = {each: getattr(problem, each) for each in fields.split()}
        run = worm3d.simulate_batch(**(given | {"worm": [problem.worm]}))[0]  # shares no worm at rest with other runs
        done = run.status is worm3d.Status.DONE
        cells.append(f"{run.newton_iterations.mean():.2f}" if done else "!")
        evaluations.extend([(run.newton_iterations + run.gradient_evaluations).mean()] if done else [])
        fallbacks += int(run.fallbacks.sum())
        distances.append(run.distance)
    moved = " ".join(f"{each:.5f}" for each in distances)
    return f"{' | '.join(cells)} | {np.mean(evaluations):.2f} | {fallbacks} | {moved}"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("constants", nargs="*")
    parser.add_argument("--seconds", type=float, default=6.0)
    given = parser.parse_args()
    sys.stdout.write(f"constant | {' | '.join(SCENES)} | evaluations | falls back | distances [m]\n")
    _row("as it is", given.seconds)
    for module, names in (COMPILED | SYMBOLIC).items():
        for name in names.split():
            if given.constants and name not in given.constants:
                continue
            for label, factor in (("half", 0.5), ("double", 2.0)):
                with changed(module, name, factor):
                    _row(f"{name} {label}", given.seconds)


def _row(label: str, seconds: float) -> None:
    sys.stdout.write(f"{label} | {measured(seconds)}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:  # none of what is compiled here is of use elsewhere
        os.environ["XDG_CACHE_HOME"] = folder
        sys.meta_path.insert(0, _Finder())
        main()
