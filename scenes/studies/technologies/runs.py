"""Runs of a scene's worm with one technology: with the scene's gait, at other periods, and with limits removed."""

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
"""Smallest number of periods of a run. Only the second half of the run is evaluated."""

LAGS = 12.0
"""Smallest duration of a run in units of the slowest time constant of the drive, so that the drive settles in the first
half of the run."""

FACTORS = (0.125, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0)
"""Periods of the runs, as multiples of the scene's period."""

STRONGER = 10.0
"""Factor that removes the limit of force. The cross-section of the actuators is multiplied by this factor, after it was
increased to the needed cross-section if it was smaller."""

RIGID = ("actuator.series=100", "actuator.droop=0", "actuator.scales=false")
"""Changes that make an actuator follow its drive exactly under any load."""

Changes = tuple[str, ...]
"""Changes of a scene, each of the form `section.key=value`."""


@dataclass(frozen=True)
class Trial:
    """Results of a run, from the second half of the run; NaN if the run did not finish."""

    period: float
    """Period of the gait [s]."""
    speed: float = math.nan
    """Speed towards the head [BL/s]."""
    drawn: float = math.nan
    """Cost of transport by the energy drawn: this energy divided by weight and distance."""
    given: float = math.nan
    """Cost of transport by the work on the worm: this work divided by weight and distance."""
    power: float = math.nan
    """Mean power drawn [W]."""
    free: float = math.nan
    """Range of the contraction that the drives would cause without load, averaged over the moving chambers, as a
    fraction of a chamber's length."""
    made: float = math.nan
    """Range of the actual contraction, averaged over the moving chambers."""
    warmth: float = math.nan
    """Highest temperature of an actuator above the temperature of the room [K]."""
    pull: float = math.nan
    """Largest force of an actuator [N]."""
    why: str = ""
    """Reason why the run did not finish."""

    @property
    def stride(self) -> float:
        """Distance per period [BL]."""
        return self.speed * self.period


class Acting(NamedTuple):
    """The actuators of a worm with N segments."""

    technology: Technology
    area: FloatArray
    """Cross-section of the actuator of each segment's chambers, shape (N,) [m^2]."""
    needed: FloatArray
    """Cross-section that gives the actuators enough force for the worm, shape (N,) [m^2]."""

    @property
    def slowest(self) -> float:
        """Largest of the rise times, fall times and delays of the drives [s]."""
        made = self.technology
        return max(max(made.rise, made.fall) * float(made.slower(self.area).max()), made.delay)


class Bench:
    """The worm of a scene, for runs with different technologies.

    Raises
    ------
    SceneError
        The scene is wrong, or does not have a 3D worm with a periodic gait.
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
        """Range of the contraction that the gait commands, averaged over the chambers that the gait moves."""

    def scene_of(self, changes: Changes) -> Scene:
        """Return the scene with changes, which take precedence over the user's overrides."""
        return load_scene(self._scene, (*self._overrides, *changes))

    def technology(self, kind: str) -> Acting:
        """Return the actuators of a kind in the scene, including the scene's values in [actuator]."""
        worm = worm_of(self.scene_of((f"actuator.kind={kind}",)).settings)
        acting = worm.actuator
        assert isinstance(acting, Technology)
        area = np.broadcast_to(acting.values(worm, hinge=False)["area"], (worm.segments,))
        return Acting(acting, area, acting.needed(worm))

    def run(self, kind: str, period: float | None = None, changes: Changes = ()) -> Trial:
        """Run the worm with a technology. Without `period`, the period is the scene's period."""
        period = self.period if period is None else period
        dt = self._dt * min(period / self.period, 2.0)  # at most twice the scene's time step, however long the period
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
    """Return, for each limit that a technology has, the changes of the scene that remove the limit.

    Without the limit "speed", the drive follows its command without delay; a thermal drive does so only while it warms
    up. Without "heat", the actuator cools without delay and is never switched off because of its temperature. Without
    "force", the actuator has ten times the cross-section, by more wires of the same thickness, and follows its drive
    exactly. Without "stroke", the free stroke equals the contraction that the gait commands.
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
    """Return the changes that remove all limits. If several limits set a key, the changes for "force" are used."""
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
    v = 0.0 if abs(v) < 1e-12 else v  # such a small speed is a rounding error
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
    """Return the range over time of values of shape (T, N, 2), averaged over the chambers that move."""
    swing = np.ptp(values, axis=0)
    moves = swing > 1e-9
    return float(swing[moves].mean()) if moves.any() else 0.0
