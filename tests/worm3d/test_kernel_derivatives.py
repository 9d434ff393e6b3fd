"""Kernels: gradients and Hessians against central differences, energies against their formulas, and both machines."""

from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

from worm3d import Plane
from worm3d.codegen import Kernel, compile_kernel
from worm3d.kernels import joint, node, point, segment
from worm3d.kernels.layout import Layout
from worm3d.plant import kernels
from worm3d.solver.band import STIFFNESS
from worm3d.solver.evaluate import LOAD, PHI
from worm3d.solver.regimes import EXCESS, NEXT, PULL, STALE, SWING, TOUCHING, Y

COUNT = 40
"""Random states of each kernel."""

AT_REST = {"first": np.zeros((3, COUNT))}
"""Seen from where the point is."""

Values = dict[str, np.ndarray]
FUNCTIONS: tuple[Callable[[], ca.Function], ...] = (
    segment.shape,
    segment.rims,
    segment.motion,
    segment.gradient,
    segment.hessian,
    segment.ledger,
    joint.start,
    joint.gradient,
    joint.hessian,
    joint.angles,
    joint.ledger,
    point.force,
    point.start,
    point.yielding,
    point.expected,
    point.slip,
    point.after,
    point.momenta,
    node.start,
    node.after,
    node.momenta,
)


def run(name: str, layout: Layout, values: Values) -> np.ndarray:
    """Return a native kernel's outputs, shape (rows, COUNT), for inputs by name, each (size, COUNT)."""
    return evaluated(kernels()[name], layout, values)


def evaluated(kernel: Kernel, layout: Layout, values: Values) -> np.ndarray:
    assert set(values) == set(layout.sizes)
    inputs, outputs = kernel.allocate(COUNT)
    inputs[:, :COUNT] = np.vstack([values[name] for name in layout.sizes])
    kernel(inputs, outputs, COUNT)
    return outputs[:, :COUNT]


def differences(of: Callable[[np.ndarray], np.ndarray], at: np.ndarray, h: float) -> np.ndarray:
    """Return the central differences of order 4 of rows (m, COUNT) in rows (n, COUNT), shape (m, n, COUNT).

    f' = (8 (f(h) - f(-h)) - (f(2h) - f(-2h)))/(12 h) + O(h^4).
    """
    columns = []
    for k in range(len(at)):
        e = np.zeros_like(at)
        e[k] = h
        columns.append((8.0 * (of(at + e) - of(at - e)) - (of(at + 2 * e) - of(at - 2 * e))) / (12.0 * h))
    return np.stack(columns, axis=1)


def assert_close(found: np.ndarray, expected: np.ndarray, relative: float) -> None:
    """Compare (m, n, COUNT) with an error relative to the largest entry of each row and instance."""
    scale = np.abs(expected).max(axis=1, keepdims=True)
    assert scale.min() >= 0.0
    worst = (np.abs(found - expected) / np.maximum(scale, 1e-3 * np.abs(expected).max())).max()
    assert worst < relative, worst


def units(rng: np.random.Generator) -> np.ndarray:
    v = rng.standard_normal((3, COUNT))
    return v / np.linalg.norm(v, axis=0)


def across(t: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    d = np.cross(t, units(rng), axis=0)
    return d / np.linalg.norm(d, axis=0)


def some_segment(seed: int = 0) -> Values:
    """Return segments in general position: stretched, rolled, bent, with unequal chambers and tilted faces."""
    rng = np.random.default_rng(seed)

    def uniform(low: float, high: float, size: int = 1) -> np.ndarray:
        return rng.uniform(low, high, (size, COUNT))

    t = units(rng)
    near = t + 0.3 * units(rng)
    t_ref = near / np.linalg.norm(near, axis=0)
    p = uniform(-1, 1, 3)
    q = np.vstack([p, uniform(-0.8, 0.8), uniform(-0.7, 0.7), p + uniform(0.13, 0.18) * t])
    l0 = uniform(0.15, 0.17)
    return {
        "q": q,
        "dq": 0.01 * uniform(-1, 1, 8),
        "t_ref": t_ref,
        "d_ref": across(t_ref, rng),
        "link": uniform(0.115, 0.14),
        "offset": uniform(0.01, 0.04),
        "radius": uniform(0.03, 0.06, 2),
        "normal": np.vstack([units(rng), units(rng)]),
        "rim": np.vstack([units(rng)[:2], units(rng)[:2]]),
        "k": uniform(5, 30),
        "k_apex": uniform(0.05, 0.3),
        "l0": l0,
        "tau": uniform(0.01, 0.1),
        "span": uniform(0.005, 0.02),
        "dt": uniform(0.005, 0.02),
        "commanded": l0 * uniform(0.7, 1.05, 2),
        "force": uniform(-1, 1, 2),
        "length_hat": uniform(0.14, 0.17, 2),
        "angle_hat": uniform(1.3, 1.9, 2),
        "commanded_n": l0 * uniform(0.7, 1.05, 2),
        "length_n": uniform(0.14, 0.17, 2),
        "angle_n": uniform(1.3, 1.9, 2),
        "f": uniform(-1, 1, 24),
        "f_ahead": uniform(-1, 1, 24),
        "K": uniform(-50, 50, 72),
        "of_points": uniform(-1, 1, 16),
    }


def points_potential(values: Values, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return points (24, COUNT) at q, and f there of the field f0 + K (x - x0), whose K is not symmetric."""
    x0 = run("segment_shape", segment.LAYOUT, values)[8:]
    x = run("segment_shape", segment.LAYOUT, values | {"q": at})[8:]
    K = values["K"].reshape(3, 3, 8, COUNT)
    moved = (x - x0).reshape(3, 8, COUNT)
    return x, values["f"] + np.einsum("rcpk,cpk->rpk", K, moved).reshape(24, COUNT)


def test_segment_gradient_and_hessian() -> None:
    """d/dq of phi(q) + f.X(q) at constant f; then d/dq of that gradient with f = f0 + K (X(q) - X0).

    The second derivatives of the points go with the force that was foreseen.
    """
    foreseen = some_segment()
    values = foreseen | {"f_ahead": foreseen["f"]}

    def potential(q: np.ndarray) -> np.ndarray:
        x, _ = points_potential(values, q)
        return run("segment_gradient", segment.LAYOUT, values | {"q": q})[:1] + np.sum(values["f"] * x, axis=0)

    def gradient(q: np.ndarray) -> np.ndarray:
        _, f = points_potential(values, q)
        return run("segment_gradient", segment.LAYOUT, values | {"q": q, "f": f})[1:]

    out = run("segment_hessian", segment.LAYOUT, values)
    assert_close(out[None, 1:9], differences(potential, values["q"], 1e-4), 1e-8)
    hessian = out[9:].reshape(8, 8, COUNT)  # row by row
    assert_close(hessian, differences(gradient, values["q"], 1e-4), 1e-8)
    assert np.abs(hessian - hessian.transpose(1, 0, 2)).max() > 1.0, "the coupled K makes it unsymmetric"
    assert_allclose(out[:9], run("segment_gradient", segment.LAYOUT, values), rtol=1e-12, atol=1e-12)
    other = run("segment_hessian", segment.LAYOUT, foreseen)
    of_foreseen = run("segment_hessian", segment.LAYOUT, foreseen | {"f": foreseen["f_ahead"]})
    assert_allclose(other[:9], out[:9], rtol=1e-12, atol=1e-12)
    assert_allclose(other[9:], of_foreseen[9:], rtol=1e-12, atol=1e-12)
    assert np.abs(other[9:] - out[9:]).max() > 0.01


def test_segment_motion_is_the_points_derivative_along_dq() -> None:
    values = some_segment(1)
    moved = run("segment_motion", segment.LAYOUT, values)
    jacobian = differences(lambda q: run("segment_shape", segment.LAYOUT, values | {"q": q})[8:], values["q"], 1e-4)
    assert_allclose(moved, np.einsum("mnk,nk->mk", jacobian, values["dq"]), rtol=0, atol=1e-11)


def test_segment_jacobian_is_the_points_derivative_point_by_point() -> None:
    values = some_segment(2)
    expected = differences(lambda q: run("segment_shape", segment.LAYOUT, values | {"q": q})[8:], values["q"], 1e-4)
    found = run("segment_jacobian", segment.LAYOUT, values).reshape(8, 3, 8, COUNT)  # point, axis, coordinate
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
    out = run("segment_shape", segment.LAYOUT, v)
    chambers = np.array([length - b * q[4], length + b * q[4]])
    assert_allclose(out[:2], chambers, rtol=1e-13)
    assert_allclose(out[2:5], t, rtol=0, atol=1e-13)
    assert_allclose(out[5:8], d, rtol=0, atol=1e-12)
    h, middle = np.sqrt(v["link"] ** 2 - chambers**2 / 4.0), (q[:3] + q[5:]) / 2
    expected = [middle + b * d - h[0] * u, middle + b * d + h[0] * u, middle + (b + h[0]) * d]
    expected += [middle - b * d - h[1] * u, middle - b * d + h[1] * u, middle - (b + h[1]) * d]
    points = out[8:].reshape(3, 8, COUNT).transpose(1, 0, 2)
    assert_allclose(points[:6], expected, rtol=0, atol=1e-13)
    rims = run("segment_rims", segment.LAYOUT, v)
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
    assert_allclose(run("segment_gradient", segment.LAYOUT, v)[0], phi.sum(axis=0), rtol=1e-12)


def some_joint(seed: int = 3) -> Values:
    """Return joints in general position: pitched, yawed, twisted, rolled, with bends, hinges and rest angles."""
    rng = np.random.default_rng(seed)

    def uniform(low: float, high: float, size: int = 1) -> np.ndarray:
        return rng.uniform(low, high, (size, COUNT))

    t1 = units(rng)
    ahead = t1 + 0.6 * units(rng)
    t2 = ahead / np.linalg.norm(ahead, axis=0)
    refs = [t + 0.2 * units(rng) for t in (t1, t2)]
    refs = [r / np.linalg.norm(r, axis=0) for r in refs]
    d1 = across(refs[0], rng)
    turned = np.cross(np.cross(refs[1], d1 + 0.4 * units(rng), axis=0), refs[1], axis=0)
    d2 = turned / np.linalg.norm(turned, axis=0)
    p = uniform(-1, 1, 3)
    p1 = p + uniform(0.13, 0.18) * t1
    p2 = p1 + uniform(0.13, 0.18) * t2
    g, th = uniform(-0.4, 0.4, 2), uniform(-0.5, 0.5, 2)
    known = {f"strain_{name}": uniform(-0.5, 0.5, 3) for name in ("hat", "n", "old")}
    return {
        "q": np.vstack([p, g[:1], th[:1], p1, g[1:], th[1:], p2]),
        "dq": 0.01 * uniform(-1, 1, 13),
        "t_ref": np.vstack(refs),
        "d_ref": np.vstack([d1, d2]),
        "k": uniform(0.5, 10, 3),
        "cross0": uniform(-0.3, 0.3),
        "tau": uniform(0.01, 0.1),
        "span": uniform(0.005, 0.02),
        "dt": uniform(0.005, 0.02),
        "hinge": uniform(-0.6, 0.6),
        "hinge_n": uniform(-0.6, 0.6),
        "weights": np.vstack([np.full(COUNT, 4 / 3), np.full(COUNT, -1 / 3)]),
        "angles_n": uniform(-0.5, 0.5, 4),
        "angles_m": uniform(-0.5, 0.5, 4),
        **known,
    }


def test_joint_gradient_and_hessian() -> None:
    values = some_joint()

    def potential(q: np.ndarray) -> np.ndarray:
        return run("joint_gradient", joint.LAYOUT, values | {"q": q})[:1]

    def gradient(q: np.ndarray) -> np.ndarray:
        return run("joint_gradient", joint.LAYOUT, values | {"q": q})[1:]

    out = run("joint_hessian", joint.LAYOUT, values)
    assert_close(out[None, 1:14], differences(potential, values["q"], 1e-4), 1e-8)
    hessian = out[14:].reshape(13, 16, COUNT)
    assert_close(hessian[:, :13], differences(gradient, values["q"], 1e-4), 1e-8)
    assert not hessian[:, 13:].any()
    assert_allclose(out[:14], run("joint_gradient", joint.LAYOUT, values), rtol=1e-12, atol=1e-12)


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
    assert_allclose(run("joint_angles", joint.LAYOUT, v), expected, rtol=0, atol=1e-11)

    def strains(angles: np.ndarray, hinge: str = "hinge") -> np.ndarray:
        yawed = angles[1] - np.sin(angles[3] / 2 + v[hinge][0])
        return np.array([angles[0] + v["cross0"][0], yawed, angles[2]])

    s, hat = strains(expected), 4 / 3 * strains(v["angles_n"]) - strains(v["angles_m"]) / 3
    known = [hat, strains(v["angles_n"]), strains(v["angles_n"], "hinge_n")]
    assert_allclose(run("joint_start", joint.LAYOUT, v), np.vstack(known), rtol=0, atol=1e-14)
    v["strain_hat"] = hat
    phi = v["k"] / 2 * (s**2 + v["tau"] / v["span"] * (s - hat) ** 2)
    assert_allclose(run("joint_gradient", joint.LAYOUT, v)[0], phi.sum(axis=0), rtol=1e-10)


CENTRE, RADIUS = np.array([[0.3], [-0.2], [-0.9]]), 1.0


def on_sphere(x: np.ndarray, inside: bool) -> Values:
    """Return distance, normal and curvature of a ball, or of the hollow one around it (`inside`)."""
    away = x - CENTRE
    r = np.linalg.norm(away, axis=0)
    n, side = away / r, -1.0 if inside else 1.0
    H = (np.eye(3)[:, :, None] - n[:, None] * n[None]) / r
    upper = np.array([H[i, j] for i in range(3) for j in range(i, 3)])
    return {"distance": side * (r - RADIUS)[None], "normal": side * n, "curvature": side * upper}


def some_point(coupled: bool, inside: bool, seed: int = 5) -> Values:
    """Return points about a sphere: free, touching, stuck and sliding, forward and backward, moving in and out."""
    rng = np.random.default_rng(seed)

    def uniform(low: float, high: float, size: int = 1) -> np.ndarray:
        return rng.uniform(low, high, (size, COUNT))

    n = units(rng)
    x = CENTRE + n * (RADIUS + uniform(-0.02, 0.01) * (-1.0 if inside else 1.0))
    along = across(n, rng)
    tangent = np.vstack([along, np.cross(n, along, axis=0)])
    reach = np.where(np.arange(COUNT) % 2, 0.002, 0.1)  # stuck and sliding
    anchor = x - along * reach * uniform(-1, 1) - tangent[3:] * reach * uniform(-1, 1)
    values = {
        "x": x,
        **on_sphere(x, inside),
        "grip": uniform(0.5, 2.0),
        "x_hat": x + uniform(-0.01, 0.01, 3),
        "inertia": uniform(1, 50),
        "weight": uniform(-0.1, 0.1, 3),
        "stiffness": uniform(50, 500),
        "damping": uniform(0.1, 2.0),
        "depth_n": np.maximum(0.0, uniform(-0.01, 0.02)),
        "tangent": tangent,
        "anchor": anchor,
        "slide_n": uniform(-0.003, 0.003, 2),
        "mu": uniform(0.1, 0.8, 3),
        "hold": uniform(0.5, 2.0),
        "yield_gauge": uniform(0.002, 0.006),
        "gauge_damping": uniform(1.0, 4.0),
        "cap": uniform(1.0, 1.3),
        "load": uniform(0.0, 2.0),
        "pull": uniform(-0.3, 0.3, 2),
        "foreseen": uniform(0.5, 2.0),
        "error": uniform(0.0, 0.002),
        "breaks": np.full((1, COUNT), np.inf),
        "pull_m": uniform(-0.3, 0.3, 2),
        "load_m": uniform(0.0, 2.0),
        "regime": np.where(np.arange(COUNT) < COUNT - 12, point.FREE, np.arange(COUNT) % 3 + point.OPEN)[None],
        "coupled": np.full((1, COUNT), float(coupled)),
        "load_n": uniform(0.0, 2.0),
        "f": uniform(-1, 1, 3),
        "of_segment": uniform(-1, 1),
        **some_mass(x, rng),
        "first": uniform(-0.01, 0.01, 3),
        "distance_n": uniform(-0.01, 0.01),
        "stored_n": uniform(0.0, 0.01),
        "segment_tangent": units(rng),
        "segment_director": units(rng),
        "deep": uniform(0.0, 0.01),
    }
    values |= presets(values)
    return {name: values[name] for name in point.LAYOUT.sizes}


def some_mass(x: np.ndarray, rng: np.random.Generator) -> Values:
    """Return the past of mass points near x; every other step is of BDF2."""
    dt = rng.uniform(0.005, 0.02, (1, COUNT))
    return {
        "past": np.vstack([x, x]) + rng.uniform(-0.01, 0.01, (6, COUNT)),
        "velocity": rng.uniform(-1, 1, (6, COUNT)),
        "mass": rng.uniform(0.01, 0.1, (1, COUNT)),
        "dt": dt,
        "span": np.where(np.arange(COUNT) % 2, 2 / 3 * dt, dt),
    }


def presets(v: Values) -> Values:
    """Return what (C1) and (C3) make of stiffness, damping, slide and depth."""
    damping, drag = v["damping"] / v["dt"], v["gauge_damping"] / v["dt"]
    stiff, r = v["stiffness"] + damping, 1.0 / (1.0 / v["yield_gauge"] + drag)
    return {"stiff": stiff, "carried": damping * v["depth_n"] / stiff, "r": r, "centre": drag * r * v["slide_n"]}


def some_node(seed: int = 13) -> Values:
    """Return joints that move in a medium and are pushed."""
    rng = np.random.default_rng(seed)
    x = rng.uniform(-1, 1, (3, COUNT))
    values = {"x": x, **some_mass(x, rng), "drag": rng.uniform(0.01, 1.0, (1, COUNT))}
    values |= {name: rng.uniform(-1, 1, (3, COUNT)) for name in ("weight", "external", "friction")}
    known = np.zeros((8, COUNT))
    assert list(node.LAYOUT.sizes)[-4:] == ["drag_hat", "x_hat", "inertia", "drag_rate"]
    empty = {"drag_hat": known[:3], "x_hat": known[3:6], "inertia": known[6:7], "drag_rate": known[7:]}
    known[:] = run("node_start", node.LAYOUT, values | empty)
    return {name: (values | empty)[name] for name in node.LAYOUT.sizes}


def difference(v: Values, new: np.ndarray, old: np.ndarray) -> np.ndarray:
    """Return the integrator's rate of change, of values at t_{n+1} and at t_n and t_{n-1}, shape (3, COUNT)."""
    bdf2 = (1.5 * new - 2.0 * old[:3] + 0.5 * old[3:]) / v["dt"]
    return np.where(np.arange(COUNT) % 2, bdf2, (new - old[:3]) / v["dt"])


def with_pull_of_the_law(values: Values) -> Values:
    """Return the values with friction (C3) and load of the place itself: what is foreseen for a step of nothing."""
    own = run("point_yielding", point.LAYOUT, values | AT_REST)
    return values | {"pull": own[PULL : PULL + 2], "foreseen": own[PULL + 2 : SWING]}


@pytest.mark.parametrize("inside", [False, True])
@pytest.mark.parametrize("coupled", [False, True])
def test_point_force_and_its_derivative_on_a_curved_world(coupled: bool, inside: bool) -> None:
    """The world is a ball or a hollow one, whose distance is |x - c| - R: normal and curvature turn with x.

    With a regime K is the derivative where what Newton foresaw is what the law says.
    """
    values = some_point(coupled, inside)
    own = run("point_yielding", point.LAYOUT, values | AT_REST)
    held = np.where(own[Y] < 0.0, point.STICKING_BACK, point.STICKING)
    held = np.where(own[EXCESS] > 0.0, point.SLIDING, held)
    values["regime"] = np.where(values["regime"] == point.STICKING, held, values["regime"])
    values = with_pull_of_the_law(values)

    def at(x: np.ndarray) -> np.ndarray:
        return run("point_stiffness", point.LAYOUT, values | {"x": x} | on_sphere(x, inside))

    out, h = at(values["x"]), 1e-6
    assert_allclose(run("point_force", point.LAYOUT, values | on_sphere(values["x"], inside)), out[:5], rtol=1e-14)
    K = out[STIFFNESS:].reshape(3, 3, COUNT)
    pushed = (out[LOAD] >= 0.0) | (
        not coupled
    )  # friction of what would pull is left out of K: it were a pushing spring
    assert pushed.sum() > COUNT - 5
    assert_close(K[..., pushed], differences(lambda x: at(x)[:3], values["x"], h)[..., pushed], 1e-6)
    if not coupled:
        assert_close(out[None, :3], differences(lambda x: at(x)[PHI : PHI + 1], values["x"], h), 1e-6)
    assert (np.abs(K - K.transpose(1, 0, 2)).max() > 1.0) == coupled
    yielding = run("point_yielding", point.LAYOUT, values | AT_REST)
    free, touching = values["regime"][0] == point.FREE, (out[LOAD] > 0.0)
    touching, sliding, ahead = free & touching, yielding[EXCESS] > 0.0, yielding[Y] > 0.0
    for kind in (touching & sliding & ahead, touching & sliding & ~ahead, touching & ~sliding, free & ~touching):
        assert kind.sum() >= 3, "every branch is among the states"


def test_a_regime_that_the_law_confirms_changes_nothing() -> None:
    """Newton's regimes OPEN, SLIDING and STICKING give force, derivative, potential and load of the law itself."""
    values = with_pull_of_the_law(some_point(coupled=True, inside=False) | {"regime": np.full((1, COUNT), point.FREE)})
    law, yielding = run("point_stiffness", point.LAYOUT, values), run("point_yielding", point.LAYOUT, values | AT_REST)
    sticking = np.where(yielding[Y] < 0.0, point.STICKING_BACK, point.STICKING)
    held = np.where(yielding[EXCESS] > 0.0, point.SLIDING, sticking)
    regime = np.where(yielding[TOUCHING] > 0.0, held, point.OPEN)
    assert len(set(regime)) == 4
    assert_allclose(
        run("point_stiffness", point.LAYOUT, values | {"regime": regime[None]}), law, rtol=1e-12, atol=1e-12
    )
    wrong = run("point_stiffness", point.LAYOUT, values | {"regime": np.where(regime == point.OPEN, 2.0, 1.0)[None]})
    assert (np.abs(wrong - law).max(axis=0) > 1e-6).all(), "and one that it denies does"


def test_looking_ahead_is_looking_from_there() -> None:
    """Displacement, excess and penetration at X + `first` are those seen at that place (of a plane: exactly)."""
    values = some_point(coupled=True, inside=False)
    there = values["x"] + values["first"]
    closer = values["distance"] + np.sum(values["normal"] * values["first"], axis=0)
    ahead = run("point_yielding", point.LAYOUT, values)
    seen = run("point_yielding", point.LAYOUT, values | AT_REST | {"x": there, "distance": closer})
    assert_allclose(ahead[: TOUCHING + 1], seen[: TOUCHING + 1], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("error", [0.0, 0.003])
def test_regimes_change_where_the_law_denies_them(error: float) -> None:
    """Each regime of each state, by the rules in words; what is denied by less than the error stays."""
    kinds = (point.OPEN, point.SLIDING, point.STICKING, point.STICKING_BACK)
    seen = set()
    for regime in kinds:
        more = {"regime": np.full((1, COUNT), regime), "error": np.full((1, COUNT), error)}
        v = some_point(coupled=True, inside=False, seed=9) | more
        v["distance"] = np.random.default_rng(3).uniform(-0.02, 0.01, (1, COUNT))
        out, now = run("point_yielding", point.LAYOUT, v), run("point_yielding", point.LAYOUT, v | AT_REST)
        f = out[PULL : PULL + 2] / np.array([np.where(out[PULL] > 0.0, v["mu"][0], v["mu"][1]), v["mu"][2]])
        inside = np.sum(f**2, axis=0) < point.HELD * v["cap"][0] ** 2
        mu_n, mu = (np.where(way[Y] > 0.0, v["mu"][0], v["mu"][1]) for way in (now, out))
        back = mu_n**2 * now[Y] * out[Y] + v["mu"][2] ** 2 * now[Y + 1] * out[Y + 1] <= 0.0
        for k in range(COUNT):
            side = point.STICKING if out[Y, k] >= 0.0 else point.STICKING_BACK
            if regime == point.OPEN:
                slides = out[EXCESS, k] > error and not back[k]
                expected = (point.SLIDING if slides else side) if out[TOUCHING, k] > error else point.OPEN
            elif out[TOUCHING, k] < -error:
                expected = point.OPEN
            elif regime == point.SLIDING:
                expected = side if out[EXCESS, k] < -error or inside[k] else point.SLIDING
            elif regime != side and abs(out[Y, k]) > error and mu[k] > 0.0:
                expected = side
            else:
                expected = point.SLIDING if out[EXCESS, k] > error else regime
            assert out[NEXT, k] == expected, (k, regime, side)
            changed = expected != regime or (regime == point.SLIDING and out[SWING, k] > point.SWUNG)
            assert out[STALE, k] == changed
            seen.add((regime, expected))
    assert len(seen) > 10, seen


def test_a_contact_is_expected_to_go_on_as_in_its_last_steps() -> None:
    """Each regime of each state, by the rules in words: what lifts, breaks away, turns or lands by its trend."""
    seen = set()
    for regime in (point.OPEN, point.SLIDING, point.STICKING, point.STICKING_BACK):
        v = some_point(coupled=True, inside=False, seed=5) | {"regime": np.full((1, COUNT), regime)}
        v["load_m"] = np.where(np.arange(COUNT) % 5 == 0, 0.0, 2.2 * v["load_m"])
        v["distance"] = np.random.default_rng(6).uniform(-0.02, 0.02, (1, COUNT))
        out, along = run("point_expected", point.LAYOUT, v), v["tangent"].reshape(2, 3, COUNT)
        y = np.einsum("idk,dk->ik", along, v["x"] + v["first"] - v["anchor"]) - v["centre"]
        trend = 2.0 * v["pull"] - v["pull_m"]
        mu, mu_of_trend = (np.vstack([np.where(x[0] > 0.0, *v["mu"][:2]), v["mu"][2]]) for x in (y, trend))
        rho, share = np.hypot(*(mu * y)), np.hypot(*(trend / mu_of_trend))
        touching = -v["distance"][0] - v["carried"][0] - np.sum(v["normal"] * v["first"], axis=0)
        for k in range(COUNT):
            cap, known, pull, load, expected = v["cap"][0, k], v["load_m"][0, k] > 0.0, v["pull"][:, k], None, regime
            against = cap * mu[:, k] ** 2 * y[:, k] / max(rho[k], cap * v["r"][0, k])
            if regime == point.OPEN and touching[k] > 0.0:
                expected, pull, load = point.SLIDING, against, v["stiff"][0, k] * v["error"][0, k]
            elif regime >= point.STICKING and known and share[k] > cap:
                expected, pull = point.SLIDING, trend[:, k] * cap / share[k]
            elif regime == point.SLIDING and rho[k] > cap * v["r"][0, k] and y[:, k] @ pull < 0.0:
                pull = against
            if regime != point.OPEN and known and 2.0 * v["load_n"][0, k] < v["load_m"][0, k]:
                expected = point.OPEN
            assert_allclose(out[:2, k], pull, rtol=1e-9, atol=1e-12)
            assert out[2, k] == pytest.approx(v["load_n"][0, k] if load is None else load)
            assert out[3, k] == expected, (k, regime)
            seen.add((regime, expected))
    assert len(seen) == 10, seen


def test_newtons_own_friction_is_that_of_its_linear_equation() -> None:
    """(C5) against (C3): m f = cap M^2 y, made linear in f and y, holds for f' and y + dy; f' is inside the set."""
    v = some_point(coupled=True, inside=False, seed=8) | {"regime": np.full((1, COUNT), point.SLIDING)}
    out, now = run("point_yielding", point.LAYOUT, v), run("point_yielding", point.LAYOUT, v | AT_REST)
    y, dy, f, cap = now[Y : Y + 2], out[Y : Y + 2] - now[Y : Y + 2], v["pull"], v["cap"][0]
    mu = np.array([np.where(y[0] > 0.0, v["mu"][0], v["mu"][1]), v["mu"][2]])
    limit = cap / (1.0 / v["yield_gauge"][0] + v["gauge_damping"][0] / v["dt"][0])

    def m(at: np.ndarray) -> np.ndarray:
        return np.maximum(limit, np.hypot(*(mu * at)))

    h = 1e-6
    slope = (m(y + h * dy) - m(y - h * dy)) / (2.0 * h)  # of m along dy
    expected = (cap * mu**2 * (y + dy) - f * slope) / m(y)
    of = np.array([np.where(expected[0] > 0.0, v["mu"][0], v["mu"][1]), v["mu"][2]])
    size = np.hypot(*(expected / of))
    sliding = m(y) > limit
    assert 5 < sliding.sum() < COUNT - 5
    assert 5 < (size > cap).sum() < COUNT - 5
    assert_allclose(out[PULL : PULL + 2], expected * np.minimum(1.0, cap / size), rtol=1e-7, atol=1e-9)
    assert_allclose(out[SWING], np.sum((mu * dy) ** 2, axis=0) / m(y) ** 2, rtol=1e-12)
    force = run("point_force", point.LAYOUT, with_pull_of_the_law(v))[:3]
    without = run("point_force", point.LAYOUT, v | {"hold": np.zeros((1, COUNT))})[:3]
    load = run("point_force", point.LAYOUT, v)[LOAD]
    own = with_pull_of_the_law(v)["pull"]
    friction = v["hold"][0] * load * (own[0] * v["tangent"][:3] + own[1] * v["tangent"][3:])
    assert_allclose(force - without, friction, rtol=0, atol=1e-12)


def test_point_force_is_that_of_the_equations() -> None:
    """(C1), (C2) and (C3) with (C4): the force of the anchor's spring and damper, both capped together by the load."""
    v = some_point(coupled=True, inside=False, seed=6) | {"regime": np.full((1, COUNT), point.FREE)}
    g, n, k, c, dt = v["distance"][0], v["normal"], v["stiffness"][0], v["damping"][0], v["dt"][0]
    load = np.maximum(0.0, k * -g + c / dt * (-g - v["depth_n"][0]))
    along, left = v["tangent"][:3], v["tangent"][3:]
    s = np.array([np.sum(t * (v["x"] - v["anchor"]), axis=0) for t in (along, left)])
    per_rho, per_rate = 1 / v["yield_gauge"][0], v["gauge_damping"][0] / dt
    y = s - per_rate * v["slide_n"] / (per_rho + per_rate)
    mu = np.array([np.where(y[0] > 0.0, v["mu"][0], v["mu"][1]), v["mu"][2]])
    elastic = per_rho * s + per_rate * (s - v["slide_n"])  # spring and damper in the gauge
    gauge = np.sqrt(np.sum((mu * elastic) ** 2, axis=0))
    share = np.minimum(1.0, v["cap"][0] / gauge)
    force = v["hold"][0] * load * share * mu**2 * elastic
    expected = v["inertia"] * (v["x"] - v["x_hat"]) - v["weight"] - load * n + force[0] * along + force[1] * left
    out = run("point_force", point.LAYOUT, v)
    assert_allclose(out[LOAD], load, rtol=1e-12)
    assert_allclose(out[:3], expected, rtol=0, atol=1e-12)
    friction = np.sqrt(np.sum((force / (mu * np.where(load > 0, v["hold"][0] * load, 1.0))) ** 2, axis=0))
    assert (friction <= v["cap"][0] * (1 + 1e-12)).all(), "inside the set"
    assert ((share < 1.0) & (load > 0.0)).sum() > 3


def test_tangents_are_the_segment_projected_and_its_left() -> None:
    """Orthonormal, in the tangent plane, along the segment; where that stands upright, along its upward normal."""
    v = some_point(coupled=True, inside=False, seed=11)
    upright = np.arange(COUNT) % 4 == 0
    v["segment_tangent"] = np.where(upright, v["normal"], v["segment_tangent"])
    v["segment_director"] = across(v["segment_tangent"], np.random.default_rng(3))
    out = run("point_start", point.LAYOUT, v)[:8]
    along, left = out[:3], out[3:6]
    pointing = np.where(upright, np.cross(v["segment_tangent"], v["segment_director"], axis=0), v["segment_tangent"])
    for a, b, expected in ((along, along, 1.0), (left, left, 1.0), (along, left, 0.0), (along, v["normal"], 0.0)):
        assert_allclose(np.sum(a * b, axis=0), expected, rtol=0, atol=1e-12)
    assert_allclose(np.cross(v["normal"], along, axis=0), left, rtol=0, atol=1e-12)
    assert (np.sum(along * pointing, axis=0) > 0.0).all(), "towards the head"
    assert_allclose(np.sum(left * pointing, axis=0), 0.0, rtol=0, atol=1e-12)
    away = v["x"] - v["anchor"]
    assert_allclose(out[6:], [np.sum(along * away, axis=0), np.sum(left * away, axis=0)], rtol=0, atol=1e-13)


def test_start_of_a_step_is_that_of_the_equations() -> None:
    """Presets of contact, friction and inertia; how deep a point gets is g + v.n dt below zero, where it approaches."""
    v = some_point(coupled=True, inside=False, seed=12)
    v["stiffness"][0, :4] = 0.0
    out, layout = run("point_start", point.LAYOUT, v), point.LAYOUT
    found = {name: out[layout.first(name) - layout.first("tangent") :][: layout.sizes[name]] for name in layout.sizes}
    v |= {"slide_n": found["slide_n"], "depth_n": np.maximum(0.0, -v["distance"])}
    speed = difference(v, found["x_hat"], v["past"])
    closing = -np.sum(v["velocity"][:3] * v["normal"], axis=0)
    strikes = (closing > 0.0) & (v["stiffness"][0] > 0.0)
    assert 5 < strikes.sum() < COUNT - 5
    expected = presets(v) | {
        "inertia": v["mass"] / v["span"] ** 2,
        "depth_n": v["depth_n"],
        "distance_n": v["distance"],
        "hold": v["grip"],
        "load": v["load_n"],
        "deep": np.where(strikes, closing * v["dt"] - v["distance"], 0.0),
    }
    for name, value in expected.items():
        assert_allclose(found[name], value, rtol=1e-13, atol=1e-16, err_msg=name)
    assert_allclose(difference(v, speed, v["velocity"]), 0.0, rtol=0, atol=1e-9)  # no acceleration


def test_a_joints_ledger_closes_and_its_terms_are_those_of_the_equations() -> None:
    """Inertia and medium times motion is the gain of kinetic energy and what is lost, each by its own formula."""
    v = some_node()
    out = run("node_after", node.LAYOUT, v)
    terms = dict(zip(node.LEDGER_TERMS, out, strict=False))
    moved, speed = v["x"] - v["past"][:3], difference(v, v["x"], v["past"])
    assert_allclose(out[len(node.LEDGER_TERMS) :], speed, rtol=0, atol=1e-12)
    against = v["mass"] * difference(v, speed, v["velocity"]) + v["drag"] * speed
    spent = terms["kinetic"] + terms["viscous_loss"] + terms["numerical_loss"]
    assert_allclose(spent, np.sum(against * moved, axis=0), rtol=0, atol=1e-12 * np.abs(against).max())
    kinetic = v["mass"] / 2 * (speed**2 - v["velocity"][:3] ** 2)
    assert_allclose(terms["kinetic"], kinetic.sum(axis=0), rtol=1e-11)
    assert_allclose(terms["viscous_loss"], (v["drag"] * speed**2 * v["dt"]).sum(axis=0), rtol=1e-11)
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


def some_inputs(function: ca.Function) -> tuple[Layout, Values]:
    name = function.name()
    if name.startswith("segment"):
        return segment.LAYOUT, some_segment(7)
    if name.startswith("joint"):
        return joint.LAYOUT, some_joint(8)
    if name.startswith("node"):
        return node.LAYOUT, some_node()
    return point.LAYOUT, some_point(coupled=True, inside=False, seed=9)


@pytest.mark.parametrize("make", FUNCTIONS, ids=lambda f: f"{f.__module__.split('.')[-1]}_{f.__name__}")
def test_native_kernels_equal_casadis_virtual_machine(make: Callable[[], ca.Function]) -> None:
    """To 1e-13 of each output's size: its largest entry over the states, sums cancel in single ones."""
    function = make()
    layout, values = some_inputs(function)
    native = run(function.name(), layout, values)
    virtual = evaluated(compile_kernel(function, backend="casadi"), layout, values)
    assert kernels()[function.name()].backend == "llvm"
    scale = np.abs(virtual).max(axis=1, keepdims=True)
    assert np.isfinite(virtual).all()
    assert (np.abs(native - virtual) <= 1e-13 * scale).all()


def test_world_kernel_equals_the_planes_equation() -> None:
    plane = Plane(0.3, 0.8)
    kernel, points = plane.kernel(), np.random.default_rng(0).uniform(-1, 1, (5, 3))
    normal = np.array([-np.sin(0.3) * np.cos(0.8), -np.sin(0.3) * np.sin(0.8), np.cos(0.3)])
    assert_allclose(plane.distance(points), points @ normal, rtol=1e-14, atol=1e-15)
    assert_allclose(kernel.parameters[6:9], normal, rtol=1e-14)
