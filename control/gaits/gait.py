"""Base class of all gaits, which give the activation of each segment over time.

A gait defines an activation A_i(t) in [-1, 1] for each segment i = 0 (tail) ... N-1 (head), or for each of the
segment's two sides. The commands to the worm follow from the activation:

    contraction = amplitude A (1 + bias) left, amplitude A (1 - bias) right, clipped to the worm's stroke
    force       = force A (1 + bias) left,     force A (1 - bias) right
    hinge_j     = hinge max(0, A_j),           j = 1 ... N-1 (the joint belongs to its headward segment)

where A_j is the mean of the two sides if the sides differ.

To add a gait, derive a dataclass from `Gait` with the name used in scenes, `class Mine(Gait, name="mine")`. If it is in
a new module, import it in `control/gaits/__init__.py`. A gait that bends the joints in another way overrides
`commands`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar, Literal, Protocol

import numpy as np

from worm3d import Command, Commands
from worm3d.values import time_steps
from worm3d.values.arrays import FloatArray
from worm3d.values.parameters import check, documented, parameter
from worm3d.values.spelling import Spelled

Direction = Literal["direct", "retrograde"]
"""Direction of the waves: "direct" from tail to head, "retrograde" from head to tail."""

GAITS: dict[str, type[Gait]] = {}
"""Class of each gait, by the name used in scenes."""


class Body(Protocol):
    """Properties of a worm that a gait needs."""

    @property
    def segments(self) -> int:
        """Number of segments."""

    @property
    def stroke(self) -> tuple[float, float]:
        """Smallest and greatest contraction of a chamber."""


@documented
@dataclass(frozen=True, kw_only=True)
class Gait(Spelled, ABC):
    """An activation pattern and its application to the chambers and hinges.

    Subclasses are registered in `GAITS` under their `name`. If a gait has a `period` [s], quantities of a run are
    averaged over it.
    """

    amplitude: float = parameter(0.2, meaning="contraction of a chamber at activation 1", aka=("contraction", "stroke"))
    bias: float = parameter(
        0.0,
        meaning="imbalance: the left chambers shorten 1 + bias, the right ones 1 - bias times as much",
        ge=-1,
        le=1,
        allowed="a number in [-1, 1]",
    )
    hinge: float = parameter(
        0.0,
        meaning="hinge angle of a joint at activation 1; positive yaws the headward segment to the left",
        unit="rad",
    )
    force: float = parameter(
        0.0, meaning="force of a chamber at activation 1, in addition to the contraction; positive contracts", unit="N"
    )
    name: ClassVar[str] = ""
    turning: ClassVar[tuple[str, ...]] = ("bias", "hinge")
    """Names of the parameters whose only effect is to turn a worm."""

    def __init_subclass__(cls, name: str = "") -> None:
        known = GAITS.get(name)
        if known is not None and (known.__module__, known.__qualname__) != (cls.__module__, cls.__qualname__):
            raise ValueError(f"name: got {name!r}, must be another than those of the gaits that there are")
        if name:  # a class that is defined again, for example in a notebook, replaces the former class
            cls.name, GAITS[name] = name, cls

    def __post_init__(self) -> None:
        check(self)

    @property
    @abstractmethod
    def lengthens(self) -> bool:
        """Whether the activation falls below 0 at some time."""

    @abstractmethod
    def activations(self, times: FloatArray, segments: int) -> FloatArray:
        """Return the activation of each segment at K times [s], in [-1, 1].

        The shape is (K, segments) or, if the left and right sides differ, (K, segments, 2).
        """

    def activation(self, t: float, segments: int) -> FloatArray:
        """Return the activation of each segment at time t [s], averaged over its sides, shape (segments,)."""
        return np.asarray(sides(self.activations(np.array([t]), segments))[0].mean(axis=-1))

    def require_body(self, segments: int) -> None:
        """Raise ValueError if the gait does not fit a body with this number of segments."""
        self.activations(np.zeros(1), segments)

    def require_stroke(self, stroke: tuple[float, float]) -> None:
        """Raise ValueError if the amplitude exceeds a stroke.

        If the stroke ends at 0, the chambers can only lengthen, or only contract, and the other part of the gait is
        left out. Lengthening by a share of the amplitude, bias and steering are clipped to the stroke.
        """
        require_amplitude(self.amplitude, stroke)

    def require_steps(self, dt: float) -> None:
        """Raise ValueError for time steps [s] that are too long for the gait."""
        period = getattr(self, "period", None)
        if period is not None:
            time_steps.require_period(dt, "the gait's period", period)

    def bind(self, worm: Body) -> BoundGait:
        """Return the actuation of `worm`: time [s] -> `worm3d.Command`, clipped to the worm's stroke.

        Raises
        ------
        ValueError
            The worm lacks segments that the gait needs, or its stroke is smaller than the gait's amplitude.
        """
        self.require_body(worm.segments)
        self.require_stroke(worm.stroke)
        return BoundGait(partial(self.commands, worm=worm), self.require_steps)

    def commands(self, times: FloatArray, worm: Body) -> Commands:
        """Return the commands to `worm` at K times [s]."""
        return self.applied(self.activations(times, worm.segments), worm)

    def applied(self, activations: FloatArray, worm: Body) -> Commands:
        """Return the commands to `worm` for activations of shape (K, segments) or (K, segments, 2)."""
        activation = sides(activations)
        chambers = activation * np.array([1.0 + self.bias, 1.0 - self.bias])
        hinge = self.hinge * np.maximum(0.0, activation[:, 1:].mean(axis=-1))
        return Commands(np.clip(self.amplitude * chambers, *worm.stroke), hinge, self.force * chambers)


def direction_of_waves(default: Direction = "retrograde", more: str = "") -> Any:
    """Return the field of the direction of the waves along the body; `more` completes the meaning."""
    meaning = "retrograde: waves run from head to tail, as in earthworms; direct: from tail to head, as in larvae"
    return parameter(default, meaning + more)


def longer(default: float, what: str = "an extended segment") -> Any:
    """Return the dataclass field for the activation of a segment or side that is longer than at rest."""
    meaning = f"activation of {what}, -0.5 lengthens it by half the amplitude"
    return parameter(default, meaning=meaning, ge=-1, le=0, allowed="a number in [-1, 0]")


@documented
@dataclass(frozen=True, kw_only=True)
class ExtendingGait(Gait):
    """A gait whose segments are either contracted, or extended beyond their length at rest."""

    extension: float = longer(-0.5)

    @property
    def lengthens(self) -> bool:
        """Whether the activation falls below 0 at some time."""
        return self.extension < 0.0

    def activation_of(self, extended: FloatArray) -> FloatArray:
        """Return the activation for shares of the full extension. It decreases from 1 to `extension`."""
        return 1.0 - (1.0 - self.extension) * extended


class BoundGait:
    """A gait as the actuation of one worm, a function of time [s] that returns a `worm3d.Command`.

    `commands` takes K times at once. `require_steps` is the method of the gait.
    """

    def __init__(self, commands: Callable[[FloatArray], Commands], require_steps: Callable[[float], None]) -> None:
        self.commands, self.require_steps = commands, require_steps

    def __call__(self, t: float) -> Command:
        """Return the command at time t [s]."""
        contraction, hinge, force = self.commands(np.array([t]))
        return Command(contraction[0], hinge[0], force[0])


def require_amplitude(amplitude: float, stroke: tuple[float, float]) -> None:
    """Raise ValueError if an amplitude exceeds a stroke, the smallest and the greatest contraction of a chamber."""
    end = stroke[0] if amplitude < 0.0 else stroke[1]
    if end != 0.0 and abs(amplitude) > abs(end) * (1.0 + time_steps.EQUAL):
        what = "lengthen" if amplitude < 0.0 else "contract"
        raise ValueError(
            f"amplitude: got {amplitude!r}, must be at {'least' if amplitude < 0.0 else 'most'} {end!r}, the worm's "
            f"stroke: its chambers {what} no further; lower the amplitude, or take a worm with a larger stroke"
        )


def sides(activations: FloatArray) -> FloatArray:
    """Return activations with an axis for the sides: shape (K, N) becomes (K, N, 1), and shape (K, N, 2) is kept."""
    return activations[..., None] if activations.ndim == 2 else activations


def joined(activation: FloatArray) -> FloatArray:
    """Return activations without an axis for equal sides: shape (K, N, 1) becomes (K, N), other shapes are kept."""
    return activation[..., 0] if activation.shape[-1] == 1 else activation


def for_segments(name: str, value: float | FloatArray, segments: int) -> FloatArray:
    """Return a number, or one number per segment or side, as an array that broadcasts to shape (N, 2).

    Raises
    ------
    ValueError
        `value` has the wrong number of segments. The message calls it `name`.
    """
    found = np.atleast_1d(value)
    found = found if found.ndim == 2 else found[:, None]
    if np.ndim(value) and found.shape not in ((segments, 1), (segments, 2)):
        raise ValueError(
            f"{name}: got shape {np.shape(value)}, must be a number, or one or a pair of left and right for each of "
            f"the worm's {segments} segments"
        )
    return found


def half_cosine(part: FloatArray) -> FloatArray:
    """Return 0 for `part` below 0, 1 for `part` above 1, and half a cosine wave in between."""
    return (1.0 - np.cos(np.pi * np.clip(part, 0.0, 1.0))) / 2.0
