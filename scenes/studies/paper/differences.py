"""Differences between the text of the paper and the program of its author, and their effects on the results.

The effect of most differences is measured by a run with six segments and a wave period of 2 s. In this run the
program follows the text in this point and is unchanged otherwise. If the program has no parameter for the point, the
effect is computed from the unchanged run.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from planar import published
from planar.published import Parameters, Run

MASS = 10.0 * (np.sqrt(3.0) / 4.0 / 6.0)
"""Mass of six rhombi [kg]: the density of Table I [kg/m^3] times their area at rest [m^2] times a depth of 1 m."""


@dataclass(frozen=True)
class Difference:
    """A difference between text and program: what differs, what the text says, what the program does, the effect."""

    what: str
    text: str
    program: str
    effect: str


def differences(program_run: Run) -> list[Difference]:
    """Return the differences with their effects on the published run of six segments at T_wave = 2 s.

    Makes about ten additional runs of the program.
    """
    return [Difference(what, text, program, effect(program_run)) for what, text, program, effect in _ENTRIES]


def _with(parameters: Parameters, label: str) -> Callable[[Run], str]:
    """Return a function that runs the program with other parameters, and describes the effect on the published run.

    `label` names the change in the description.
    """

    def effect(run: Run) -> str:
        other = published.simulate(parameters=parameters)
        unconverged = f"; {other.unconverged_steps} steps unconverged" if other.unconverged_steps else ""
        inverted = f"; segments inside out in {other.inverted_steps} steps" if other.inverted_steps else ""
        ending = f"; {other.stop.sentence}" if other.status.diverged else ""
        return (
            f"{label}: reported distance {other.reported_distance:.6g} m (program {run.reported_distance:.6g}), "
            f"true {other.true_displacement:.6g} m ({run.true_displacement:.6g}), "
            f"work {other.work:.6g} J ({run.work:.6g}){unconverged}{inverted}{ending}"
        )

    return effect


def _torsion(run: Run) -> str:
    main = run.q[:, run.net.main]
    e = np.diff(main, axis=1)
    t = e / np.linalg.norm(e, axis=-1, keepdims=True)
    cross = t[:, :-1, 0] * t[:, 1:, 1] - t[:, :-1, 1] * t[:, 1:, 0]
    return (
        f"none: with the main nodes' y held the chain stays straight, |cross| <= {np.abs(cross).max():.1g} "
        "in the whole run, so that the springs would exert no force whatever their stiffness"
    )


def _residual_loads(run: Run) -> str:
    other = published.simulate(steps=200, parameters=Parameters(normal_load="residual"))
    return (
        f"it blows up: after {other.time[-1]:g} s the true displacement is {other.true_displacement:.3g} m, "
        f"{other.unconverged_steps} of 200 steps unconverged; loads of newtons act on a worm of 1e-8 kg"
    )


def _centre_of_mass(run: Run) -> str:
    return f"distance {run.reported_distance:.6f} m instead of {run.true_displacement:.6f} m"


def _work(run: Run) -> str:
    return (
        f"work {run.work:.6f} J; with its sign, but dq from the snapped start, {run.work_contract.sum():.6f} J; "
        f"by (P11) as it stands {run.work_contract_p11.sum():.6f} J: the forces take energy out on balance"
    )


def _plotted_cost(run: Run) -> str:
    return (
        f"the curve ends at {run.cumulative_cot[-1]:.6g} J/m, total work over total distance is "
        f"{run.total_cot:.6g} J/m; steps in which the centre of mass hardly moves dominate the sum"
    )


def _snaps(run: Run) -> str:
    snapped = int((np.abs(run.start - run.q[:-1]).max(axis=(1, 2)) > 0.0).sum())
    without = published.simulate(parameters=Parameters(snap=False))
    far = published.simulate(parameters=Parameters(ground_clearance=100.0))
    return (
        f"{snapped} of {len(run.start)} steps start from a moved configuration; without moving it the work is "
        f"{without.work:.6g} J ({1 - without.work / run.work:.1%} less), reported distance "
        f"{without.reported_distance:.6g} m; without a ground within reach {far.work:.6g} J and "
        f"{far.reported_distance:.6g} m"
    )


def _friction_nodes(run: Run) -> str:
    lowest = float(run.q[:, run.net.main, 1].min())
    return (
        f"the nodes with friction stay at y = {lowest:g} m, {lowest - run.ground:.3g} m above the ground that the "
        "connectors touch without any friction"
    )


def _wave_name(run: Run) -> str:
    peaks = run.activation[: round(2.0 / run.dt)].argmax(axis=0)
    return f"none but the name: segments peak one after the other, {np.diff(peaks)[0] * run.dt:.2f} s apart"


_ENTRIES: list[tuple[str, str, str, Callable[[Run], str]]] = [
    (
        "sign of the elastic force",
        "M q'' - dE/dq - ... = 0 in (P3); but an elastic force is minus the gradient, so that it should be + dE/dq",
        "as (P3) is printed: -dE/dq in the residual",
        _with(Parameters(elastic_sign=1.0), "with the right sign"),
    ),
    (
        "centre of mass",
        "centre of mass along x",
        "mean of every third entry of (x0, y0, x1, y1, ...), which mixes x and y of main nodes and connectors",
        _centre_of_mass,
    ),
    (
        "link stiffness",
        "k_link = 0.12 (Table I, where it is called a torsional stiffness)",
        "1e4 N in (P7) for each of the four links",
        _with(Parameters(k_link=0.12), "with 0.12 N in (P7)"),
    ),
    ("torsional springs", "k_torsion = 1e4 (Table I), (P6)", "switched off", _torsion),
    (
        "mass",
        "density 10 kg/m^3 (Table I), no depth",
        "1e-8 kg in all, 1e-11 kg of it on the connectors",
        _with(
            Parameters(mass=MASS, connector_mass=1e-3 * MASS),
            f"with {MASS:.3g} kg (a depth of 1 m; the shares as in the program)",
        ),
    ),
    (
        "where friction acts",
        "on what touches the ground",
        "on the main nodes, whose height is held; from their velocity at the start of the step",
        _friction_nodes,
    ),
    (
        "normal loads of the friction",
        "from the residual of the held y in a predictor, (P9)",
        "m_i g of each main node, constant, whether or not anything touches the ground; weight acts nowhere else",
        _residual_loads,
    ),
    (
        "wave",
        "A = sin(kx - wt); section V names non-rectified profiles as future work, so rectified is implied",
        "max(0, sin(kx - wt))",
        _with(Parameters(rectified=False), "not rectified"),
    ),
    (
        "name of the wave",
        "standing wave (Fig. 9 and III.B), travelling wave (III.C)",
        "travelling wave",
        _wave_name,
    ),
    (
        "amplitude",
        "A = sin(kx - wt), no factor",
        "times 10 N, vertically on the connectors",
        _with(Parameters(contraction_force=1.0), "with 1 N"),
    ),
    (
        "Newton's tolerance",
        "EI/L^2 * 1e-3, without a value of EI",
        "1e-6 N, tested before the update that follows it",
        _with(Parameters(tolerance=1e-9), "with 1e-9 N"),
    ),
    (
        "predictor and corrector",
        "forward Euler predictor, implicit corrector, friction from the loads of the predictor",
        "implicit predictor; where contact changes, touching nodes of the start configuration are set on the ground",
        _snaps,
    ),
    ("work", "(P11), F . (q_{n+1} - q_n)", "|F . dq| summed, dq counted after touching nodes were moved", _work),
    (
        "cumulative cost of transport",
        "(P12), work over displacement of each step",
        "sum of |work / dx| over the steps with |dx| > 1e-6 m",
        _plotted_cost,
    ),
    (
        "head",
        "index 0, the wave runs head to tail",
        "moves away from index 0",
        lambda run: f"index 0 is the tail: displacement {run.true_displacement:+.6f} m along x",
    ),
    (
        "static friction",
        "mu_s = 0.12 (Table I)",
        "not used; 0.3 mu_k and 2 mu_k with mu_k = 0.10 are",
        lambda run: "none: nothing reads it",
    ),
]
"""The differences: name, text, program, and a function that takes the published run and describes the effect."""
