"""A worm that falls on its world: the impact is inelastic, whatever integrator and time step."""

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from control.gaits import TravellingWave
from worm3d import Friction, Plane, Result, State, Status, Worm, simulate
from worm3d.physics.friction import ContactConstants

HEIGHT = 0.2
INTEGRATORS = ("bdf2", "implicit_euler")


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


def fall(integrator: str, dt: float, height: float = 0.3, speed: float = 0.0, **changes: Any) -> Result:
    """Drop a worm that moves along x, and wait until it lies still."""
    worm, ground = changes.pop("worm", Worm()), changes.pop("ground", Friction())
    start = State.straight(worm, Plane(), (0.0, 0.0, height))
    start = start.with_changes(joint_velocity=np.tile([speed, 0.0, 0.0], (worm.segments + 1, 1)))
    given = {"duration": 0.6, "settle_first": False} | changes
    result = simulate(worm, Plane(), ground, dt=dt, integrator=integrator, state=start, **given)  # type: ignore[arg-type]
    assert result.status is Status.DONE
    return result


def lost(result: Result) -> float:
    """Return what has gone of the kinetic energy and the potential energy [J]."""
    return -float(result.energy.kinetic.sum() + result.energy.potential.sum())


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("speed", [0.0, 1.0])
def test_what_a_landing_takes_is_no_numerical_loss(speed: float, integrator: str) -> None:
    """0.3 J: of a fall from 0.3 m the integrator's part is below 5 % at 10 ms, straight down or thrown."""
    result = fall(integrator, 0.01, speed=speed)
    energy = result.energy
    assert lost(result) > 0.29
    assert abs(energy.numerical_loss.sum()) < 0.05 * lost(result)
    assert energy.impact.sum() > 0.8 * lost(result)
    assert energy.balance_error < 1e-12
    aloft = result.points[:, :, :6, 2].min(axis=(1, 2)) > 0.0
    assert aloft.sum() > 20
    assert not energy.impact[aloft].any(), "nothing in flight"


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_the_loss_at_landing_tends_to_that_of_resolved_contacts(integrator: str) -> None:
    """With 0.1 ms contacts give way by steps: it is then the loss in their dampers."""
    losses = np.array([fall(integrator, dt).energy.impact.sum() for dt in (0.01, 5e-3, 2e-3, 1e-3, 5e-4, 1e-4)])
    errors = np.abs(losses / losses[-1] - 1.0)[:-1]
    assert errors[0] < 0.1
    assert errors[-1] < 0.03
    assert (errors[2:] < errors[:-2]).all()


def test_impact_is_half_the_impulse_times_the_velocities_before_and_after() -> None:
    """Implicit Euler, no friction: the impact follows from the recorded places and forces alone."""
    worm, dt, ground = Worm(actuator_lag=0.0), 0.01, Friction(1e-9, 1e-9, 1e-9)
    result = fall("implicit_euler", dt, worm=worm, ground=ground)
    height, force = result.points[..., 2], result.contact_force[1:, ..., 2]
    speed = np.diff(height, axis=0, prepend=height[:1]) / dt
    impulses = -(force * dt * (speed[1:] + speed[:-1]) / 2).sum(axis=(1, 2))
    (stiffness,) = set(ContactConstants.of(worm, ground, 9.81).stiffness.tolist())
    stored = np.diff((stiffness / 2 * np.maximum(0.0, -height) ** 2).sum(axis=(1, 2)))
    fallen = result.com_velocity[:, 2]
    carried = worm.mass * 9.81 * dt * (fallen[1:] - fallen[:-1]) / 2
    expected = impulses - stored - carried
    first = int(np.argmax(force.max(axis=(1, 2)) > 1e-9))
    assert expected[first] > 0.2
    assert_allclose(
        result.energy.impact[first + 1], expected[first], rtol=2e-3
    )  # points move on arcs, forces act on tangents


def test_a_body_that_slides_at_landing_loses_by_friction_what_its_impulse_takes() -> None:
    """A stiff worm thrown flat: friction's impulse at landing is no integrator's error either."""
    worm = Worm(k_spring=2e3, kelvin_voigt_time=0.005)
    result = fall("implicit_euler", 0.002, speed=2.0, worm=worm, ground=Friction(0.1, 0.1, 0.1), duration=0.4)
    energy = result.energy
    horizontal = worm.mass / 2 * (4.0 - result.com_velocity[-1, 0] ** 2)
    assert horizontal > 0.03
    assert abs(energy.numerical_loss.sum()) < 0.03 * lost(result)


@pytest.mark.parametrize("height", [0.005, 0.02, 0.1])
def test_what_a_landing_takes_does_not_depend_on_the_step(height: float) -> None:
    """Also where steps of BDF2 resolve the landing: of the energy of the fall, down to 0.05 ms."""
    runs = {dt: fall("bdf2", dt, height, duration=0.3) for dt in (0.01, 1e-3, 5e-4, 2.5e-4, 5e-5)}
    impact = {dt: float(run.energy.impact.sum()) / lost(run) for dt, run in runs.items()}
    numerical = {dt: float(run.energy.numerical_loss.sum()) / lost(run) for dt, run in runs.items()}
    for dt, within in {1e-3: 0.03, 5e-4: 0.02, 2.5e-4: 0.01}.items():
        assert abs(impact[dt] - impact[5e-5]) < within
        assert abs(numerical[dt]) < 0.01
    assert all(0.0 < share < 1.0 for share in impact.values())
    assert abs(numerical[0.01]) < 0.12


def test_in_a_crawl_impact_and_numerical_loss_have_limits_of_their_own() -> None:
    """Numerical loss vanishes; impact comes to half a percent of the work."""
    uses = {}
    for dt in (2e-3, 5e-4, 1e-4):
        run = simulate(Worm(), Plane(), actuation=TravellingWave(), duration=4.0, dt=dt, record_every=round(0.02 / dt))
        uses[dt] = {name: part / run.energy.work_contract.sum() for name, part in run.energy.uses.items()}
    assert abs(uses[2e-3]["numerical"]) < 5e-3
    assert abs(uses[5e-4]["numerical"]) < 1e-3
    assert abs(uses[1e-4]["numerical"]) < min(3e-4, 0.5 * abs(uses[5e-4]["numerical"]))
    assert abs(uses[5e-4]["impact"] - uses[1e-4]["impact"]) < 2e-3
    assert 0.003 < uses[1e-4]["impact"] < 0.006


@pytest.mark.parametrize(
    ("worm", "gait", "ground"),
    [
        (
            Worm(segments=3, k_spring=68.6, mass=0.128),
            TravellingWave(amplitude=0.174, period=1.63),
            Friction(0.68, 0.077, 0.5),
        ),
        (
            Worm(segments=4, k_spring=12.6, mass=0.055),
            TravellingWave(amplitude=0.233, period=1.58),
            Friction(0.85, 0.053, 0.5),
        ),
    ],
)
def test_feet_that_bear_much_do_not_strike(worm: Worm, gait: TravellingWave, ground: Friction) -> None:
    """They lie deeper than at rest all the time; short steps are of second order nevertheless."""

    def end(integrator: str, dt: float) -> Any:
        every = round(2.0**-4 / dt)
        given = {"actuation": gait, "duration": 0.5, "record_every": every, "integrator": integrator}
        return simulate(worm, Plane(), ground, dt=dt, **given).joints[-1]  # type: ignore[arg-type]

    right = end("bdf2", 2.0**-14)
    bdf2, euler = (np.abs(end(integrator, 2.0**-11) - right).max() for integrator in INTEGRATORS)
    assert bdf2 < 0.1 * euler
