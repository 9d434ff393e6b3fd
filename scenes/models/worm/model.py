"""The models `worm` and `worm_planar`: simulation of the 3D worm from a scene, and the record of the run."""

from __future__ import annotations

import json
from typing import TypeVar

import worm3d
from scenes.language.checks import Check
from scenes.models.base import Model, Observer, Outcome, Watch, pictures, status_word
from scenes.models.worm import overview as worm_overview
from scenes.models.worm import view as worm_view
from scenes.models.worm.build import measures_of, simulate
from scenes.models.worm.checks import PLANAR_CHECKS, WORM_CHECKS
from scenes.models.worm.play import GaitPlay
from scenes.models.worm.schema import NO_RECORD, AnyWormScene, GaitScene, PlanarWormScene, WormScene
from scenes.records.record import Cell, Record, fault_row
from worm3d.values.named import is_own

S = TypeVar("S", WormScene, PlanarWormScene)

ENTRIES = {
    "speed_BL_per_period": "mean speed, in body lengths per period of the gait",
    "mass_kg": "mass of the worm",
    "faults": "table of detected faults: time, kind, what happened, advice",
}
"""Meanings of the entries that the summary has beside the measures, by name."""

WORM_ADVICE = (
    "try a smaller run.dt_s or gait.amplitude (or gait.hinge_deg), a longer gait.period_s, a lighter worm or larger "
    "worm.spring_N, worm.torsion_J or worm.kelvin_voigt_time_s"
)

OF_A_BODY = ("body", "contraction", "loads_and_slip", "energy_ledger")
"""Figures of every 3D worm, with a gait or with a controller."""

OF_THE_CLOCK = ("status", "real_time_factor")
"""Entries of `Result.summary` that are not in the summary of the record, which stores them separately."""


def run(scene: GaitScene, observer: Observer) -> Outcome:
    """Simulate a scene."""
    return outcome(simulate(scene, observer), scene)


def watch(scene: GaitScene, observer: Observer, how: Watch) -> Outcome:
    """Simulate a scene while a browser shows the run live."""
    with worm3d.Live(speed=how.speed, began=how.began, title=scene.title or "worm3d") as live:
        result = simulate(scene, observer, live=live)
        while live.again:
            live.again = False
            result = simulate(scene, observer, live=live)
        return outcome(result, scene)


def resume(scene: GaitScene, earlier: Record, observer: Observer) -> Outcome:
    """Continue a run from the end of a record to the end of the scene, and return the whole run."""
    from scenes.models.worm.record import ENERGY_TERMS, STORED_SERIES, joined  # imports the libraries of files
    from worm3d.results.files import state_of

    for name in (*STORED_SERIES, *ENERGY_TERMS):
        earlier.variable(name)  # raises an error, before the simulation, if the record has no such variable
    rest = simulate(scene, observer, state_of(earlier.checkpoint), earlier.sizes["step"])
    return outcome(joined(earlier, rest), scene)


def faults_of(result: worm3d.Result) -> list[dict[str, Cell]]:
    """Return rows for the faults of a run: the worm fell on its side, or the result is not accurate enough."""
    since, error, found = result.on_its_side, result.error_estimate, []
    if since is not None:
        advice = "a worm on its side does not follow its gait: ask for gentler turns, less slope or a weaker push"
        found.append(fault_row(since, "on its side", "the worm lies on its side", advice))
    if error is not None and not error.met:
        from worm3d.measures.spread import UNEVEN_GROUND_ADVICE, rough  # imports the statistics

        small_causes = "small causes have large effects here: allow a larger error, or take the mean of several starts"
        advice = UNEVEN_GROUND_ADVICE if rough(result) else small_causes
        found.append(fault_row(float(result.time[-1]), "not accurate", error.sentence, advice))
    return found


def outcome(result: worm3d.Result, scene: AnyWormScene) -> Outcome:
    """Return a run as an outcome for the command line, with the user's own measures in the scene."""
    from worm3d.results.files import checkpoint_of, described  # imports the libraries of files

    asked = {measure.name: measure(result) for measure in measures_of(scene)}
    figures = {**result.summary(), **{name: value for name, (value, _) in asked.items()}}
    period, faults = result.period, faults_of(result)
    speed = figures["mean_speed_m_s"]
    merits = {
        **{name: figure for name, figure in figures.items() if name not in OF_THE_CLOCK},
        "speed_BL_per_period": speed * period / result.worm.length if isinstance(speed, float) and period else None,
        "mass_kg": result.worm.mass,
        "faults": faults,
    }
    reasons = {**result.reasons(), **{name: why for name, (value, why) in asked.items() if value is None}}
    run, parts = described(result, asked)
    return Outcome(
        status_word(result.status),
        result.stop.sentence,
        tuple(result.variables()),
        merits,
        {**reasons, "speed_BL_per_period": reasons.get("mean_speed_m_s", "")},
        result.wall_s,
        checkpoint=checkpoint_of(result.state),
        errors=_errors(result),
        run=run,
        parts=parts,
    )


def _errors(result: worm3d.Result) -> dict[str, float]:
    """Return the estimated errors of entries of the summary, by name; empty if the run has no error estimate."""
    errors = {} if result.error_estimate is None else dict(result.error_estimate.figures)
    if result.period and "mean_speed_m_s" in errors:
        errors["speed_BL_per_period"] = errors["mean_speed_m_s"] * result.period / result.worm.length
    return errors


def _period(scene: GaitScene, record: Record) -> float | None:
    """Return the period of the gait of a stored run [s].

    The period of a user's own gait is read from the record, since the scene need not have a key for the period. There
    is none for recorded commands.
    """
    own = is_own(scene.gait.kind) or getattr(scene.gait, "file", NO_RECORD) != NO_RECORD
    found: float | None = json.loads(record.run or "{}").get("period") if own else scene.gait.period_s
    return found


def model_of(name: str, title: str, schema: type[S], checks: tuple[Check, ...]) -> Model[S]:
    """Return a model that simulates a worm with a gait by `worm3d`."""
    return Model(
        name=name,
        title=title,
        schema=schema,
        checks=checks,
        run=run,
        resume=resume,
        figures=pictures(
            "scenes.models.worm.figures", "side_and_top", "path", "centre_of_mass_and_heading", *OF_A_BODY
        ),
        overview=worm_overview.draw,
        animate=worm_view.RunMovie,
        view=worm_view.view,
        mesh=worm_view.mesh,
        watch=watch,
        played=GaitPlay,
        recorded=lambda scene, played, result: outcome(result, scene),
        beside=lambda scene, record, rows: {"period": _period(scene, record)},
        advice=WORM_ADVICE,
        headlines=(
            ("speed_BL_per_period", "speed", "BL/period"),
            ("heading_change_deg", "turned", "deg"),
            ("work_contract_positive_J", "positive work", "J"),
        ),
        entries=ENTRIES,
    )


WORM_MODEL = model_of("worm", "the 3D worm in contact", WormScene, WORM_CHECKS)
PLANAR = model_of("worm_planar", "the planar worm as a special case of the 3D one", PlanarWormScene, PLANAR_CHECKS)
