"""Kernels of joints as mass points: inertia, weight, viscous medium and forces, before and after a step."""

from __future__ import annotations

import casadi as ca

from worm3d.physics.kernels import inertia, losses
from worm3d.physics.kernels.layout import Layout

NODE_LAYOUT = Layout(
    {
        "x": 3,
        **inertia.SIZES,
        "drag": 1,  # [N s/m]
        "weight": 3,  # m g [N]
        "external": 3,  # force at t_{n+1} [N]
        "friction": 3,  # (P10) of the clamped worm [N]
        "drag_hat": 3,
        "x_hat": 3,
        "inertia": 1,  # m/(beta dt)^2 [N/m]
        "drag_rate": 1,  # drag/(beta dt) [N/m]
    }
)


def start() -> ca.Function:
    """Return the quantities that are known at the start of a step: the rows from "drag_hat" on (8)."""
    s = NODE_LAYOUT.symbols
    rows = {"drag_hat": inertia.still(s), "x_hat": inertia.coasting(s), "inertia": inertia.stiffness(s)}
    return NODE_LAYOUT.function("node_start", {**rows, "drag_rate": s["drag"] / s["span"]})


LEDGER_TERMS = (
    "kinetic",
    "potential",
    "work_external",
    "friction_loss",
    "work_friction_p13",
    "drag_loss",
    "impact",
    "numerical_loss",
)


def after() -> ca.Function:
    """Return the joint's terms of the energy ledger, in the order of `LEDGER_TERMS`, and its velocity (3)."""
    s = NODE_LAYOUT.symbols
    moved = inertia.motion(s)  # a joint's coordinates are its position, so this is also the first-order motion
    own = inertia.ledger(s, moved)
    rubbed = ca.dot(s["friction"], moved)
    axes = [losses.damper(s["drag"], s["x"][d] - s["drag_hat"][d], s["span"], s["dt"], moved[d]) for d in range(3)]
    viscous = [ca.sum1(ca.vertcat(*of)) for of in zip(*axes, strict=True)]
    terms = {
        **own,
        "work_external": ca.dot(s["external"], moved),
        "friction_loss": -rubbed,
        "work_friction_p13": rubbed,
        "drag_loss": viscous[0],
        "numerical_loss": own["numerical_loss"] + viscous[1],
    }
    return NODE_LAYOUT.function(
        "node_after", {"terms": [terms[name] for name in LEDGER_TERMS], "v": inertia.velocity(s)}
    )


def momenta() -> ca.Function:
    """Return momentum (3), angular momentum about the origin (3) and mass times position (3)."""
    return NODE_LAYOUT.function("node_momenta", {"momenta": inertia.momenta(NODE_LAYOUT.symbols)})
