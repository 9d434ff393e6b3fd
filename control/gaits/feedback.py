"""Gaits with a memory, and optionally with sensors: oscillators and other networks that have a state.

A gait of this kind is a subclass of `FeedbackGait`. Its property `senses` contains the names of the channels of
`control.sensing.QUANTITIES` that the gait uses. Its method `start` returns the initial memory. At each step of a run,
`Memory.step` gets the latest samples, advances the state, and returns the activation of the segments.
`control.gaits.gait` converts the activation to commands, as for any gait. For example:

    @documented
    @dataclass(frozen=True, kw_only=True)
    class Mine(FeedbackGait, name="mine"):
        senses = ("strain",)
        lengthens = False

        def start(self, body: Body) -> Memory:
            return MyNetwork(body.segments)

A gait that uses sensors is bound to a worm as a controller (`Feedback`). The `sensor` of
`worm3d.simulate(..., sensor=...)` then takes the samples, with its errors. Without a `sensor` the samples are exact. A
gait without sensors is a function of time, whose memory is advanced from time 0. It can be used wherever a gait can be
used.

A `worm3d.State` does not contain the memory. If a run continues from a state, the memory of a gait with sensors begins
again with `start`, and the memory of a gait without sensors is again advanced from time 0.
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
"""Latest sample of each sensed channel by name, with the shape of the quantity: strain (N, 2), contact_load (N, 6).

Each number keeps its latest finite value. It is 0 before the first finite value.
"""
Commanding = Callable[[float, Felt], Command]
"""Gait during one run, as a function from the time [s] and the latest samples to the command. The times of successive
calls must not decrease."""


class Memory(Protocol):
    """State of a gait during a run."""

    def step(self, t: float, felt: Felt) -> FloatArray:
        """Advance to time t [s] and return the activation of the segments, shape (N,), or of their sides, (N, 2).

        The first call sets the start time of the memory. The times of later calls must not decrease. `felt` contains
        the latest samples, which are assumed to have been constant since the previous call. Without sensors, the
        activation at a time does not depend on the times of earlier calls, except for integration errors, because the
        memory advances in its own fixed steps.
        """


class FeedbackGait(Gait):
    """Base class of gaits with a memory and optional sensors. A subclass is a dataclass with a `name`, as any gait."""

    @property
    def senses(self) -> tuple[str, ...]:
        """Names of the channels of `control.sensing.QUANTITIES` that the gait uses; empty if it uses no sensors."""
        return ()

    @abstractmethod
    def start(self, body: Body) -> Memory:
        """Return the initial memory for one run of a body."""

    def activations(self, times: FloatArray, segments: int) -> FloatArray:
        """Return the activation of each segment at K times [s], shape (K, segments) or (K, segments, 2), in [-1, 1].

        The memory is advanced from time 0. It continues from the time of the previous call if the times increase.

        Raises
        ------
        ValueError
            The gait uses sensors, and is therefore not a function of time.
        """
        if self.senses:
            raise ValueError(
                f"gait: {self.name!r} senses {', '.join(self.senses)}, so it is not a function of time. It must be "
                "bound to a simulated worm (in a scene: use the model worm or worm_planar)"
            )
        played: dict[int, Played] = self.__dict__.setdefault("_played", {})  # a cache, not a field
        if segments not in played:
            played[segments] = Played(partial(self.start, _Segments(segments)))
        return played[segments](times)

    def require_body(self, segments: int) -> None:
        """Raise ValueError if the gait does not fit a body with this number of segments."""
        self.start(_Segments(segments))

    def __getstate__(self) -> dict[str, Any]:
        """Return the state for copying and pickling: only the fields, without the cache of `activations`."""
        return {name: value for name, value in self.__dict__.items() if name != "_played"}

    def bind(self, worm: Body) -> Any:
        """Return the actuation of `worm`: a `Feedback` if the gait uses sensors, else a `BoundGait`."""
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
        Function without arguments that returns a new memory. The memory begins at time 0.
    """

    def __init__(self, begin: Callable[[], Memory]) -> None:
        self._begin, self._time = begin, np.inf

    def __call__(self, times: FloatArray) -> FloatArray:
        """Return the activations at K times [s], stacked along a first axis of length K.

        Before time 0 they equal the activations at time 0.
        """
        return np.array([self._at(max(float(t), 0.0)) for t in times])

    def _at(self, t: float) -> FloatArray:
        if t < self._time:
            self._memory, self._time = self._begin(), 0.0
            self._given = self._memory.step(0.0, {})
        if t > self._time:
            self._given, self._time = self._memory.step(t, {}), t
        return self._given


class Feedback:
    """Gait with sensors, as the controller of one worm.

    Parameters
    ----------
    worm : Worm
    senses : tuple of str
        Names of the channels that the gait uses.
    begin : callable
        Function without arguments that returns a new `Commanding`, for one run.

    Raises
    ------
    ValueError
        A channel does not exist, or the worm does not have its quantity.
    """

    def __init__(self, worm: Any, senses: tuple[str, ...], begin: Callable[[], Commanding]) -> None:
        require_known(senses)
        missing = [name for name in senses if not (isinstance(worm, Worm) and QUANTITIES[name].exists(worm))]
        if missing:
            raise ValueError(f"gait: it senses {missing[0]}, so it must be bound to a worm3d.Worm with this quantity")
        self._worm, self._senses, self._begin = worm, senses, begin
        self.reset()

    def reset(self) -> None:
        """Restart with a new memory; all latest samples are 0."""
        self._command = self._begin()
        self.felt = {name: np.zeros(QUANTITIES[name].shape(self._worm)) for name in self._senses}

    def step(self, t: float, measurement: Measurement | Observation | None) -> Command:
        """Return the command at time t [s]. `measurement` is None if nothing was measured.

        Raises
        ------
        ValueError
            The measurement does not contain a channel that the gait uses.
        """
        if measurement is not None:
            self.felt = {name: latest(name, measurement, before) for name, before in self.felt.items()}
        return self._command(t, self.felt)

    def __call__(self, t: float) -> Command:
        """Return the initial command of a run that begins at time t [s]."""
        return Feedback(self._worm, self._senses, self._begin).step(t, None)


def latest(name: str, measurement: Measurement | Observation, before: FloatArray) -> FloatArray:
    """Return the latest sample of a channel. Numbers that are missing or not finite are taken from `before`."""
    if isinstance(measurement, Observation):
        return true_value(name, measurement)
    if name not in measurement:
        raise ValueError(
            f"sensor: got a sensor without the channel {name!r}, must have it because the gait senses it. For example: "
            f"control.sensing.Sensors({name}=control.sensing.QUANTITIES[{name!r}].default)"
        )
    value = measurement[name].value
    return before if value is None else np.where(np.isfinite(value), value, before)


def commanding(gait: Gait, worm: Any) -> Commanding:
    """Return a gait, with or without sensors, as a `Commanding` for one run of a worm."""
    if not isinstance(gait, FeedbackGait):
        bound = gait.bind(worm)
        return lambda t, felt: bound(t)
    gait.require_stroke(worm.stroke)
    memory = gait.start(worm)

    def command(t: float, felt: Felt) -> Command:
        return Command(*(each[0] for each in gait.applied(memory.step(t, felt)[None], worm)))

    return command


class _Segments(NamedTuple):
    """Body that is described only by its number of segments, for gaits that are not bound to a worm."""

    segments: int
    stroke: tuple[float, float] = (-np.inf, 1.0)
