"""Laws of friction: the resistance of a contact as two symbolic functions. A new law is a subclass of `FrictionLaw`.

All laws use the same set of forces, anchors and compiled step (`worm3d.physics.contact`). A law defines

(C7) the capacity C(N) [N], which the coefficients multiply, for a normal load N [N]. C(0) = 0, and C never decreases.
     C = N is Coulomb's law.
(C8) the excess Psi(w) [m/s], a potential per unit of capacity. The rate w = rho(slip)/dt of (C2) [m/s] is the power
     that Coulomb's law loses per unit of capacity, and Psi'(w) w is the power lost in addition.
     Psi(0) = Psi'(0) = 0. Psi = 0 is Coulomb's law.

A contact that slides steadily at the velocity v along an axis with the coefficient mu has the friction
C(N) mu (1 + Psi'(mu |v|)). A contact that sticks holds up to static_ratio mu C(N). `worm3d/physics/README.md` derives
the step from these two functions.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from worm3d.physics.expressions import answer, scalar
from worm3d.physics.part import Numbers, Part, Symbol, Symbols
from worm3d.values import arguments
from worm3d.values.arrays import FloatArray
from worm3d.values.parameters import documented, parameter, parameters_of

if TYPE_CHECKING:
    import casadi as ca

LAWS: dict[str, type[FrictionLaw]] = {}
"""Class of each law of friction, by name."""

MAX_PARAMETERS = 4
"""Maximum number of parameters of a law. The kernels have this number of input rows for parameters."""

CHECKED_LOADS, CHECKED_RATES = np.geomspace(1e-6, 1e3, 91), np.geomspace(1e-6, 1e2, 81)
"""Normal loads [N] and rates [m/s] at which the functions of a law are checked."""


@dataclass(frozen=True, eq=False)
class FrictionLaw(Part, registry=LAWS):
    """Base class of all laws of friction.

    A subclass is a frozen dataclass, for example `class Sticky(FrictionLaw, name="sticky")`. It has at most four
    parameters, which are fields declared by `worm3d.values.parameters.parameter` with each="segment". A subclass
    overrides `capacity`, `excess` or both. These methods receive the parameters by name in `p`.

    Raises
    ------
    ValueError
        A parameter that is not finite or out of range, or functions that contradict (C7) or (C8).
    """

    def __post_init__(self) -> None:
        names = parameters_of(type(self))
        if len(names) > MAX_PARAMETERS:
            raise ValueError(f"{type(self).__name__}: got {len(names)} parameters, must be at most {MAX_PARAMETERS}")
        super().__post_init__()
        if (type(self).capacity, type(self).excess) != (FrictionLaw.capacity, FrictionLaw.excess):
            self._check_functions()

    def _check_functions(self) -> None:
        import casadi as ca  # loading casadi takes longer than everything else that describes a worm

        x, rows = ca.SX.sym("x"), ca.SX.sym("p", MAX_PARAMETERS)
        p = self.symbols(rows)
        capacity_of, excess_of = (
            scalar(f"{type(self).__name__}.{name}", answer(type(self), name, x, p)) for name in ("capacity", "excess")
        )
        slope_of, rise_of = ca.gradient(capacity_of, x), ca.gradient(excess_of, x)
        values = ca.Function("law", [x, rows], [capacity_of, excess_of, slope_of, rise_of])
        grown = ca.Function("grown", [x, rows], [capacity_of, slope_of])
        curved = ca.Function("curved", [x, rows], [excess_of, rise_of, ca.gradient(rise_of, x)])
        for column in np.unique(self.rows(), axis=1).T:
            capacity, excess, slope, rise = (float(each) for each in values(0.0, column))
            for what, value in (("capacity at 0", capacity), ("excess at 0", excess), ("slope of excess at 0", rise)):
                if not abs(value) <= 1e-12:  # more than rounding
                    raise ValueError(f"{type(self).__name__}: the {what} is {value:g}, must be 0")
            if not 0.0 <= slope < np.inf:
                raise ValueError(
                    f"{type(self).__name__}: the slope of capacity at 0 is {slope:g}, must be finite and at least 0"
                )
            self._check_growth("capacity", "slope", grown(CHECKED_LOADS[None], column), CHECKED_LOADS, "N")
            self._check_growth("excess", "second derivative", curved(CHECKED_RATES[None], column), CHECKED_RATES, "m/s")

    def _check_growth(self, name: str, derivative: str, values: Sequence[ca.DM], at: FloatArray, unit: str) -> None:
        """Raise ValueError if a function or a derivative is not finite, or if the last derivative is negative.

        A negative derivative counts as rounding up to 1e-9 of the largest absolute derivative at smaller `at`.
        """
        found = np.array([each.full()[0] for each in values])
        least = -1e-9 * np.maximum.accumulate(np.abs(found[-1]))
        for what, wrong, must in (
            (f"{name} or a derivative of it", ~np.isfinite(found).all(axis=0), "finite"),
            (f"{derivative} of {name}", found[-1] < least, "at least 0"),
        ):
            if wrong.any():
                k = int(np.argmax(wrong))
                got = found[-1, k] if must != "finite" else found[~np.isfinite(found[:, k]), k][0]
                raise ValueError(
                    f"{type(self).__name__}.{name}: the {what} at {at[k]:.3g} {unit} is {got:.3g}, must be {must}"
                )

    def __hash__(self) -> int:  # type: ignore[override]
        return hash((type(self), self.rows().tobytes()))

    def rows(self, segments: int | None = None) -> FloatArray:
        """Return the parameters in the form of the kernels' inputs, shape (4, N). Unused rows are 0.

        Raises
        ------
        ValueError
            A parameter without exactly one value per segment.
        """
        given = self.parameters()
        lanes = max((np.size(value) for value in given.values()), default=1) if segments is None else segments
        rows = np.zeros((MAX_PARAMETERS, lanes))
        for row, (name, value) in zip(rows, given.items(), strict=False):
            row[:] = arguments.array(name, value, (lanes,), fill=True)
        return rows

    @classmethod
    def symbols(cls, rows: ca.SX) -> Symbols:
        """Return the parameters by name. `rows` has the shape (4,)."""
        return {name: rows[k] for k, name in enumerate(parameters_of(cls))}

    @staticmethod
    def capacity(load: ca.SX, p: Symbols) -> ca.SX:
        """Return C of (C7) [N] for a normal load [N].

        Iterates of Newton's method may have small negative loads. C must be finite and smooth for them too.
        """
        return load

    @staticmethod
    def excess(rate: ca.SX, p: Symbols) -> ca.SX:
        """Return Psi of (C8) [m/s] for a rate [m/s], which is never negative."""
        return 0.0 * rate


@dataclass(frozen=True, eq=False)
class Coulomb(FrictionLaw, name="coulomb"):
    """Coulomb's law: a sliding contact has the friction mu N at any speed."""


@documented
@dataclass(frozen=True, eq=False)
class Viscous(FrictionLaw, name="viscous"):
    """Coulomb's law with a resistance that grows with the speed of sliding, as in mucus, mud or on a greased skin.

    A contact that slides along an axis with the coefficient mu has the friction mu N (1 + viscosity mu |v|), as in a
    Bingham fluid. At the speed 1/(viscosity mu), this is twice the kinetic friction. Sticking and breakaway follow
    Coulomb's law.
    """

    viscosity: Numbers = parameter(
        10.0, "growth of friction with speed, over the square of the coefficient", "s/m", ge=0, each="segment"
    )

    @staticmethod
    def excess(rate: ca.SX, p: Symbols) -> Symbol:
        """Return viscosity w^2/2 for the rate w. Its derivative is viscosity w."""
        return 0.5 * p["viscosity"] * rate**2


def law_of(given: FrictionLaw | str | Mapping[str, Any]) -> FrictionLaw:
    """Return a law from an instance, from a name, or from a dictionary with the name and parameters.

    Raises
    ------
    ValueError
        Anything else, an unknown name, or a bad parameter.
    """
    if isinstance(given, FrictionLaw):
        return given
    more = dict(given) if isinstance(given, Mapping) else {"name": given}
    name = more.pop("name", None)
    if not isinstance(name, str) or name not in LAWS:
        known = ", ".join(map(repr, LAWS))
        raise ValueError(f"law: got {arguments.shown(name)}, must be one of {known}, or a worm3d.FrictionLaw")
    allowed = parameters_of(LAWS[name])
    unknown = [key for key in more if key not in allowed]
    if unknown:
        raise ValueError(f"law: got {unknown[0]!r} for {name!r}, must be of {', '.join(allowed) or 'no parameters'}")
    return LAWS[name](**more)
