"""A pipe's kernel keeps each point's piece from call to call: that may change its time, never what it says."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import worm3d
from control.gaits import TravellingWave
from worm3d import Bend, Centreline, Patch, Pipe, Profile, Straight, Worm
from worm3d.machine.codegen import evaluate
from worm3d.values.arrays import FloatArray
from worm3d.worlds import kernels, pipe_table
from worm3d.worlds.kernels import WorldKernel

TURN = np.linspace(0.0, 8.0 * np.pi, 80)
COIL = Centreline.through(np.column_stack([2.0 * np.cos(TURN), 2.0 * np.sin(TURN), 0.1 / 2.0 / np.pi * TURN]))
SPLINE = Centreline.through([(0.0, 0.0, 0.0), (0.5, 0.0, 0.1), (1.0, 0.4, 0.0), (1.2, 1.0, 0.3)])
LEGS = Centreline.of([Straight(1.0), Bend(np.pi / 2, 0.3), Straight(0.6), Bend(1.0, 0.4, "up"), Straight(1.5)])
CROSSING = Centreline.of([piece for _ in range(6) for piece in (Straight(0.3), Bend(1.2, 0.4))])
GRIPS = (Patch(0.2, along=(0.3, 0.7)), Patch(0.0, along=(0.9, 1.2)))
PIPES = {
    "spline": Pipe(SPLINE, 0.1),
    "coil": Pipe(COIL, 0.04),
    "crossing": Pipe(CROSSING, 0.1),
    "legs": Pipe(LEGS, Profile([0.1, 0.3, 0.5], [0.1, 0.08, 0.12]), GRIPS, start_wall=True, end_wall=True),
}
LANES = 64


def laid_out(kernel: WorldKernel) -> FloatArray:
    """Inputs of a kernel that has not been asked yet."""
    inputs = np.zeros((3 + len(kernel.parameters), LANES))
    inputs[3:] = kernel.parameters[:, None]
    return inputs


def asked(kernel: WorldKernel, inputs: FloatArray, points: FloatArray) -> FloatArray:
    """What the kernel says of points with these inputs, with what has been kept in them."""
    outputs = np.full((kernels.WORLD_ROWS, LANES), 7.0)
    inputs[:3, : len(points)] = points.T
    evaluate(kernel.address, inputs, outputs, len(points))
    return outputs[:, : len(points)]


def scattered(line: Centreline, rng: np.random.Generator) -> FloatArray:
    """Points near to a line, far away from it, on planes where pieces begin, repeated, and some that are no numbers."""
    points = line.at(rng.uniform(-0.5, line.total + 0.5, LANES))[0] + rng.normal(0.0, 0.04, (LANES, 3))
    points[:8] += rng.normal(0.0, 3.0, (8, 3))
    points[8:16] = line.start[rng.integers(0, len(line.start), 8)]
    points[20:24] = points[19]
    points[rng.integers(24, LANES), rng.integers(0, 3)] = np.nan
    return points


@pytest.mark.parametrize("name", PIPES)
def test_points_that_jump_get_what_they_get_with_nothing_kept(name: str) -> None:
    pipe, rng = PIPES[name], np.random.default_rng(4)
    kernel = pipe.kernel()
    inputs, last, used = laid_out(kernel), -pipe_table.TABLE_ROWS, set()
    for _ in range(50):
        points = scattered(pipe.centreline, rng)
        first = asked(kernel, laid_out(kernel), points)
        assert_array_equal(asked(kernel, inputs, points), first)
        assert_array_equal(asked(kernel, inputs, points), first, err_msg="and once more")
        assert_array_equal(np.isnan(first[0]), np.isnan(points).any(axis=1))
        assert not np.signbit(first[-1]).any(), "what marks a point in question is taken away"
        used |= set(inputs[last])
    assert len(used - {pipe_table.NO_PIECE}) > 0.8 * len(pipe._pieces()), "points have been on most pieces"


@pytest.mark.parametrize("name", PIPES)
def test_points_that_creep_get_what_they_get_with_nothing_kept(name: str) -> None:
    """Along the pipe, from piece to piece: most keep theirs from call to call, and some change it."""
    pipe, rng = PIPES[name], np.random.default_rng(5)
    kernel, away = pipe.kernel(), rng.normal(0.0, 0.02, (LANES, 3))
    inputs, places, changed = laid_out(kernel), rng.uniform(0.0, 0.9 * pipe.centreline.total, LANES), 0
    before = np.full(LANES, pipe_table.NO_PIECE)
    for step in range(200):
        points = pipe.centreline.at(places + 5e-4 * step)[0] + away
        assert_array_equal(asked(kernel, inputs, points), asked(kernel, laid_out(kernel), points))
        kept = inputs[-pipe_table.TABLE_ROWS].copy()
        changed += step > 0 and (kept != before).sum()
        before = kept
    assert 0 < changed < 0.1 * 200 * LANES


@pytest.mark.parametrize("count", [1, 5, 8, 61])
def test_so_many_points_as_one_after_the_other(count: int) -> None:
    pipe = PIPES["spline"]
    points = scattered(SPLINE, np.random.default_rng(6))[:count]
    each = [kernels.looked_up(pipe.kernel(), point) for point in points]
    assert_array_equal(asked(kernel := pipe.kernel(), laid_out(kernel), points), np.array(each).T)


def test_a_piece_at_a_time_says_what_the_whole_formula_says() -> None:
    """Which compares all pieces at each point."""
    pipe, rng = PIPES["legs"], np.random.default_rng(7)
    kernel, formula = pipe.kernel(), pipe.symbolic()
    assert formula is not None
    whole, inputs = kernels.compiled(*formula), laid_out(kernel)
    assert len(whole.parameters) > len(kernel.parameters), "it is the other kernel"
    for _ in range(50):
        s = rng.uniform(-0.2, LEGS.total + 0.2, LANES)
        points = LEGS.at(s)[0] + rng.normal(0.0, 0.05, (LANES, 3))
        assert_allclose(asked(kernel, inputs, points), kernels.looked_up(whole, points), rtol=0, atol=1e-10)


def test_worms_in_one_pipe_do_not_share_what_is_kept() -> None:
    """In threads side by side, at different places: bit for bit the runs of each alone."""
    line = Centreline.through(np.column_stack([4.0 * TURN / TURN[-1], 0.3 * np.sin(TURN / 4.0), 0.0 * TURN]))
    pipe = Pipe(line, 0.12)
    gaits = [TravellingWave(amplitude=amplitude) for amplitude in (0.1, 0.2, 0.3, 0.35)]
    alone = [worm3d.simulate(Worm(), pipe, actuation=gait, duration=2.0) for gait in gaits]
    beside = worm3d.simulate_batch(Worm(), pipe, actuation=gaits, duration=2.0, threads=4)
    for one, other in zip(alone, beside, strict=True):
        assert_array_equal(other.joints, one.joints)
        assert_array_equal(other.normal_load, one.normal_load)
    assert len({run.joints[-1].tobytes() for run in alone}) == len(gaits)
