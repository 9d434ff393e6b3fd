"""Drive of the worm of a scene with a controller that is played (`scenes.models.base.Played`)."""

from __future__ import annotations

import math
from dataclasses import replace
from time import perf_counter
from typing import Any

import numpy as np

import worm3d
from control.faults.injected import Faulty
from control.loop import Driver
from control.sensing.sensors import Measurement
from control.tracking.references import Constant, Reference
from scenes.models.base import Played
from scenes.models.control.build import controller_of, faults_of, sensors_of
from scenes.models.control.reference import HEADING_KIND, reference_of
from scenes.models.control.schema import ControlScene
from scenes.models.control.view import horizon_of, in_space
from scenes.models.worm.play import Once
from worm3d.values.arrays import FloatArray

TURN_STEP, SPEED_STEP = math.radians(10.0), 0.01
"""Changes of the heading [rad] and of the speed [m/s] by a press of an arrow key. With half these values, a user
presses ten times for a turn that is seen. With double, the speed is soon beyond the worm's reach."""

PATH_SHOWN, PATH_POINTS = 4.0, 200
"""Length of an endless path that is shown ahead and behind, in body lengths, and number of points of a path. With half
the length, the end of the path is seen. With double the number of points, a page loads more slowly."""

KEPT = 200
"""Number of decisions that are kept while nothing is recorded. The controllers look back at the last ones only."""


class Phased:
    """Wrapper of a controller that stores the commanded phase and the computing time of each step."""

    def __init__(self, controller: Driver) -> None:
        self.controller = controller
        self.waves: list[float] = []
        """Commanded phase at the beginning of each step [waves]."""
        self.seconds: list[float] = []
        """Wall time of each step [s]. It is measured here, since a user's own controller may not measure it."""

    @property
    def period(self) -> float:
        """Averaging period of the speed [s]."""
        return self.controller.period

    def reset(self) -> None:
        """Reset the controller and the stored values."""
        self.controller.reset()
        self.waves, self.seconds = [], []

    def step(self, t: float, measurement: Measurement) -> worm3d.Command:
        """Return the command from time t [s] on."""
        began = perf_counter()
        command = self.controller.step(t, measurement)
        self.seconds.append(perf_counter() - began)
        self.waves.append(self.controller.waves)
        return command

    def at_rows(self, rows: int, every: int) -> FloatArray:
        """Return the commanded phase at the stored instants, shape (rows,) [waves].

        Every `every`-th step is stored. The phase at the end of the run is extrapolated.
        """
        waves = self.waves or [0.0]
        further = waves[-1] + (waves[-1] - waves[-2] if len(waves) > 1 else 0.0)
        return np.array([*waves, further])[: (rows - 1) * every + 1 : every]


class ControlPlay(Played):
    """The controller of a scene, which arrow keys steer by its reference."""

    steers = "Arrow keys: left and right turn away from the path, up and down change the speed; Esc: back to the path."

    def __init__(self, scene: ControlScene) -> None:
        self._scene = scene
        self.driver = Phased(controller_of(scene))
        faults = faults_of(scene)
        faulty: Any = Faulty(self.driver, faults, scene.seed, self.driver.controller) if faults else self.driver
        self._drive = Once(faulty), Once(sensors_of(scene))
        self._reference, self._heading = reference_of(scene), math.nan
        self._horizon = horizon_of(lambda: self.driver.controller.decisions, scene)

    def drive(self) -> tuple[Any, Any]:
        """Return the controller and its sensors."""
        return self._drive

    def follow(self, scene: ControlScene, time: float) -> None:
        """Take over the reference of a changed scene. The controller does not notice other changes."""
        if scene.reference != self._scene.reference:
            self._lead(reference_of(scene), self._heading)
        self._scene = scene

    def _lead(self, reference: Reference, heading: float) -> None:
        """Let the controller follow a reference, or the heading that keys have set. ValueError if it refuses."""
        wanted = reference
        if math.isfinite(heading):
            free: dict[str, Any] = {"path": None, "ends": False, "corridor": math.inf, "obstacles": ()}
            wanted = replace(wanted, heading=Constant(heading), **free)
        self.driver.controller.lead(wanted)
        self._reference, self._heading = reference, heading

    def steer(self, left: float, up: float, heading: float) -> dict[str, float]:
        """Turn away from the path, and return the changed speed or heading of the reference."""
        asked = self._scene.reference
        changed = {"reference.speed_m_s": round(asked.speed_m_s + SPEED_STEP * up, 9)} if up else {}
        if left and asked.kind == HEADING_KIND:
            changed["reference.heading_deg"] = round(asked.heading_deg + math.degrees(TURN_STEP) * left, 9)
        elif not self._reference.walled and (left or not up):
            before = self._heading if math.isfinite(self._heading) else heading
            self._lead(self._reference, before + TURN_STEP * left if left else math.nan)
        return changed

    def state(self) -> str:
        """Return the heading that keys have set, as a text."""
        if not math.isfinite(self._heading):
            return ""
        return f"steered to {math.degrees(self._heading):.0f} deg instead of along the path; Esc: back to the path"

    def horizon(self, time: float, com: FloatArray) -> FloatArray | None:
        """Return the latest predicted path."""
        return self._horizon(time, com)

    def path(self, com: FloatArray) -> FloatArray | None:
        """Return the path near the centre of mass."""
        path = self._reference.path
        if path is None:
            return None
        here, reach = float(path.project(com[:2])), PATH_SHOWN * self._scene.worm.length_m
        begin, end = (0.0, path.length) if math.isfinite(path.length) else (here - reach, here + reach)
        return in_space(path.point(np.linspace(begin, end, PATH_POINTS)), float(com[2]), self._scene)

    def wanted(self, time: float) -> float | None:
        """Return the speed of the reference."""
        return float(self._reference.speed(time))

    def forget(self) -> None:
        """Forget all but the last decisions."""
        driver, controller = self.driver, self.driver.controller
        driver.waves, driver.seconds = [], []
        for kept in (controller.decisions, getattr(controller.estimator, "innovations", [])):
            del kept[:-KEPT]
