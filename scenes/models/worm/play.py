"""Drive of the worm of a scene with a gait that is played (`scenes.models.base.Played`)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import worm3d
from scenes.models.base import Played
from scenes.models.worm.build import gait_of, sensor_of
from scenes.models.worm.schema import GaitScene

HINGE_STEP, BIAS_STEP, PERIOD_STEP = 5.0, 0.1, 1.1
"""Changes of the hinge [deg], of the bias and of the period (as a factor) by a press of an arrow key. With half these
values, a user presses ten times for an effect that is seen. With double, the worm swerves."""


class Once:
    """A controller or a sensor that goes on over several runs: it is reset only at the start of the first.

    The time that a controller is told is later than the time of the run by `shift` [s].
    """

    def __init__(self, part: Any, shift: float = 0.0) -> None:
        self._part, self._shift, self._begun = part, shift, False
        if hasattr(part, "period"):
            self.period = part.period

    def reset(self) -> None:
        """Reset a part that was not in use before."""
        if not self._begun:
            getattr(self._part, "reset", lambda: None)()
        self._begun = True

    def step(self, t: float, measurement: Any) -> worm3d.Command:
        """Return the command from time t [s] on."""
        command: worm3d.Command = self._part.step(t + self._shift, measurement)
        return command

    def __call__(self, observation: Any) -> Any:
        """Return a measurement."""
        return self._part(observation)


class Going:
    """A gait with shifted time, so that a new period does not make the phase jump."""

    def __init__(self, gait: Any, shift: float = 0.0) -> None:
        self.gait, self.shift = gait, shift
        self._bound: Once | None = None
        self.period: float | None = getattr(gait, "period", None)

    def bind(self, worm: worm3d.Worm) -> Callable[[float], worm3d.Command] | Once:
        """Return the commands as a function of the time, or the same controller for all runs."""
        given = self.gait.bind(worm)
        if not hasattr(given, "step"):
            return lambda t: given(t + self.shift)
        self._bound = self._bound or Once(given, self.shift)
        return self._bound

    def followed_by(self, gait: Any, time: float) -> Going:
        """Return another gait that goes on with the phase at a time [s]."""
        period: float | None = getattr(gait, "period", None)
        if self.period is None or period is None:
            return Going(gait, self.shift)
        return Going(gait, (time + self.shift) * period / self.period - time)


class GaitPlay(Played):
    """The gait of a scene. Arrow keys steer by parameters of the gait."""

    steers = "Arrow keys: left and right turn, up and down change the period."

    def __init__(self, scene: GaitScene) -> None:
        self._scene, self._gait, self._sensor = scene, Going(gait_of(scene)), self._sensor_of(scene)

    @staticmethod
    def _sensor_of(scene: GaitScene) -> Once | None:
        sensor = sensor_of(scene)
        return None if sensor is None else Once(sensor)

    def drive(self) -> tuple[Any, Any]:
        """Return the gait and the sensor."""
        return self._gait, self._sensor

    def follow(self, scene: GaitScene, time: float) -> None:
        """Take over the gait of a changed scene, in the phase of the former one."""
        if scene.gait != self._scene.gait:
            self._gait, self._sensor = self._gait.followed_by(gait_of(scene), time), self._sensor_of(scene)
        self._scene = scene

    def steer(self, left: float, up: float, heading: float) -> dict[str, float]:
        """Return the changed hinge, or bias for a gait without hinges, and the changed period."""
        gait = self._scene.gait
        changed: dict[str, float] = {}
        for name, step in (("hinge_deg", HINGE_STEP), ("bias", BIAS_STEP)):
            if left and not changed and isinstance(getattr(gait, name, None), int | float):
                changed[f"gait.{name}"] = round(getattr(gait, name) + step * left, 9)
        if up and isinstance(getattr(gait, "period_s", None), int | float):
            changed["gait.period_s"] = float(f"{gait.period_s / PERIOD_STEP**up:.6g}")
        return changed
