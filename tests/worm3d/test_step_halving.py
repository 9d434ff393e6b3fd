"""Steps that do not converge are taken in parts: forced here, by denying convergence to steps of one's choice."""

import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from control.gaits import TravellingWave
from worm3d import Actuator, Command, FirstOrder, Plane, Pneumatic, Result, State, Status, Worm, simulate
from worm3d.recorded.energy import LOST_ENERGY, STORED_ENERGY, SUPPLIED_ENERGY
from worm3d.running.run import MAX_HALVINGS, NEVER
from worm3d.solver.guard import NO_CONVERGENCE, OK

N = 6
Deny = Callable[[set[int], float], None]


@pytest.fixture
def deny(monkeypatch: pytest.MonkeyPatch) -> Deny:
    """Return a function that lets the given steps fail until their parts are no longer than some time."""
    module = sys.modules["worm3d.running.run"]
    real = module.advance

    def install(steps: set[int], longest: float) -> None:
        def stubborn(core, records, counters, commands, external, first, *others):
            every, dt = others[:2]
            if every == NEVER:
                if dt > longest:
                    return 0, NO_CONVERGENCE
                return real(core, records, counters, commands, external, first, *others)
            good = next((k for k in range(len(commands)) if first + k in steps), len(commands))
            done, end = 0, OK
            if good > 0:
                done, end = real(core, records, counters, commands[:good], external[: good + 1], first, *others)
            return (done, end) if end != OK or good == len(commands) else (done, NO_CONVERGENCE)

        monkeypatch.setattr(module, "advance", stubborn)

    return install


def smooth(t: float) -> Command:
    wave = 0.1 * np.sin(np.pi * t / 0.4) ** 2 * np.sin(np.arange(N))
    return Command(np.column_stack([1.4 * wave, 0.6 * wave]), hinge=wave[1:])


def push(t: float) -> np.ndarray:
    return 0.02 * np.sin(7 * t) * np.linspace(-1, 1, N + 1)[:, None] * [0.0, 1.0, 1.0]


def fly(dt: float, actuator: Actuator) -> Result:
    state = State.straight(Worm(), position=(0.0, 0.0, 5.0)).with_changes(roll_rate=1.0)
    worm = Worm(k_torsion=0.5, actuator=actuator)
    return simulate(worm, None, actuation=smooth, duration=0.4, dt=dt, state=state, external_force=push)


@pytest.mark.parametrize(
    ("parts", "actuator"), [(2, FirstOrder()), (4, FirstOrder()), (64, FirstOrder()), (4, Pneumatic())]
)
def test_a_run_with_some_halved_steps_converges_at_the_order_of_the_integrator(
    deny: Deny, parts: int, actuator: Actuator
) -> None:
    """Two steps of a run, wherever they are, by implicit Euler: each costs an error of order 2 once, as the first does.

    BDF2 goes on from them with the past of a whole step.
    """
    true = fly(1.25e-4, actuator).joints[-1]
    errors = []
    for dt in (2e-3, 1e-3, 5e-4):
        deny({round(0.1 / dt), round(0.25 / dt)}, 1.01 * dt / parts)
        result = fly(dt, actuator)
        assert result.status is Status.DONE
        assert result.halved_steps == 2
        errors.append(np.abs(result.joints[-1] - true).max())
    assert_allclose(np.log2(np.array(errors[:-1]) / errors[1:]), 2.0, atol=0.25)
    assert errors[-1] < 2e-5


@pytest.mark.parametrize("integrator", ["bdf2", "implicit_euler"])
def test_ledger_and_rows_do_not_notice(deny: Deny, integrator: str) -> None:
    arguments: dict[str, Any] = {"actuation": TravellingWave(amplitude=0.3, bias=0.3, hinge=0.5), "duration": 1.2}
    plain = simulate(Worm(), Plane(0.1), integrator=integrator, **arguments)
    deny({0, 3, 50, 51, 52, 119}, 0.003)
    result = simulate(Worm(), Plane(0.1), integrator=integrator, record_every=4, **arguments)
    assert result.status is Status.DONE
    assert result.halved_steps == 6
    assert_allclose(result.time, plain.time[::4], rtol=0, atol=1e-14)
    terms = np.sum(
        [np.abs(getattr(result.energy, name)) for name in (*SUPPLIED_ENERGY, *STORED_ENERGY, *LOST_ENERGY)], axis=0
    )[1:]
    assert (np.abs(result.energy.residual[1:]) < 1e-9 * terms).all()
    assert_allclose(result.contraction, plain.contraction[::4], rtol=0, atol=2e-4)  # parts follow the command closer
    moved = np.abs(plain.joints[-1] - plain.joints[0]).max()
    assert np.abs(result.joints[-1] - plain.joints[-1]).max() < 0.05 * moved
    assert (result.newton_iterations[[0, 3, 50, 51, 52, 119]] >= 2).all()


def test_a_step_that_never_converges_ends_the_run_with_its_name(deny: Deny) -> None:
    deny({30}, 0.01 / 2**MAX_HALVINGS / 2)
    result = simulate(Worm(), Plane(), actuation=TravellingWave(), duration=1.0)
    assert result.status is Status.NO_CONVERGENCE
    assert result.stop.step == 31
    assert "step 31, t = 0.31 s" in result.stop.sentence
    assert len(result.time) == 31
    plain = simulate(Worm(), Plane(), actuation=TravellingWave(), duration=0.3)
    assert_array_equal(result.joints, plain.joints)


def test_final_state_of_a_failed_run_is_its_last_row() -> None:
    """Whatever the step was that could not be kept, `Result.state` is where the kept ones end."""

    def fold(t: float) -> Command:
        return Command(np.zeros((N, 2)), hinge=3.0 * t)

    result = simulate(Worm(), Plane(), actuation=fold, duration=2.0)
    assert result.status in (Status.FOLDED, Status.FLATTENED)
    assert_array_equal(result.state.joints, result.joints[-1])
    assert_array_equal(result.state.bend, result.bend[-1])


def test_a_force_that_fails_between_steps_is_named(deny: Deny) -> None:
    """Parts of a step ask for forces at times of their own."""

    def force(t: float) -> np.ndarray:
        on_time = abs(t / 0.01 - round(t / 0.01)) < 1e-6
        return np.zeros((N + 1, 3)) if on_time else np.full((N + 1, 3), np.nan)

    deny({10}, 0.006)
    result = simulate(Worm(), Plane(), duration=0.3, external_force=force)
    assert result.status is Status.BAD_COMMAND
    assert len(result.time) == 11
