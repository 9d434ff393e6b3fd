"""A segment law that interpolates a dense table of finite elements with splines, the reference of `soft_segments.py`.

With the strain s = 1 - l/(l0 (1 - a)) as in (SL5) of `worm3d.physics.segment_laws.learned`, and bicubic splines S on
uniform knots of x(s) and y(a),

    U(l, a) = s^2 (k l0/4 + E S_U(x, y)),    R(l, a) = S_R(x, y),
    B = S_K(x, y) th^2/2 + S_N(x, y) th^4/4 - w (U(l + b th, a) + U(l - b th, a) - 2 U(l, a)),
    x = s/sqrt(c^2 + s^2),    y = sqrt(1 + a/d),

where a is the mean of both chambers in B. With w = 1, a segment under equal commands has the energy 2 U(l, a) and the
terms with S_K and S_N: errors of the chambers' energies do not enter the moment. With w = 0 and S_N = 0, S_K is the
stiffness m of (SL7). Knots are closest at s = 0 and at a = 0, where a worm crawls and where threads become taut. The
splines are twice continuously differentiable, and linear in their coefficients. Therefore forces and volumes of all
states give S_U by linear least squares, with (LF1) and (LF2) of `scenes.studies.law.fitting`, and forces and moments of
bent states give S_K and S_N. The free contraction a(p) and the free volume in (LF2) come from finite elements, too.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, NamedTuple

import casadi as ca
import numpy as np
from scipy.interpolate import BSpline, CubicSpline

from scenes.studies.law.free import BoolArray, States
from worm3d import Learned
from worm3d.physics.body import Body
from worm3d.physics.segment_laws.file import SCALES, LawFile
from worm3d.physics.segment_laws.law import Spring
from worm3d.physics.segment_laws.network import ENERGY_SIZES, network
from worm3d.values.arrays import FloatArray

Warp = Callable[[Any], tuple[Any, Any]]
"""Function that returns a coordinate and its derivative."""


class Axis(NamedTuple):
    """A coordinate of a spline, a function of strain or contraction, whose range is scaled to [-1, 1]."""

    low: float
    high: float
    warp: Warp
    count: int
    """Number of coefficients."""

    def of(self, at: Any) -> tuple[Any, Any]:
        """Return the coordinate and its derivative, for numbers, arrays and CasADi symbols."""
        low, high = (self.warp(end)[0] for end in (self.low, self.high))
        value, slope = self.warp(at)
        return (2.0 * value - low - high) / (high - low), 2.0 * slope / (high - low)

    def symbols(self, at: Any) -> Any:
        """Return the basis functions at a CasADi symbol: cardinal cubic B-splines at distances t from their centres."""
        distances = [ca.fabs((self.of(at)[0] + 1.0) * (self.count - 3) / 2.0 - (k - 1)) for k in range(self.count)]
        return ca.vertcat(*((ca.fmax(0.0, 2.0 - t) ** 3 - 4.0 * ca.fmax(0.0, 1.0 - t) ** 3) / 6.0 for t in distances))

    def matrix(self, at: FloatArray, derivative: int = 0) -> FloatArray:
        """Return the basis functions, or their first derivative, at S points, shape (S, count). It uses SciPy."""
        knots = -1.0 + 2.0 / (self.count - 3) * np.arange(-3, self.count + 1)
        value, slope = self.of(at)
        found = np.asarray(BSpline(knots, np.eye(self.count), 3)(value, nu=derivative))
        return found if derivative == 0 else found * slope[:, None]


def _near_zero(scale: float) -> Warp:
    return lambda s: (s / (scale**2 + s**2) ** 0.5, scale**2 / (scale**2 + s**2) ** 1.5)


def _from_zero(scale: float) -> Warp:
    return lambda a: ((1.0 + a / scale) ** 0.5, 0.5 / scale / (1.0 + a / scale) ** 0.5)


STRAINS = (-0.12, 0.12)
"""Strains of the splines. The worms of `soft_segments.py` stay between -0.07 and 0.09. At strains down to -0.4,
forces are above 10 N."""


def _grid(along: int, across: int) -> tuple[Axis, Axis]:
    return Axis(*STRAINS, _near_zero(0.1), along), Axis(0.0, 0.275, _from_zero(0.02), across)


GRIDS = {"energy": _grid(18, 18), "radius": _grid(10, 12), "bending": _grid(10, 9), "cubic": _grid(6, 6)}
"""Axes along strain and contraction of S_U, S_R, S_K and S_N."""

ROUGHNESS = {"energy": 1e-9, "radius": 1e-8, "bending": 1e-4, "cubic": 1e-3}
"""Weight of the third differences of coefficients beside the mean square error, for places without states."""

FORCE_FLOOR = 0.02
"""Force, as a fraction of the rms force, above which errors of the force count relative to the force."""


MOMENT_FLOOR, BENT_FORCE_FLOOR = 0.02, 1.0
"""Bending stiffness [N m/rad], and force [N], above which errors at bent states count relative to the value."""


@dataclass(frozen=True, eq=False)
class Interpolated(Learned, name="interpolated"):
    """A law with the sizes and the domain of a file, and with splines instead of networks."""

    further_inputs: ClassVar[Mapping[str, int]] = {
        **{name: along.count * across.count for name, (along, across) in GRIDS.items()},
        "scales": len(SCALES),
        "whole": 1,
    }

    splines: Mapping[str, FloatArray] = field(default_factory=dict, repr=False)
    """Coefficients by name, each of shape (along, across)."""
    whole: float = 1.0
    """w."""
    offset: float = 0.0
    """Offset b of the chambers [m]; 0: the offset of the file."""

    @classmethod
    def springs(cls, s: Mapping[str, Any]) -> tuple[Spring, ...]:
        damping = s["tau"] * s["k"] / (2.0 * s["l0"])
        return (Spring(lambda length, commanded: _energy(s, length, commanded), damping),)

    @classmethod
    def bending(cls, s: Mapping[str, Any], length: Any, bend: Any, commanded: Any) -> Any:
        mean = (commanded[0] + commanded[1]) / 2.0
        k, n = (_surface(s, name, length, mean) for name in ("bending", "cubic"))
        longer, shorter, straight = (_energy(s, length + sign * s["offset"] * bend, mean) for sign in (1.0, -1.0, 0.0))
        chambers = longer + shorter - 2.0 * straight
        return k * bend**2 / 2.0 + n * bend**4 / 4.0 - s["whole"] * chambers

    @classmethod
    def outline(cls, s: Mapping[str, Any], length: Any, commanded: Any) -> tuple[Any, Any]:
        radius = _surface(s, "radius", length, commanded)
        return (radius**2 - s["offset"] ** 2) ** 0.5, radius

    def values(self, worm: Body) -> Mapping[str, Any]:
        columns = {name: each.reshape(-1, 1, order="F") for name, each in self.splines.items()}
        return {"scales": super().values(worm)["scales"], "whole": self.whole, **columns}

    def implied(self, segments: int, *, flat: bool) -> Mapping[str, Any]:
        found = dict(super().implied(segments, flat=flat))
        if self.offset and not flat:
            found |= {"chamber_offset": self.offset, "half_height": (self.law.rest_radius**2 - self.offset**2) ** 0.5}
        return found


def _energy(s: Mapping[str, Any], length: Any, commanded: Any) -> Any:
    """Return the energy U of a chamber in CasADi symbols."""
    own = s["scales"][SCALES.index("energy_J")] * _surface(s, "energy", length, commanded)
    return (1.0 - length / commanded) ** 2 * (s["k"] * s["l0"] / 4.0 + own)


def _surface(s: Mapping[str, Any], name: str, length: Any, commanded: Any) -> Any:
    """Return a spline in CasADi symbols."""
    along, across = GRIDS[name]
    x, y = along.symbols(1.0 - length / commanded), across.symbols(1.0 - commanded / s["l0"])
    return ca.mtimes([x.T, ca.reshape(s[name], along.count, across.count), y])


@dataclass(frozen=True, eq=False)
class Points:
    """Points in the plane of length [m] and contraction, arrays of shape (S,)."""

    law: LawFile
    length: FloatArray
    contraction: FloatArray

    @property
    def strain(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Strain s, and its derivatives by l and by a."""
        free = self.law.rest_length * (1.0 - self.contraction)
        return 1.0 - self.length / free, -1.0 / free, -self.length / free / (1.0 - self.contraction)

    def basis(self, name: str, by_s: int = 0, by_a: int = 0) -> FloatArray:
        """Return derivatives of the basis functions of a spline, shape (S, K)."""
        along, across = GRIDS[name]
        x, y = along.matrix(self.strain[0], by_s), across.matrix(self.contraction, by_a)
        return np.einsum("si,sj->sij", x, y).reshape(len(x), -1)

    def slopes(self) -> tuple[tuple[FloatArray, FloatArray], ...]:
        """Return 2 dU/dl and 2 dU/da as linear functions of S_U: constants (S,) and factors (S, K) of each."""
        spring, scale = self.law.stiffness * self.law.rest_length / 4.0, self.law.scales["energy_J"]
        s, by_l, by_a = self.strain
        of_s = 2.0 * s[:, None] * self.basis("energy") + (s**2)[:, None] * self.basis("energy", 1)
        at_s = (s**2)[:, None] * self.basis("energy", 0, 1)
        of_l, of_a = by_l[:, None] * of_s, by_a[:, None] * of_s + at_s
        return (4.0 * s * by_l * spring, 2.0 * scale * of_l), (4.0 * s * by_a * spring, 2.0 * scale * of_a)

    def value(self, name: str, coefficients: FloatArray) -> FloatArray:
        """Return the values of a spline, shape (S,)."""
        found: FloatArray = self.basis(name) @ coefficients.ravel()
        return found

    def force(self, energy: FloatArray) -> FloatArray:
        """Return the axial force of a straight segment (LF1), shape (S,) [N]."""
        (constant, factors), _ = self.slopes()
        found: FloatArray = constant + factors @ energy.ravel()
        return found


def fitted(name: str, factors: FloatArray, wanted: FloatArray) -> FloatArray:
    """Return the coefficients of a spline by regularised least squares, shape (along, across)."""
    return _fitted([name], factors, wanted)[0]


def _fitted(names: list[str], factors: FloatArray, wanted: FloatArray) -> list[FloatArray]:
    """Return the coefficients of several splines, whose factors are side by side."""
    blocks = [_rough(name, len(wanted)) for name in names]
    sizes = np.cumsum([0, *(block.shape[1] for block in blocks)])
    rough = [np.zeros((len(block), sizes[-1])) for block in blocks]
    for rows, block, begin in zip(rough, blocks, sizes[:-1], strict=True):
        rows[:, begin : begin + block.shape[1]] = block
    right = np.concatenate([wanted, np.zeros(sum(map(len, rough)))])
    found = np.linalg.lstsq(np.vstack([factors, *rough]), right, rcond=None)[0]
    parts = np.split(found, sizes[1:-1])
    return [part.reshape(_shape(name)) for name, part in zip(names, parts, strict=True)]


def _shape(name: str) -> tuple[int, int]:
    along, across = GRIDS[name]
    return along.count, across.count


def _rough(name: str, count: int) -> FloatArray:
    rows, columns = _shape(name)
    third = [np.diff(np.eye(size), n=3, axis=0) for size in (rows, columns)]
    rough = np.vstack([np.kron(third[0], np.eye(columns)), np.kron(np.eye(rows), third[1])])
    found: FloatArray = np.sqrt(ROUGHNESS[name] * count) * rough
    return found


class FreeCurve(NamedTuple):
    """Free contraction and free volume [m^3] as functions of the pressure [Pa]."""

    contraction: CubicSpline
    volume: CubicSpline


def energy_and_radius(law: LawFile, states: States, free: FreeCurve) -> dict[str, FloatArray]:
    """Return the coefficients of S_U and S_R. States beyond the strains of the splines are left out."""
    strain = Points(law, states.length, free.contraction(states.input)).strain[0]
    states = states.part((strain > STRAINS[0]) & (strain < STRAINS[1]))
    points, slope = Points(law, states.length, free.contraction(states.input)), free.contraction(states.input, 1)
    (c_l, of_l), (c_a, of_a) = points.slopes()
    w = 1.0 / np.hypot(FORCE_FLOOR * np.sqrt(np.mean(states.force**2)), states.force)
    assert states.volume is not None
    v = 1.0 / float(np.std(states.volume))
    factors = np.vstack([w[:, None] * of_l, -v * slope[:, None] * of_a])
    wanted = [w * (states.force - c_l), v * (states.volume - free.volume(states.input) + slope * c_a)]
    energy = fitted("energy", factors, np.concatenate(wanted))
    return {"energy": energy, "radius": fitted("radius", points.basis("radius"), states.radius)}


class Bent(NamedTuple):
    """Bent states, arrays of shape (B,)."""

    length: FloatArray
    contraction: FloatArray
    bend: FloatArray
    force: FloatArray
    moment: FloatArray

    def part(self, rows: BoolArray) -> Bent:
        """Return some of the states."""
        return Bent(*(each[rows] for each in self))

    def terms(self, law: LawFile) -> tuple[FloatArray, FloatArray]:
        """Return force and moment of S_K th^2/2 + S_N th^4/4 as linear functions of both splines, shape (B, K)."""
        points, th = Points(law, self.length, self.contraction), self.bend[:, None]
        names, by_l = ("bending", "cubic"), points.strain[1][:, None]
        force = [points.basis(name, 1) * by_l * th**n / n for name, n in zip(names, (2, 4), strict=True)]
        moment = [points.basis(name) * th**n for name, n in zip(names, (1, 3), strict=True)]
        return np.hstack(force), np.hstack(moment)

    def answer(self, law: LawFile, splines: Mapping[str, FloatArray], offset: float) -> tuple[FloatArray, FloatArray]:
        """Return force [N] and moment [N m] of a segment with splines. With the offset 0, w is 1, otherwise 0."""
        ends = (self.length + sign * offset * self.bend for sign in (1.0, -1.0))
        longer, shorter = (Points(law, end, self.contraction).force(splines["energy"]) / 2.0 for end in ends)
        both = np.concatenate([splines[name].ravel() for name in ("bending", "cubic")])
        force, moment = (terms @ both for terms in self.terms(law))
        return longer + shorter + force, offset * (longer - shorter) + moment


def bending(law: LawFile, energy: FloatArray, bent: Bent) -> dict[str, FloatArray]:
    """Return the coefficients of S_K and S_N for w = 1, from forces and moments of bent states."""
    straight = Points(law, bent.length, bent.contraction).force(energy)
    force, moment = bent.terms(law)
    w = 1.0 / (bent.bend * (MOMENT_FLOOR + bent.moment / bent.bend))
    f = 1.0 / np.hypot(BENT_FORCE_FLOOR, bent.force)
    wanted = np.concatenate([w * bent.moment, f * (bent.force - straight)])
    factors = np.vstack([w[:, None] * moment, f[:, None] * force])
    return dict(zip(("bending", "cubic"), _fitted(["bending", "cubic"], factors, wanted), strict=True))


def of_learned(learned: Learned) -> dict[str, FloatArray]:
    """Return the coefficients of splines that follow a learned law in its domain."""
    law, found = learned.law, dict[str, FloatArray]()
    for name, (along, across) in GRIDS.items():
        s, a = (
            each.ravel()
            for each in np.meshgrid(np.linspace(along.low, along.high, 120), np.linspace(0, across.high, 60))
        )
        length = law.rest_length * (1.0 - a) * (1.0 - s)
        inside = (length > 0.98 * law.shortest.min()) & (length < 1.02 * law.longest.max())
        points = Points(law, length[inside], a[inside])
        found[name] = fitted(name, points.basis(name), _value(law, name, points))
    return found


def _value(law: LawFile, name: str, points: Points) -> FloatArray:
    """Return the value that a learned law has in place of a spline, shape (S,)."""
    s = law.scales
    x = (points.length / law.rest_length - s["x_mid"]) / s["x_half"]
    y = (points.contraction - s["y_mid"]) / s["y_half"]
    terms = np.array([np.ones_like(x), x, y, x * x, x * y, y * y])
    values: dict[str, Callable[[], FloatArray]] = {
        "energy": lambda: np.asarray(network(law.energy, ENERGY_SIZES, [x, y])),
        "radius": lambda: law.radius_at(points.length, points.contraction),
        "bending": lambda: law.bending @ terms,
        "cubic": lambda: 0.0 * x,
    }
    return values[name]()
