"""Worms of all kinds finish or stop with a name: the study `random_worms.py`, and a part of it with uneven worms."""

import numpy as np
import pytest
import random_worms as study

import worm3d
from worm3d import Status

NAMES = {status.name for status in Status} | {"LIMIT_POINT"}
PART = 8
"""Worms that one test takes."""


@pytest.mark.parametrize("part", range(3))
@pytest.mark.parametrize("kind", ["uneven"])
def test_random_worms_end_with_a_name(kind: str, part: int) -> None:
    """No hang, no NaN; nearly all that the guards admit finish with every step converged and hardly sink in."""
    outcomes = [study.outcome(study.case(4, index, kind)) for index in range(PART * part, PART * (part + 1))]
    admitted = [one for one in outcomes if not one.refused]
    for one in outcomes:
        assert one.end in NAMES - {"NOT_FINITE", "INTERRUPTED", "BAD_COMMAND"}, one
        assert one.finite, one
        assert one.balance_error < 1e-6, one
        assert one.penetration < 0.02, one
        assert one.mean_iterations < 150.0, one  # the most that one of them takes is 56
    assert len(admitted) >= PART // 2
    assert sum(one.good for one in admitted) >= len(admitted) - 2, outcomes
    assert sum(one.end == "NO_CONVERGENCE" for one in admitted) == 0, outcomes


@pytest.mark.slow
def test_a_hundred_random_worms() -> None:
    """Half of the study: 97 % of those that the guards admit are good to 1e-3 of a segment length; few are refused."""
    outcomes = [study.outcome(study.case(4, index)) for index in range(100)]
    assert all(one.finite and one.end in NAMES for one in outcomes)
    assert sum(one.end == "NO_CONVERGENCE" for one in outcomes) == 0
    admitted = [one for one in outcomes if not one.refused]
    assert len(outcomes) - len(admitted) < 0.15 * len(outcomes)
    assert sum(one.good for one in admitted) >= 0.97 * len(admitted)


def test_a_case_is_always_the_same() -> None:
    one, same, other = study.case(4, 3), study.case(4, 3), study.case(4, 4)
    assert one.sentence == same.sentence != other.sentence
    runs = [study.simulate(each, 0.2) for each in (one, same)]
    np.testing.assert_array_equal(runs[0].joints, runs[1].joints)


@pytest.mark.parametrize("k_torsion", [1.0, 1e2, 1e4, 1e6])
def test_high_torsional_stiffness_costs_iterations_at_most(k_torsion: float) -> None:
    """The paper's section IV.C: "destabilizes the Newton iterations". Here no step is even halved."""
    worm = worm3d.Worm(k_torsion=k_torsion, k_yaw=k_torsion, k_twist=k_torsion)
    gait = study.TravellingWave(amplitude=0.2)
    run = worm3d.simulate(worm, worm3d.Plane(), actuation=gait, duration=4.0)
    assert run.status is Status.DONE
    assert run.halved_steps == 0
    assert run.newton_iterations.mean() < 25


@pytest.mark.parametrize("fraction", [0.0, 1.0])
def test_all_mass_on_the_joints_or_on_the_apexes_runs(fraction: float) -> None:
    """Section IV.C: "concentrating mass at nodes leads to unstable collapsed states". Here it does not."""
    worm = worm3d.Worm(joint_mass_fraction=fraction)
    run = worm3d.simulate(worm, worm3d.Plane(), actuation=study.TravellingWave(), duration=6.0)
    assert run.status is Status.DONE
    assert run.distance > 0.1
    assert run.energy.balance_error < 1e-9


@pytest.mark.parametrize("dt", [0.001, 0.003, 0.01, 0.02, 0.05])
def test_the_default_worm_runs_at_any_step(dt: float) -> None:
    gait = study.TravellingWave(amplitude=0.3, bias=0.3, hinge=0.3)
    run = worm3d.simulate(worm3d.Worm(), worm3d.Plane(), actuation=gait, duration=4.0, dt=dt)
    assert run.status is Status.DONE
    assert run.halved_steps == 0
    depth = -run.world.distance(run.points).min()
    assert depth < 1e-3 * run.worm.l0
    assert run.energy.balance_error < 1e-9
