"""An episode: a worm in a scene, which crawls one control period at a time by an agent's actions.

The reward of a control period depends on the true centre of mass, averaged over the last wave. With the offset e from
the path, the speed V along the path and the wanted speed V_ref, the reward is

    1 - ln(1 + (e / 0.01 L)^2) / 2 - ln(1 + ((V/V_ref - 1) / 0.05)^2) / 2.                                     (LE1)

An offset of 0.01 L, or an error of the speed of 5 %, reduces the reward by a third of a unit. The slope of the reward
is noticeable from a millimetre to a body length, and stays bounded where a worm is far off.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import gcd, inf, tau
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

import worm3d
from control.estimation.estimator import span_of
from control.gaits.steering import GaitParameters, WaveGenerator
from control.learned.acts import ACTS
from control.learned.course import Course
from control.learned.senses import MIN_REFERENCE_SPEED, Senses, along
from control.sensing.gate import Gate
from control.sensing.sensors import Sensors
from control.tracking.curves import Curve
from control.tracking.paths import offset
from control.tracking.references import Reference
from scenes.language.errors import SceneError
from scenes.models.control.build import identified_of, sensors_of
from scenes.models.control.reference import reference_of
from scenes.models.control.schema import ControlScene
from scenes.models.worm.build import problem_of, worm_of
from scenes.studies.learn.sampled import Sampled
from worm3d.recorded.status import Status
from worm3d.running.run import Run
from worm3d.values.arrays import FloatArray


@dataclass(frozen=True)
class Terms:
    """Actions and observations of an agent.

    Raises
    ------
    ValueError
        The meaning of actions is unknown.
    """

    control_period: float = 0.2
    """Time between two actions [s]."""
    acts: str = "course"
    """Meaning of an action, a name among `control.learned.acts.ACTS`."""
    channels: tuple[str, ...] = ()
    """Further channels that the agent observes, `control.learned.senses.Senses`."""

    def __post_init__(self) -> None:
        if self.acts not in ACTS:
            raise ValueError(f"acts: got {self.acts!r}, must be one of {', '.join(map(repr, ACTS))}")


class Episode:
    """A run of a scene, the sensors, and the wave that an agent decides.

    Parameters
    ----------
    scene : ControlScene
        The scene; its controller is not used.
    how : Terms
    seed : int
        Seed of the sensors' errors.

    Raises
    ------
    SceneError
        The worm is neither identified nor near the default worm, or a further channel is not measured in the scene.
    ValueError
        The control period is less than a time step.
    """

    def __init__(self, scene: ControlScene, how: Terms, seed: int) -> None:
        dt = scene.run.dt_s
        if not how.control_period >= dt:
            raise ValueError(f"control_period: got {how.control_period!r} s, must be at least {dt} s, a step")
        found, worm = identified_of(scene), worm_of(scene)
        mechanism, self._dt, self._length = scene.controller.mechanism, dt, worm.length
        self._act = ACTS[how.acts](found.maps[mechanism], mechanism, worm.length)
        self._reference = _sampled(scene, worm.length)
        self.senses = Senses(worm, self._reference, self._act.size, how.channels)
        self._sensors = _only(sensors_of(replace(scene, seed=seed)), ("com", *how.channels))
        self._gate = Gate(worm, span_of(self._sensors.channels))
        self._every = round(how.control_period / dt)
        self._look = gcd(self._every, *(_steps_between(each.rate, dt) for each in self._sensors.channels.values()))
        self.generator = WaveGenerator(found.schedule, worm)
        self._true = Course()
        self._near: float | None = None
        self._run = _begun(scene, self._every)
        self._sense(GaitParameters(0.0, 1.0))

    def crawl(self, action: ArrayLike) -> tuple[float, bool, bool, dict[str, Any]]:
        """Crawl for a control period; return reward, whether the run diverged, whether time is up, and facts."""
        asked = np.clip(np.asarray(action, dtype=float), -1.0, 1.0)
        self.senses.acted(asked, self._waves)
        wave = self._act(asked, self._seen)
        for _ in range(self._every // self._look):
            elapsed = [self._dt] * self._look
            if self._run.done == 0:
                elapsed[0] = 0.0  # the wave begins with the run
            status = self._run.follow(self.generator.steps(elapsed, wave))
            if status is not Status.DONE:
                return -5.0, True, False, self._facts(status)  # less than for any offset that worms reach
            self._sense(wave)
        facts = self._facts(status)
        return self._reward(facts), False, self._run.done >= self._run.steps, facts

    def observed(self) -> FloatArray:
        """Return the observation of the agent, once a control period."""
        self._seen = self.senses.observed(self._time)
        return self._seen

    @property
    def _time(self) -> float:
        return self._run.time(self._run.done)

    @property
    def _waves(self) -> float:
        return float(self.generator.phase) / tau

    def _sense(self, wave: GaitParameters) -> None:
        seen = self._run.observation()
        self._true.add(self._waves, seen.time, seen.com[:2])
        passed = self._gate(seen.time, self._sensors(seen))
        self.senses.take(seen.time, passed, wave, float(self.generator.phase))

    def _facts(self, status: Status) -> dict[str, Any]:
        """Return the true centre of mass's speed along the reference and offset from the reference, and the status."""
        motion, reference, heading, aside = self._true.motion(), self._reference, None, 0.0
        assert motion is not None
        if reference.path is not None:
            self._near = s = float(reference.path.project(motion.place, self._near))
            heading = float(reference.path.heading(s))
            aside = float(offset(reference.path, motion.place, s, heading))
        elif reference.heading is not None:
            heading = float(reference.heading(self._time))
        speed, course = along(motion.velocity, heading)
        return {
            "speed_m_s": speed,
            "offset_m": aside,
            "course_rad": course,
            "status": status.value,
            "measurements_refused": self._gate.refused.total(),
        }

    def _reward(self, facts: dict[str, Any]) -> float:
        """Return (LE1); without the second part in the first waves."""
        asked = max(float(self._reference.speed(self._time)), MIN_REFERENCE_SPEED * self._length)
        miss = 0.0 if facts["speed_m_s"] is None else facts["speed_m_s"] / asked - 1.0
        return float(reward_of(facts["offset_m"] / self._length, miss))


def reward_of(aside: ArrayLike, miss: ArrayLike) -> FloatArray:
    """Return (LE1) of offsets [body lengths] and relative errors of the speed."""
    lost = np.log1p((np.asarray(aside) / 0.01) ** 2) + np.log1p((np.asarray(miss) / 0.05) ** 2)
    return np.asarray(1.0 - 0.5 * lost)


def _sampled(scene: ControlScene, body: float) -> Reference:
    """Return the reference of a scene; a curved path is sampled up to the distance that the worm can need."""
    reference = reference_of(scene)
    if not isinstance(reference.path, Curve):
        return reference
    times = np.linspace(0.0, scene.run.duration_s, 1001)
    way = scene.run.duration_s * float(np.mean(reference.speed(times)))
    return replace(reference, path=Sampled(reference.path, 2.0 * way + body, body))


def _begun(scene: ControlScene, every: int) -> Run:
    """Return the run before its first step, with whole control periods and a record of the end only."""
    problem = problem_of(scene, drive=(_Outside(), None))
    steps = max(1, problem.steps // every) * every
    return Run(replace(problem, duration=steps * problem.dt, record_every=steps))


def _only(sensors: Sensors, names: tuple[str, ...]) -> Sensors:
    """Return the sensors of some channels, with the same errors; the other channels would cost time."""
    for name in names:
        if name not in sensors.channels:
            known = ", ".join(sensors.channels)
            raise SceneError(f"channels: got '{name}', must be measured in the scene, which has {known}")
    kept: dict[str, Any] = {"strain": None, **{name: sensors.channels[name] for name in names}}
    return Sensors(seed=sensors.seed, **kept)


def _steps_between(rate: float, dt: float) -> int:
    """Return the number of steps between two samples at a rate [Hz], rounded down."""
    return 1 if rate == inf else max(1, int(1.0 / (rate * dt) + 1e-9))


class _Outside:
    """Placeholder for the agent in the run; commands come from `Run.follow`."""

    def reset(self) -> None:
        """Do nothing."""

    def step(self, t: float, _: object) -> worm3d.Command:
        """Raise RuntimeError: the run must not request a command."""
        raise RuntimeError(f"at {t} s a command was asked for; an agent gives them")
