"""The model `planar_linkage`: simulation of the corrected planar worm from a scene, and the record of the run."""

from __future__ import annotations

from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np

from planar import linkage
from planar.metrics import p12_cost_of_transport
from scenes.models.base import MOVIE_S, Model, Movie, Observer, Outcome, pictures, status_word
from scenes.models.planar.linkage_scene import LINKAGE_CHECKS, LinkageScene, simulate
from scenes.models.planar.merit import NO_STEP, Travel, common, movie, no_cost_because
from scenes.records import overview
from scenes.records.record import Record
from worm3d.values.arrays import FloatArray
from worm3d.values.period_means import SHORT_RUN
from worm3d.values.variable import Variable

if TYPE_CHECKING:
    from PIL.Image import Image

LINKAGE_ADVICE = (
    "try a smaller run.dt_s or gait.amplitude, a longer gait.period_s, a lighter worm or larger worm.spring_N, "
    "worm.torsion_J or worm.kelvin_voigt_time_s"
)

SUPPLIED_ENERGY = {
    "work_contract": "work of the actuators",
    "work_external": "work of external forces",
    "load_change": "anchor energy changed by the normal loads",
}
STORED_ENERGY = {
    "kinetic": "change of kinetic energy",
    "elastic": "change of elastic energy",
    "potential": "change of potential energy of the weight",
    "penetration": "change of energy of the normal contact",
    "anchor": "change of energy of the friction's anchors",
}
LOST_ENERGY = {
    "friction_loss": "loss to friction",
    "viscous_loss": "loss to Kelvin-Voigt damping, medium and friction's dampers",
    "impact": "loss to impacts on the ground",
    "numerical_loss": "numerical loss of implicit Euler",
}
PAPERS = {
    "work_contract_p11": "work F.dq of the contraction force, (P11)",
    "work_friction_p13": "work F.dq of the friction force, (P13)",
}


def run(scene: LinkageScene, observer: Observer) -> Outcome:
    """Simulate a scene with the corrected worm."""
    start = perf_counter()
    result = simulate(scene, observer)
    wall_s = perf_counter() - start
    summary = merits(scene, result)
    ended = status_word(result.status), result.stop.sentence
    return Outcome(*ended, _variables(scene, result), summary, reasons(summary), wall_s)


def cumulative_cost(work: FloatArray, com_x: FloatArray, shortest: float = 1e-6) -> FloatArray:
    """Return the cumulative cost of transport (P12), (P14) as the paper plots it, shape (S,) [J/m].

    It is the sum of |work / dx| over the steps, where dx is the displacement of the centre of mass in a step. Steps
    with |dx| <= `shortest` [m] are left out.
    """
    cumulative: FloatArray = np.cumsum(np.abs(p12_cost_of_transport(work, com_x, shortest)))
    return cumulative


def merits(scene: LinkageScene, result: linkage.Run) -> dict[str, float | None]:
    """Return the entries of `summary.json` for a run."""
    ledger, worm = result.ledger, result.worm
    travel = Travel.of(result.com, result.time, scene.gait.period_s)
    work = float(ledger.work_contract.sum())
    weight = worm.total_mass * scene.ground.gravity_m_s2
    cumulative = cumulative_cost(ledger.work_contract_p11, result.com[:, 0])
    in_lengths = scene.gait.period_s / worm.length
    return {
        **common(result, travel, (work, ledger.uses["friction"]), weight, ledger.balance_error),
        "speed_BL_per_period": None if travel.mean_speed is None else travel.mean_speed * in_lengths,
        "work_contract_positive_J": float(np.maximum(0.0, ledger.work_contract).sum()),
        "work_contract_p11_J": float(ledger.work_contract_p11.sum()),
        "work_friction_p13_J": float(ledger.work_friction_p13.sum()),
        "cumulative_cot_J_per_m": float(cumulative[-1]) if result.steps else None,
        "mass_kg": worm.total_mass,
        "halved_steps": float(result.halved_steps),
        **{f"work_{name}_J": joules for name, joules in ledger.uses.items()},
    }


def reasons(summary: dict[str, float | None]) -> dict[str, str]:
    """Return the reasons why entries of the summary have no value."""
    return {
        **dict.fromkeys(("path_length_m", "mean_speed_m_s", "speed_BL_per_period"), SHORT_RUN),
        **dict.fromkeys(("newton_iterations_mean", "cumulative_cot_J_per_m"), NO_STEP),
        "cost_of_transport": no_cost_because(
            summary["work_contract_J"], summary["distance_m"], "the worm gave its actuators more than they gave it"
        ),
    }


def _variables(scene: LinkageScene, result: linkage.Run) -> tuple[Variable, ...]:
    parts = np.array([len(each) for each in result.steps], dtype=np.int64)
    return (
        *states(result, scene.run.record_every),
        Variable("step_time", ("step",), result.time[1:], "s", "end of each time step"),
        *(_contact(scene, result) if scene.ground.kind == "contact" else _clamped(result)),
        *_energies(result),
        Variable("newton_iterations", ("step",), result.newton_iterations, "1", "evaluations of the Jacobian"),
        Variable("parts", ("step",), parts, "1", "parts that the step was taken in, 1 for a whole one"),
    )


def states(result: linkage.Run, every: int) -> tuple[Variable, ...]:
    """Return the variables of position and command of the worm, at every `every`-th step."""
    stored, time = slice(None, None, every), ("time",)
    apexes = result.apexes[stored]
    return (
        Variable("time", time, result.time[stored], "s", "time"),
        Variable("joint", ("time", "joint", "axis"), result.joints[stored], "m", "joints, from tail to head"),
        Variable("bottom_apex", ("time", "segment", "axis"), apexes[:, :, 0], "m", "bottom apex of each segment"),
        Variable("top_apex", ("time", "segment", "axis"), apexes[:, :, 1], "m", "top apex of each segment"),
        Variable("com", ("time", "axis"), result.com[stored], "m", "centre of mass of joints and apexes"),
        Variable("com_velocity", ("time", "axis"), result.com_velocity[stored], "m/s", "its velocity"),
        Variable("length", ("time", "segment"), result.length[stored], "m", "length of each segment"),
        Variable("contraction", ("time", "segment"), result.contraction[stored], "1", "commanded contraction"),
    )


def _contact(scene: LinkageScene, result: linkage.Run) -> tuple[Variable, ...]:
    load = result.normal_load[:: scene.run.record_every]
    return (
        Variable("ground", (), 0.0, "m", "height of the ground"),
        Variable("normal_load", ("time", "segment", "side"), load, "N", "normal load of each apex [bottom, top]"),
        Variable("slip", ("step", "segment", "side"), result.slip, "m", "metres slid by each apex [bottom, top]"),
    )


def _clamped(result: linkage.Run) -> tuple[Variable, ...]:
    return (
        Variable("joint_load", ("step", "joint"), result.joint_load, "N", "normal load of each joint, (P9)"),
        Variable("joint_friction", ("step", "joint"), result.joint_friction, "N", "friction on each joint, (P10)"),
    )


def _energies(result: linkage.Run) -> tuple[Variable, ...]:
    ledger, com_x = result.ledger, result.com[:, 0]
    terms = {
        **SUPPLIED_ENERGY,
        **STORED_ENERGY,
        **LOST_ENERGY,
        **PAPERS,
        "residual": "what comes in less what is stored or lost",
    }
    costs = {
        "cumulative_cot_contract": ("work_contract_p11", "cumulative |cost of transport| of contraction, (P12)"),
        "cumulative_cot_friction": ("work_friction_p13", "cumulative |cost of transport| of friction, (P14)"),
    }
    return (
        *(Variable(name, ("step",), getattr(ledger, name), "J", meaning) for name, meaning in terms.items()),
        *(
            Variable(name, ("step",), cumulative_cost(getattr(ledger, work), com_x), "J/m", meaning)
            for name, (work, meaning) in costs.items()
        ),
    )


POINT_VARIABLES = ("joint", "top_apex", "bottom_apex")
"""Names of the variables of the joints and apexes, for the overview and the movie."""


def _overview(record: Record) -> Image:
    return overview.of_planar(record, POINT_VARIABLES, record["contraction"][-1])


def animate(record: Record) -> Movie:
    """Return the movie of a record with the variables of `states`."""
    contraction = record["contraction"]
    most = np.abs(contraction[record["time"] <= MOVIE_S]).max() or 1.0
    return movie(record, POINT_VARIABLES, contraction / most)


LINKAGE_MODEL = Model(
    name="planar_linkage",
    title="the paper's planar worm with the physics right",
    schema=LinkageScene,
    checks=LINKAGE_CHECKS,
    run=run,
    figures=pictures(
        "scenes.models.planar.figures",
        *("centre_of_mass", "cumulative_cost_of_transport", "energy_ledger", "loads_and_slip", "contraction"),
    ),
    overview=_overview,
    animate=animate,
    advice=LINKAGE_ADVICE,
    headlines=(
        ("speed_BL_per_period", "speed", "BL/period"),
        ("work_contract_positive_J", "positive work", "J"),
    ),
    entries={
        "speed_BL_per_period": "mean speed, in body lengths per period of the gait",
        "cumulative_cot_J_per_m": "sum over the steps of work divided by displacement, (P12)",
        "mass_kg": "mass of the worm",
    },
)
