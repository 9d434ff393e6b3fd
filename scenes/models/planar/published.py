"""The model `planar_published`: the author's program of the paper (`planar.published`), with scene, run and record."""

from __future__ import annotations

from functools import partial
from time import perf_counter
from typing import TYPE_CHECKING, Literal

import numpy as np

from control.gaits import Gait
from control.parts import GAIT
from planar import published
from planar.published import Parameters, bytes_per_step
from scenes.language.parts import PartSection, keys_of, part_of
from scenes.language.schema import setting
from scenes.models.base import Model, Movie, Observer, Outcome, pictures, status_word
from scenes.models.checks import RUN_CHECKS, building, gait_checks, memory_check
from scenes.models.planar.merit import NO_STEP, Travel, common, movie, no_cost_because
from scenes.models.sections import BODY_BOUNDS, WAVE, Settings, gait_from, planar_gait_keys
from scenes.records import overview
from scenes.records.record import Record
from worm3d.values.period_means import SHORT_RUN
from worm3d.values.variable import Variable

if TYPE_CHECKING:
    from PIL.Image import Image

SPRINGS = ("length", "k_spring", "k_link", "mass", "connector_mass")
FRICTION = ("mu_forward", "mu_backward", "gravity", "velocity_threshold")
FORCE_BOUNDS = {"contraction_force": {"ge": 0}}
SOLVER = {"tolerance": {"gt": 0}, "max_iterations": {"ge": 1, "le": 10_000}}


class Worm(PartSection, keys=keys_of(Parameters, these=SPRINGS, bounds=BODY_BOUNDS)):
    """The mass points and springs."""

    segments: int = setting(6, ge=1, le=200, meaning="number of segments", aka=("n", "n_segments"))


class Friction(PartSection, keys=keys_of(Parameters, these=FRICTION)):
    """Friction along the ground, (P10), with the normal load m g."""


class PublishedGait(
    PartSection,
    holds={"kind": GAIT},
    keys=partial(planar_gait_keys, without=("amplitude", "force", "wavelength"), direction="direct"),
    more=keys_of(Parameters, these=("wavelength",), only=(WAVE,))
    | keys_of(Parameters, these=FORCE_BOUNDS, bounds=FORCE_BOUNDS),
):
    """The contraction, as a force on the connectors."""


class Ground(PartSection, keys=keys_of(Parameters, these=("ground_clearance",))):
    """The ground that the connectors can touch."""


class Solver(PartSection, keys=keys_of(Parameters, these=SOLVER, bounds=SOLVER)):
    """Newton's iteration, (P2)."""

    elastic_sign: Literal[-1, 1] = setting(
        int(Parameters().elastic_sign), meaning="sign of the elastic force: -1 as in the program, 1 as in mechanics"
    )


class PublishedScene(Settings):
    """A whole scene."""

    model: Literal["planar_published"] = setting(meaning="which simulation the scene is for")
    worm: Worm = Worm()
    friction: Friction = Friction()
    gait: PublishedGait = PublishedGait()
    ground: Ground = Ground()
    solver: Solver = Solver()


PUBLISHED_CHECKS = (
    *RUN_CHECKS,
    *gait_checks(PublishedGait, Worm, unlimited=("force_N",), can_sense=False),
    memory_check(bytes_per_step),
    building(lambda worm: part_of(Parameters, worm), "worm"),
)


def run(scene: PublishedScene, observer: Observer) -> Outcome:
    """Simulate a scene with the paper's program."""
    start = perf_counter()
    result = published.simulate(
        n=scene.worm.segments,
        T_wave=scene.gait.period_s,
        dt=scene.run.dt_s,
        steps=scene.run.steps,
        activation=partial(gait_of(scene).activation, segments=scene.worm.segments),
        parameters=parameters_of(scene),
        observer=observer,
    )
    wall_s = perf_counter() - start
    # Before a divergence the values may overflow. The summary then has reasons in place of the values.
    with np.errstate(all="ignore"):
        summary = _summary(scene, result)
        ended = status_word(result.status), result.stop.sentence
        return Outcome(*ended, _variables(scene, result), summary, _reasons(summary), wall_s)


def parameters_of(scene: PublishedScene) -> Parameters:
    """Return the constants of the program as set in the scene."""
    return part_of(Parameters, scene.worm, scene.friction, scene.gait, scene.ground, scene.solver)


def gait_of(scene: PublishedScene) -> Gait:
    """Return the gait; the program uses only the activation."""
    wavelength = scene.gait.wavelength_m / scene.worm.length_m
    return gait_from(scene.gait, scene.run.dt_s, wavelength=wavelength, force=0.0)  # force_N is a key of the program


def _variables(scene: PublishedScene, result: published.Run) -> tuple[Variable, ...]:
    stored = slice(None, None, scene.run.record_every)
    nodes, time, step = result.q[stored], ("time",), ("step",)
    return (
        Variable("time", time, result.time[stored], "s", "time"),
        Variable("main_node", ("time", "joint", "axis"), nodes[:, 0::3], "m", "main nodes, from tail to head"),
        Variable("top_node", ("time", "segment", "axis"), nodes[:, 1::3], "m", "top connector of each segment"),
        Variable("bottom_node", ("time", "segment", "axis"), nodes[:, 2::3], "m", "bottom connector of each segment"),
        Variable("com", ("time", "axis"), result.com[stored], "m", "centre of mass of all nodes"),
        Variable("reported_com", time, result.reported_com[stored], "m", "centre of mass as the program takes it"),
        Variable("ground", (), result.ground, "m", "height of the ground"),
        Variable("step_time", step, result.time[1:], "s", "end of each time step"),
        Variable("activation", ("step", "segment"), result.activation, "1", "activation of each segment"),
        Variable("work_contract", step, result.work_contract, "J", "work of the contraction force, (P11)"),
        Variable("work_friction", step, result.work_friction, "J", "work of the friction force, (P13)"),
        Variable("cumulative_cot", step, result.cumulative_cot, "J/m", "cumulative cost of transport, as plotted"),
        Variable("newton_iterations", step, result.newton_iterations, "1", "iterations, predictor and corrector"),
        Variable("residual", step, result.residual, "N", "norm of the residual of the last iterate tested"),
    )


def _summary(scene: PublishedScene, result: published.Run) -> dict[str, float | None]:
    travel = Travel.of(result.com, result.time, scene.gait.period_s)
    work = float(result.work_contract.sum())
    weight = scene.worm.mass_kg * scene.friction.gravity_m_s2
    return {
        **common(result, travel, (work, float(result.work_friction.sum())), weight, result.energy_balance_error),
        "reported_distance_m": result.reported_distance,
        "reported_work_J": result.work,
        "reported_total_cot_J_per_m": result.total_cot,
        "true_displacement_m": result.true_displacement,
        "work_contract_positive_J": float(np.maximum(0.0, result.work_contract).sum()),
        "work_contract_p11_J": float(result.work_contract_p11.sum()),
        "unconverged_steps": result.unconverged_steps,
        "inverted_steps": result.inverted_steps,
    }


def _reasons(summary: dict[str, float | None]) -> dict[str, str]:
    reasons = dict.fromkeys(summary, "not a finite number: the state overflowed")
    reasons["path_length_m"] = reasons["mean_speed_m_s"] = SHORT_RUN
    reasons["newton_iterations_mean"] = NO_STEP
    reasons["reported_total_cot_J_per_m"] = "the distance as the program takes it is zero"
    reasons["cost_of_transport"] = no_cost_because(
        summary["work_contract_J"],
        summary["distance_m"],
        "the integrator, whose numerical loss is negative here, and the snaps to the ground supply that energy",
    )
    return reasons


NODES = ("main_node", "top_node", "bottom_node")
"""Names of the variables of the nodes, for the overview and the movie."""


def _overview(record: Record) -> Image:
    return overview.of_planar(record, NODES, record["activation"][-1])


def _animate(record: Record) -> Movie:
    steps = np.searchsorted(record["step_time"], record["time"][1:])
    activation = record["activation"]
    return movie(record, NODES, np.vstack([activation[:1], activation[steps]]))


PUBLISHED_MODEL = Model(
    name="planar_published",
    title="the paper's planar worm, number for number as its author's program computes it",
    schema=PublishedScene,
    checks=PUBLISHED_CHECKS,
    run=run,
    figures=pictures("scenes.models.planar.figures", "centre_of_mass", "cumulative_cost_of_transport", "activation"),
    overview=_overview,
    animate=_animate,
    advice="try a smaller run.dt_s, a smaller gait.force_N or a larger worm.mass_kg",
    headlines=(
        ("reported_distance_m", "reported distance", "m"),
        ("reported_work_J", "reported work", "J"),
        ("reported_total_cot_J_per_m", "reported total CoT", "J/m"),
    ),
    entries={
        "reported_distance_m": "distance that the figures of the paper show",
        "reported_work_J": "sum of the absolute work of the contraction over the steps, as in the paper",
        "reported_total_cot_J_per_m": "reported work divided by reported distance",
        "true_displacement_m": "mean displacement of the main nodes along x",
        "unconverged_steps": "number of steps in which Newton's method did not reach its tolerance",
        "inverted_steps": "number of steps after which a segment is inside out",
    },
)
