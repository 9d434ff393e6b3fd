"""Kernels: gradients and Hessians against central differences, energies against their formulas, and both machines."""

from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest
from kernel_states import (
    COUNT,
    Values,
    assert_close,
    difference,
    differences,
    run,
    some_inputs,
    some_joint,
    some_node,
    some_segment,
)
from numpy.testing import assert_allclose

from worm3d import Plane
from worm3d.physics.kernels import actuator, joint, node, point, regime, segment
from worm3d.running.plant import kernels

FUNCTIONS: tuple[Callable[[], ca.Function], ...] = (
    segment.shape,
    actuator.start,
    actuator.hinge_start,
    segment.rims,
    segment.motion,
    segment.gradient,
    segment.hessian,
    segment.jacobian,
    segment.ledger,
    joint.start,
    joint.gradient,
    joint.hessian,
    joint.angles,
    joint.ledger,
    point.force,
    point.stiffness,
    point.ahead,
    point.free_force,
    point.free_stiffness,
    point.start,
    regime.near,
    regime.yielding,
    regime.expected,
    point.after,
    point.touches,
    point.free_after,
    point.momenta,
    node.start,
    node.after,
    node.momenta,
)


def points_potential(values: Values, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return points (24, COUNT) at q, and f there of the field f0 + k (x - x0): of free masses with the stiffness k."""
    x0 = run("segment_shape", segment.SEGMENT_LAYOUT, values)[8:]
    x = run("segment_shape", segment.SEGMENT_LAYOUT, values | {"q": at})[8:]
    return x, values["f"] + np.tile(values["K"][:8], (3, 1)) * (x - x0)


def test_segment_gradient_and_hessian() -> None:
    """d/dq of phi(q) + f.X(q) at constant f; then d/dq of that gradient with f = f0 + k (X(q) - X0).

    The second derivatives of the points go with the force that was foreseen.
    """
    foreseen = some_segment()
    values = foreseen | {"f_ahead": foreseen["f"]}

    def potential(q: np.ndarray) -> np.ndarray:
        x, _ = points_potential(values, q)
        return run("segment_gradient", segment.SEGMENT_LAYOUT, values | {"q": q})[:1] + np.sum(values["f"] * x, axis=0)

    def gradient(q: np.ndarray) -> np.ndarray:
        _, f = points_potential(values, q)
        return run("segment_gradient", segment.SEGMENT_LAYOUT, values | {"q": q, "f": f})[1:]

    out = run("segment_hessian", segment.SEGMENT_LAYOUT, values)
    assert_close(out[None, 1:9], differences(potential, values["q"], 1e-4), 1e-8)
    hessian = out[9:].reshape(8, 8, COUNT)  # row by row
    assert_close(hessian, differences(gradient, values["q"], 1e-4), 1e-8)
    np.testing.assert_array_equal(hessian, hessian.transpose(1, 0, 2))
    assert_allclose(out[:9], run("segment_gradient", segment.SEGMENT_LAYOUT, values), rtol=1e-12, atol=1e-12)
    other = run("segment_hessian", segment.SEGMENT_LAYOUT, foreseen)
    of_foreseen = run("segment_hessian", segment.SEGMENT_LAYOUT, foreseen | {"f": foreseen["f_ahead"]})
    assert_allclose(other[:9], out[:9], rtol=1e-12, atol=1e-12)
    assert_allclose(other[9:], of_foreseen[9:], rtol=1e-12, atol=1e-12)
    assert np.abs(other[9:] - out[9:]).max() > 0.01


def test_segment_motion_is_the_points_derivative_along_dq() -> None:
    values = some_segment(1)
    moved = run("segment_motion", segment.SEGMENT_LAYOUT, values)
    jacobian = differences(
        lambda q: run("segment_shape", segment.SEGMENT_LAYOUT, values | {"q": q})[8:], values["q"], 1e-4
    )
    assert_allclose(moved, np.einsum("mnk,nk->mk", jacobian, values["dq"]), rtol=0, atol=1e-11)


def test_segment_jacobian_is_the_points_derivative_point_by_point() -> None:
    values = some_segment(2)
    expected = differences(
        lambda q: run("segment_shape", segment.SEGMENT_LAYOUT, values | {"q": q})[8:], values["q"], 1e-4
    )
    found = run("segment_jacobian", segment.SEGMENT_LAYOUT, values).reshape(8, 3, 8, COUNT)  # point, axis, coordinate
    assert_allclose(found, expected.reshape(3, 8, 8, COUNT).transpose(1, 0, 2, 3), rtol=0, atol=1e-10)


def transported(a: np.ndarray, b: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Rotate d by the smallest rotation from a to b (Rodrigues), all (3, COUNT)."""
    axis = np.cross(a, b, axis=0)
    s, c = np.linalg.norm(axis, axis=0), np.sum(a * b, axis=0)
    n = axis / s
    return c * d + s * np.cross(n, d, axis=0) + (1 - c) * np.sum(n * d, axis=0) * n


def frames(e: np.ndarray, roll: np.ndarray, t_ref: np.ndarray, d_ref: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return length, t, d and u = t x d of segments by rotations: from t_ref to t, then by the roll about t."""
    length = np.linalg.norm(e, axis=0)
    t = e / length
    d = transported(t_ref, t, d_ref)
    d = np.cos(roll) * d + np.sin(roll) * np.cross(t, d, axis=0)
    return length, t, d, np.cross(t, d, axis=0)


def test_segment_shape_and_energy_are_those_of_the_equations() -> None:
    """Rotations by Rodrigues' formula instead of (E1); (E2), (E3), (E4) and Kelvin-Voigt dampers as they stand.

    Apexes of chamber c keep the links: a^2 = h_c^2 + l_c^2/4. The point of a face is that of the disc which is chosen
    for it: the lowest one across the segment, against the normal (up to the rounding FACING = 1e-3 of (E6)).
    """
    v = some_segment(2)
    q, b = v["q"], v["offset"][0]
    length, t, d, u = frames(q[5:] - q[:3], q[3], v["t_ref"], v["d_ref"])
    out = run("segment_shape", segment.SEGMENT_LAYOUT, v)
    chambers = np.array([length - b * q[4], length + b * q[4]])
    assert_allclose(out[:2], chambers, rtol=1e-13)
    assert_allclose(out[2:5], t, rtol=0, atol=1e-13)
    assert_allclose(out[5:8], d, rtol=0, atol=1e-12)
    h, middle = np.sqrt(v["link"] ** 2 - chambers**2 / 4.0), (q[:3] + q[5:]) / 2
    expected = [middle + b * d - h[0] * u, middle + b * d + h[0] * u, middle + (b + h[0]) * d]
    expected += [middle - b * d - h[1] * u, middle - b * d + h[1] * u, middle - (b + h[1]) * d]
    points = out[8:].reshape(3, 8, COUNT).transpose(1, 0, 2)
    assert_allclose(points[:6], expected, rtol=0, atol=1e-13)
    rims = run("segment_rims", segment.SEGMENT_LAYOUT, v)
    for k, p in enumerate((q[:3], q[5:])):
        r = v["rim"][2 * k : 2 * k + 2]
        assert_allclose(points[6 + k], p + v["radius"][k] * (r[0] * d + r[1] * u), rtol=0, atol=1e-13)
        n = v["normal"][3 * k : 3 * k + 3]
        w = n - np.sum(n * t, axis=0) * t
        w /= np.linalg.norm(w, axis=0)
        lowest, r = -w, rims[2 * k : 2 * k + 2]
        tilted = np.linalg.norm(np.cross(n, t, axis=0), axis=0) > 0.1
        assert tilted.sum() > COUNT // 2
        assert_allclose((r[0] * d + r[1] * u)[:, tilted], lowest[:, tilted], rtol=0, atol=1e-4)
    k, ka, l0, tau, span = (v[name][0] for name in ("k", "k_apex", "l0", "tau", "span"))
    angle, rest = 2 * np.arcsin(chambers / (2 * v["link"])), 2 * np.arcsin(l0 / (2 * v["link"][0]))
    phi = k / 2 * l0 / 2 * (1 - chambers / v["commanded"]) ** 2 + v["force"] * chambers + ka / 2 * (angle - rest) ** 2
    phi += tau * k / (2 * l0) / (2 * span) * (chambers - v["length_hat"]) ** 2
    phi += tau * ka / (2 * span) * (angle - v["angle_hat"]) ** 2
    rolling = v["roll_damping"][0] / (2 * v["dt"][0]) * q[3] ** 2
    assert_allclose(run("segment_gradient", segment.SEGMENT_LAYOUT, v)[0], phi.sum(axis=0) + rolling, rtol=1e-12)


def test_joint_gradient_and_hessian() -> None:
    values = some_joint()

    def run_at(name: str) -> np.ndarray:
        return run(f"joint_{name}", joint.JOINT_LAYOUT, values)

    def potential(q: np.ndarray) -> np.ndarray:
        return run("joint_gradient", joint.JOINT_LAYOUT, values | {"q": q})[:1]

    def gradient(q: np.ndarray) -> np.ndarray:
        return run("joint_gradient", joint.JOINT_LAYOUT, values | {"q": q})[1:14]

    assert_close(run_at("gradient")[None, 1:14], differences(potential, values["q"], 1e-4), 1e-8)
    hessian = run_at("hessian")[17:].reshape(13, 16, COUNT)
    assert_close(hessian[:, :13], differences(gradient, values["q"], 1e-4), 1e-8)
    assert not hessian[:, 13:].any()


def test_joint_strains_and_energy_are_those_of_the_equations() -> None:
    """(E5) with frames by rotations; the twist as the angle left between the directors carried to a common tangent."""
    v = some_joint(4)
    q = v["q"]
    _, t1, d1, u1 = frames(q[5:8] - q[:3], q[3], v["t_ref"][:3], v["d_ref"][:3])
    _, t2, d2, u2 = frames(q[10:] - q[5:8], q[8], v["t_ref"][3:], v["d_ref"][3:])
    c = np.cross(t1, t2, axis=0)
    d, u = d1 + d2, u1 + u2
    pitch = np.sum(c * d, axis=0) / np.linalg.norm(d, axis=0)
    yaw = np.sum(c * u, axis=0) / np.linalg.norm(u, axis=0)
    carried = transported(t1, t2, d1)
    twist = np.arccos(np.sum(carried * d2, axis=0))
    twist *= np.sign(np.sum(np.cross(carried, d2, axis=0) * t2, axis=0))
    bends = q[4] + q[9]
    expected = np.array([pitch, yaw, twist, bends])
    assert_allclose(run("joint_angles", joint.JOINT_LAYOUT, v), expected, rtol=0, atol=1e-11)

    def strains(angles: np.ndarray, hinge: str = "hinge") -> np.ndarray:
        yawed = angles[1] - np.sin(angles[3] / 2 + v[hinge][0])
        return np.array([angles[0] + v["cross0"][0], yawed, angles[2]])

    s, hat = strains(expected), 4 / 3 * strains(v["angles_n"]) - strains(v["angles_m"]) / 3
    known = [hat, strains(v["angles_n"]), strains(v["angles_n"], "hinge_n")]
    assert_allclose(run("joint_start", joint.JOINT_LAYOUT, v), np.vstack(known), rtol=0, atol=1e-14)
    v["strain_hat"] = hat
    phi = v["k"] / 2 * (s**2 + v["tau"] / v["span"] * (s - hat) ** 2)
    assert_allclose(run("joint_gradient", joint.JOINT_LAYOUT, v)[0], phi.sum(axis=0), rtol=1e-10)


def test_a_joints_ledger_closes_and_its_terms_are_those_of_the_equations() -> None:
    """Inertia and medium times motion is the gain of kinetic energy and what is lost, each by its own formula."""
    v = some_node()
    out = run("node_after", node.NODE_LAYOUT, v)
    terms = dict(zip(node.LEDGER_TERMS, out, strict=False))
    moved, speed = v["x"] - v["past"][:3], difference(v, v["x"], v["past"])
    assert_allclose(out[len(node.LEDGER_TERMS) :], speed, rtol=0, atol=1e-12)
    against = v["mass"] * difference(v, speed, v["velocity"]) + v["drag"] * speed
    numerical = terms["impact"] + terms["numerical_loss"]
    spent = terms["kinetic"] + terms["drag_loss"] + numerical
    assert_allclose(spent, np.sum(against * moved, axis=0), rtol=0, atol=1e-12 * np.abs(against).max())
    kinetic = v["mass"] / 2 * (speed**2 - v["velocity"][:3] ** 2)
    assert_allclose(terms["kinetic"], kinetic.sum(axis=0), rtol=1e-11)
    assert_allclose(terms["drag_loss"], (v["drag"] * speed**2 * v["dt"]).sum(axis=0), rtol=1e-11)
    for name, force in (
        ("potential", -v["weight"]),
        ("work_external", v["external"]),
        ("friction_loss", -v["friction"]),
    ):
        assert_allclose(terms[name], np.sum(force * moved, axis=0), rtol=0, atol=1e-15, err_msg=name)
    assert_allclose(terms["work_friction_p13"], -terms["friction_loss"], rtol=1e-15)


@pytest.mark.parametrize("kind", ["point", "node"])
def test_momenta_are_those_of_mass_points(kind: str) -> None:
    layout, v = some_inputs({"point": point, "node": node}[kind].momenta())
    x, p = v["past"][:3], v["mass"] * v["velocity"][:3]
    expected = np.vstack([p, np.cross(x, p, axis=0), v["mass"] * x])
    assert_allclose(run(f"{kind}_momenta", layout, v), expected, rtol=0, atol=1e-16)


def test_all_kernels_are_compared_with_the_virtual_machine() -> None:
    assert {make().name() for make in FUNCTIONS} == set(kernels())


@pytest.mark.parametrize("make", FUNCTIONS, ids=lambda f: f"{f.__module__.split('.')[-1]}_{f.__name__}")
def test_native_kernels_equal_casadis_virtual_machine(make: Callable[[], ca.Function]) -> None:
    """To 1e-13 of each output's size: its largest entry over the states, sums cancel in single ones."""
    function = make()
    layout, values = some_inputs(function)
    native = run(function.name(), layout, values)
    sizes = {function.name_in(k): function.size_in(k)[0] for k in range(function.n_in())}
    given = [values.get(name, np.zeros((size, COUNT))) for name, size in sizes.items()]
    virtual = np.vstack([np.array(each) for each in function.map(COUNT).call(given)])
    scale = np.abs(virtual).max(axis=1, keepdims=True)
    assert np.isfinite(virtual).all()
    assert (np.abs(native - virtual) <= 1e-13 * scale).all()


def test_world_kernel_equals_the_planes_equation() -> None:
    plane = Plane(0.3, 0.8)
    kernel, points = plane.kernel(), np.random.default_rng(0).uniform(-1, 1, (5, 3))
    normal = np.array([-np.sin(0.3) * np.cos(0.8), -np.sin(0.3) * np.sin(0.8), np.cos(0.3)])
    assert_allclose(plane.distance(points), points @ normal, rtol=1e-14, atol=1e-15)
    assert_allclose(kernel.parameters[6:9], normal, rtol=1e-14)
