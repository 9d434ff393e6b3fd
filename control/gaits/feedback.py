"""Gaits with memory, which may sense: oscillators and other networks whose state goes on from step to step.

A gait of this kind says what it `senses`, channels of `control.sensing.QUANTITIES` by name, and how its memory
`start`s. The memory advances from one step to the next under what is felt, and gives the activation of the segments,
which `control.gaits.gait` turns into commands as those of any gait:

    @documented
    @dataclass(frozen=True, kw_only=True)
    class Mine(FeedbackGait, name="mine"):
        senses = ("strain",)
        lengthens = False

        def start(self, body: Body) -> Memory:
            return MyNetwork(body.segments)

A gait that senses is bound as a controller (`Feedback`): `worm3d.simulate(..., sensor=...)` decides how well it feels,
exactly if there is no sensor. One that senses nothing remains a function of time, which runs wherever gaits do; it is
computed by advancing its memory from time 0.

The memory is no part of a `worm3d.State`. A run that goes on from a state meets a memory that begins anew, where
the gait senses; where it does not, its memory is advanced from time 0 again.
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
"""Latest sample of each channel that is sensed, of the shape of its quantity: strain (N, 2), contact_load (N, 6).

A sample is kept until the next arrives; before the first, and where no finite number has come yet, it is 0.
"""


class Memory(Protocol):
    """State of a gait during one run."""

    def step(self, t: float, felt: Felt) -> FloatArray:
        """Advance to time t [s] and return the activation of the segments, shape (N,), or of their sides, (N, 2).

        The first call tells when the memory begins; times ascend from there. `felt` has been constant since the call
        before. Where nothing is felt, the activation at a time does not depend on the times asked for before, but for
        errors of integration: steps of the memory's own, on a grid of its own, see to that.
        """


class FeedbackGait(Gait):
    """A gait with memory, which may sense; a subclass is a dataclass that registers as any gait does."""

    @property
    def senses(self) -> tuple[str, ...]:
        """Names of the channels of `control.sensing.QUANTITIES` that it senses."""
        return ()

    @abstractmethod
    def start(self, body: Body) -> Memory:
        """Return a fresh memory for one run of a body."""

    def activations(self, times: FloatArray, segments: int) -> FloatArray:
        """Return the activation of each segment at K times [s], shape (K, segments) or (K, segments, 2), in [-1, 1].

        The memory is advanced from time 0; it goes on where it stopped as long as the times ascend.

        Raises
        ------
        ValueError
            The gait senses, so that it is no function of time.
        """
        if self.senses:
            raise ValueError(
                f"gait: {self.name!r} senses {', '.join(self.senses)}, so it is no function of time, must be bound to "
                "a worm that is simulated (in a scene, of the model worm or worm_planar)"
            )
        played: dict[int, Played] = self.__dict__.setdefault("_played", {})  # of a frozen dataclass, beside its fields
        if segments not in played:
            played[segments] = Played(partial(self.start, _Segments(segments)))
        return played[segments](times)

    def require_body(self, segments: int) -> None:
        """Raise ValueError unless a body of so many segments can have the gait."""
        self.start(_Segments(segments))

    def __getstate__(self) -> dict[str, Any]:
        """Return the fields alone, to be copied or sent to other processes."""
        return {name: value for name, value in self.__dict__.items() if name != "_played"}

    def bind(self, worm: Body) -> Any:
        """Return the actuation of `worm`: a `Feedback` where the gait senses, else a `BoundGait`."""
        self.require_stroke(worm.stroke)
        if self.senses:
            return Feedback(worm, self.senses, partial(_Activating, self, worm))
        self.require_body(worm.segments)
        played = Played(partial(self.start, worm))
        return BoundGait(lambda times: self.applied(played(times), worm), self.require_steps)


class Played:
    """Activations of a memory that feels nothing, as a function of time.

    Parameters
    ----------
    begin : callable
        Returns a fresh memory, which begins at time 0.
    """

    def __init__(self, begin: Callable[[], Memory]) -> None:
        self._begin, self._time = begin, np.inf

    def __call__(self, times: FloatArray) -> FloatArray:
        """Return the activations at K times [s], stacked; those before time 0 are those at 0."""
        return np.array([self._at(max(float(t), 0.0)) for t in times])

    def _at(self, t: float) -> FloatArray:
        if t < self._time:
            self._memory, self._time = self._begin(), 0.0
            self._given = self._memory.step(0.0, {})
        if t > self._time:
            self._given, self._time = self._memory.step(t, {}), t
        return self._given


class Commanding(Protocol):
    """Memory of a run that gives whole commands."""

    def command(self, t: float, felt: Felt) -> Command:
        """Advance to time t [s], as a `Memory` does, and return the command."""


class Feedback:
    """Gait that senses, as the controller of one worm.

    Parameters
    ----------
    worm : Worm
    senses : tuple of str
        Channels that it senses.
    begin : callable
        Returns a fresh `Commanding` for a run.

    Raises
    ------
    ValueError
        There is no such channel, or the worm does not have its quantity.
    """

    def __init__(self, worm: Any, senses: tuple[str, ...], begin: Callable[[], Commanding]) -> None:
        require_known(senses)
        missing = [name for name in senses if not (isinstance(worm, Worm) and QUANTITIES[name].exists(worm))]
        if missing:
            raise ValueError(f"gait: senses {missing[0]}, must be bound to a worm3d.Worm that has this quantity")
        self._worm, self._senses, self._begin = worm, senses, begin
        self.reset()

    def reset(self) -> None:
        """Begin anew, with a fresh memory that has felt nothing."""
        self._memory = self._begin()
        self.felt = {name: np.zeros(QUANTITIES[name].shape(self._worm)) for name in self._senses}

    def step(self, t: float, measurement: Measurement | Observation | None) -> Command:
        """Return the command at time t [s], after what has been measured; None: nothing has.

        Raises
        ------
        ValueError
            A measurement without a channel that is sensed.
        """
        if measurement is not None:
            self.felt = {name: latest(name, measurement, before) for name, before in self.felt.items()}
        return self._memory.command(t, self.felt)

    def __call__(self, t: float) -> Command:
        """Return the command at which a run would begin at time t [s]."""
        return Feedback(self._worm, self._senses, self._begin).step(t, None)


def latest(name: str, measurement: Measurement | Observation, before: FloatArray) -> FloatArray:
    """Return the latest sample of a channel; numbers that have not arrived or are not finite remain as before."""
    if isinstance(measurement, Observation):
        return true_value(name, measurement)
    if name not in measurement:
        raise ValueError(
            f"sensor: got one without the channel {name!r}, must have it: the gait senses it, as by "
            f"control.sensing.Sensors({name}=control.sensing.QUANTITIES[{name!r}].default)"
        )
    value = measurement[name].value
    return before if value is None else np.where(np.isfinite(value), value, before)


class _Activating:
    """Memory of a gait whose activations are applied as those of any gait."""

    def __init__(self, gait: FeedbackGait, worm: Body) -> None:
        gait.require_stroke(worm.stroke)
        self._gait, self._worm, self._memory = gait, worm, gait.start(worm)

    def command(self, t: float, felt: Felt) -> Command:
        given = self._gait.applied(self._memory.step(t, felt)[None], self._worm)
        return Command(*(each[0] for each in given))


def commanding(gait: Gait, worm: Any) -> Callable[[float, Felt], Command]:
    """Return a gait for one run of a worm, whether it senses or not: time [s] and what is felt -> command."""
    if isinstance(gait, FeedbackGait):
        return _Activating(gait, worm).command
    bound = gait.bind(worm)
    return lambda t, felt: bound(t)


class _Segments(NamedTuple):
    """Body of which no more than the number of its segments is known."""

    segments: int
    stroke: tuple[float, float] = (-np.inf, 1.0)
