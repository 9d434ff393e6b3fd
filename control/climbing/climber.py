"""A controller that crawls in open space, and climbs where walls enclose the worm.

When the first segment is enclosed (`control.climbing.climb`), the worm begins to climb with two anchors. It needs no
steering, since the walls lead it. The pace follows the reference speed (`control.climbing.way`). If no segment has been
enclosed for two periods of the gait, the walls have ended, and the worm crawls again under `control.supervisor`. The
estimator, the planner and the watch are reset at this change, because their data belong to the other gait. At the end
of a path the climbing worm stops, with an anchor that holds. While the worm crawls, the reflex `WallLoad` limits the
load on the walls.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from time import perf_counter

import numpy as np

from control.climbing.climb import CLIMB, WEDGING, Climb, enclosed
from control.climbing.way import STUCK, Way
from control.estimation.estimate import Estimate
from control.faults.rules import SLOW_AT_LIMIT, Fault
from control.faults.watch import Watch
from control.gaits.feedback import latest
from control.gaits.reflexes import WallLoad
from control.gaits.steering import GaitParameters
from control.loop import Choice
from control.sensing.sensors import QUANTITIES, Measurement
from control.supervisor import ARRIVED, Supervisor
from worm3d import Command
from worm3d.values.arrays import FloatArray

LOAD_CHANNEL = "contact_load"
OPENED = 2.0
"""Number of periods of the gait without an enclosed segment after which the worm crawls again."""
CLIMBS = "walls close round the worm: it climbs"


class Climber(Supervisor):
    """A supervisor that climbs between walls that enclose the worm. It needs the sensor channel "contact_load"."""

    senses = (LOAD_CHANNEL,)

    def reset(self) -> None:
        """Reset to the initial state."""
        super().reset()
        self._load = np.zeros(QUANTITIES[LOAD_CHANNEL].shape(self.worm))
        self._limit = WallLoad().start(self.worm)
        self._climb: Climb | None = None
        self._way = Way(self.reference.path, self.worm.length, CLIMB.period)
        self._com: FloatArray | None = None
        self._enclosed_at, self._pace = 0.0, 0.0
        self._given: Command | None = None
        self._blended_from: tuple[float, Command] | None = None

    @property
    def climbs(self) -> bool:
        """Whether the worm is climbing."""
        return self._climb is not None

    def step(self, t: float, measurement: Measurement) -> Command:
        """Return the command from time t [s] on. TypeError if `measurement` is not a `Measurement`."""
        self._load = latest(LOAD_CHANNEL, measurement, self._load)
        self._change(t, enclosed(self.worm, self._load) > 0)
        wanted = self._crawled(t, measurement) if self._climb is None else self._climbed(t, self._climb, measurement)
        self._given = self._blended(t, wanted)
        self.chamber_gains.tell(t, self._given)
        return self._given

    def _change(self, t: float, closed: bool) -> None:
        """Change the gait if walls begin or cease to enclose the worm. `closed` is whether a segment is enclosed."""
        climb = self._climb
        if climb is None and closed:
            self._climb, self._enclosed_at = Climb(self.worm), 0.0
            self._way = Way(self.reference.path, self.worm.length, self._climb.period)
            self._com = None
        elif climb is not None and closed:
            self._enclosed_at = climb.phase
        elif climb is not None and climb.phase - self._enclosed_at > OPENED:
            self._climb = None
            self._begin_to_crawl()
        if self._given is not None and (climb is None) != (self._climb is None):
            self._blended_from, self._due = (t, self._given), t

    def _begin_to_crawl(self) -> None:
        faults = self.watch.faults
        self.watch = Watch(self.worm, self.reference, self.feed_forward)
        self.watch.faults = faults
        if self.estimator is not None:
            self.estimator.reset()
        self.chamber_gains.reset()
        self.planner.reset()
        self.generator.parameters = None
        self._accepted = None
        self._heading_known, self._began = False, self.generator.waves

    def _crawled(self, t: float, measurement: Measurement) -> Command:
        """Return the command of the supervisor, reduced in segments that press hard against the walls."""
        given = super().step(t, measurement)
        limited = self._limit.step(t, given.contraction, {LOAD_CHANNEL: self._load})
        return Command(np.clip(limited, *self.worm.stroke), given.hinge, given.force)

    def _climbed(self, t: float, climb: Climb, measurement: Measurement) -> Command:
        """Return the command of the climbing gait."""
        began, dt = perf_counter(), 0.0 if self._time is None else t - self._time
        self._time = t
        com = self.gate(t, measurement).com
        if com is not None and np.isfinite(com).all():
            # A mean over half a second at 20 samples a second.
            self._com = com if self._com is None else self._com + 0.3 * (com - self._com)
        self._way.take(climb.phase, com)
        if t >= self._due - 1e-9:
            self._decide(t, self._estimate(t), began)
            began = perf_counter()
        before = climb.phase
        command = climb.step(t, dt, self._pace, {LOAD_CHANNEL: self._load})
        # The commanded phase advances while the worm waits, as with a wave of amplitude 0.
        self.generator.phase += 2.0 * np.pi * ((climb.phase - before) or dt / climb.period)
        self._spent += perf_counter() - began
        return command

    def _choose(self, t: float, estimate: Estimate | None) -> Choice:
        if self._climb is None:
            return super()._choose(t, estimate)
        arrived = estimate is not None and self._arrived(estimate)
        speed = 0.0 if arrived else self._speed(t)
        self._pace = self._way.pace(speed)
        if speed > 0.0:
            self.watch.report(self._slow(t, speed))
        frequency = max(self._pace, 1e-3) / self._climb.period
        return Choice("climb", GaitParameters(CLIMB.amplitude, frequency), ARRIVED if arrived else CLIMBS)

    def _slow(self, t: float, speed: float) -> Iterator[Fault]:
        """Yield the faults that prevent a climbing worm from reaching the reference speed [m/s]."""
        advice = "look at the pipe's width, rise and friction, and at what lies in it"
        fastest = self._way.fastest
        if self._way.idle >= STUCK:
            what = f"the worm climbs, but makes no way in {STUCK} periods of its gait"
            yield Fault(t, "stuck", what, advice)
        elif fastest < SLOW_AT_LIMIT * speed:
            what = f"the worm climbs at {max(fastest, 0.0):.3g} m/s at most, {speed:.3g} are asked for"
            yield Fault(t, "too slow", what, f"ask for less speed; {advice}")

    def _estimate(self, t: float) -> Estimate | None:
        """Return the estimate. While the worm climbs, only position and speed are updated."""
        last = super()._estimate(t)
        if self._climb is None or last is None or self._com is None:
            return last
        stride = 0.0 if np.isnan(self._way.stride) else self._way.stride
        speed = self._pace * stride / self._climb.period
        x, y = map(float, self._com[:2])
        return replace(last, time=t, state=last.state._replace(x=x, y=y, speed=speed, slip=0.0, turn_rate=0.0))

    def _blended(self, t: float, wanted: Command) -> Command:
        """Return the command, blended with the last command of the other gait during a transition."""
        if self._blended_from is None or t - self._blended_from[0] >= WEDGING:
            return wanted
        since, old = self._blended_from
        share = (t - since) / WEDGING
        return Command(
            share * wanted.contraction + (1.0 - share) * old.contraction,
            share * wanted.hinge + (1.0 - share) * old.hinge,
            share * wanted.force + (1.0 - share) * old.force,
        )
