"""Controllers that should not pay: at rest, slow, constant, or after the rules of the benchmark instead of the task."""

from __future__ import annotations

import math
from dataclasses import replace
from time import sleep

import numpy as np

from control.baselines import PiLineOfSight
from control.gaits.steering import GaitParameters, WaveGenerator
from control.parts import part
from worm3d import Command

PART = "controller"


class Own:
    """A controller without a base class of the package, which makes and asks line-of-sight for what it commands."""

    def __init__(self, task):
        self.task, self.guide = task, PiLineOfSight.of(self.seen(task))

    @classmethod
    def of(cls, task):
        return cls(task)

    def seen(self, task):
        return task

    def reset(self):
        self.guide.reset()

    def step(self, t, measurement):
        return self.guide.step(t, measurement)

    def rest(self):
        return Command(np.zeros((self.task.worm.segments, 2)))


@part(PART)
class Rests(Own):
    def step(self, t, measurement):
        return self.rest()


@part(PART)
class Slow(Own):
    """Line-of-sight at 40 % of the speed asked for: its offset is small."""

    def seen(self, task):
        asked = task.reference.speed
        return replace(task, reference=replace(task.reference, speed=lambda t: 0.4 * asked(t)))


@part(PART)
class Lies(Slow):
    """The same, which says that it waves a thousand times as fast as it does, and that it takes no time."""

    waves, overruns, decisions = property(lambda self: 1000.0 * self.guide.waves), 0, ()


@part(PART)
class Constant(Own):
    """The wave of the speed asked for at first, by the map, whatever happens."""

    def reset(self):
        self.wave = WaveGenerator(self.task.map.schedule, self.task.worm)
        self.guide.reset()
        amplitude, frequency, _ = self.guide.feed_forward(float(self.task.reference.speed(0.0)), 0.0)
        self.parameters = GaitParameters(float(amplitude), float(frequency))

    def step(self, t, measurement):
        return self.wave.step(0.01, self.parameters)


@part(PART)
class Stops(Own):
    """Line-of-sight that stops once it does well."""

    def step(self, t, measurement):
        return super().step(t, measurement) if t < 7.0 else self.rest()


@part(PART)
class RaisesLate(Own):
    """Line-of-sight that wants no more to be measured."""

    def step(self, t, measurement):
        if t > 9.0:
            raise SystemExit(0)
        return super().step(t, measurement)


@part(PART)
class Nothing(Rests):
    """Commands that are no numbers."""

    def step(self, t, measurement):
        return Command(np.full((self.task.worm.segments, 2), np.nan))


@part(PART)
class Forces(Rests):
    """It pulls with forces that no worm of the trials has."""

    def step(self, t, measurement):
        return Command(np.zeros((self.task.worm.segments, 2)), force=0.1)


@part(PART)
class Weaves(PiLineOfSight):
    """Line-of-sight that swings to and fro with the period of the window."""

    def _turn(self, t, estimate):
        return super()._turn(t, estimate) + 0.3 * math.sin(2.0 * math.pi / 2.5 * t)


@part(PART)
class Late(PiLineOfSight):
    """It computes between the times that it keeps."""

    def step(self, t, measurement):
        sleep(0.0125)
        return super().step(t, measurement)


@part(PART)
class Sees(Rests):
    """It brings a sensor of its own."""

    senses = ("truth",)
