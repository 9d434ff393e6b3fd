"""The trials of `worm3d study control`: random tasks, worms, grounds and sensors, which follow from a seed.

Trial k of seed S is the same on every machine, because all its numbers come from one generator with the seed [S, k] and
are rounded to the printed digits. Trial k has task class k modulo 12, so that any twelve consecutive trials contain
each class once.
"""

from __future__ import annotations

import math
import shlex
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.random import Generator

from scenes.language.errors import SceneError
from worm3d.values.arrays import FloatArray
from worm3d.values.spelling import did_you_mean

START_POSITION_M = (0.5, 0.0)
"""Start position (x, y) of the middle of the worm [m]. The worm lies along +x, and paths begin at this position."""
SCENES = {"pipe": "velocity_pipe"}
"""Shipped scene of a class of trials; classes that are not listed use `path_line`."""
SPEEDS = (0.04, 0.09)
"""Lowest and highest required speed [m/s]. A weak worm on rough ground and uphill still reaches about 0.1 m/s."""
QUICK, SHORT = ("circle", "line"), ("run.duration_s=12",)
"""Classes of the trials of `--quick`, and the override that shortens their runs. These runs check that everything
works; they are too short to compare controllers."""


class Trial(NamedTuple):
    """A shipped scene, and the changes to it that would follow `-o` on the command line."""

    name: str
    kind: str
    """Class of the trial, a name of `CLASSES`."""
    scene: str
    overrides: tuple[str, ...] = ()

    @property
    def command(self) -> str:
        """Command that runs the trial."""
        return " ".join(["worm3d run", self.scene, *(f"-o {shlex.quote(each)}" for each in self.overrides)])


class Range(NamedTuple):
    """A key of the scene, and the range of its random values."""

    key: str
    least: float
    most: float
    form: str = ".3g"
    """Format of the value; "d": a whole number."""
    log: bool = False
    """Whether the logarithm of the value is uniformly distributed, rather than the value itself."""

    def drawn(self, random: Generator) -> str:
        """Return an override, `key=value`, with a random value."""
        if self.form == "d":
            return f"{self.key}={random.integers(int(self.least), int(self.most) + 1)}"
        draw = _log_uniform if self.log else Generator.uniform
        return f"{self.key}={draw(random, self.least, self.most):{self.form}}"


class Group(NamedTuple):
    """Changes of a scene that are made together."""

    share: float
    """Probability that a trial has these changes."""
    says: str
    """Description of the changes."""
    ranges: tuple[Range, ...] = ()
    """Keys with random values."""
    switch: tuple[str, ...] = ()
    """Overrides with fixed values."""


SLOPE = Group(
    0.5,
    "a slope that rises in a random direction (not in pipes)",
    (Range("world.slope_deg", 0.0, 2.5, ".2f"), Range("world.heading_deg", -180, 180, ".0f")),
)
GROUPS = (
    Group(
        1.0,
        "body and actuators",
        (
            Range("worm.segments", 5, 9, "d"),
            Range("worm.spring_N", 9, 18, log=True),
            Range("worm.actuator_lag_s", 0.05, 0.2, log=True),
        ),
    ),
    Group(
        0.5,
        "unequal chambers: each contracts by its command times a random factor between `fault.unequal_least` and 1.1",
        (Range("fault.unequal_least", 0.7, 1.0), Range("fault.unequal_seed", 0, 999, "d")),
        ("fault.unequal=true",),
    ),
    Group(
        1.0,
        "friction",
        (
            Range("friction.forward", 0.02, 0.05, log=True),
            Range("friction.backward", 0.15, 0.26, log=True),
            Range("friction.lateral", 0.15, 0.26, log=True),
        ),
    ),
    Group(
        1.0,
        "sensors",
        (
            Range("sensor.com_noise_m", 0.002, 0.02, ".2g", log=True),
            Range("sensor.com_rate_Hz", 5, 20, ".2g", log=True),
            Range("sensor.com_delay_s", 0.0, 0.2, ".2f"),
            Range("sensor.strain_noise", 0.005, 0.03, ".2g", log=True),
        ),
    ),
    Group(1.0 / 3.0, "a sensor of the heading", switch=("sensor.heading=true",)),
    SLOPE,
)
"""Random changes of the default worm, ground and sensors."""


def drawn(seed: int, number: int) -> Trial:
    """Return trial `number` of a seed."""
    random = np.random.default_rng([seed, number])
    kind = tuple(CLASSES)[number % len(CLASSES)]
    changed = task_of(kind, random, float(_log_uniform(random, *SPEEDS)))
    for group in GROUPS:
        values = [each.drawn(random) for each in group.ranges]
        if random.uniform() < group.share and not (kind == "pipe" and group is SLOPE):
            changed += (*group.switch, *values)
    common = ("run.duration_s=60", "controller.map=default", f"seed={random.integers(2**31)}")
    return Trial(f"{seed}-{number:02}-{kind}", kind, SCENES.get(kind, "path_line"), (*changed, *common))


def _line(random: Generator, speed: float) -> Iterator[str]:
    """Yield a line that begins beside the worm and points to one side."""
    yield f"reference.start_m=[{START_POSITION_M[0]}, {random.uniform(-0.1, 0.1):.3f}]"
    yield f"reference.azimuth_deg={random.uniform(-20.0, 20.0):.1f}"


def _circle(random: Generator, speed: float) -> Iterator[str]:
    """Yield a circle that turns to a random side."""
    yield f"reference.radius_m={_log_uniform(random, 0.6, 2.0):.3g}"
    yield f"reference.towards={_side(random)}"


def _s_curve(random: Generator, speed: float) -> Iterator[str]:
    """Yield an S-curve that first turns to a random side."""
    yield f"reference.amplitude_m={random.uniform(0.2, 0.4):.3g}"
    yield f"reference.wavelength_m={random.uniform(3.0, 5.0):.3g}"
    yield f"reference.towards={_side(random)}"


def _eight(random: Generator, speed: float) -> Iterator[str]:
    """Yield a figure of eight that starts at the outer end of a loop."""
    # x = a sin u, y = 0.31 a sin 2u, with radii of at least a/4, turned to begin along +x where u = pi/2. A worm that
    # begins at the crossing would be on two branches at once.
    u, a = np.pi / 2.0 + np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False), random.uniform(1.2, 1.6)
    yield "reference.closed=true"
    yield _points(random, a * np.column_stack([-0.31 * np.sin(2.0 * u), np.sin(u) - 1.0]))


def _spiral(random: Generator, speed: float) -> Iterator[str]:
    """Yield one and a quarter turns of a spiral whose radius decreases to a half."""
    u, radius = np.linspace(0.0, 2.5 * np.pi, 16), random.uniform(1.0, 1.6)
    r = radius * (1.0 - u / (5.0 * np.pi))
    yield _points(random, np.column_stack([r * np.sin(u), radius - r * np.cos(u)]))


def _square(random: Generator, speed: float) -> Iterator[str]:
    """Yield a path along a square, from the middle of a side around three corners, which are round."""
    half = random.uniform(0.7, 1.1)
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 2.0], [-1.0, 2.0], [-1.0, 0.3]])
    yield f"reference.radius_m={random.uniform(0.3, 0.6):.3g}"
    yield _points(random, half * corners)


def _waypoints(random: Generator, speed: float) -> Iterator[str]:
    """Yield way points with round corners between them."""
    turns, ways = np.radians(random.uniform(-60.0, 60.0, 5)), random.uniform(1.0, 1.8, 6)
    azimuths = np.cumsum([0.0, *turns])
    yield f"reference.radius_m={random.uniform(0.3, 0.6):.3g}"
    steps = ways[:, None] * np.column_stack([np.cos(azimuths), np.sin(azimuths)])
    yield _points(random, np.vstack([[0.0, 0.0], np.cumsum(steps, axis=0)]))


def _heading(random: Generator, speed: float) -> Iterator[str]:
    """Yield a heading that changes twice, in steps."""
    first, second = random.uniform(-40.0, 40.0, 2)
    yield (
        f"reference.heading_steps=[{{at_s={random.uniform(10.0, 20.0):.1f}, heading_deg={first:.1f}}}, "
        f"{{at_s={random.uniform(30.0, 45.0):.1f}, heading_deg={second:.1f}}}]"
    )


def _stop_and_go(random: Generator, speed: float) -> Iterator[str]:
    """Yield a line with two stops of the worm."""
    stop, rest, again, last = random.uniform((12.0, 4.0, 10.0, 4.0), (20.0, 8.0, 16.0, 8.0)).cumsum()
    yield _steps((stop, 0.0), (rest, float(_log_uniform(random, *SPEEDS))), (again, 0.0), (last, speed))


def _speed_steps(random: Generator, speed: float) -> Iterator[str]:
    """Yield a circle; the required speed changes twice, in steps."""
    yield from _circle(random, speed)
    times = random.uniform((15.0, 35.0), (25.0, 45.0))
    yield _steps(*zip(times, _log_uniform(random, *SPEEDS, 2), strict=True))


def _speed_sine(random: Generator, speed: float) -> Iterator[str]:
    """Yield an S-curve; the required speed varies as a sine of time."""
    yield from _s_curve(random, speed)
    yield f"reference.speed_sine_m_s={speed * random.uniform(0.15, 0.4):.2g}"
    yield f"reference.speed_sine_period_s={random.uniform(15.0, 30.0):.3g}"


def _pipe(random: Generator, speed: float) -> Iterator[str]:
    """Yield a pipe with a bend; the worm crawls along the bottom of the pipe."""
    bend = f"{{bend_deg={random.uniform(20.0, 60.0):.0f}, bend_radius_m=2.0, towards='{_side(random)}'}}"
    yield f"world.radius_m={random.uniform(0.12, 0.16):.3g}"
    yield f"world.pieces=[{{straight_m={random.uniform(1.0, 2.0):.2f}}}, {bend}, {{straight_m=3.0}}]"


Maker = Callable[[Generator, float], Iterator[str]]
"""Function that takes a generator and the required speed [m/s], and yields the overrides of a task. The kind and the
speed of the reference are not among these overrides."""

CLASSES: dict[str, tuple[str, Maker]] = {
    "circle": ("circle", _circle),
    "heading": ("heading", _heading),
    "stop_and_go": ("line", _stop_and_go),
    "waypoints": ("way_points", _waypoints),
    "speed_sine": ("s_curve", _speed_sine),
    "pipe": ("pipe", _pipe),
    "eight": ("spline", _eight),
    "line": ("line", _line),
    "square": ("way_points", _square),
    "speed_steps": ("circle", _speed_steps),
    "spiral": ("spline", _spiral),
    "s_curve": ("s_curve", _s_curve),
}
"""Classes of trials in the order of their turns: for each class the kind of the reference, and the function that makes
the task."""


def task_of(name: str, random: Generator, speed: float) -> list[str]:
    """Return the overrides of a random task of the class `name`, for a required speed in m/s."""
    kind, maker = CLASSES[name]
    return [f"reference.kind={kind}", f"reference.speed_m_s={speed:.3f}", *maker(random, speed)]


def _points(random: Generator, points: FloatArray) -> str:
    """Return the override for way points given relative to the start, mirrored left to right in half of the cases."""
    x, y = (points * [1.0, random.choice([-1.0, 1.0])] + START_POSITION_M).T
    return f"reference.points=[{', '.join(f'{{x_m={a:.3f}, y_m={b:.3f}}}' for a, b in zip(x, y, strict=True))}]"


def _steps(*steps: tuple[float, float]) -> str:
    return f"reference.speed_steps=[{', '.join(f'{{at_s={t:.1f}, speed_m_s={v:.3f}}}' for t, v in steps)}]"


def _side(random: Generator) -> str:
    return str(random.choice(["left", "right"]))


def _log_uniform(random: Generator, least: float, most: float, size: int | None = None) -> FloatArray:
    return np.exp(random.uniform(math.log(least), math.log(most), size))


def chosen(names: Sequence[str], seeds: Sequence[int], count: int) -> tuple[Trial, ...]:
    """Return the first `count` trials of each seed.

    If `names` is not empty, only trials whose name, number or class is in `names` are returned.

    Raises
    ------
    SceneError
        No trial has a given name.
    """
    trials = {
        trial: {trial.name, str(k), trial.kind} for seed in seeds for k in range(count) for trial in [drawn(seed, k)]
    }
    known = set().union(*trials.values())
    for name in names:
        if name not in known:
            meant = did_you_mean(name, [(each, each) for each in known])
            hint = f"; did you mean '{meant}'?" if meant else ""
            raise SceneError(
                f"--trial: got '{name}', must be a class ({', '.join(CLASSES)}), a number from 0 to {count - 1} (more "
                f"with --trials), or a name that --show prints{hint}"
            )
    return tuple(trial for trial, called in trials.items() if not names or called & set(names))
