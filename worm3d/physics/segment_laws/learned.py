"""A segment law learned from finite elements or from measurements.

A chamber has the length l and the contraction a, which is the contraction that it would have without load. With
s = 1 - l/(l0 (1 - a)), x = (l/l0 - x_mid)/x_half and y = (a - y_mid)/y_half,

    U(l, a) = s^2 (k l0/4 + E N_U(x, y))         energy of a chamber                                        (SL5)
    R(l, a) = R_mid + R_scale N_R(x, y)          outer radius of the segment at a chamber                   (SL6)
    B = m(x, y) th^2/2                           energy of bending, x and y at the mean of both chambers    (SL7)

N_U and N_R are networks (`worm3d.physics.segment_laws.network`), and m is a polynomial of degree 2. For every a, value
and slope of U are 0 at the free length l0 (1 - a). Without a network, U is the spring (E4). The cross-section is a
circle with the radius R about the axis of the segment. Below and above chamber c the apexes are therefore at the height
sqrt(R^2 - b^2), and outward at the distance R. There are no links. The chambers have the Kelvin-Voigt damping
tau k/(2 l0) on their length.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from worm3d.physics.body import Body
from worm3d.physics.part import Symbol, Symbols
from worm3d.physics.segment_laws.file import BENDING_TERMS, INPUT_UNITS, SCALES, LawFile, parsed, text_of
from worm3d.physics.segment_laws.law import Domain, InputTable, SegmentLaw, Spread, Spring
from worm3d.physics.segment_laws.network import ENERGY_SIZES, RADIUS_SIZES, network, weights_of
from worm3d.values.arrays import FloatArray
from worm3d.values.parameters import documented, parameter


@documented
@dataclass(frozen=True, eq=False)
class Learned(SegmentLaw, name="learned"):
    """Energy, radius and bending stiffness of a segment from a file that 'worm3d law' writes, (SL5) to (SL7).

    The sizes and the stiffness of the worm follow from the file. A run that leaves the domain of the file stops. The
    file also contains an ensemble of further laws, fitted to parts of the same table. Runs with all members show how
    sure a result is.

    Raises
    ------
    ValueError
        The file cannot be read, a value in the file is missing or not allowed, or the ensemble has no such member.
    """

    is_long: ClassVar[bool] = True
    bounded_by: ClassVar[str] = "the domain of the segment law"
    bears_more: ClassVar[str] = "its chambers more contracted at the start"
    further_inputs: ClassVar[Mapping[str, int]] = {
        "energy": weights_of(ENERGY_SIZES),
        "radius": weights_of(RADIUS_SIZES),
        "bending": BENDING_TERMS,
        "scales": len(SCALES),
        "passive": 1,
    }

    file: str = parameter("", "file of the law, beside the scene, or the name of a law that comes with worm3d")
    member: int = parameter(
        0, "number of the law in the file: 0 for the law itself, 1 and more for the further laws of its ensemble", ge=0
    )
    stiffness_factor: float = parameter(1.0, "factor of the energy of chambers, to fit a law to another robot", gt=0)
    bending_factor: float = parameter(1.0, "factor of the bending stiffness, to fit a law to another robot", gt=0)
    content: str = field(default="", repr=False)
    """Text of the file. It is read from `file` if it is empty. Files of results contain this text."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "file", os.fspath(self.file))
        super().__post_init__()
        if not self.content:
            object.__setattr__(self, "content", text_of(self.file))
        found = parsed(self.content, os.path.basename(self.file))
        vars(self)["_of_file"] = found.stiffened(self.stiffness_factor, self.bending_factor)
        vars(self)["_law"] = vars(self)["_of_file"].member(self.member)

    @property
    def law(self) -> LawFile:
        """Content of the file, with the networks of the chosen `member`."""
        found: LawFile = vars(self)["_law"]
        return found

    @classmethod
    def inputs(cls) -> dict[str, int]:
        """Return `further_inputs`: the parameters only say where their values come from."""
        return dict(cls.further_inputs)

    @classmethod
    def springs(cls, s: Symbols) -> tuple[Spring, ...]:
        """Return the energy (SL5)."""

        def energy(length: Symbol, commanded: Symbol) -> Symbol:
            strain = 1.0 - length / commanded
            own = network(s["energy"], ENERGY_SIZES, _scaled(s, length, commanded))
            return strain**2 * (s["k"] * s["l0"] / 4.0 + s["scales"][SCALES.index("energy_J")] * own)

        return (Spring(energy, s["tau"] * s["k"] / (2.0 * s["l0"])),)

    @classmethod
    def bending(cls, s: Symbols, length: Symbol, bend: Symbol, commanded: Symbol) -> Symbol:
        """Return the energy (SL7)."""
        x, y = _scaled(s, length, (commanded[0] + commanded[1]) / 2.0)
        m = sum(s["bending"][k] * term for k, term in enumerate((1.0, x, y, x * x, x * y, y * y)))
        return m * bend**2 / 2.0

    @classmethod
    def outline(cls, s: Symbols, length: Symbol, commanded: Symbol) -> tuple[Symbol, Symbol]:
        """Return sqrt(R^2 - b^2) and R, (SL6)."""
        middle, scale = (s["scales"][SCALES.index(name)] for name in ("radius_mid_m", "radius_m"))
        radius = middle + scale * network(s["radius"], RADIUS_SIZES, _scaled(s, length, commanded))
        return (radius**2 - s["offset"] ** 2) ** 0.5, radius

    @classmethod
    def passive_length(cls, s: Symbols) -> Symbol:
        """Return l0 (1 - a) with the contraction a without an input."""
        return s["l0"] * (1.0 - s["passive"])

    @property
    def passive_contraction(self) -> float:
        """Contraction of a chamber without an input, according to the file."""
        return self.law.passive

    def values(self, worm: Body) -> Mapping[str, Any]:
        """Return weights, coefficients, scales and the passive contraction, each of shape (size, 1)."""
        law = self.law
        scales = np.array([law.scales[name] for name in SCALES])
        own = {"energy": law.energy, "radius": law.radius, "bending": law.bending, "scales": scales}
        own["passive"] = np.array([law.passive])
        return {name: each[:, None] for name, each in own.items()}

    def implied(self, segments: int, *, flat: bool) -> Mapping[str, Any]:
        """Return the sizes and the stiffness of the worm."""
        law, offset = self.law, 0.0 if flat else self.law.chamber_offset
        return {
            "length": segments * law.rest_length,
            "chamber_offset": offset,
            "half_height": float(np.sqrt(law.rest_radius**2 - offset**2)),
            "k_spring": law.stiffness,
        }

    def suited(self) -> Mapping[str, Any]:
        """Return the stroke from 0 to the greatest contraction of the domain."""
        return {"stroke": (0.0, self.law.most_contraction)}

    def face_radius(self, worm: Body) -> FloatArray:
        """Return the radius of the end plates."""
        return np.full(worm.segments, self.law.plate_radius)

    def domain(self, worm: Body) -> Domain:
        """Return the domain of the file."""
        law, n = self.law, worm.segments
        shortest, longest = (np.tile(bound, (n, 1)) for bound in (law.shortest, law.longest))
        return Domain(shortest, longest, np.zeros(n), np.full(n, law.most_contraction))

    def ensemble(self, length: FloatArray, contraction: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return axial forces of a straight segment [N], and its radii [m], according to all laws of the file.

        `length` [m] and `contraction` have a common shape (...,). The results have the shape (M, ...), the law first.
        The force 2 dU/dl is the imaginary part of 2 U(l + ih)/h with a tiny h, which is exact to rounding.
        """
        law, step = vars(self)["_of_file"], 1e-30
        s: dict[str, Any] = {"k": law.stiffness, "l0": law.rest_length, "offset": 0.0, "tau": 0.0}
        s["scales"] = [law.scales[name] for name in SCALES]
        commanded, found = law.rest_length * (1.0 - np.asarray(contraction)), []
        for each in (law.member(k) for k in range(1 + len(law.ensemble))):
            (spring,) = self.springs({**s, "energy": each.energy})
            force = 2.0 * np.imag(spring.energy(length + 1j * step, commanded)) / step
            found.append((force, self.outline({**s, "radius": each.radius}, length, commanded)[1]))
        forces, radii = zip(*found, strict=True)
        return np.array(forces), np.array(radii)

    def spread(self, length: FloatArray, contraction: FloatArray) -> Spread | None:
        """Return how much the laws of the file differ at states of chambers."""
        if not self.law.ensemble:
            return None
        forces, radii = self.ensemble(length, contraction)
        force, radius = (float(np.sqrt(np.mean(np.var(each, axis=0)))) for each in (forces, radii))
        size = float(np.sqrt(np.mean(np.mean(forces, axis=0) ** 2)))
        return Spread(force, force / size if size > 0.0 else 0.0, radius)

    @property
    def input_table(self) -> InputTable:
        """Table p(a) of the file."""
        law = self.law
        return InputTable(law.input_name, INPUT_UNITS[law.input_name], law.contraction, law.value)


def _scaled(s: Symbols, length: Symbol, commanded: Symbol) -> tuple[Symbol, Symbol]:
    """Return the inputs x and y of the networks."""
    x_mid, x_half, y_mid, y_half = (s["scales"][k] for k in range(4))
    return (length / s["l0"] - x_mid) / x_half, (1.0 - commanded / s["l0"] - y_mid) / y_half
