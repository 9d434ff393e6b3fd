"""The planar case of the 3D worm is `planar.linkage`, step by step: two programs, written independently."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.testing import assert_allclose

import worm3d
from control.gaits import ContractionEngine_segmentdriven
from planar import linkage

N = 6
X = (np.arange(N) + 0.5) / N
Gait = Callable[[float], np.ndarray]

SOFT = {"half_height": 0.05, "mass": 0.1, "k_torsion": 0.1, "k_apex": 0.0}
"""Bends by degrees under its own weight and wave."""


def wave(sign: float = 1.0, amplitude: float = 0.2) -> Gait:
    """Retrograde for sign 1, direct for -1."""
    return lambda t: amplitude * np.maximum(0.0, np.sin(2 * np.pi * (X + sign * t / 2.0)))


def full_wave(t: float) -> np.ndarray:
    return 0.1 * np.sin(2 * np.pi * (X + t / 2.0))


def engine(t: float) -> np.ndarray:
    gait = ContractionEngine_segmentdriven(T_wave=2.0, T_contract=0.4, amplitude=0.1)
    return gait.amplitude * gait.activation(t, N)


def uneven() -> dict:
    """Return a worm in which every parameter counts and differs along the body."""
    rng = np.random.default_rng(3)
    return {
        "length": 0.8,
        "half_height": rng.uniform(0.05, 0.09, N),
        "mass": 0.1,
        "apex_mass_fraction": 0.3,
        "k_spring": rng.uniform(5.0, 30.0, N),
        "k_torsion": rng.uniform(0.1, 4.0, N - 1),
        "cross0": rng.uniform(-0.1, 0.1, N - 1),
        "k_apex": rng.uniform(0.05, 0.2, N),
        "kelvin_voigt_time": 0.03,
        "drag": 0.2,
    }


def pushed(t: float) -> np.ndarray:
    """Return forces along and normal to the ground on the head and the middle, shape (N+1, 2) [N]."""
    force = np.zeros((N + 1, 2))
    force[-1] = [0.05 * np.sin(2 * np.pi * t / 3), 0.02]
    force[3] = [0.0, -0.05]
    return force


def both(
    worm: dict,
    gait: Gait = wave(),  # noqa: B008 - a function, never changed
    *,
    ground: str = "contact",
    friction: tuple = (0.03, 0.20, 1.2),
    slope: float = 0.0,
    tilt: float = 0.0,
    external_force: Gait | None = None,
    steps: int = 1000,
    dt: float = 0.01,
) -> tuple[linkage.Run, worm3d.Result, np.ndarray]:
    """Run both programs; return their results, and the joints of the 3D one in the axes of the ground.

    `slope` tilts the 3D plane under a vertical gravity; `tilt` tilts gravity over a level one instead.
    """
    segments = len(gait(0.0))
    oracle = linkage.simulate(
        linkage.Linkage(segments=segments, **worm),
        gait,
        duration=steps * dt,
        dt=dt,
        ground=ground,
        friction=linkage.Friction(*friction),
        slope=slope + tilt,
        external_force=external_force,
    )
    plane = worm3d.Plane(slope=slope)

    def force(t: float) -> np.ndarray:
        along, normal = np.transpose(external_force(t))
        return along[:, None] * plane.axes[0] + normal[:, None] * plane.axes[2]

    result = worm3d.simulate(
        worm3d.Worm.planar(segments=segments, **worm),
        worm3d.ClampedGround() if ground == "clamped" else plane,
        worm3d.Friction(friction[0], friction[1], lateral=0.7, static_ratio=friction[2]),
        actuation=lambda t: worm3d.Command(np.column_stack([gait(t), gait(t)])),
        duration=steps * dt,
        dt=dt,
        integrator="implicit_euler",
        gravity=(-9.81 * np.sin(tilt), 0.0, -9.81 * np.cos(tilt)),
        external_force=None if external_force is None else force,
    )
    return oracle, result, result.joints @ plane.axes.T


def assert_equal(oracle: linkage.Run, result: worm3d.Result, joints: np.ndarray) -> None:
    """Joints within 1e-9 m at every step; what else both report agrees as well."""
    assert oracle.status.name == result.status.name
    assert len(joints) == len(oracle.joints)
    assert_allclose(joints[..., [0, 2]], oracle.joints, rtol=0, atol=1e-9)
    assert_allclose(joints[..., 1], 0.0, rtol=0, atol=1e-15)
    weight = oracle.worm.total_mass * 9.81
    assert_allclose(result.energy.work_contract[1:].sum(), oracle.work_contract, rtol=1e-6, atol=1e-9)
    assert_allclose(result.energy.friction_loss[1:].sum(), oracle.work_friction, rtol=1e-6, atol=1e-9)
    if oracle.law == "anchored":
        below, above = (result.normal_load[:, :, [side, 3 + side]].sum(axis=2) for side in (0, 1))
        # A load is stiffness x depth: 1e-9 m of depth weigh a hundred thousandth of the worm.
        assert_allclose(below, oracle.normal_load[:, :, 0], rtol=0, atol=1e-5 * weight)
        assert_allclose(above, oracle.normal_load[:, :, 1], rtol=0, atol=1e-5 * weight)
        assert_allclose(result.slip[1:, :, 0], oracle.slip[:, :, 0], rtol=0, atol=1e-9)
    else:
        assert_allclose(result.joint_load[1:], oracle.joint_load, rtol=0, atol=1e-6 * weight)


def bends(joints: np.ndarray) -> float:
    """Return the greatest angle between neighbouring segments [rad]."""
    edges = np.diff(joints, axis=1)
    tangents = edges / np.linalg.norm(edges, axis=2)[..., None]
    return float(np.arcsin(np.linalg.norm(np.cross(tangents[:, :-1], tangents[:, 1:]), axis=2)).max())


@pytest.mark.parametrize("ground", ["contact", "clamped"])
@pytest.mark.parametrize("sign", [1.0, -1.0], ids=["retrograde", "direct"])
def test_a_thousand_steps_with_bending(ground: str, sign: float) -> None:
    oracle, result, joints = both(SOFT, wave(sign), ground=ground)
    assert len(joints) == 1001
    assert_equal(oracle, result, joints)
    if ground == "contact":
        assert bends(joints) > 0.02
    assert abs(oracle.distance) > 0.3


@pytest.mark.parametrize("ground", ["contact", "clamped"])
def test_a_thousand_steps_with_every_parameter_uneven(ground: str) -> None:
    """cross0, k_apex, drag, arrays for every segment and joint; friction that differs along the body."""
    friction = (np.linspace(0.01, 0.1, N), np.linspace(0.3, 0.1, N), 1.2)
    assert_equal(*both(uneven(), wave(), ground=ground, friction=friction))


CONTACT = {
    "static_ratio 1": (SOFT, wave(), {"friction": (0.03, 0.20, 1.0)}),
    "uphill": (SOFT, wave(), {"slope": 0.03}),
    "sliding downhill": (SOFT, wave(), {"slope": -0.05}),
    "gravity tilted over a level plane": (SOFT, wave(), {"tilt": 0.03}),
    "pushed": (SOFT | {"drag": 0.1}, wave(-1.0), {"external_force": pushed}),
    "pushed uphill": (SOFT, wave(), {"external_force": pushed, "slope": 0.02}),
    "contraction engine": (SOFT, engine, {}),
    "both signs": (SOFT | {"k_apex": 0.12, "cross0": 0.05}, full_wave, {}),
    "the paper's height and k_torsion": ({}, full_wave, {}),
    "all mass on the joints": (SOFT | {"apex_mass_fraction": 0.0}, wave(), {}),
    "all mass on the apexes": (SOFT | {"apex_mass_fraction": 1.0, "kelvin_voigt_time": 0.0}, wave(), {}),
    "without friction": (SOFT, wave(), {"friction": (0.0, 0.0, 1.0)}),
    "one way without friction": (SOFT, wave(), {"friction": (0.0, 0.2, 1.2)}),
    "forward without friction": (SOFT, wave(-1.0), {"friction": (0.0, 0.2, 1.0), "steps": 600}),
    "backward without friction": (SOFT, wave(-1.0), {"friction": (0.2, 0.0, 1.2), "steps": 600}),
    "hardly any friction forward": (SOFT, wave(), {"friction": (1e-5, 0.2, 1.0), "steps": 600}),
    "friction of some segments": (
        SOFT,
        wave(),
        {"friction": (0.2 * (np.arange(N) % 2), 0.2 * (np.arange(N) < 4), 1.0)},
    ),
    "long steps": (SOFT, wave(), {"dt": 0.05}),
    "short steps": (SOFT, wave(), {"dt": 0.001}),
}


@pytest.mark.parametrize("name", CONTACT)
def test_in_contact(name: str) -> None:
    worm, gait, more = CONTACT[name]
    assert_equal(*both(worm, gait, **({"steps": 150} | more)))


CLAMPED = {
    "gravity tilted": (SOFT, wave(), {"tilt": 0.1}),
    "pushed": (SOFT | {"drag": 0.1}, wave(-1.0), {"external_force": pushed}),
    "contraction engine": (SOFT, engine, {}),
    "both signs": (SOFT | {"k_apex": 0.12, "cross0": 0.05}, full_wave, {}),
    "the paper's height and k_torsion": ({}, full_wave, {}),
}


@pytest.mark.parametrize("name", CLAMPED)
def test_clamped(name: str) -> None:
    worm, gait, more = CLAMPED[name]
    assert_equal(*both(worm, gait, ground="clamped", steps=150, **more))


@pytest.mark.parametrize("segments", [1, 2, 13])
def test_any_number_of_segments(segments: int) -> None:
    x = (np.arange(segments) + 0.5) / segments
    worm = {"half_height": 0.3 / segments, "mass": 0.05, "k_spring": 30.0, "k_torsion": 0.2, "k_apex": 0.01}
    gait = lambda t: 0.2 * np.maximum(0.0, np.sin(2 * np.pi * (x + t / 2)))  # noqa: E731
    assert_equal(*both(worm, gait, steps=150))


def test_both_flatten_at_the_same_step() -> None:
    """Lengthened by 0.2 the chambers have no equilibrium under the worm's weight."""
    oracle, result, joints = both(SOFT, lambda t: 2.0 * full_wave(t), steps=50)
    assert oracle.status.name == "FLATTENED"
    assert_equal(oracle, result, joints)
    assert result.stop.step == oracle.stop.step
