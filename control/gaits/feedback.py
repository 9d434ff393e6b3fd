"""Gaits with memory, such as oscillators and networks of neurons, which may also use sensors.

Such a gait has an attribute `senses`, the names of the channels of `control.sensing.QUANTITIES` that it uses, and a
method `start` that returns its memory. The memory advances from one step to the next, depending on the felt samples,
and returns the activation of the segments. `control.gaits.gait` converts the activation into commands, as for any gait:

    @documented
    @dataclass(frozen=True, kw_only=True)
    class Mine(FeedbackGait, name="mine"):
        senses = ("strain",)
        lengthens = False

        def start(self, body: Body) -> Memory:
            return MyNetwork(body.segments)

If a gait uses sensors, `bind` returns a controller (`Feedback`). The argument `sensor` of `worm3d.simulate` determines
the accuracy of the samples. Without it they are exact. A gait without sensors is a function of time that advances the
memory from time 0, and can be used like any other gait.

The memory is not part of a `worm3d.State`. In a run that continues from a state, the memory of a gait with sensors
starts anew from its initial state. The memory of a gait without sensors is advanced from time 0 again.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, NamedTuple, Protocol

import numpy as np

from control.gaits.gait import Body, BoundGait, Gait
from control.sensing.sensors import QUANTITIES, Measurement, require_known, true_value
from worm3d import Command, Observation, Worm
from worm3d.values.arrays import FloatArray

Felt = Mapping[str, FloatArray]
"""Latest sample of each channel that the gait uses, for example strain (N, 2) or contact_load (N, 6).

A sample is kept until the next sample arrives. Each value is 0 until its first finite sample.
"""
Commanding = Callable[[float, Felt], Command]
"""Gait during one run, as a function of the time [s] and the felt samples that returns a command. Times must
increase."""


class Memory(Protocol):
    """State of a gait during a run."""

    def step(self, t: float, felt: Felt) -> FloatArray:
        """Advance to time t [s] and return the activation of the segments, shape (N,), or of their sides, (N, 2).

        The first call sets the start time of the memory, and later times must increase. `felt` has been constant since
        the previous call. Without sensors, the activation at a time does not depend on the times of earlier calls,
        except for integration errors, because the memory advances on an internal grid.
        """


class FeedbackGait(Gait):
    """A gait with memory, which may use sensors. Subclasses are dataclasses, and register like those of `Gait`."""

    @property
    def senses(self) -> tuple[str, ...]:
        """Names of the channels of `control.sensing.QUANTITIES` that the gait uses."""
        return ()

    @abstractmethod
    def start(self, body: Body) -> Memory:
        """Return the initial memory for one run of a body."""

    def activations(self, times: FloatArray, segments: int) -> FloatArray:
        """Return the activation of each segment at K times [s], shape (K, segments) or (K, segments, 2), in [-1, 1].

        The memory is advanced from time 0. If the times increase, it continues from the last time instead.

        Raises
        ------
        ValueError
            The gait uses sensors, and therefore is not a function of time.
        """
        if self.senses:
            raise ValueError(
                f"gait: {self.name!r} senses {', '.join(self.senses)}, so it is no function of time, must be bound to "
                "a worm that is simulated (in a scene, of the model worm or worm_planar)"
            )
        played: dict[int, Played] = self.__dict__.setdefault("_played", {})  # in a frozen dataclass, beside its fields
        if segments not in played:
            played[segments] = Played(partial(self.start, _Segments(segments)))
        return played[segments](times)

    def require_body(self, segments: int) -> None:
        """Raise ValueError if the gait does not fit a body with this number of segments."""
        self.start(_Segments(segments))

    def __getstate__(self) -> dict[str, Any]:
        """Return only the fields, for copies and for other processes."""
        return {name: value for name, value in self.__dict__.items() if name != "_played"}

    def bind(self, worm: Body) -> Any:
        """Return the actuation of `worm`: a `Feedback` if the gait uses sensors, otherwise a `BoundGait`."""
        self.require_stroke(worm.stroke)
        if self.senses:
            return Feedback(worm, self.senses, partial(commanding, self, worm))
        self.require_body(worm.segments)
        played = Played(partial(self.start, worm))
        return BoundGait(lambda times: self.applied(played(times), worm), self.require_steps)


class Played:
    """Activations of a memory without sensors, as a function of time.

    Parameters
    ----------
    begin : callable
        Returns an initial memory, which begins at time 0.
    """

    def __init__(self, begin: Callable[[], Memory]) -> None:
        self._begin, self._time = begin, np.inf

    def __call__(self, times: FloatArray) -> FloatArray:
        """Return the activations at K times [s], stacked. Before time 0 they equal those at time 0."""
        return np.array([self._at(max(float(t), 0.0)) for t in times])

    def _at(self, t: float) -> FloatArray:
        if t < self._time:
            self._memory, self._time = self._begin(), 0.0
            self._given = self._memory.step(0.0, {})
        if t > self._time:
            self._given, self._time = self._memory.step(t, {}), t
        return self._given


class Feedback:
    """Controller of one worm that runs a gait with sensors.

    Parameters
    ----------
    worm : Worm
    senses : tuple of str
        Names of the channels that the gait uses.
    begin : callable
        Returns the `Commanding` of a new run.

    Raises
    ------
    ValueError
        There is no such channel, or the worm does not have the channel's quantity.
    """

    def __init__(self, worm: Any, senses: tuple[str, ...], begin: Callable[[], Commanding]) -> None:
        require_known(senses)
        missing = [name for name in senses if not (isinstance(worm, Worm) and QUANTITIES[name].exists(worm))]
        if missing:
            raise ValueError(f"gait: senses {missing[0]}, must be bound to a worm3d.Worm that has this quantity")
        self._worm, self._senses, self._begin = worm, senses, begin
        self.reset()

    def reset(self) -> None:
        """Return to the initial state."""
        self._command = self._begin()
        self.felt = {name: np.zeros(QUANTITIES[name].shape(self._worm)) for name in self._senses}

    def step(self, t: float, measurement: Measurement | Observation | None) -> Command:
        """Return the command at time t [s]. `measurement` is None if nothing was measured.

        Raises
        ------
        ValueError
            The measurement lacks a channel that the gait uses.
        """
        if measurement is not None:
            self.felt = {name: latest(name, measurement, before) for name, before in self.felt.items()}
        return self._command(t, self.felt)

    def __call__(self, t: float) -> Command:
        """Return the initial command of a run that begins at time t [s]."""
        return Feedback(self._worm, self._senses, self._begin).step(t, None)


def latest(name: str, measurement: Measurement | Observation, before: FloatArray) -> FloatArray:
    """Return the latest sample of a channel. Numbers that are missing or not finite keep their previous values."""
    if isinstance(measurement, Observation):
        return true_value(name, measurement)
    if name not in measurement:
        raise ValueError(
            f"sensor: got one without the channel {name!r}, must have it: the gait senses it, as by "
            f"control.sensing.Sensors({name}=control.sensing.QUANTITIES[{name!r}].default)"
        )
    value = measurement[name].value
    return before if value is None else np.where(np.isfinite(value), value, before)


def commanding(gait: Gait, worm: Any) -> Commanding:
    """Return a gait, with or without sensors, as the `Commanding` of one run of a worm."""
    if not isinstance(gait, FeedbackGait):
        bound = gait.bind(worm)
        return lambda t, felt: bound(t)
    gait.require_stroke(worm.stroke)
    memory = gait.start(worm)

    def command(t: float, felt: Felt) -> Command:
        return Command(*(each[0] for each in gait.applied(memory.step(t, felt)[None], worm)))

    return command


class _Segments(NamedTuple):
    """A body that only has a number of segments."""

    segments: int
    stroke: tuple[float, float] = (-np.inf, 1.0)
