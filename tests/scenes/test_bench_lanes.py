"""`scenes.bench.lanes`: the eliminated systems are solved, the bounds are counted as they say; no time is asserted."""

from __future__ import annotations

import ctypes
import itertools
from collections import Counter
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from typer.testing import CliRunner

from scenes.bench import lane_bound, lane_elimination, lane_figure, lanes, shares
from scenes.bench.lane_bound import Bound, LaneStudy, in_lock_step
from scenes.bench.shares import Bed, Counts
from scenes.bench.throughput import Throughput
from worm3d.machine.banded import WIDTH, B
from worm3d.solver.arrays import KERNELS


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shares, "BEFORE", 0.1)
    monkeypatch.setattr(shares, "LOOP_S", 1e-5)
    monkeypatch.setattr(lane_bound, "ROUNDS", 1)
    monkeypatch.setattr(lane_bound, "WORMS", (2,))


@pytest.mark.parametrize("worms", [2, 4, 8])
def test_systems_side_by_side_are_each_solved(worms: int) -> None:
    rng, n = np.random.default_rng(3), 23
    matrices = [rng.normal(size=(n, n)) + 20.0 * np.eye(n) for _ in range(worms)]
    bands = np.zeros((worms, n + B, WIDTH))
    for matrix, band in zip(matrices, bands, strict=True):
        matrix[np.abs(np.subtract.outer(np.arange(n), np.arange(n))) > B] = 0.0
        for i in range(n):
            columns = np.arange(max(0, i - B), min(n, i + B + 1))
            band[i, B + columns - i] = matrix[i, columns]
    b, x = rng.normal(size=(n, worms)), np.zeros((n + 2 * B, worms))
    systems = lane_elimination.side_by_side(bands)
    factors = np.zeros_like(systems)
    for renew in (True, False):
        lane_elimination.elimination(worms)(systems, b, x, factors, renew, 2)
        for w in range(worms):
            assert_allclose(x[B : B + n, w], np.linalg.solve(matrices[w], b[:, w]), rtol=1e-12, atol=1e-14)
        x[B : B + n] = 0.0


@pytest.mark.usefixtures("quick")
def test_each_loop_runs_the_kernels_that_are_said() -> None:
    bed, ran = Bed(3), Counter[str]()
    kind = ctypes.CFUNCTYPE(ctypes.c_int64, *[ctypes.c_int64] * 7)
    table, kept = bed.plant.memory_of_core.kernels, []

    def counting(name: str, address: int) -> int:
        original = kind(address)

        def call(*arguments: int) -> int:
            ran[name] += 1
            return int(original(*arguments))

        kept.append(kind(call))
        found = ctypes.cast(kept[-1], ctypes.c_void_p).value
        assert found is not None
        return found

    bed.us(bed.loops()["whole"])
    for k, name in enumerate(itertools.takewhile(lambda name: name != "evaluate", KERNELS)):
        table[k] = counting(name, int(table[k]))
    for name, loop in bed.loops().items():
        if name in lane_bound.KERNELS_OF:
            ran.clear()
            loop(5)
            expected = Counter(5 * lane_bound.KERNELS_OF[name])
            if name == "exchanged":  # of one vector of contacts, the derivatives of its points being kept
                expected += Counter(point_stiffness=5, segment_jacobian=1)
            assert ran == expected, name


def test_in_lock_step_all_do_what_one_needs() -> None:
    def run(jacobians: list[int], residuals: list[int], breakaways: list[int]) -> SimpleNamespace:
        named = {"newton_iterations": jacobians, "gradient_evaluations": residuals, "breakaways": breakaways}
        return SimpleNamespace(**{name: np.array(counts) for name, counts in named.items()})

    runs = [run([1, 2], [5, 1], [0, 0]), run([3, 1], [1, 1], [0, 1]), run([1, 1], [1, 1], [0, 0])] * 2
    assert_allclose(list(vars(in_lock_step(runs, 1)).values()), [1.0 + 1.0 / 6.0, 1.5, 10.0 / 6.0])
    together = in_lock_step(runs[:2], 2)
    assert_allclose([together.solves, together.jacobians, together.residuals], [1.5, 2.5, 4.5 - 2.5])


def test_at_their_own_pace_all_do_what_one_needs() -> None:
    us = dict.fromkeys(lane_bound.KERNELS_OF, 1.0) | {"factorise": 1.0, "refactorise": 1.0, "solve": 0.0}
    alone = lane_bound._own_pace(us, Counts(1.0, 2.0, 3.0), 1)
    assert_allclose(list(alone.values()), [5.0, 2.0, 6.0, 2.0, 1.0, 1.0])
    beside = lane_bound._own_pace(us, Counts(1.0, 2.0, 3.0), 2)
    turns, jacobians = 5.0 * (1.0 - 0.8**2), 5.0 * (1.0 - 0.6**2)
    assert_allclose(list(beside.values()), [5.0, jacobians, 5.0 + turns, 2.0 * turns, turns, turns])


def test_the_rest_of_a_loop_is_shared_by_the_lanes() -> None:
    names = {kernel for run in lane_bound.KERNELS_OF.values() for kernel in run}
    alone = dict.fromkeys(names, 1.0) | dict.fromkeys(lane_bound.KERNELS_OF, 9.0)
    alone |= {"factorise": 8.0, "refactorise": 4.0}
    side = dict.fromkeys(names, 0.5) | {"factorise": 3.0, "solve": 1.0}
    filled = lane_bound._filled(alone, side, 4)
    assert filled["expect"] == 0.5 + 8.0 / 4.0
    assert filled["end"] == 9.0 / 4.0
    assert (filled["factorise"], filled["refactorise"], filled["solve"]) == (3.0, 1.5, 1.0)


def study() -> LaneStudy:
    now = {"kernels": 20.0, "other": 10.0}
    bounds = tuple(Bound(scheme, 2, {"kernels": 10.0, "other": 5.0}, 2.0, 1.8) for scheme in ("a b", "c"))
    counts = {1: Counts(1.0, 2.0, 3.0), 2: Counts(1.0, 4.0, 3.5)}
    return LaneStudy(Throughput(2, 6, 1, 1.0, 3.0, 2.5, 80.0, 1.2, 1.0, True), 2.0, counts, now, {}, bounds)


def test_what_a_step_may_cost_follows_from_the_bar() -> None:
    assert_allclose(study().allowed(1.5), (3.0 / 1.5 - 0.5) / 2.0)
    assert "a step may cost 0.75 of what it does" in lanes.sentence(study())
    axes = lane_figure.draw(study(), 1.5).axes[0]
    assert_allclose(axes.lines[0].get_ydata(), 0.75 * 30.0)
    assert_allclose([bar.get_height() for bar in axes.patches], [20.0, 10.0, 10.0, 10.0, 5.0, 5.0])


@pytest.mark.usefixtures("quick")
def test_the_command_writes_a_table_and_a_figure(tmp_path: Path) -> None:
    command = ["--out", str(tmp_path / "out"), "--runs", "2", "--duration", "0.1", "--repeats", "1"]
    done = CliRunner().invoke(lanes.app, command)
    assert done.exit_code == 0
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"lanes.md", "lanes.png"}
    rows = [line.split()[:3] for line in done.output.splitlines()]
    assert [row[0] for row in rows[:5]] == ["scheme", "as", "no", "lock-step", "own"]
    again = CliRunner().invoke(lanes.app, command)
    assert (again.exit_code, "is not empty" in again.output) == (2, True)
