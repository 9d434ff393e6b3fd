"""Media whose resistance follows the shape, (D1), (D2): closed forms, the ledger, resumed runs, files, mistakes."""

from dataclasses import dataclass
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import worm3d
from control.gaits import TravellingWave
from worm3d import Command, Medium, StrainDrag, Worm

GAIT = TravellingWave(period=2.0, amplitude=0.3)


def stiff(segments: int, medium: Medium) -> Worm:
    """Return a light worm that has the shape that it is told."""
    return Worm(
        segments=segments,
        mass=0.01,
        drag=0.5,
        medium=medium,
        k_spring=1e5,
        k_yaw=10.0,
        k_twist=10.0,
        kelvin_voigt_time=0.0,
        actuator_lag=0.0,
    )


def floating(worm: Worm, **given: object) -> worm3d.Result:
    return worm3d.simulate(worm, None, **{"gravity": (0.0, 0.0, 0.0), **given})  # type: ignore[arg-type]


def shaped(contraction: float) -> worm3d.State:
    return worm3d.State.straight(stiff(5, Medium()), None, contraction=np.full((5, 2), contraction))


@pytest.mark.parametrize(("contraction", "gain"), [(0.2, 2.0), (0.2, -3.0), (-0.1, 4.0)])
def test_terminal_speed_is_that_of_the_strained_segments(contraction: float, gain: float) -> None:
    """F = v sum of the segments' resistances, drag/N (1 - gain contraction) each, here with a gain each."""
    gains = gain * np.array([1.0, 0.5, 0.0, 1.0, 0.25])
    resistance = 0.5 / 5 * np.sum(1.0 - gains * contraction)
    force = np.zeros((6, 3))
    force[:, 0] = 0.01
    run = floating(
        stiff(5, StrainDrag(gain=gains)),
        actuation=lambda t: Command(np.full((5, 2), contraction)),
        external_force=lambda t: force,
        state=shaped(contraction),
        duration=2.0,
    )
    assert_allclose(run.joint_velocity[-1, :, 0], 0.06 / resistance, rtol=1e-5)


def test_a_factor_below_zero_counts_as_none() -> None:
    """Without resistance the worm falls; the first moments, in which it contracts, are left out."""
    run = floating(
        stiff(5, StrainDrag(gain=50.0)),
        actuation=lambda t: Command(np.full((5, 2), 0.3)),
        gravity=(1.0, 0.0, 0.0),
        state=shaped(0.3),
        duration=0.5,
    )
    assert_allclose(run.joint_velocity[-1, :, 0] - run.joint_velocity[-26, :, 0], 0.25, rtol=1e-9)


@pytest.mark.parametrize("gain", [5.0, -5.0])
def test_a_segment_that_resists_by_its_rate_pushes_the_worm(gain: float) -> None:
    """Two segments shorten at e = -0.1/s, the rear one with the factor 1 + g e: V = l0 e/2 g e/(2 + g e)."""
    worm = stiff(2, StrainDrag(gain=0.0, rate_gain=[gain, 0.0]))
    run = floating(worm, actuation=lambda t: Command(np.full((2, 2), 0.1 * t)), duration=3.0)
    joints = run.joints[:, :, 0]
    mean = (joints[:, :-1] + joints[:, 1:]).mean(axis=1) / 2.0
    factor = -0.1 * gain
    assert_allclose(mean[-1] - mean[-101], worm.l0 * -0.1 / 2.0 * factor / (2.0 + factor), rtol=1e-6)


def swum(worm: Worm, gait: TravellingWave, steps: int) -> float:
    """Return the velocity of the mean joint in the second period, over A c."""
    start = worm3d.State.straight(worm, None, contraction=gait.bind(worm)(0.0).contraction)
    run = floating(worm, actuation=gait, duration=2 * gait.period, dt=gait.period / steps, state=start, record_every=50)
    joints = run.joints[:, :, 0]
    mean = (joints[:, :-1] + joints[:, 1:]).mean(axis=1) / 2.0
    return float(mean[-1] - mean[len(mean) // 2]) / (gait.amplitude * gait.wavelength * worm.length)


@pytest.mark.parametrize("seed", range(5))
def test_random_waves_swim_as_the_closed_form_says(seed: int) -> None:
    """V = (A B/2) c cos(phi) (k l0/2) cot(k l0/2), B cos(phi) = gain A, whatever the rate gain."""
    rng = np.random.default_rng(seed)
    n, waves, period = int(rng.integers(6, 12)), int(rng.integers(1, 3)), rng.uniform(3.0, 8.0)
    gait = TravellingWave(
        period=period,
        amplitude=rng.uniform(0.03, 0.1),
        wavelength=1.0 / waves,
        rectified=False,
        direction=("direct", "retrograde")[seed % 2],
    )
    medium = StrainDrag(gain=rng.uniform(-5.0, 5.0), rate_gain=rng.uniform(-0.5, 0.5))
    half = np.pi * waves / n
    law = (1.0, -1.0)[seed % 2] * medium.gain * gait.amplitude / 2.0 * half / np.tan(half)
    assert_allclose(swum(stiff(n, medium), gait, 4000), law, rtol=3e-6, atol=1e-8)


def test_the_shape_is_foreseen_to_second_order() -> None:
    medium = StrainDrag(gain=3.0, rate_gain=1.0)
    worm, gait = stiff(8, medium), TravellingWave(period=4.0, amplitude=0.1, rectified=False)
    half = np.pi / 8
    law = -medium.gain * gait.amplitude / 2.0 * half / np.tan(half)
    errors = [abs(swum(worm, gait, steps) - law) for steps in (200, 400, 800)]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert_allclose(orders, 2.0, atol=0.15)
    assert errors[-1] < 1e-4 * abs(law)


def test_a_medium_that_resists_alike_is_the_drag_of_the_worm() -> None:
    plain, uniform, flat = (
        worm3d.simulate(Worm(drag=0.5, **more), worm3d.Plane(), actuation=GAIT, duration=1.0)
        for more in ({}, {"medium": Medium()}, {"medium": StrainDrag(gain=0.0)})
    )
    assert_array_equal(uniform.joints, plain.joints)
    assert_allclose(flat.joints, plain.joints, rtol=0, atol=1e-12)


@pytest.mark.parametrize("integrator", ["bdf2", "implicit_euler"])
@pytest.mark.parametrize("seed", range(2))
def test_the_ledger_closes_and_the_medium_only_takes(integrator: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    medium = StrainDrag(gain=rng.uniform(-8.0, 8.0, 6), rate_gain=rng.uniform(-2.0, 2.0, 6))
    gait = TravellingWave(period=1.0, amplitude=0.3, bias=0.3, hinge=0.2)
    worm = Worm(drag=0.5, medium=medium)
    run = worm3d.simulate(worm, worm3d.Plane(), actuation=gait, duration=2.0, integrator=integrator)  # type: ignore[arg-type]
    assert run.status is worm3d.Status.DONE
    assert run.energy.drag_loss.min() >= 0.0
    assert run.energy.drag_loss.sum() > 1e-3
    assert run.summary()["energy_balance_error"] < 1e-9  # type: ignore[operator]


def test_a_resumed_and_a_saved_run_are_the_same(tmp_path: Path) -> None:
    worm = Worm(drag=0.5, medium=StrainDrag(gain=2.0, rate_gain=0.3))
    whole, half = (worm3d.simulate(worm, worm3d.Plane(), actuation=GAIT, duration=span) for span in (1.0, 0.5))
    half.save(tmp_path / "half.nc")
    read = worm3d.load(tmp_path / "half.nc")
    assert read.worm.medium == worm.medium
    rest = worm3d.simulate(read.worm, worm3d.Plane(), actuation=GAIT, duration=0.5, state=read.state)
    assert_array_equal(rest.joints[-1], whole.joints[-1])


@dataclass(frozen=True, eq=False, kw_only=True)
class Shaken(Medium):
    """A medium that gets thinner as it is sheared."""

    @classmethod
    def factor(cls, s):  # type: ignore[no-untyped-def]
        return 1.0 / (1.0 + s["rate"] ** 2)


@dataclass(frozen=True, eq=False, kw_only=True)
class Wrong(Medium):
    """A medium whose factor is none."""

    @classmethod
    def factor(cls, s):  # type: ignore[no-untyped-def]
        return ca.vertcat(s["strain"], s["rate"])


def test_a_medium_of_ones_own_is_a_class_with_one_function() -> None:
    run = worm3d.simulate(Worm(drag=0.5, medium=Shaken()), worm3d.Plane(), actuation=GAIT, duration=0.5)
    assert run.status is worm3d.Status.DONE


def test_what_is_wrong_is_said() -> None:
    with pytest.raises(ValueError, match=r"drag: got 0\.0 N s/m, must be above 0 with a medium"):
        Worm(medium=StrainDrag())
    with pytest.raises(ValueError, match=r"medium\.gain: got 3 values, must be a number or 6"):
        Worm(drag=1.0, medium=StrainDrag(gain=[1.0, 2.0, 3.0]))
    with pytest.raises(ValueError, match=r"medium: got str, must be a worm3d\.Medium"):
        Worm(drag=1.0, medium="mud")
    with pytest.raises(ValueError, match=r"Wrong\.factor: got an array of shape \(2, 1\)"):
        worm3d.simulate(Worm(drag=1.0, medium=Wrong()), None, duration=0.1)
