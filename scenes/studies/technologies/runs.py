"""Runs of a scene's worm on one technology: with the scene's gait, at other periods, and without one of the limits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from scenes.language.errors import SceneError
from scenes.models.loading import Scene, load_scene, parse_scene
from scenes.models.worm.build import gait_of, worm_of
from scenes.models.worm.schema import WormScene
from scenes.records.record import Record
from scenes.running.runner import simulate
from worm3d.physics.technologies.law import MOST_STROKE, Technology
from worm3d.values.arrays import FloatArray

MIN_RUN_PERIODS = 6
"""Least number of periods of a run; the last half of the run counts."""

LAGS = 12.0
"""Shortest run, over the time constant of the drive: a slow drive settles in the first half of the run."""

FACTORS = (0.125, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0)
"""Periods of the runs, over the scene's period."""

STRONGER = 10.0
"""Strength of actuators whose force is not to limit them, over the larger of their own and the needed strength."""

RIGID = ("actuator.series=100", "actuator.droop=0", "actuator.scales=false")
"""Changes that make an actuator a source of position."""

Changes = tuple[str, ...]


@dataclass(frozen=True)
class Trial:
    """Results of a run over the periods of its second half; NaN if the run did not finish."""

    period: float
    """[s]"""
    speed: float = math.nan
    """Speed towards the head [BL/s]."""
    drawn: float = math.nan
    """Energy drawn from the sources, over weight and distance: the cost of transport of the input."""
    given: float = math.nan
    """Energy given to the worm, over weight and distance."""
    power: float = math.nan
    """Mean power drawn [W]."""
    free: float = math.nan
    """Swing of the contraction of unloaded actuators, averaged over the moving chambers."""
    made: float = math.nan
    """Swing of the contraction of these chambers."""
    warmth: float = math.nan
    """Highest temperature above the room's [K]."""
    pull: float = math.nan
    """Largest force of an actuator [N]."""
    why: str = ""
    """Reason why the run did not finish."""

    @property
    def stride(self) -> float:
        """Way in a period [BL]."""
        return self.speed * self.period


class Acting(NamedTuple):
    """The actuators of a worm."""

    technology: Technology
    area: FloatArray
    """Cross-section of the actuator of a chamber, shape (N,) [m^2]."""
    needed: FloatArray
    """Cross-section of actuators with enough force for the worm, shape (N,) [m^2]."""

    @property
    def slowest(self) -> float:
        """Largest of rise, fall and delay of the drives [s]."""
        made = self.technology
        return max(max(made.rise, made.fall) * float(made.slower(self.area).max()), made.delay)


class Bench:
    """The worm of a scene, for runs on technologies.

    Raises
    ------
    SceneError
        The scene is wrong, or has no periodic gait of a worm with actuators.
    """

    def __init__(self, scene: str, overrides: Sequence[str]) -> None:
        self._scene, self._overrides = scene, tuple(overrides)
        loaded = load_scene(scene, [change for change in overrides if not change.startswith("actuator.")])
        settings = loaded.settings
        if not isinstance(settings, WormScene):
            raise SceneError(f"{scene}: must be a scene of the model 'worm', with a gait; is of {loaded.model.name!r}")
        found = getattr(gait_of(settings), "period", None) or getattr(settings.gait, "period_s", None)
        if found is None:
            raise SceneError(f"{scene}: its gait has no period; choose a periodic one, such as travelling_wave")
        self.name, self.period, self._dt = loaded.name, float(found), float(settings.run.dt_s)
        bound = gait_of(settings).bind(worm_of(settings))
        times = np.linspace(4.0, 5.0, 200, endpoint=False) * self.period
        self.asked = _swing(np.array([bound(float(t)).contraction for t in times]))
        """Swing of the contraction that the gait commands, averaged over the chambers that it moves."""

    def scene_of(self, changes: Changes) -> Scene:
        """Return the scene with changes, which override the user's changes."""
        return load_scene(self._scene, (*self._overrides, *changes))

    def technology(self, kind: str) -> Acting:
        """Return the actuators of a kind, with the scene's numbers."""
        worm = worm_of(self.scene_of((f"actuator.kind={kind}",)).settings)
        acting = worm.actuator
        assert isinstance(acting, Technology)
        area = np.broadcast_to(acting.values(worm, hinge=False)["area"], (worm.segments,))
        return Acting(acting, area, acting.needed(worm))

    def run(self, kind: str, period: float | None = None, changes: Changes = ()) -> Trial:
        """Run the worm on a technology, with the scene's period or another period."""
        period = self.period if period is None else period
        dt = self._dt * min(period / self.period, 2.0)  # long periods have steps of at most twice the scene's
        count = max(MIN_RUN_PERIODS, 2 * math.ceil(LAGS * self.technology(kind).slowest / (2.0 * period)))
        told = (
            f"actuator.kind={kind}",
            f"gait.period_s={period!r}",
            f"run.dt_s={dt!r}",
            f"run.duration_s={count * period!r}",
            "run.record_every=1",
        )
        try:
            record = simulate(self.scene_of((*told, *changes)))
        except SceneError as error:
            return Trial(period, why="; ".join(error.lines))
        if record.status != "done":
            return Trial(period, why=record.sentence)
        return _measured(record, period)


def lifted(bench: Bench, kind: str) -> dict[str, Changes]:
    """Return the changes of the scene that remove one limit of a technology, by the limit; only limits that exist.

    speed: the drive follows at once (a thermal drive follows at once while warming); heat: the actuator cools at once,
    and may get hot; force: the actuator is ten times as strong, by more wires of the same thickness, and follows its
    drive exactly; stroke: the free stroke equals the contraction that the gait commands.
    """
    acting, area, needed = bench.technology(kind)
    thermal, stroke = acting.hot > 0.0, np.minimum(acting.strain * np.asarray(acting.lever), MOST_STROKE)
    at_once: Changes = ("actuator.delay_s=0", "actuator.rise_s=0", "actuator.rate_per_s=1e6")
    strong = STRONGER * np.maximum(area, needed)
    bundled: Changes = (
        () if acting.gauge is None else (f"actuator.gauge_m2={(acting.gauge * strong / area).tolist()!r}",)
    )
    found: dict[str, Changes] = {
        "speed": at_once if thermal else (*at_once, "actuator.fall_s=0"),
        "force": (f"actuator.area_m2={strong.tolist()!r}", *bundled, *RIGID),
    }
    cool: Changes = ("actuator.hottest=1e9",) if math.isfinite(acting.hottest) else ()
    if thermal or cool:
        found["heat"] = (*cool, "actuator.fall_s=0") if thermal else cool
    if (wanted := min(bench.asked, MOST_STROKE)) > float(np.min(stroke)):
        strain = wanted / float(np.min(acting.lever))
        kept = f"actuator.area_m2={area.tolist()!r}"
        found["stroke"] = (f"actuator.strain={strain!r}", kept)
    return found


def together(limits: dict[str, Changes]) -> Changes:
    """Return the changes that remove all limits; if two limits set the same key, the larger actuator counts."""
    order = ("stroke", "speed", "heat", "force")
    keys = {change.partition("=")[0]: change for name in order for change in limits.get(name, ())}
    return tuple(keys.values())


def _measured(record: Record, period: float) -> Trial:
    time, figures = record["time"], record.summary.metrics
    speed = figures.get("speed_bl_s")
    last = time > time[-1] * 0.5 + 1e-9 * period
    worm = worm_of(parse_scene(record.scene, record.name).settings)
    drawn, kept, lost = (float(record[name][last].sum()) for name in ("work_contract", "actuator", "actuator_loss"))
    span, waves = float(time[-1] - time[~last][-1]), time > time[-1] - period * (1.0 + 1e-9)
    v = float(speed) if isinstance(speed, float) else math.nan
    v = 0.0 if abs(v) < 1e-12 else v  # a worm at rest, but for rounding
    way = v * worm.length * span
    carried = worm.mass * 9.81 * way if way > 0.0 else math.nan
    return Trial(
        period=period,
        speed=v,
        drawn=drawn / carried,
        given=(drawn - kept - lost) / carried,
        power=drawn / span,
        free=_swing(record["contraction"][waves]),
        made=_swing(1.0 - record["chamber_length"][waves] / worm.l0),
        warmth=float(record["actuator_warmth"].max()),
        pull=float(np.abs(record["actuator_pull"][last]).max()),
    )


def _swing(values: FloatArray) -> float:
    """Return the maximum minus the minimum over time, averaged over the moving chambers; values of shape (T, N, 2)."""
    swing = np.ptp(values, axis=0)
    moves = swing > 1e-9
    return float(swing[moves].mean()) if moves.any() else 0.0
