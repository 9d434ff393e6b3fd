"""The model `worm_control`: the 3D worm with a controller that follows a reference by sensors."""

from __future__ import annotations

from dataclasses import replace

import worm3d
from control.estimation.estimate import NIS, consistency
from control.faults.injected import Faulty
from control.loop import Driver
from control.tracking.metrics import METRICS, measured
from scenes.models.base import Model, Observer, Outcome, Watch, pictures
from scenes.models.control import view as control_view
from scenes.models.control.build import controller_of, faults_of, map_name, maps_of, sensors_of, wave_of
from scenes.models.control.checks import CONTROL_CHECKS
from scenes.models.control.faults import entered, in_turn, of_controller, refused
from scenes.models.control.play import ControlPlay, Phased
from scenes.models.control.record import motion_of, outline_of, path_variable, timing_of, variables_of, way_variables
from scenes.models.control.reference import reference_of
from scenes.models.control.schema import ControlScene
from scenes.models.worm import model as worm
from scenes.models.worm import overview as worm_overview
from scenes.models.worm import view as worm_view
from scenes.models.worm.build import simulate
from scenes.records.record import Metric
from worm3d.values.named import is_own

FIGURES = ("tracking", "speed_and_heading", "commands", "estimates", "control_steps")

NO_MPC = "this controller makes no plans; exceptions that it raises are faults"
NO_NIS = "this controller estimates nothing from innovations, or none came after its start"


ENTRIES = {
    **worm.ENTRIES,
    **METRICS,
    "mpc_failures": "number of control steps in which the MPC found no plan",
    "measurements_refused": "number of measurements that the gate or the estimator refused",
    "nis_mean": "mean normalised innovation squared of the estimator, (KF7)",
    "nis_low": "lower limit of the mean for an estimator whose model and noise are right, (KF7)",
    "nis_high": "upper limit of the mean for an estimator whose model and noise are right, (KF7)",
    "wave": "shape of the wave that the controller commanded",
    "map": "source of the controller's map from commands to motion: identified, nearby or default",
}
"""Meanings of the entries that the summary has beside the measures, by name."""


def run(scene: ControlScene, observer: Observer) -> Outcome:
    """Simulate a scene."""
    return _run(scene, observer, Phased(controller_of(scene)))


def watch(scene: ControlScene, observer: Observer, how: Watch) -> Outcome:
    """Simulate a scene while a browser shows the run live."""
    driver = Phased(controller_of(scene))
    horizon = control_view.horizon_of(lambda: driver.controller.decisions, scene)
    with worm3d.Live(speed=how.speed, began=how.began, horizon=horizon, title=scene.title or "worm3d") as live:
        found = _run(scene, observer, driver, live)
        while live.again:
            live.again = False
            found = _run(scene, observer, driver, live)  # which resets the driver
        return found


def _run(scene: ControlScene, observer: Observer, driver: Phased, live: worm3d.Live | None = None) -> Outcome:
    faults = faults_of(scene)
    faulty = Faulty(driver, faults, scene.seed, driver.controller) if faults else driver
    return recorded(scene, driver, simulate(scene, observer, live=live, drive=(faulty, sensors_of(scene))))


def recorded(scene: ControlScene, driver: Phased, result: worm3d.Result) -> Outcome:
    """Return a run with a controller as an outcome for the command line."""
    waves = driver.at_rows(len(result.time), scene.run.record_every)
    plain, controller, decisions = worm.outcome(result, scene), driver.controller, driver.controller.decisions
    found, unfounded = innovations(controller)
    reference = reference_of(scene)
    outline = outline_of(result) if reference.obstacles else None
    figures, reasons = measured(motion_of(result, waves, outline), reference, result.worm.length)
    path = [path_variable(reference.path, result.com[:, :2])] if reference.path and is_own(scene.reference.kind) else ()
    merits: dict[str, Metric] = {
        **plain.summary,
        **figures,
        "mpc_failures": controller.failures if controller.plans else None,
        "measurements_refused": refused(controller),
        **found,
        "wave": wave_of(scene),
        "map": map_name(scene),
        "faults": in_turn([*worm.faults_of(result), *of_controller(controller), *entered(result, outline, reference)]),
    }
    return replace(
        plain,
        variables=(*plain.variables, *variables_of(decisions, waves), *path, *way_variables(controller.reference.path)),
        summary=merits,
        reasons={**plain.reasons, **reasons, "mpc_failures": NO_MPC, **unfounded},
        checkpoint=(),
        timing=timing_of(decisions, driver.seconds, scene.run.dt_s, scene.controller.period_s),
    )


def innovations(controller: Driver) -> tuple[dict[str, float | None], dict[str, str]]:
    """Return the consistency (KF7) of a controller's estimator, and reasons for missing values.

    (KF7) is defined in `control.estimation`. The first three periods are left out.
    """
    start = 3.0 * controller.period  # the estimator needs three waves to find the heading
    seen: list[tuple[float, float]] = getattr(controller.estimator, "innovations", [])
    nis = [value for t, value in seen if t >= start]
    if not nis:
        return dict.fromkeys(NIS), dict.fromkeys(NIS, NO_NIS)
    found = consistency(nis)
    return dict(zip(NIS, (found.mean, found.low, found.high), strict=True)), {}


CONTROL_MODEL = Model(
    name="worm_control",
    title="the 3D worm with a controller, sensors and a reference",
    schema=ControlScene,
    checks=CONTROL_CHECKS,
    run=run,
    figures=pictures("scenes.models.control.figures", *FIGURES)
    | pictures("scenes.models.worm.figures", "side_and_top", *worm.OF_A_BODY),
    overview=worm_overview.draw,
    animate=worm_view.RunMovie,
    view=worm_view.view,
    mesh=worm_view.mesh,
    watch=watch,
    played=ControlPlay,
    recorded=lambda scene, played, result: recorded(scene, played.driver, result),
    beside=control_view.beside,
    refers_to=maps_of,
    advice="try a smaller run.dt_s or reference.speed_m_s, a lighter worm or larger worm.spring_N",
    headlines=(
        ("cross_track_rms_bl", "beside the path, rms", "body lengths"),
        ("heading_error_rms_deg", "heading error, rms", "deg"),
        ("speed_error_rms_relative", "speed error, rms", ""),
        ("speed_bias_relative", "speed bias", ""),
        ("settling_periods", "settling", "periods"),
        ("mpc_failures", "failures of the MPC", ""),
        ("measurements_refused", "measurements refused", ""),
    ),
    entries=ENTRIES,
)
