"""The limits of a worm with an actuator technology, and sentences that report them.

The possible limits of an actuator are its speed, force, stroke and heat. A run without one of these limits shows how
much the limit slows the worm down.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from scenes.studies.technologies.runs import FACTORS, Bench, Trial, lifted, together
from worm3d.physics.technologies.law import MOST_STROKE, Technology
from worm3d.values.arrays import FloatArray

MOVES = 0.002
"""A worm counts as moving above this distance per period [body lengths, BL]."""

ALL = "all"
"""Name of the run with all limits removed."""


@dataclass(frozen=True)
class Verdict:
    """Results of the runs of a worm with one technology. N is the number of segments."""

    kind: str
    acting: Technology
    """The actuators."""
    area: FloatArray
    """Cross-section of the actuator of each segment's chambers, shape (N,) [m^2]."""
    asked: float
    """Range of the contraction that the gait commands, as a fraction of a chamber's length."""
    own: Trial
    """Run with the scene's gait."""
    periods: tuple[Trial, ...]
    """Runs at other periods."""
    without: dict[str, Trial] = field(default_factory=dict)
    """Runs with the scene's gait and one limit removed, by the name of the limit, and `ALL` without any limit."""

    @property
    def best(self) -> Trial:
        """The run with the highest speed among all periods."""
        ran = [trial for trial in self.periods if np.isfinite(trial.speed)]
        return max(ran, key=lambda trial: trial.speed, default=self.own)

    @property
    def moves(self) -> bool:
        """Whether the worm moves with the scene's gait."""
        return bool(self.own.stride > MOVES)

    @property
    def drawn(self) -> float:
        """Cost of transport by the energy that the actuators draw; NaN if the worm does not move."""
        return self.own.drawn if self.moves else math.nan

    @property
    def given(self) -> float:
        """Cost of transport by the work that the actuators do on the worm; NaN if the worm does not move."""
        return self.own.given if self.moves else math.nan

    @property
    def efficiency(self) -> float:
        """Work on the worm divided by the energy drawn; NaN if the model does not count all of this energy."""
        return math.nan if self.acting.uncounted else self.given / self.drawn

    @property
    def smallest_area_mm2(self) -> float:
        """Cross-section of the smallest actuator [mm^2]."""
        return 1e6 * float(self.area.min())

    @property
    def blocking(self) -> float:
        """Smallest blocking force of an actuator [N]."""
        return float(np.min(self.acting.stress * self.area / self.acting.lever))

    @property
    def idle(self) -> float:
        """Power that all drives together draw even without motion [W]."""
        return self.acting.idle * 2.0 * len(self.area)

    @property
    def stroke(self) -> float:
        """Smallest stroke of an unloaded actuator, as a fraction of a chamber's length."""
        return min(float(np.min(self.acting.strain * np.asarray(self.acting.lever))), MOST_STROKE)

    @property
    def limit(self) -> str:
        """The limit whose removal makes the worm fastest, if the worm is then faster by more than 5 %.

        It is `ALL` if this is true only when all limits are removed together, and empty otherwise.
        """
        ran = {name: trial.speed for name, trial in self.without.items() if np.isfinite(trial.speed)}
        single = {name: speed for name, speed in ran.items() if name != ALL}
        name = max(single, key=lambda each: single[each], default="")
        if name and self._counts(single[name]):
            return name
        return ALL if self._counts(ran.get(ALL, -np.inf)) else ""

    @property
    def limit_or_none(self) -> str:
        """The limit, or "-" if there is no limit."""
        return self.limit or "-"

    def _counts(self, speed: float) -> bool:
        """Return whether a limit matters: without it, at the given speed, the worm is more than 5 % faster."""
        return bool(speed * self.own.period > max(MOVES, 1.05 * self.own.stride))

    @property
    def sentence(self) -> str:
        """A sentence with the speed and the limit of the technology."""
        if self.own.why:
            return f"{self.kind}: the run did not come to its end: {self.own.why}"
        name, speed = self.limit, f"{self.own.speed:.2g} BL/s with the gait of the scene"
        if not name and not self.moves:
            return f"{self.kind}: does not move the worm, and would not without its limits: gait and ground hold it"
        if not name:
            return f"{self.kind}: {speed}; gait and ground limit it, no limit of its own costs it 5 %{self._fastest}"
        free = self.without[name].speed
        what = "its limits together" if name == ALL else f"its {name}: {self._why(name)}"
        if not self.moves:
            held = f"does not move the worm; what holds it is {what}"
            return f"{self.kind}: {held}; without that {free:.2g} BL/s{self._fastest}"
        return (
            f"{self.kind}: {speed}, limited by {what}; without that {free / self.own.speed:.2g} times as "
            f"fast{self._fastest}"
        )

    @property
    def _fastest(self) -> str:
        best = self.best
        if best.period == self.own.period or best.stride <= MOVES:
            return ""
        return f"; fastest at a period of {best.period:g} s: {best.speed:.2g} BL/s"

    def _why(self, name: str) -> str:
        own, acting = self.own, self.acting
        slower = float(acting.slower(self.area).max())
        got = f"of the {self.asked:.2g} that the gait asks for in {own.period:g} s"
        if name == "stroke":
            return f"{got} it has {self.stroke:.2g}"
        if name == "force":
            return (
                f"without load it would contract by {own.free:.2g}, on the worm by {own.made:.2g}, at {own.pull:.2g} N"
            )
        if name == "heat" and acting.hot == 0.0:
            return f"it warms by {own.warmth:.3g} K, and is switched off at {acting.hottest:.3g} K"
        if name == "heat":
            return f"{got} it gives {own.free:.2g}: it cools with {slower * acting.fall:.2g} s"
        lags = [f"{slower * max(acting.rise, 0.0 if acting.hot else acting.fall):.2g} s of lag"]
        lags += [f"{acting.delay:.2g} s of delay"] if acting.delay else []
        lags += [f"at most {acting.rate:.2g} of its stroke a second"] if np.isfinite(acting.rate) else []
        return f"{got} it gives {own.free:.2g}, with {' and '.join(lags)}"


def judged(bench: Bench, kind: str) -> Verdict:
    """Run the worm about a dozen times with a technology, and return the results."""
    acting, area, _ = bench.technology(kind)
    own, limits = bench.run(kind), lifted(bench, kind)
    periods = tuple(own if f == 1.0 else bench.run(kind, f * bench.period) for f in FACTORS)
    without = {name: bench.run(kind, changes=changes) for name, changes in limits.items()}
    without[ALL] = bench.run(kind, changes=together(limits))
    return Verdict(kind, acting, area, bench.asked, own, periods, without)
