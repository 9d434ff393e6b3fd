"""Random states of the kernels, and what tests of them share."""

from collections.abc import Callable

import casadi as ca
import numpy as np

from worm3d.machine.codegen import Kernel, evaluate
from worm3d.physics.actuators import FirstOrder
from worm3d.physics.friction_laws import Coulomb, FrictionLaw
from worm3d.physics.kernels import actuator, joint, node, point, segment
from worm3d.physics.kernels.layout import Layout
from worm3d.running.plant import kernels
from worm3d.solver.regimes import PREDICTED_FRICTION, SWING

COUNT = 40
"""Random states of each kernel."""

AT_REST = {"first": np.zeros((3, COUNT))}
"""Seen from where the point is."""

Values = dict[str, np.ndarray]
"""Inputs by name, each (size, COUNT)."""


def run(name: str, layout: Layout, values: Values, law: type[FrictionLaw] = Coulomb) -> np.ndarray:
    """Return a native kernel's outputs, shape (rows, COUNT), for inputs by name, each (size, COUNT)."""
    return evaluated(kernels(law)[name], layout, values)


def evaluated(kernel: Kernel, layout: Layout, values: Values) -> np.ndarray:
    assert set(values) == set(layout.sizes)
    inputs, outputs = kernel.allocate(COUNT)
    rows = np.vstack([values[name] for name in layout.sizes])
    inputs[: len(rows), :COUNT] = rows  # those behind them are of actuators, which have no part in the potential
    evaluate(kernel.address, inputs, outputs, COUNT)
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
        "roll_damping": uniform(0.1, 1.0),
        "span": uniform(0.005, 0.02),
        "dt": uniform(0.005, 0.02),
        "weights": np.vstack([np.full(COUNT, 4 / 3), np.full(COUNT, -1 / 3)]),
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


CENTRE, RADIUS = np.array([[0.3], [-0.2], [-0.9]]), 1.0
"""Centre and radius of the ball that is the world of the points [m]."""


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
        "hardness": np.ones((3, COUNT)),
        "hold": uniform(0.5, 2.0),
        "yield_gauge": uniform(0.002, 0.006),
        "gauge_damping": uniform(1.0, 4.0),
        "limit_ratio": uniform(1.0, 1.3),
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
        "law": uniform(0.5, 2.0, 4),
    }
    values |= presets(values)
    return {name: values[name] for name in point.POINT_LAYOUT.sizes}


def some_mass(x: np.ndarray, rng: np.random.Generator) -> Values:
    """Return the past of mass points near x; every other step is of BDF2, after one of another length."""
    dt = rng.uniform(0.005, 0.02, (1, COUNT))
    ratio = np.where(np.arange(COUNT) % 2, np.linspace(0.3, 2.0, COUNT), 0.0)[None]
    return {
        "past": np.vstack([x, x]) + rng.uniform(-0.01, 0.01, (6, COUNT)),
        "velocity": rng.uniform(-1, 1, (6, COUNT)),
        "mass": rng.uniform(0.01, 0.1, (1, COUNT)),
        "dt": dt,
        "span": dt * (1.0 + ratio) / (1.0 + 2.0 * ratio),
        "ratio": ratio,
        "lands": np.arange(COUNT)[None] % 3 == 0,
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
    assert list(node.NODE_LAYOUT.sizes)[-4:] == ["drag_hat", "x_hat", "inertia", "drag_rate"]
    empty = {"drag_hat": known[:3], "x_hat": known[3:6], "inertia": known[6:7], "drag_rate": known[7:]}
    known[:] = run("node_start", node.NODE_LAYOUT, values | empty)
    return {name: (values | empty)[name] for name in node.NODE_LAYOUT.sizes}


def difference(v: Values, new: np.ndarray, old: np.ndarray) -> np.ndarray:
    """Return the integrator's rate of change, of values at t_{n+1} and at t_n and t_{n-1}, shape (3, COUNT).

    It is that of Newton's parabola through the three: the last slope, and dt times the second divided difference.
    """
    dt, bdf2 = v["dt"], v["ratio"] > 0.0
    before = dt / np.where(bdf2, v["ratio"], 1.0)
    slope, slope_before = (new - old[:3]) / dt, (old[:3] - old[3:]) / before
    return slope + np.where(bdf2, dt * (slope - slope_before) / (dt + before), 0.0)


def with_pull_of_the_law(values: Values, law: type[FrictionLaw] = Coulomb) -> Values:
    """Return the values with friction (C3) and load of the place itself: what is foreseen for a step of nothing."""
    own = run("point_yielding", point.POINT_LAYOUT, values | AT_REST, law)
    return values | {
        "pull": own[PREDICTED_FRICTION : PREDICTED_FRICTION + 2],
        "foreseen": own[PREDICTED_FRICTION + 2 : SWING],
    }


def some_actuated(layout: Layout, values: Values) -> tuple[Layout, Values]:
    """Return the layout, and values of the inputs that it has beside those given."""
    rng = np.random.default_rng(11)
    more = {name: size for name, size in layout.sizes.items() if name not in values}
    return layout, values | {name: rng.uniform(0.1, 0.4, (size, COUNT)) for name, size in more.items()}


def some_inputs(function: ca.Function) -> tuple[Layout, Values]:
    name = function.name()
    if name.startswith("actuator"):
        return some_actuated(actuator.chambers(FirstOrder), some_segment(7))
    if name.startswith("hinge"):
        return some_actuated(actuator.hinges(FirstOrder), some_joint(8))
    if name.startswith("segment"):
        return segment.SEGMENT_LAYOUT, some_segment(7)
    if name.startswith("joint"):
        return joint.JOINT_LAYOUT, some_joint(8)
    if name.startswith("node"):
        return node.NODE_LAYOUT, some_node()
    return point.POINT_LAYOUT, some_point(coupled=True, inside=False, seed=9)
