"""Actuators: first-order lag, rate and stroke limits, and what a chamber force does, against closed forms."""

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import worm3d
from worm3d import Command, Held, Worm

SIZES = np.array([[0.3, 0.1], [0.0, -0.05], [0.2, 0.2]])


def floating(actuation: Any, duration: float, dt: float = 0.01, **worm: Any) -> worm3d.Result:
    """Run three segments without weight or world."""
    body = {"segments": 3, "length": 0.5} | worm
    return worm3d.simulate(Worm(**body), None, actuation=actuation, duration=duration, dt=dt, gravity=(0, 0, 0))


@pytest.mark.parametrize("dt", [0.05, 0.01])
def test_the_lag_answers_a_step_like_a_first_order_system(dt: float) -> None:
    """c(t) = c0 (1 - exp(-t/lag)) at every instant, whatever the time step; likewise hinges and forces."""
    still = Command(SIZES, hinge=[0.2, -0.1], force=[[0.1, 0.0], [0.0, 0.0], [-0.05, 0.02]])
    run = floating(lambda t: still, 0.5, dt, actuator_lag=0.1)
    rise = (1.0 - np.exp(-run.time / 0.1))[:, None]
    assert_allclose(run.contraction, rise[..., None] * SIZES, rtol=0, atol=1e-14)
    assert_allclose(run.hinge, rise * [0.2, -0.1], rtol=0, atol=1e-14)
    assert_allclose(run.force, rise[..., None] * still.force, rtol=0, atol=1e-14)
    assert_array_equal(run.command, np.broadcast_to(SIZES, run.command.shape))


@pytest.mark.parametrize("dt", [0.05, 0.01])
def test_the_lag_answers_a_ramp_like_a_first_order_system(dt: float) -> None:
    """c = r t gives r (t - lag (1 - exp(-t/lag))): it follows late by the lag, exactly for any time step."""
    run = floating(lambda t: Command(SIZES * t), 1.0, dt, actuator_lag=0.1)
    late = run.time - 0.1 * (1.0 - np.exp(-run.time / 0.1))
    assert_allclose(run.contraction, late[:, None, None] * SIZES, rtol=0, atol=1e-14)


def test_without_lag_the_command_is_given_at_once() -> None:
    run = floating(lambda t: Command(SIZES * np.sin(t)), 0.3, actuator_lag=0.0)
    assert_allclose(run.contraction[1:], np.sin(run.time[1:])[:, None, None] * SIZES, rtol=0, atol=1e-15)
    assert_array_equal(run.contraction[0], 0.0)


def test_contraction_is_no_faster_than_the_rate_limit() -> None:
    """|dc/dt| <= rate: towards a constant command c = min(rate t, c0), both ways; the lag comes first."""
    run = floating(lambda t: Command(SIZES), 1.0, actuator_lag=0.0, rate_limit=0.25)
    ramp = np.sign(SIZES) * np.minimum(0.25 * run.time[:, None, None], np.abs(SIZES))
    assert_allclose(run.contraction, ramp, rtol=0, atol=1e-13)
    assert_allclose(
        floating(lambda t: Command(SIZES, hinge=0.5), 0.1, actuator_lag=0.0, rate_limit=0.25).hinge[1:], 0.5
    )
    lagged = floating(lambda t: Command(SIZES), 2.0, actuator_lag=0.1, rate_limit=0.25)
    assert np.abs(np.diff(lagged.contraction, axis=0)).max() <= 0.25 * 0.01 * (1 + 1e-9)
    assert_allclose(lagged.contraction[-1], SIZES, rtol=0, atol=1e-4)
    assert_allclose(lagged.contraction[20, 0, 0], 0.25 * lagged.time[20], rtol=1e-9)


@pytest.mark.parametrize("dt", [0.05, 0.01])
def test_a_chamber_fills_and_vents_with_its_own_time_constants(dt: float) -> None:
    """The contraction approaches 0.3, the greatest, as exp(-t/fill), then 0.1 as exp(-t/vent), exactly."""
    drive = worm3d.FillAndVent(fill=0.1, vent=0.4, greatest=0.3)
    run = floating(lambda t: Command(np.full((3, 2), 0.5 if t < 0.98 else 0.1)), 2.0, dt, actuator=drive)
    up, down = (run.time > 0.0) & (run.time < 0.9), run.time > 1.0 + dt
    assert_allclose(run.contraction[up, 0, 0], 0.3 * (1.0 - np.exp(-run.time[up] / 0.1)), atol=1e-13)
    left = run.contraction[down, 2, 1] - 0.1
    assert_allclose(left[1:], left[:-1] * np.exp(-dt / 0.4), atol=1e-13)
    assert left[0] > 0.14


def test_commands_are_clipped_to_the_stroke() -> None:
    run = floating(lambda t: Command(3.0 * SIZES), 2.0, actuator_lag=0.05, stroke=(-0.1, 0.4))
    clipped = np.clip(3.0 * SIZES, -0.1, 0.4)
    assert_array_equal(run.command[1:], np.broadcast_to(clipped, run.command[1:].shape))
    assert_allclose(run.contraction[-1], clipped, rtol=0, atol=1e-9)
    assert run.contraction.max() <= 0.4


@pytest.mark.parametrize("integrator", ["bdf2", "implicit_euler"])
def test_a_chamber_force_shortens_its_chamber_by_its_closed_form(integrator: str) -> None:
    """dE/dl = F per chamber: (k/2) (l0/l_cmd) (1 - l/l_cmd) = F at rest, so l = l_cmd (1 - 2 F l_cmd/(k l0)).

    One segment, so that nothing couples left and right; positive forces contract.
    """
    k, force, contraction = 20.0, np.array([[1.5, -0.8]]), np.array([[0.1, 0.0]])
    worm = Worm(segments=1, length=0.2, k_spring=k, actuator_lag=0.0)
    run = worm3d.simulate(
        worm,
        None,
        actuation=lambda t: Command(contraction, force=force),
        duration=4.0,
        gravity=(0, 0, 0),
        integrator=integrator,
    )
    commanded = worm.l0 * (1.0 - contraction)
    assert_allclose(run.chamber_length[-1], commanded * (1.0 - 2.0 * force * commanded / (k * worm.l0)), rtol=1e-9)
    assert_allclose(run.bend[-1], (run.chamber_length[-1, 0, 1] - run.chamber_length[-1, 0, 0]) / 2 / 0.03, rtol=1e-12)


def test_a_force_and_an_equal_pull_at_the_ends_cancel() -> None:
    """Chamber forces F left and right hold a pull of 2 F between the ends at the rest length."""
    pull = np.array([[-1.2, 0.0, 0.0], [1.2, 0.0, 0.0]])
    worm = Worm(segments=1, length=0.2, actuator_lag=0.0)
    run = worm3d.simulate(
        worm,
        None,
        actuation=lambda t: Command([[0.0, 0.0]], force=0.6),
        external_force=lambda t: pull,
        duration=1.0,
        gravity=(0, 0, 0),
    )
    assert_allclose(run.chamber_length, worm.l0, rtol=1e-9)
    bare = worm3d.simulate(worm, None, external_force=lambda t: pull, duration=4.0, gravity=(0, 0, 0))
    assert_allclose(bare.chamber_length[-1], worm.l0 * (1.0 + 1.2 / 13.0), rtol=1e-9)


def test_contraction_sets_the_length_at_rest() -> None:
    run = floating(lambda t: Command(SIZES[:, :1] * [1.0, 1.0]), 6.0, actuator_lag=0.1)
    rest = (0.5 / 3) * (1.0 - SIZES[:, :1] * [1.0, 1.0])
    assert_allclose(run.chamber_length[-1], rest, rtol=1e-6)


def test_a_hinge_yaws_the_headward_segment_to_the_left() -> None:
    """With the bends held the angle of segment j to segment j-1 about z becomes the commanded one."""
    angles = np.array([0.1, -0.2, 0.3, 0.0, 0.15])
    still = Command(np.zeros((6, 2)), hinge=angles)
    run = worm3d.simulate(
        Worm(actuator_lag=0.0, k_yaw=5.0),
        None,
        actuation=lambda t: still,
        duration=5.0,
        gravity=(0, 0, 0),
        held=Held(bend=True),
        integrator="implicit_euler",
    )
    edges = np.diff(run.joints[-1], axis=0)
    assert_allclose(np.diff(np.arctan2(edges[:, 1], edges[:, 0])), angles, rtol=0, atol=1e-6)


def test_left_chambers_that_shorten_bend_the_segment_to_the_left() -> None:
    """Bend th > 0 where left is shorter; two free segments then yaw: the headward one to the left."""
    command = Command([[0.2, 0.0], [0.2, 0.0]])
    worm = Worm(segments=2, length=0.3, actuator_lag=0.0, k_yaw=5.0)
    run = worm3d.simulate(worm, None, actuation=lambda t: command, duration=3.0, gravity=(0, 0, 0))
    assert (run.bend[-1] > 0.1).all()
    edges = np.diff(run.joints[-1], axis=0)
    azimuth = np.arctan2(edges[:, 1], edges[:, 0])
    # The yaw strain c.u - sin(th/2 + th/2) vanishes but for the load of the chambers, of order k b^2/k_yaw.
    assert_allclose(azimuth[1] - azimuth[0], run.bend[-1].mean(), rtol=0.02)
