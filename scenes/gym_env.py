"""A worm as an environment of Gymnasium: an agent decides the parameters of its wave, a scene says where it is to go.

    env = WormEnv("path_circle", control_period=0.2)

It needs the optional part `gym` (pip install 'worm3d[gym]').

An action is amplitude, frequency and steering, each scaled to [-1, 1] over the range in which the worm was identified,
for a control period. What the agent observes is measured by the scene's sensors, with their noise; L is the body
length:

    place      2N strains of the chambers (the latest)
    2N, +1     sine and cosine of the commanded phase
    2N+2, 3    offset to the left of the path / L (0 without a path), speed asked for, in L/s
    2N+4, 5    sine and cosine of the azimuth that is asked for
    2N+6, 7    how far the measured centre of mass came in the last period, x and y, over what was asked for
    2N+8       curvature of the path x L
    2N+9 ...   the action before

The reward of a period is 1 - (speed/asked for - 1)^2 - (offset/0.1 L)^2 of the true centre of mass, no less than -1;
the speed is that over the last commanded wave, which rocks the worm, along the path or heading that is asked for.
An episode ends with the scene's duration (truncated), or when the run diverges (terminated). Samples that cannot be are
not used (`control.sensing.gate`); `info["measurements_refused"]` counts them.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

import worm3d
from control.estimation.estimator import span_of
from control.estimation.reduced import INPUTS
from control.gaits.steering import GaitParameters, WaveGenerator
from control.sensing.gate import Gate
from control.sensing.sensors import Measurement
from control.tracking.paths import offset
from scenes.language.errors import MissingPartError, SceneError
from scenes.models.control.build import identified_of, reference_of, sensors_of
from scenes.models.control.schema import ControlScene
from scenes.models.loading import load_scene
from scenes.models.worm.build import problem_of, worm_of
from worm3d.run import Run
from worm3d.status import Status
from worm3d.values.arrays import FloatArray

try:
    import gymnasium
except ImportError as error:
    raise MissingPartError("scenes.gym_env needs Gymnasium: pip install 'worm3d[gym]'") from error

Seen = NDArray[np.float32]

LARGEST = 10.0
"""Observations are clipped to this."""

WIDE = 0.1
"""Offset that costs as much as standing still [body lengths]."""


class WormEnv(gymnasium.Env[Seen, Seen]):
    """A worm that is to keep to the reference of a scene.

    Parameters
    ----------
    scene : str
        A name from `worm3d list` or a file; its controller is not used.
    overrides : tuple of str
        As after -o.
    control_period : float
        Between two actions [s].

    Raises
    ------
    SceneError
        The scene is wrong, or has no reference, or its worm has not been identified.
    ValueError
        A control period of less than a time step.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": []}

    def __init__(self, scene: str = "path_line", overrides: tuple[str, ...] = (), control_period: float = 0.2) -> None:
        settings = load_scene(scene, overrides).settings
        if not isinstance(settings, ControlScene):
            raise SceneError(f"{scene}: a scene of the model '{settings.model}', must be of 'worm_control'")
        found = identified_of(settings)
        assert found is not None  # the scene was checked
        if not control_period >= settings.run.dt_s:
            raise ValueError(
                f"control_period: got {control_period!r} s, must be at least {settings.run.dt_s} s, a step"
            )
        self._scene, self._mechanism = settings, settings.controller.mechanism
        self._ranges, self._schedule = found.maps[self._mechanism].ranges, found.schedule
        self._reference, self._worm = reference_of(settings), worm_of(settings)
        self._every = round(control_period / settings.run.dt_s)
        self.control_period = self._every * settings.run.dt_s
        size = 2 * self._worm.segments + 9 + INPUTS
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (INPUTS,), np.float32)
        self.observation_space = gymnasium.spaces.Box(-LARGEST, LARGEST, (size,), np.float32)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Seen, dict[str, Any]]:
        """Begin an episode; without a seed the next noise is drawn."""
        super().reset(seed=seed)
        errors = int(self.np_random.integers(2**31))
        self._sensors = sensors_of(self._scene.model_copy(update={"seed": errors}))
        self._gate = Gate(self._worm, span_of(self._sensors.channels))
        self._wave = _Wave(WaveGenerator(self._schedule, self._worm), self._scene.run.dt_s)
        self._run = self._begun()
        self._action, self._strain = np.zeros(INPUTS, dtype=np.float32), np.zeros((self._worm.segments, 2))
        self._near: float | None = None
        true = self._run.observation()
        self._measured, self._way = true.com[:2], [(true.time, 0.0, *true.com[:2])]
        self._listen(self._wave.measurement or self._sensors(true))
        self._measured_before = self._measured
        return self._observed(), {}

    def step(self, action: Seen) -> tuple[Seen, float, bool, bool, dict[str, Any]]:
        """Crawl for a control period."""
        self._action = np.clip(np.asarray(action, dtype=np.float32), -1.0, 1.0)
        self._wave.target, self._measured_before = self._parameters(), self._measured
        status = self._crawled()
        true = self._run.observation()
        self._way.append((true.time, self._wave.generator.waves, *true.com[:2]))
        reward, info = self._reward()
        info |= {"status": status.value, "measurements_refused": self._gate.refused.total()}
        return self._observed(), reward, status is not Status.DONE, self._run.done >= self._run.steps, info

    def _begun(self) -> Run:
        """Return the run before its first step."""
        problem = problem_of(self._scene, drive=(self._wave, self._sensors))
        steps = max(1, problem.steps // self._every) * self._every
        return Run(replace(problem, duration=steps * problem.dt, record_every=self._every))

    def _crawled(self) -> Status:
        """Take the steps of a control period; return how the run stands."""
        for _ in range(self._every):
            status = self._run.take()
            if status is not Status.DONE:
                return status
            assert self._wave.measurement is not None
            self._listen(self._wave.measurement)
        return Status.DONE

    def _listen(self, measurement: Measurement) -> None:
        seen = self._gate(measurement.time, measurement)
        if seen.strain is not None:
            self._strain = np.where(np.isfinite(seen.strain), seen.strain, self._strain)
        if seen.com is not None:
            self._measured = seen.com[:2]

    def _parameters(self) -> GaitParameters:
        """Return the wave that the action means."""
        amplitude, frequency, steering = (0.5 * (1.0 + float(a)) for a in self._action)
        low, high = self._ranges.amplitude, self._ranges.frequency
        wave = GaitParameters(low[0] + amplitude * (low[1] - low[0]), high[0] + frequency * (high[1] - high[0]))
        return wave.steered(self._mechanism, (2.0 * steering - 1.0) * self._ranges.steering)

    def _asked(self, place: FloatArray) -> tuple[float, float, float, float]:
        """Return speed [m/s], azimuth [rad], offset [m] and curvature [1/m] at a place."""
        t, reference = self._run.time(self._run.done), self._reference
        speed = float(reference.speed(t))
        if reference.path is None:
            return speed, 0.0 if reference.heading is None else float(reference.heading(t)), 0.0, 0.0
        self._near = s = float(reference.path.project(place, self._near))
        path = reference.path
        return speed, float(path.heading(s)), float(offset(path, place, s)), float(path.curvature(s))

    def _observed(self) -> Seen:
        length = self._worm.length
        speed, azimuth, aside, curvature = self._asked(self._measured)
        phase, way = self._wave.generator.phase, max(speed * self.control_period, 1e-3 * length)
        parts = (
            self._strain.ravel(),
            [np.sin(phase), np.cos(phase), aside / length, speed / length, np.sin(azimuth), np.cos(azimuth)],
            (self._measured - self._measured_before) / way,
            [curvature * length],
            self._action,
        )
        return np.clip(np.concatenate(parts), -LARGEST, LARGEST).astype(np.float32)

    def _reward(self) -> tuple[float, dict[str, Any]]:
        """Return the reward for the last period, of the true centre of mass, and what it is made of."""
        way = np.array(self._way)
        speed, azimuth, aside, _ = self._asked(way[-1, 2:])
        before = np.array([np.interp(way[-1, 1] - 1.0, way[:, 1], column) for column in way.T])
        along = (way[-1, 2:] - before[2:]) @ np.array([np.cos(azimuth), np.sin(azimuth)])
        made = float(along) / float(way[-1, 0] - before[0])
        miss = made / max(speed, 1e-3 * self._worm.length) - 1.0
        reward = 1.0 - miss**2 - (aside / (WIDE * self._worm.length)) ** 2
        return max(-1.0, reward), {"speed_m_s": made, "offset_m": aside}


class _Wave:
    """The controller that the agent decides for: it keeps the latest measurement, and drives the wave asked for."""

    def __init__(self, generator: WaveGenerator, dt: float) -> None:
        self.generator, self._dt = generator, dt
        self.target = GaitParameters(0.0, 1.0)
        self.measurement: Measurement | None = None
        self._begun = False

    def reset(self) -> None:
        """Begin anew."""
        self.generator.reset()
        self.measurement, self._begun = None, False

    def step(self, t: float, measurement: Measurement) -> worm3d.Command:
        """Return the command from time t [s] on."""
        self.measurement = measurement
        command = self.generator.step(self._dt if self._begun else 0.0, self.target)
        self._begun = True
        return command
