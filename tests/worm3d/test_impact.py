"""A worm that falls on its world: the impact is inelastic, whatever integrator and time step."""

import numpy as np
import pytest

from worm3d import Friction, Plane, Result, State, Status, Worm, simulate

HEIGHT = 0.2


def dropped(integrator: str, dt: float) -> Result:
    start = State.straight(Worm(), Plane(), (0.0, 0.0, HEIGHT))
    result = simulate(Worm(), Plane(), state=start, duration=0.4, dt=dt, integrator=integrator, settle_first=False)  # type: ignore[arg-type]
    assert result.status is Status.DONE
    return result


@pytest.mark.parametrize("dt", [0.02, 0.01, 0.004, 0.001])
def test_bdf2_does_not_throw_the_worm_back(dt: float) -> None:
    """It extrapolates velocities: left to itself it returns a third to a half of the velocity of an impact."""
    result, landed = dropped("bdf2", dt), np.sqrt(2.0 * HEIGHT / 9.81)
    after = result.time > landed + 0.02
    lowest = result.points[after][:, :, [0, 3], 2]
    assert lowest.max() < 2e-3, "a bounce with a third of the velocity would be 22 mm high"
    np.testing.assert_allclose(result.com[-1, 2], dropped("implicit_euler", dt).com[-1, 2], rtol=0, atol=1e-4)
    assert result.energy.balance_error < 1e-10


@pytest.mark.parametrize("integrator", ["bdf2", "implicit_euler"])
def test_contact_forces_and_weight_are_the_change_of_momentum(integrator: str) -> None:
    """With implicit Euler to rounding in every step, impact and all; with BDF2 in the steps of its own formula."""
    worm, dt = Worm(actuator_lag=0.0), 0.01
    start = State.straight(worm, Plane(), (0.0, 0.0, 0.02))
    run = simulate(
        worm,
        Plane(),
        Friction(),
        state=start,
        duration=0.3,
        dt=dt,
        integrator=integrator,
        settle_first=False,  # type: ignore[arg-type]
    )
    force = run.contact_force.sum(axis=(1, 2))[1:] + worm.mass * np.array([0.0, 0.0, -9.81])
    p = run.momentum
    if integrator == "implicit_euler":
        np.testing.assert_allclose(np.diff(p, axis=0) / dt, force, rtol=0, atol=1e-8)
    else:
        bdf2 = (1.5 * p[2:] - 2.0 * p[1:-1] + 0.5 * p[:-2]) / dt
        far = np.abs(force[1:] - bdf2).max(axis=1) > 1e-8
        assert 1 <= far.sum() <= 4, "the first step's history, and impacts"
        assert not far[run.time[2:] > 0.15].any()
    touching = run.contact_force[..., 2] > 0.0
    np.testing.assert_allclose(
        run.contact_force[:, :, :6, 2][touching[:, :, :6]], run.normal_load[touching[:, :, :6]], rtol=1e-9, atol=1e-9
    )
