"""Compare two checkouts: every shipped scene bit for bit, or the cost of a step. For changes that keep behaviour.

    python tests/bit_equality.py OLD NEW [--scenes NAME ...] [--seconds 6] [--keep DIR]
    python tests/bit_equality.py OLD NEW --cost

OLD and NEW are checkouts, each with its own `.venv`. The first form runs every scene in both, at most `--seconds` of
simulated time (whole for studies and the planar models), and compares all variables of `result.nc` but wall-clock
times. A variable that only one of the two has is named, and is a difference too unless `RENAMED` maps it or `ADDED`
names it. With `--keep` the results of OLD stay in DIR, and are read there the next time. The second prints the cost of
a step of NEW over that of OLD, from runs that take turns.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5netcdf
import numpy as np

RENAMED: dict[str, str] = {}
"""Path of a variable in OLD, such as "checkpoint/fronts", and its path in NEW."""

ADDED = {"actuator", "actuator_loss", "checkpoint/state_contraction", "hysteresis_loss", "twist"}
"""Paths of variables that only NEW has, or may have."""

NOT_COMPARED = ("timing", "run")
"""Groups of `result.nc` that are not compared: wall-clock times, and arrays of worm and world."""

OF_A_PROGRAM = ("case",)
"""Variables of `sweep.nc` that are not compared: keys of cases depend on the program."""

BAD_SCENE = 2
"""Exit code of a scene that cannot be shortened so far."""

ROUNDS = 7
"""Runs of each checkout from which the fastest is taken."""

COST = """
import sys, time, worm3d
from control.gaits import TravellingWave
for segments, duration in ((6, 20.0), (100, 1.0)):
    worm = worm3d.Worm(segments=segments)
    run = lambda: worm3d.simulate(worm, worm3d.Plane(), actuation=TravellingWave(bias=0.1), duration=duration)
    run()
    begun = time.process_time()
    result = run()
    print(segments, 1e6 * (time.process_time() - begun) / len(result.newton_iterations))
"""
"""Prints segments and microseconds of a step, with what a run costs beside its steps."""


def main() -> int:
    """Compare the checkouts that the command line names; return the number of scenes that differ."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("old", type=Path)
    parser.add_argument("new", type=Path)
    parser.add_argument("--scenes", nargs="*", help="names; all if left out")
    parser.add_argument("--seconds", type=float, default=6.0, help="simulated time of a worm's scene")
    parser.add_argument("--keep", type=Path, help="folder of the results of OLD, for this many seconds")
    parser.add_argument("--cost", action="store_true")
    given = parser.parse_args()
    if given.cost:
        _print_costs(given.old, given.new)
        return 0
    names = given.scenes or sorted(path.stem for path in (given.old / "scenes").glob("*.toml"))
    return sum(not _equal(name, given) for name in names)


def _equal(name: str, given: argparse.Namespace) -> bool:
    """Run a scene in both checkouts, and print whether and where its results differ."""
    with tempfile.TemporaryDirectory() as folder:
        kept = (given.keep or Path(folder) / "old") / name
        before = dict(_variables(_file_of(kept) or _run(name, given.old, kept, given.seconds)))
        after = dict(_variables(_run(name, given.new, Path(folder) / "new", given.seconds)))
    renamed = {RENAMED.get(path, path): values for path, values in before.items()}
    lines = [f"{path}: only in {side}" for side, path in _unpaired(renamed, after)]
    lines += [_difference(path, renamed[path], after[path]) for path in renamed if path in after]
    found = [line for line in lines if line]
    verdict = f"{name}: {'equal' if not found else 'differs'} ({len(after)} variables)"
    sys.stdout.write("\n  ".join([verdict, *found]) + "\n")
    sys.stdout.flush()
    return not found


def _run(name: str, checkout: Path, out: Path, seconds: float) -> Path:
    """Run a scene for at most so long, or whole where that is too short for it, and return its `result.nc`."""
    command = [checkout / ".venv" / "bin" / "worm3d", "run", name, "--out", out, "--quiet"]
    text, shorter = (checkout / "scenes" / f"{name}.toml").read_text(), []
    if 'model = "worm' in text or 'model = "control' in text:
        duration = next(float(line.split("=")[1].split("#")[0]) for line in text.splitlines() if "duration_s" in line)
        shorter = ["-o", f"run.duration_s={min(duration, seconds)}"]
    done = subprocess.run([*command, *shorter], cwd=checkout, check=False, capture_output=True, text=True)
    if done.returncode == BAD_SCENE:
        done = subprocess.run(command, cwd=checkout, check=False, capture_output=True, text=True)
    if (found := _file_of(out)) is None:  # a run that diverges has a result too
        raise RuntimeError(f"{name} in {checkout}: {done.stderr}")
    return found


def _file_of(out: Path) -> Path | None:
    """Return the result of a run, or of a sweep, in a folder."""
    return next((out / name for name in ("result.nc", "sweep.nc") if (out / name).exists()), None)


def _variables(path: Path) -> Iterator[tuple[str, np.ndarray[Any, Any]]]:
    """Yield the path in the file and the values of each variable that is compared."""
    with h5netcdf.File(path, "r") as file:
        for name, variable in file.variables.items():
            if name in OF_A_PROGRAM:
                continue
            yield name, np.asarray(variable[...])
        for group in file.groups:
            if group not in NOT_COMPARED:
                for name, variable in file.groups[group].variables.items():
                    yield f"{group}/{name}", np.asarray(variable[...])


def _unpaired(old: dict[str, Any], new: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield the side and path of each variable that only one of two files has."""
    for side, own, other in (("OLD", old, new), ("NEW", new, old)):
        yield from ((side, path) for path in own if path not in other and (side == "OLD" or path not in ADDED))


def _difference(path: str, old: np.ndarray[Any, Any], new: np.ndarray[Any, Any]) -> str:
    """Say in a line how the values of a variable differ; nothing where they are the same bits."""
    if old.shape != new.shape:
        return f"{path}: shape {old.shape} became {new.shape}"
    if old.dtype.kind not in "iufb":
        return "" if (old == new).all() else f"{path}: the texts differ"
    if old.tobytes() == new.tobytes():
        return ""
    size = np.abs(new.astype(float) - old.astype(float))
    return f"{path}: largest difference {np.nanmax(size):.3g}, largest value {np.nanmax(np.abs(old.astype(float))):.3g}"


def _print_costs(old: Path, new: Path) -> None:
    """Print the cost of a step in both checkouts, the fastest of runs that take turns, and their ratio."""
    costs: dict[tuple[Path, str], float] = {}
    for _ in range(ROUNDS):
        for checkout in (old, new):
            python = checkout / ".venv" / "bin" / "python"
            done = subprocess.run([python, "-c", COST], cwd=checkout, check=True, capture_output=True, text=True)
            for segments, cost in (line.split() for line in done.stdout.splitlines()):
                costs[checkout, segments] = min(float(cost), costs.get((checkout, segments), np.inf))
    for segments in sorted({segments for _, segments in costs}, key=int):
        before, after = costs[old, segments], costs[new, segments]
        sys.stdout.write(f"N = {segments}: {before:.1f} us a step became {after:.1f}, ratio {after / before:.3f}\n")


if __name__ == "__main__":
    sys.exit(main())
