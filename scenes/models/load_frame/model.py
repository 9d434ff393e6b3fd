"""The model `load_frame`: one segment of the 3D worm, with a cable around it that is taken in and let out.

If the length u of cable is taken in, the half-height of the segment is h = h0 - u/(2 kappa), with the half-height h0
at rest and kappa = cable_per_diameter. The length of a rhombus with links a is l = 2 sqrt(a^2 - h^2), so that
dl/du = 2 h/(kappa l). For other segment laws l(u) is a spline through lengths in the domain of the law, at the
contraction without an input. The chambers lie on the axis, so that h of a learned law is its outer radius. The force in
the cable is P dl/du, where P is the force that would stretch the segment to the length l.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from time import perf_counter
from typing import NamedTuple

import numpy as np

from control.parts import HYSTERESIS, SEGMENT_KIND
from scenes.language.checks import Check, Found
from scenes.language.errors import SceneError
from scenes.language.loader import file_named
from scenes.language.parts import keys_by_parameter, part_named, part_of
from scenes.language.schema import Section
from scenes.models.base import Model, Observer, Outcome, pictures
from scenes.models.checks import RUN_CHECKS, building, in_keys
from scenes.models.load_frame import overview
from scenes.models.load_frame.schema import NO_FILE, Frame, LoadFrameScene, Worm
from scenes.models.sections import Run
from scenes.models.worm.build import part_in
from scenes.models.worm.checks import law_is_named
from scenes.records import measured
from worm3d.physics.worm import Worm as PlantWorm
from worm3d.running import segment_law
from worm3d.values.arrays import FloatArray
from worm3d.values.variable import Variable

SEGMENT_KEYS = keys_by_parameter(PlantWorm, Worm)
"""Key of each parameter of the segment in the section [worm]."""

NONE_MOVES = "a load frame moves no worm"
NO_WORK = "the cable does no work"

OF_A_WORM = (
    "distance_m",
    "path_length_m",
    "mean_speed_m_s",
    "heading_change_deg",
    "work_contract_J",
    "work_friction_J",
    "cost_of_transport",
    "newton_iterations_mean",
)
"""Entries of the summary of a crawling worm. The summary of a load frame contains them without a value."""

LENGTH_KEY = SEGMENT_KEYS["length"]

LAW_LENGTHS = 500
"""Number of lengths of a segment without links through which the spline l(u) goes. The forces of a hydrostat have
errors of 1e-7 of the greatest force, and of 1e-6 with half as many."""

SHORTEST = 0.05
"""Least length of a segment without links, in rest lengths, where the law has no shorter limit."""

HOOP_ROUNDING = 1e-3
"""Length of cable beyond the domain of a law that counts as the end of the domain, as a fraction of the cable within
the domain. The radius of the shipped law of a mesh segment misses by 1.2e-4 of it at the end of the record."""


def worm_of(scene: LoadFrameScene) -> PlantWorm:
    """Return the worm of a scene, which has one segment."""
    hysteresis = part_named(HYSTERESIS, scene.hysteresis.kind, scene.hysteresis)
    segment = part_in("segment", SEGMENT_KIND, scene.segment)
    parts = {"hysteresis": hysteresis, "segment": segment}
    return part_of(PlantWorm, scene.worm, segments=1, chamber_offset=0.0, flat=True, **parts)


def instants(scene: LoadFrameScene) -> FloatArray:
    """Return the times of the start and of the ends of all S steps, shape (S + 1,) [s]."""
    return scene.run.dt_s * np.arange(scene.run.steps + 1.0)


def file_of(frame: Frame) -> Path | None:
    """Return the path of the file named in the section [frame], or None if it names no file.

    The name may be the name of a shipped file.
    """
    return None if frame.file == NO_FILE else file_named(frame.file)


def cable_of(frame: Frame, time: FloatArray) -> FloatArray:
    """Return the length of cable taken in at the given times, shape (T,) [m].

    Before the first and after the last instant of a file the length is constant.
    """
    path = file_of(frame)
    if path is None:
        way = frame.speed_m_s * time % (2.0 * frame.cable_m)
        return np.minimum(way, 2.0 * frame.cable_m - way)
    stat = path.stat() if path.exists() else None
    at, cable = _measured_cable(path, stat and (stat.st_mtime_ns, stat.st_size))
    return np.asarray(np.interp(time, at, cable))


@lru_cache(maxsize=4)
def _measured_cable(path: Path, changed: tuple[int, int] | None) -> tuple[FloatArray, FloatArray]:
    """Return the instants [s] and the length of cable taken in [m] of a file.

    The result is cached, since fits and sweeps need it for every run. `changed` is the time of the last change and the
    size of the file, so that a changed file is read again.
    """
    record = measured.load(path)
    if "cable" not in record or record.variable("cable").units != "m" or record["cable"].ndim != 1:
        raise SceneError(f"{path}: no column of the cable taken in, must have one named cable_mm (or cable_m)")
    known = np.isfinite(record["cable"])
    if not known.any():
        raise SceneError(f"{path}: its column of the cable has no number")
    return record["time"][known], record["cable"][known]


class Hoop(NamedTuple):
    """Shape of a segment inside a hoop cable, arrays of shape (T,)."""

    height: FloatArray
    """Half-height [m]."""
    length: FloatArray
    """Length l [m]."""
    rise: FloatArray
    run: FloatArray
    """Numerator and denominator of dl/du."""


def shape(worm: PlantWorm, cable: FloatArray, per_diameter: float) -> Hoop:
    """Return the shape of the segment. `cable` is the length of cable taken in, shape (T,) [m].

    Raises
    ------
    ValueError
        If so much cable is taken in that the diameter would be 0, or so much is let out that the links would not reach,
        or the segment would leave the domain of its law.
    """
    if not worm.segment.has_links:
        return _along_law(worm, cable, per_diameter)
    link, h0 = float(worm.link_length[0]), float(np.ravel(worm.half_height)[0])
    height = h0 - cable / (2.0 * per_diameter)
    if not ((height > 0.0) & (height < link)).all():
        least, most = 2.0 * per_diameter * (h0 - link), 2.0 * per_diameter * h0
        raise ValueError(
            f"the cable is taken in by {cable.min():.4g} to {cable.max():.4g} m, must be above {least:.4g} and below "
            f"{most:.4g} m with this half_height and {LENGTH_KEY}"
        )
    length = 2.0 * np.sqrt(link**2 - height**2)
    return Hoop(height, length, 2.0 * height, per_diameter * length)


def _along_law(worm: PlantWorm, cable: FloatArray, per_diameter: float) -> Hoop:
    """Return the shape of a segment without links."""
    from scipy.interpolate import CubicSpline

    law, free = worm.segment, worm.segment.passive_contraction
    low, high = (float(each[0, 0]) for each in law.possible(worm, np.full((worm.segments, 1), free)))
    lengths = np.geomspace(max(low, SHORTEST * worm.l0), high, LAW_LENGTHS)
    rest = np.clip(worm.l0 * (1.0 - free), lengths[0], lengths[-1])
    height, at_rest = (law.outlines(worm, each[None], np.array(free))[0][0] for each in (lengths, np.array([rest])))
    taken = 2.0 * per_diameter * (at_rest - height)
    least, most = taken[[0, -1]]
    room = HOOP_ROUNDING * (most - least)
    if not ((np.diff(taken) > 0.0).all() and cable.min() >= least - room and cable.max() <= most + room):
        raise ValueError(
            f"the cable is taken in by {cable.min():.4g} to {cable.max():.4g} m, must be from {least:.4g} to "
            f"{most:.4g} m with this segment law, {law.bounded_by}, and the radius must fall with the length"
        )
    along = CubicSpline(taken, lengths)
    cable = np.clip(cable, least, most)
    slope = along(cable, 1)
    return Hoop(at_rest - cable / (2.0 * per_diameter), along(cable), slope, np.ones_like(slope))


def run(scene: LoadFrameScene, observer: Observer) -> Outcome:
    """Simulate the load frame of a scene."""
    begun = perf_counter()
    time = instants(scene)
    worm, cable = worm_of(scene), cable_of(scene.frame, time)
    try:
        hoop = shape(worm, cable, scene.frame.cable_per_diameter)
        pulled = segment_law.stretch_segment(worm, hoop.length, time)
    except ValueError as error:
        raise SceneError(in_keys(str(error), SEGMENT_KEYS)) from error
    force = pulled.force * hoop.rise / hoop.run
    work: FloatArray = np.diff(cable) * (force[1:] + force[:-1]) / 2.0
    observer(scene.run.steps)
    rows, step = slice(None, None, scene.run.record_every), ("step",)
    variables = (
        Variable("time", ("time",), time[rows], "s", "time"),
        Variable("cable", ("time",), cable[rows], "m", "cable taken in"),
        Variable("force", ("time",), force[rows], "N", "force in the cable"),
        Variable("diameter", ("time",), 2.0 * hoop.height[rows], "m", "diameter of the hoop"),
        Variable("length", ("time",), hoop.length[rows], "m", "length of the segment"),
        Variable("pull", ("time",), pulled.force[rows], "N", "pull that would lengthen the segment as much"),
        Variable("step_time", step, time[1:], "s", "end of each time step"),
        Variable("work", step, work, "J", "work of the cable, by the trapezoidal rule"),
        Variable("elastic", step, pulled.elastic[1:], "J", "change of elastic energy"),
        Variable("viscous_loss", step, pulled.viscous_loss[1:], "J", "loss to Kelvin-Voigt damping"),
        Variable("hysteresis_loss", step, pulled.hysteresis_loss[1:], "J", "loss to friction in the joints"),
    )
    summary = _summary(time, np.diff(cable), work, float(force.max()), pulled)
    reasons = {**dict.fromkeys(summary, NONE_MOVES), "work_lost_share": NO_WORK, "energy_balance_error": NO_WORK}
    return Outcome("done", "the run reached its end", variables, summary, reasons, perf_counter() - begun)


def _summary(
    time: FloatArray, taken: FloatArray, work: FloatArray, peak: float, pulled: segment_law.Stretch
) -> dict[str, float | None]:
    """Return the entries of `summary.json`; `taken` is the length of cable taken in at each step, shape (S,) [m]."""
    put_in, given_back = float(work[taken > 0.0].sum()), -float(work[taken < 0.0].sum())
    uses = {
        "hysteresis": float(pulled.hysteresis_loss.sum()),
        "damping": float(pulled.viscous_loss.sum()),
        "gained": float(pulled.elastic.sum()),
    }
    scale = put_in + abs(given_back) + sum(map(abs, uses.values()))
    return {
        "duration_s": float(time[-1]),
        **dict.fromkeys(OF_A_WORM),
        "energy_balance_error": abs(float(work.sum()) - sum(uses.values())) / scale if scale > 0.0 else None,
        "peak_force_N": peak,
        "work_in_J": put_in,
        "work_returned_J": given_back,
        "work_lost_share": 1.0 - given_back / put_in if put_in > 0.0 else None,
        **{f"work_{name}_J": joules for name, joules in uses.items()},
    }


OF_THE_SEGMENT = ("worm", "hysteresis", "segment")
"""Sections that describe the segment."""


def _segment_of(*sections: Section) -> PlantWorm:
    return worm_of(LoadFrameScene(model="load_frame", **dict(zip(OF_THE_SEGMENT, sections, strict=True))))


def _can_be_pulled(file: str, frame: Frame, run: Run, *sections: Section) -> Found:
    """Return an error if the file of the frame cannot be used, or if the segment cannot follow the cable."""
    try:
        cable = cable_of(frame, instants(LoadFrameScene(model="load_frame", run=run)))
    except SceneError as error:
        return {"frame.file": str(error)}
    try:
        pulled = _segment_of(*sections)
    except ValueError:
        return None  # another check reports it
    try:
        shape(pulled, cable, frame.cable_per_diameter)
    except ValueError as error:
        return dict.fromkeys(("frame", "worm"), in_keys(str(error), SEGMENT_KEYS))
    return None


def _not_too_many(dt_s: float, duration_s: float, most: int = 1_000_000) -> Found:
    steps = duration_s / dt_s
    if steps <= most:
        return None
    return f"got {dt_s} s: makes {steps:.3g} steps of run.duration_s ({duration_s} s), at most {most} are allowed"


LOAD_FRAME_CHECKS = (
    *RUN_CHECKS,
    Check(("run.dt_s", "run.duration_s"), _not_too_many),
    Check(("segment.file", "segment.kind"), law_is_named),
    building(_segment_of, *OF_THE_SEGMENT),
    Check(("frame.file", "frame", "run", *OF_THE_SEGMENT), _can_be_pulled),
)

LOAD_FRAME_MODEL = Model(
    name="load_frame",
    title="one segment of the 3D worm in a load frame",
    schema=LoadFrameScene,
    checks=LOAD_FRAME_CHECKS,
    run=run,
    figures=pictures("scenes.models.load_frame.figures", "force_over_cable", "energy"),
    overview=overview.draw,
    advice="try a smaller run.dt_s",
    moves=False,
    inputs=("cable",),
    abscissa="cable",
    headlines=(
        ("peak_force_N", "peak force", "N"),
        ("work_in_J", "work put in", "J"),
        ("work_returned_J", "work given back", "J"),
        ("work_lost_share", "share lost", ""),
        ("work_hysteresis_J", "lost to joints", "J"),
        ("work_damping_J", "lost to damping", "J"),
        ("energy_balance_error", "energy balance error", ""),
    ),
    entries={
        "peak_force_N": "greatest force in the cable",
        "work_in_J": "work that the cable does while it is taken in",
        "work_returned_J": "work that the segment returns while the cable is let out",
        "work_lost_share": "share of work_in_J that is not returned",
    },
)
