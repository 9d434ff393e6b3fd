"""An episode: a worm in a scene, which crawls for one control period after each action of an agent.

The reward of a control period depends on the true position of the centre of mass, averaged over the last wave. Let e be
the offset from the path, V the speed along the path, V_ref the required speed, and L the body length. The reward is

    1 - ln(1 + (e / 0.01 L)^2) / 2 - ln(1 + ((V/V_ref - 1) / 0.05)^2) / 2.                                     (LE1)

An offset of 0.01 L, or an error of the speed of 5 %, reduces the reward by 0.35. The reward changes noticeably with the
offset from a millimetre to a body length, and the slope of the reward is bounded far from the path.
"""

from __future__ import annotations

from collections.abc import Callable
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
from scenes.studies.learn.seen import Camera, Picture
from worm3d.recorded.status import Status
from worm3d.results.pictures import FPS
from worm3d.running.run import Run
from worm3d.values.arrays import FloatArray


@dataclass(frozen=True)
class Terms:
    """Settings of the actions and observations of an agent.

    Raises
    ------
    ValueError
        `acts` is unknown.
    """

    control_period: float = 0.2
    """Time between two actions [s]."""
    acts: str = "course"
    """Meaning of an action, a key of `control.learned.acts.ACTS`."""
    channels: tuple[str, ...] = ()
    """Further channels of the sensors that the agent observes; see `control.learned.senses.Senses`."""

    def __post_init__(self) -> None:
        if self.acts not in ACTS:
            raise ValueError(f"acts: got {self.acts!r}, must be one of {', '.join(map(repr, ACTS))}")


class Episode:
    """A run of a scene with an agent that chooses the parameters of the wave.

    Parameters
    ----------
    scene : ControlScene
        The scene. The controller of the scene is not used.
    how : Terms
    seed : int
        Seed of the measurement errors.
    pictured : bool
        Whether pictures can be made of the episode, which needs memory for the motion.

    Raises
    ------
    SceneError
        The worm has not been identified and differs too much from the default worm, or the scene has no sensor for a
        further channel.
    ValueError
        The control period is shorter than a time step.
    """

    def __init__(self, scene: ControlScene, how: Terms, seed: int, *, pictured: bool = False) -> None:
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
        self._camera = Camera()
        self.run = _begun(scene, self._every, pictured)
        self._sense(GaitParameters(0.0, 1.0))

    def crawl(
        self, action: ArrayLike, watch: Callable[[Run], object] | None = None
    ) -> tuple[float, bool, bool, dict[str, Any]]:
        """Crawl for a control period, and call `watch` at each sample of the sensors.

        Returns
        -------
        reward : float
        terminated : bool
            Whether the run has diverged.
        truncated : bool
            Whether the run has reached its end.
        facts : dict
            As in `_facts`.
        """
        asked = np.clip(np.asarray(action, dtype=float), -1.0, 1.0)
        self.senses.acted(asked, self._waves)
        wave = self._act(asked, self._seen)
        for _ in range(self._every // self._look):
            elapsed = [self._dt] * self._look
            if self.run.done == 0:
                elapsed[0] = 0.0  # the wave begins with the run
            status = self.run.follow(self.generator.steps(elapsed, wave))
            if status is not Status.DONE:
                return -5.0, True, False, self._facts(status)  # lower than the reward at any offset that worms reach
            self._sense(wave)
            if watch is not None:
                watch(self.run)
        facts = self._facts(status)
        return self._reward(facts), False, self.run.done >= self.run.steps, facts

    def picture(self) -> Picture:
        """Return a picture of the worm and the path now, shape (height, width, 3)."""
        path, com, way = self._reference.path, self.run.observation().com, None
        if path is not None:
            s = float(path.project(com[:2], self._near)) + self._length * np.linspace(-3.0, 3.0, 121)
            way = np.column_stack([path.point(s), np.full(len(s), com[2])])
        return self._camera.picture(self.run, way)

    def observed(self) -> FloatArray:
        """Return the observation of the agent. Call this once per control period."""
        self._seen = self.senses.observed(self._time)
        return self._seen

    @property
    def _time(self) -> float:
        return self.run.time(self.run.done)

    @property
    def _waves(self) -> float:
        return float(self.generator.phase) / tau

    def _sense(self, wave: GaitParameters) -> None:
        seen = self.run.observation()
        self._true.add(self._waves, seen.time, seen.com[:2])
        passed = self._gate(seen.time, self._sensors(seen))
        self.senses.take(seen.time, passed, wave, float(self.generator.phase))

    def _facts(self, status: Status) -> dict[str, Any]:
        """Return the true speed [m/s] and offset [m] of the centre of mass relative to the reference, and the status.

        The dictionary also has the direction of motion relative to the reference [rad], and the number of discarded
        measurements.
        """
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
        """Return (LE1). The term of the speed is left out in the first waves, since the speed is not known yet."""
        asked = max(float(self._reference.speed(self._time)), MIN_REFERENCE_SPEED * self._length)
        miss = 0.0 if facts["speed_m_s"] is None else facts["speed_m_s"] / asked - 1.0
        return float(reward_of(facts["offset_m"] / self._length, miss))


def reward_of(aside: ArrayLike, miss: ArrayLike) -> FloatArray:
    """Return (LE1), given offsets [body lengths] and relative errors of the speed."""
    lost = np.log1p((np.asarray(aside) / 0.01) ** 2) + np.log1p((np.asarray(miss) / 0.05) ** 2)
    return np.asarray(1.0 - 0.5 * lost)


def _sampled(scene: ControlScene, body: float) -> Reference:
    """Return the reference of a scene. A curved path is replaced by a polygon longer than the worm can crawl."""
    reference = reference_of(scene)
    if not isinstance(reference.path, Curve):
        return reference
    times = np.linspace(0.0, scene.run.duration_s, 1001)
    way = scene.run.duration_s * float(np.mean(reference.speed(times)))
    return replace(reference, path=Sampled(reference.path, 2.0 * way + body, body))


def _begun(scene: ControlScene, every: int, pictured: bool) -> Run:
    """Return a run before the first step. The duration is a whole number of control periods.

    Without `pictured`, the run records only start and end.
    """
    problem = problem_of(scene, drive=(_Outside(), None))
    steps = max(1, problem.steps // every) * every
    often = gcd(every, max(1, int(1.0 / (FPS * problem.dt))))
    return Run(replace(problem, duration=steps * problem.dt, record_every=often if pictured else steps))


def _only(sensors: Sensors, names: tuple[str, ...]) -> Sensors:
    """Return sensors with only the named channels, to save time. Their measurement errors stay the same."""
    for name in names:
        if name not in sensors.channels:
            known = ", ".join(sensors.channels)
            raise SceneError(f"channels: got '{name}', must be measured in the scene, which has {known}")
    kept: dict[str, Any] = {"strain": None, **{name: sensors.channels[name] for name in names}}
    return Sensors(seed=sensors.seed, **kept)


def _steps_between(rate: float, dt: float) -> int:
    """Return the number of time steps dt [s] between two samples at a rate [Hz], rounded down, but at least 1."""
    return 1 if rate == inf else max(1, int(1.0 / (rate * dt) + 1e-9))


class _Outside:
    """Placeholder for a controller in a run with commands from `Run.follow`."""

    def reset(self) -> None:
        """Do nothing."""

    def step(self, t: float, _: object) -> worm3d.Command:
        """Raise RuntimeError, because the run must not request a command."""
        raise RuntimeError(f"at {t} s a command was asked for; an agent gives them")
