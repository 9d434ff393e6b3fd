"""Segment laws, which relate the shape of a segment to its energy and to the places of its contact points.

A segment has two chambers, left and right. Chamber c has the length l_c of (E2) in `worm3d.physics.elements`. Its state
of command is the rest length l_cmd = l0 (1 - a), where a is the contraction that the actuator has reached. A segment
law gives, in CasADi symbols,

    springs   of each chamber: an energy U(l_c, l_cmd), and possibly a second energy of an angle of the chamber (SL1)
    dampers   on the same coordinates                                                                       (SL2)
    bending   a further energy of the whole segment, B(l, th, l_cmd of both chambers)                       (SL3)
    outline   of each chamber: height h(l_c, l_cmd) and outward distance w(l_c, l_cmd)                      (SL4)

The apexes of chamber c below and above are at m +- b d -+ h u, and the outward apex is at m +- w d, in the notation of
(E3). If the outline depends on l_cmd, the command moves contact points at a constant shape of the segment. In a step,
the work of the command on these points is f . (dX/dl_cmd) dl_cmd, where f is the gradient of the potential of the
points at the end of the step. The energy ledger counts this work as work of the actuators.

A segment law is a dataclass. Its numeric fields, and `further_inputs`, are inputs of the kernels, which are generated
and compiled once per class.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from worm3d.physics.body import Body
from worm3d.physics.part import Part, Symbol, Symbols
from worm3d.values.arrays import FloatArray
from worm3d.values.parameters import parameters_of

SEGMENT_LAWS: dict[str, type[SegmentLaw]] = {}
"""Class of each segment law by name."""

SEGMENT_INPUTS = ("link", "offset", "k", "k_apex", "l0", "tau")
"""Names of the inputs of a segment law other than parameters and `further_inputs`."""

GREATEST_LENGTH = 20.0
"""Greatest length of a chamber without links, in rest lengths of the segment. It bounds only the iterates of Newton's
method. No worm comes close to this length, so that half and double this value change nothing."""

JOINT_REACH = 0.95
"""Length of a chamber without links, over twice the links of the rhombus in (H5), above which the lever of its joints
is constant. A rhombus is flat at 1. Friction is fitted only to shorter segments."""

FLATTENING_LENGTHS = 201
"""Number of lengths at which `SegmentLaw.flattening_weight` looks for the greatest weight. Half and double this number
change the weight of the shipped laws by less than 0.1 %."""

TABLE_ROUNDING = 1e-9
"""Margin of the table of inputs, as a fraction of its range. It is above the rounding error of a command."""

Pair = Callable[[Any, Symbols, Symbol, Symbol], tuple[Symbol, Symbol]]
"""Function of a class, its inputs, length and commanded rest length of a chamber that returns two expressions."""


class Spring(NamedTuple):
    """A spring of a chamber with a damper, (SL1) and (SL2)."""

    energy: Callable[[Symbol, Symbol], Symbol]
    """Function of the coordinate and of the chamber's commanded rest length [m] that returns the energy [J]."""
    damping: Symbol
    """Force, or moment, of the damper divided by the rate of the coordinate."""


class Domain(NamedTuple):
    """Shapes and commands for which a segment law is valid.

    The bounds of the length are given at K contractions, at equal steps from the least to the greatest one, and are
    linear between them. With K = 1 they do not depend on the contraction.
    """

    shortest: FloatArray
    """Least length of a chamber, shape (N, K) [m]."""
    longest: FloatArray
    """Greatest length of a chamber, shape (N, K) [m]."""
    least: FloatArray
    """Least contraction of a chamber, shape (N,)."""
    greatest: FloatArray
    """Greatest contraction of a chamber, shape (N,)."""

    def at(self, contraction: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the least and the greatest length [m] at contractions, each in their shape (N, C)."""
        rows, last = np.arange(len(contraction))[:, None], self.shortest.shape[1] - 1
        if last == 0:
            return self.shortest + 0.0 * contraction, self.longest + 0.0 * contraction
        range_ = (self.greatest - self.least)[:, None]
        place = np.clip((contraction - self.least[:, None]) / range_, 0.0, 1.0) * last
        low = np.minimum(place.astype(int), last - 1)
        ends = ((1.0 - place + low) * each[rows, low] + (place - low) * each[rows, low + 1] for each in self[:2])
        shortest, longest = ends
        return shortest, longest


class Spread(NamedTuple):
    """Standard deviations between the laws of an ensemble, as root mean squares over states of chambers."""

    force: float
    """Standard deviation of the axial force of a segment of two such chambers [N]."""
    force_share: float
    """`force` divided by the rms force of the mean law."""
    radius: float
    """Standard deviation of the outer radius [m]."""


class InputTable(NamedTuple):
    """Input of a segment over the contraction that a segment without load has; both ascend."""

    name: str
    """Input, "pressure" or "cable"."""
    unit: str
    """Unit of the input, "Pa" or "N"."""
    contraction: FloatArray
    """Contractions, shape (P,)."""
    value: FloatArray
    """Inputs, shape (P,) [unit]."""


@dataclass(frozen=True, eq=False, kw_only=True)
class SegmentLaw(Part, registry=SEGMENT_LAWS):
    """Base class of all segment laws: a frozen dataclass with fields made by `worm3d.values.parameters.parameter`.

    The class statement gives a subclass its name, for example `class Barrel(SegmentLaw, name="barrel")`. A subclass
    defines at least `outline`. The argument `segment` of `worm3d.Worm` selects the law. Without further definitions, a
    chamber has the spring (E4) and the damper of the rhombus, and no angle.
    """

    known: ClassVar[tuple[str, ...]] = SEGMENT_INPUTS
    told: ClassVar[tuple[str, ...]] = ("further_inputs", "has_links")
    has_links: ClassVar[bool] = False
    """Whether a chamber is a rhombus of links. Parts that use the length of the links need such a segment law."""
    is_long: ClassVar[bool] = False
    """Whether energy and outline are long expressions. The kernels then contain their derivatives with respect to the
    length of a chamber instead of length and bend of the segment, and common parts are computed once."""
    bounded_by: ClassVar[str] = f"{GREATEST_LENGTH:g} rest lengths"
    """Reason of the bounds of `possible`."""
    bears_more: ClassVar[str] = "k_spring or half_height larger"
    """What to make different so that a segment bears a larger weight (`flattening_weight`)."""
    further_inputs: ClassVar[Mapping[str, int]] = {}
    """Number of values of each further input by name, such as the weights of a network."""

    @classmethod
    def inputs(cls) -> dict[str, int]:
        """Return the number of values of each input that the law adds to the inputs of a segment, by name."""
        numeric = (name for name, known in parameters_of(cls).items() if known.hint is not str)
        return {**dict.fromkeys(numeric, 1), **cls.further_inputs}

    @classmethod
    def angle(cls, s: Symbols, length: Symbol, bend: Symbol) -> Symbol:
        """Return the second coordinate of a chamber [rad]. The default is the bend of the segment.

        Parameters
        ----------
        s : mapping of str to SX
            Inputs by name: the length "link" of the links [m] (only if `has_links`), the distance "offset" of the
            chambers from the axis [m], the stiffness of the segment's springs "k" [N] and of its apex hinges "k_apex"
            [N m/rad], the rest length "l0" [m] and the Kelvin-Voigt time "tau" [s], then the parameters of the law and
            the columns of `further_inputs`.
        length : SX
            Length of the chamber [m].
        bend : SX
            Bend of the segment [rad].
        """
        return bend

    @classmethod
    def springs(cls, s: Symbols) -> tuple[Spring, ...]:
        """Return the springs (SL1) of a chamber: one on its length, or a second one on its `angle`."""
        return (lengthwise(s),)

    @classmethod
    def bending(cls, s: Symbols, length: Symbol, bend: Symbol, commanded: Symbol) -> Symbol:
        """Return the further energy (SL3) of a segment [J].

        Parameters
        ----------
        s : mapping of str to SX
            As in `angle`.
        length, bend : SX
            Length of the segment on its axis [m], and its bend [rad].
        commanded : SX, shape (2,)
            Commanded rest lengths of the chambers [left, right] [m].
        """
        return 0.0

    @classmethod
    def outline(cls, s: Symbols, length: Symbol, commanded: Symbol) -> tuple[Symbol, Symbol]:
        """Return height h and outward distance w of a chamber, (SL4) [m].

        The arguments are the inputs as in `angle`, and the length and commanded rest length of the chamber [m].
        """
        raise NotImplementedError

    @classmethod
    def passive_length(cls, s: Symbols) -> Symbol:
        """Return the commanded rest length of a chamber without an input [m]. `s` is as in `angle`."""
        return s["l0"]

    @classmethod
    def joints(cls, s: Symbols, length: Symbol) -> dict[str, Symbol]:
        """Return on what friction in the joints of a chamber acts, by name, as functions of the chamber's length [m].

        "passive_length" is `passive_length`. "energy" is the energy of the springs at this rest length in a straight
        segment [J]. "angle" is the angle of the joints [rad]: the angle of the apex hinges, or without links (H5) of
        `worm3d.physics.hysteresis`.
        """
        import casadi as ca  # parameters do not need casadi

        angle, rest = cls.angle(s, length, 0.0), cls.passive_length(s)
        energies = (spring.energy(at, rest) for spring, at in zip(cls.springs(s), (length, angle), strict=False))
        if not cls.has_links:
            link = ca.sqrt(cls.outline(s, rest, rest)[1] ** 2 + rest**2 / 4.0)
            share = length / (2.0 * link)
            bounded = ca.fmin(share, JOINT_REACH)
            angle = 2.0 * ca.asin(bounded) + 2.0 * (share - bounded) / (1.0 - JOINT_REACH**2) ** 0.5
        return {"passive_length": rest, "energy": sum(energies), "angle": angle}

    @property
    def passive_contraction(self) -> float:
        """Contraction of a chamber without an input. It is not 0 if the input lengthens the chamber."""
        return 0.0

    def values(self, worm: Body) -> Mapping[str, Any]:
        """Return the inputs of the law by name: a number, N numbers, or a column with a number for each value."""
        return {name: getattr(self, name) for name in parameters_of(type(self)) if name in self.inputs()}

    def implied(self, segments: int, *, flat: bool) -> Mapping[str, Any]:
        """Return the arguments of `worm3d.Worm` that follow from the law, by name, for a worm of N segments.

        In a `flat` worm the chambers lie on the axis.
        """
        return {}

    def suited(self) -> Mapping[str, Any]:
        """Return further arguments of `worm3d.Worm` that suit the law, by name. Other values are allowed, too."""
        return {}

    def face_radius(self, worm: Body) -> FloatArray:
        """Return the radius of the end faces that each segment would have at an end of the worm, shape (N,) [m]."""
        return np.asarray(worm.half_height)

    def reach(self, worm: Body) -> FloatArray:
        """Return half of the greatest length of a chamber for which there is a shape, shape (N,) [m].

        During Newton's method, a chamber can have any length below twice this value.
        """
        return np.full(worm.segments, GREATEST_LENGTH / 2.0 * worm.l0)

    def possible(self, worm: Body, contraction: FloatArray | None = None) -> tuple[FloatArray, FloatArray]:
        """Return the bounds of the length of a chamber [m].

        With `contraction`, shape (N, C), the bounds are at these contractions, each in their shape. Otherwise the
        bounds are the widest ones at any contraction, each of shape (N, 1).
        """
        domain = self.domain(worm)
        if contraction is None:
            return domain.shortest.min(axis=1, keepdims=True), domain.longest.max(axis=1, keepdims=True)
        return domain.at(contraction)

    def flattened_length(self, worm: Body) -> FloatArray:
        """Return the length above which a chamber is flattened, shape (N,) [m]; infinite without links."""
        return np.full(worm.segments, np.inf)

    def domain(self, worm: Body) -> Domain:
        """Return the domain of the law. The base class has no limits other than those of a shape."""
        none = np.full(worm.segments, np.inf)
        return Domain(np.zeros((worm.segments, 1)), 2.0 * self.reach(worm)[:, None], -none, none)

    def spread(self, length: FloatArray, contraction: FloatArray) -> Spread | None:
        """Return how much the laws of an ensemble differ, or None for a law without an ensemble.

        `length` [m] and `contraction` are states of chambers, of the same shape.
        """
        return None

    def flattening_weight(self, worm: Body, contraction: float) -> FloatArray:
        """Return the weight that flattens each segment, shape (N,) [N]; infinite if the law has no `domain`.

        In equilibrium the weight is 2 dU/dl over -dh/dl, as in `worm3d.physics.segment_laws.limit_point`. The result is
        the greatest weight in the domain. A segment whose height does not fall with its length bears any weight.
        """
        if not np.isfinite(self.domain(worm).greatest).all():
            return np.full(worm.segments, np.inf)
        at = np.full((worm.segments, 1), contraction)
        length = np.linspace(worm.l0 * (1.0 - at[:, 0]), self.possible(worm, at)[1][:, 0], FLATTENING_LENGTHS, axis=1)
        force, fall = self._evaluated(_balance, worm, length, at)
        borne: FloatArray = np.where(fall > 0.0, force / np.where(fall > 0.0, fall, 1.0), np.inf)
        return np.asarray(borne.max(axis=1))

    def free_outlines(self, worm: Body, length: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the outlines, as in `outlines`, of chambers that have their free length at some contraction.

        `length` has the shape (N, K) [m]. The contraction is the nearest one in the domain.
        """
        domain = self.domain(worm)
        contraction = np.clip(1.0 - length / worm.l0, domain.least[:, None], domain.greatest[:, None])
        return self.outlines(worm, length, contraction)

    def outlines(self, worm: Body, length: FloatArray, contraction: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return heights h and outward distances w of chambers, each of shape (N, K) [m].

        Parameters
        ----------
        worm : Worm
        length, contraction : ndarray, shape (N, K)
            Lengths [m] and contractions of K chambers, or of a chamber at K instants, of each segment.

        NaN marks a length for which the chamber has no shape.
        """
        height, outward = self._evaluated(_outline, worm, length, contraction)
        return height, outward

    def _evaluated(self, pair: Pair, worm: Body, length: FloatArray, contraction: FloatArray) -> FloatArray:
        """Return a pair of functions of a chamber at lengths [m] and contractions, shape (2, N, K)."""
        length, contraction = np.broadcast_arrays(np.asarray(length, dtype=float), contraction)
        columns = [np.repeat(row, length.shape[1], axis=1) for row in columns_of(self, worm).values()]
        commanded = worm.l0 * (1.0 - contraction)
        kind: Any = type(self)
        function = _function(kind, pair)
        found: FloatArray = function(length.reshape(1, -1), commanded.reshape(1, -1), *columns).full()
        return found.reshape(2, *length.shape)

    @property
    def input_table(self) -> InputTable | None:
        """Input over the contraction. None if the law has neither a pressure nor a cable."""
        return None

    def input_of(self, contraction: ArrayLike) -> FloatArray:
        """Return the inputs for contractions without load, in their shape [Pa or N].

        The table of the law is interpolated linearly.

        Raises
        ------
        ValueError
            The law has no table, or a contraction is beyond the table.
        """
        table = self.require_table()
        return _interpolated("contraction", contraction, table.contraction, table.value)

    def contraction_of(self, value: ArrayLike, name: str = "") -> FloatArray:
        """Return the contractions without load for inputs [Pa or N], in their shape; the inverse of `input_of`.

        `name` is "pressure" or "cable" if it must be the input of the law.

        Raises
        ------
        ValueError
            The law has no table or another input, or an input is beyond the table.
        """
        table = self.require_table(name)
        return _interpolated(table.name, value, table.value, table.contraction, f" {table.unit}")

    def require_table(self, name: str = "") -> InputTable:
        """Return the input over the contraction, or raise ValueError if the law has none or not the named input."""
        table = self.input_table
        if table is None or name not in ("", table.name):
            own, instead = self.name or type(self).__name__, "the contraction" if table is None else f"its {table.name}"
            raise ValueError(f"segment: the law {own!r} has no {name or 'pressure'}; command {instead}")
        return table


def _interpolated(name: str, at: ArrayLike, known: FloatArray, values: FloatArray, unit: str = "") -> FloatArray:
    """Return values of a table by linear interpolation, and raise ValueError for numbers beyond the table."""
    given, margin = np.asarray(at, dtype=float), TABLE_ROUNDING * (known[-1] - known[0])
    beyond = ~((given >= known[0] - margin) & (given <= known[-1] + margin))
    if beyond.any():
        raise ValueError(
            f"{name}: got {given[beyond].flat[0]:g}{unit}, must be from {known[0]:g} to {known[-1]:g}{unit} as in the "
            "table of the segment law"
        )
    found: FloatArray = np.interp(given, known, values)
    return found


def lengthwise(s: Symbols) -> Spring:
    """Return the spring (E4) of a chamber on its length, with the Kelvin-Voigt damping tau k/(2 l0)."""
    from worm3d.physics.elements import chamber_energy  # parameters do not need casadi

    damping = s["tau"] * s["k"] / (2.0 * s["l0"])
    return Spring(lambda at, commanded: chamber_energy(s["k"], s["l0"], at, commanded), damping)


def columns_of(law: SegmentLaw, worm: Body) -> dict[str, FloatArray]:
    """Return the inputs of a law by name: `SEGMENT_INPUTS`, then `SegmentLaw.inputs`, each of shape (size, N)."""
    own = {"link": law.reach(worm), "offset": worm.chamber_offset, "k": worm.k_spring, "k_apex": worm.k_apex}
    own |= {"l0": worm.l0, "tau": worm.kelvin_voigt_time, **law.values(worm)}
    sizes = dict.fromkeys(SEGMENT_INPUTS, 1) | law.inputs()
    return {
        name: np.broadcast_to(np.asarray(own[name], dtype=float), (size, worm.segments)) for name, size in sizes.items()
    }


def _outline(kind: Any, s: Symbols, length: Symbol, commanded: Symbol) -> tuple[Symbol, Symbol]:
    """Return height and outward distance of a chamber, (SL4)."""
    found: tuple[Symbol, Symbol] = kind.outline(s, length, commanded)
    return found


def _balance(kind: Any, s: Symbols, length: Symbol, commanded: Symbol) -> tuple[Symbol, Symbol]:
    """Return the axial force of a straight segment, 2 dU/dl, and the fall -dh/dl of its height."""
    import casadi as ca

    height, energy = kind.outline(s, length, commanded)[0], kind.springs(s)[0].energy(length, commanded)
    return 2.0 * ca.gradient(energy, length), -ca.gradient(height, length)


@cache
def _function(kind: Any, pair: Pair) -> Any:
    """Return a CasADi function of length, commanded rest length and the columns of `columns_of`: a pair of values."""
    import casadi as ca

    sizes = dict.fromkeys(SEGMENT_INPUTS, 1) | kind.inputs()
    s = {name: ca.SX.sym(name, size) for name, size in sizes.items()}
    length, commanded = ca.SX.sym("length"), ca.SX.sym("commanded")
    seen = {name: each for name, each in s.items() if name != "link" or kind.has_links}
    return ca.Function("pair", [length, commanded, *s.values()], [ca.vertcat(*pair(kind, seen, length, commanded))])
