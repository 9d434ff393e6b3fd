"""Fallback of Newton's method: normal loads are updated, and relaxed where full updates go round in a circle."""

import numpy as np
import pytest

from control.gaits import TravellingWave
from worm3d import Bend, Centreline, Friction, Pipe, Plane, Result, Status, Straight, Worm, simulate

BENT = Centreline.of([Straight(0.3), Bend(1.5, 0.48), Straight(3.0)])


def harsh(seed: int, case: int) -> Result:
    """Take 100 steps of a random quick gait with much friction, on a steep slope, level ground or in a tight pipe."""
    rng = np.random.default_rng([seed, case])
    mu = np.minimum(10 ** rng.uniform(-1, 0.7, 3), 5)
    ground = Friction(*mu, static_ratio=rng.uniform(1, 2))
    kind = rng.integers(3)
    slope, pipe = Plane(rng.uniform(0, 0.5), rng.uniform(-3, 3)), Pipe(BENT, rng.uniform(0.08, 0.12))
    worm = Worm(k_yaw=rng.uniform(0.05, 1), k_torsion=rng.uniform(0.5, 10))
    amplitude, bias, hinge, period = rng.uniform(0.1, 0.4), *rng.uniform(-1, 1, 2), rng.uniform(0.3, 2)
    gait = TravellingWave(amplitude=amplitude, bias=bias, hinge=hinge, period=period)
    dt = float(rng.choice([0.01, 0.03, 0.003]))
    return simulate(worm, (slope, pipe, Plane())[kind], ground, gait, duration=100 * dt, dt=dt)


@pytest.mark.parametrize(("seed", "case"), [(1, 10), (1, 44), (2, 28)])
def test_relaxed_loads_solve_what_full_updates_do_not(seed: int, case: int) -> None:
    """With full updates alone, without relaxation, each of these runs halves a step."""
    run = harsh(seed, case)
    assert run.status is Status.DONE
    assert run.fallbacks.sum() > 30
    assert run.halved_steps == 0
    assert run.energy.balance_error < 1e-9
