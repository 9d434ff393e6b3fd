"""Recorded series of a run. Each series is declared once, as an attribute of a class.

The recorder (`worm3d.solver.records`), `Result` and its documentation, the data that an observer receives, the
variables and columns of files, and `to_xarray` all use these declarations. A series that an array of the solver
contains is a field with the value `recorded(...)`. A series that is computed from other series is a method decorated
with `derived`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, fields
from functools import cached_property
from itertools import count
from textwrap import fill
from typing import Any, TypeVar

import numpy as np

from worm3d.physics.actuators import Actuator
from worm3d.physics.hysteresis import Hysteresis, chamber_states
from worm3d.physics.load import Load
from worm3d.physics.worm import Worm
from worm3d.values.arrays import FloatArray, IntArray
from worm3d.values.documented import by
from worm3d.values.read_only import ReadOnly, read_only
from worm3d.values.variable import Variable

T = TypeVar("T")

UPRIGHT = 1e-3
"""A chord counts as vertical if the horizontal part is below this fraction of the chord."""

_declared = count()


@dataclass(frozen=True)
class Rows:
    """Position of a series in the solver: rows of an array, one for each component, from a first row on.

    For example, `Rows("joints", 0)` is x, y, z of the joints: the rows 0 to 2, with a column for each joint.
    """

    array: str
    row: str | int = 0
    """First row: its number, or its name in the layout of a kernel's inputs."""


@dataclass(frozen=True)
class Points(Rows):
    """Rows of an array with one column for each contact point."""


@dataclass(frozen=True)
class Entries:
    """Position of a series in the solver: entries of an array that are `step` apart."""

    array: str
    first: int = 0
    first_per_segment: int = 0
    """The first entry is `first` + `first_per_segment` N."""
    step: int = 1


Source = Rows | Entries


@dataclass(frozen=True)
class Series:
    """A recorded quantity."""

    dims: tuple[str, ...]
    """Names of the dimensions. The first is "time" or "step", the others are in `SIZES`. Empty for a single number."""
    unit: str
    """SI unit; "1" for a dimensionless number."""
    meaning: str
    """Meaning, in a few words."""
    source: Source | None = None
    """Position in the solver, which the recorder reads. None if Python computes the series."""
    clamped: Source | None = None
    """Position for a worm on the clamped ground, if different."""
    order: int = 0
    """Place in the order of the variables of a file."""
    derived: bool = False
    """Whether the series is computed from other series."""

    def shape(self, segments: int) -> tuple[int, ...]:
        """Return the shape of the series at one instant."""
        return tuple(SIZES[dim][0] * segments + SIZES[dim][1] for dim in self.dims[1:])

    @property
    def shape_text(self) -> str:
        """Shape as text, such as "(T, N+1, 3)"."""
        sizes = [{"time": "T", "step": "S"}.get(dim) or _size_text(*SIZES[dim]) for dim in self.dims]
        return f"({', '.join(sizes)}{',' if len(sizes) == 1 else ''})"


SIZES = {
    "joint": (1, 1),
    "inner_joint": (1, -1),
    "segment": (1, 0),
    "chamber": (0, 2),
    "apex": (0, 6),
    "point": (0, 8),
    "axis": (0, 3),
}
"""Length of each dimension for N segments: (a, b) means a N + b."""


def _size_text(per_segment: int, more: int) -> str:
    return (f"N{more:+d}" if more else "N") if per_segment else str(more)


def recorded(dims: str, unit: str, meaning: str, source: Source | None = None, clamped: Source | None = None) -> Any:
    """Return the dataclass field of a series. `dims` contains the names of the dimensions, separated by spaces."""
    known = Series(tuple(dims.split()), unit, meaning, source, clamped, next(_declared))
    return field(metadata={"series": known})


class _Derived(cached_property[T]):
    """A series that is computed from other series at the first access. Its arrays are read-only."""

    series: Series


def derived(dims: str, unit: str, meaning: str) -> Callable[[Callable[[Any], T]], _Derived[T]]:
    """Return a decorator that makes a method a series, computed at the first access. Arguments as in `recorded`."""

    def declare(method: Callable[[Any], T]) -> _Derived[T]:
        made = _Derived[T](lambda self: read_only(method(self)))
        made.series = Series(tuple(dims.split()), unit, meaning, order=next(_declared), derived=True)
        made.__doc__ = method.__doc__
        return made

    return declare


def series_of(holder: type) -> dict[str, Series]:
    """Return the series of a class by name, in the order of declaration."""
    found = {each.name: each.metadata["series"] for each in fields(holder) if "series" in each.metadata}
    for parent in holder.__mro__:
        found |= {name: each.series for name, each in vars(parent).items() if isinstance(each, _Derived)}
    return dict(sorted(found.items(), key=lambda item: item[1].order))


def states_of(worm: Worm) -> dict[str, Series]:
    """Return the states of a worm's actuators, joint friction and loads as series.

    The prefix of a name denotes the part: "hinge_" for an actuator of a hinge, "hysteresis_" for friction in the
    joints, "load_" for the first load, "load_2_" for the second load, and so on.
    """
    return states_of_parts(*part_classes(worm))


def part_classes(worm: Worm) -> tuple[Any, ...]:
    """Return the classes of the worm's parts, which are the arguments of `states_of_parts`."""
    return type(worm.actuator), type(worm.hysteresis), type(worm.hinge_actuator), *map(type, worm.loads)


def states_of_parts(
    chamber: type[Actuator], own: type[Hysteresis], hinge: type[Actuator], *loads: type[Load]
) -> dict[str, Series]:
    """Return the states of actuators, joint friction and loads of these classes as series."""
    found = {}
    for k, (name, unit) in enumerate(chamber_states(chamber, own).items()):
        of = "actuator" if name in chamber.states else "joints"
        meaning = f"{name} of the {of} of each chamber [left, right]"
        found[name] = Series(("time", "segment", "chamber"), unit, meaning, Rows("actuator", 2 * k))
    for k, (name, unit) in enumerate(hinge.states.items()):
        meaning = f"{name} of the actuator of each hinge"
        found[f"hinge_{name}"] = Series(("time", "inner_joint"), unit, meaning, Rows("hinge_states", k))
    names = [(k, name, unit) for k, kind in enumerate(loads) for name, unit in kind.states.items()]
    for row, (k, name, unit) in enumerate(names):
        which = f"{k + 1}_" if k else ""
        found[f"load_{which}{name}"] = Series(
            ("time",), unit, f"{name} of the load", Entries("loads", len(loads) + row)
        )
    return found


def variables_of(holder: Any, *first: str) -> Iterator[Variable]:
    """Yield the series whose first dimension is one of `first` ("" for no dimension), with NaN in place of None."""
    for name, series in series_of(type(holder)).items():
        if "".join(series.dims[:1]) in first:
            value = getattr(holder, name)
            yield Variable(name, series.dims, np.nan if value is None else value, series.unit, series.meaning)
    if isinstance(holder, Recorded) and "time" in first:
        for name, series in states_of(holder.worm).items():
            values = holder.actuator_states[name]
            yield Variable(f"actuator_{name}", series.dims, values, series.unit, series.meaning)
        if (table := holder.worm.segment.input_table) is not None:
            meaning = f"{table.name} that gives the contraction of each chamber [left, right] without load"
            dims = ("time", "segment", "chamber")
            yield Variable(table.name, dims, holder.chamber_input, table.unit, meaning)


@by
def documented(holder: Any) -> str:
    """Return a description of the series of a class, for its documentation."""
    lines = ""
    for name, series in series_of(holder).items():
        kind = f"ndarray, shape {series.shape_text}" if series.dims else "number"
        unit = f" [{series.unit}]" if series.unit != "1" else ""
        about = f"{series.meaning[0].upper()}{series.meaning[1:]}{unit}."
        lines += f"    {name} : {kind}\n{fill(about, 110, initial_indent=' ' * 8, subsequent_indent=' ' * 8)}\n"
    return lines


def heading(joints: FloatArray) -> FloatArray:
    """Return the azimuth of the chord from tail to head, unwrapped, shape (T,); NaN where the chord is vertical.

    `joints` has the shape (T, N+1, 3).
    """
    chord = joints[:, -1] - joints[:, 0]
    azimuth = np.arctan2(chord[:, 1], chord[:, 0])
    upright = np.hypot(chord[:, 0], chord[:, 1]) < UPRIGHT * np.linalg.norm(chord, axis=1)
    azimuth[~upright] = np.unwrap(azimuth[~upright])
    azimuth[upright] = np.nan
    return azimuth


@dataclass(frozen=True, eq=False, kw_only=True)
class Recorded(ReadOnly):
    """Series of a worm at T instants."""

    worm: Worm
    actuator_states: Mapping[str, FloatArray]
    """States of the actuators by name (`states_of`). The shape is (T, N, 2) for chambers, (T, N-1) for hinges, and (T,)
    for loads."""
    time: FloatArray = recorded("time", "s", "time")
    joints: FloatArray = recorded("time joint axis", "m", "joints, from tail to head", Rows("joints"))
    joint_velocity: FloatArray = recorded("time joint axis", "m/s", "velocity of the joints", Rows("joint_velocity"))
    points: FloatArray = recorded(
        "time segment point axis",
        "m",
        "apexes L-below, -above, -outward, R-below, -above, -outward; tail, head face",
        Points("points"),
    )
    directors: FloatArray = recorded(
        "time segment axis", "1", "unit vector to the left of each segment", Rows("segment_in", "d_ref")
    )
    bend: FloatArray = recorded(
        "time segment",
        "rad",
        "chamber bend: the left chamber is offset x bend shorter than the segment",
        Entries("x", first=4, step=5),
    )
    twist: FloatArray = recorded(
        "time inner_joint",
        "rad",
        "roll of the segment ahead of joints 1 to N-1 relative to the segment behind; positive: left side up",
        Rows("joint_angles", 2),
    )
    chamber_length: FloatArray = recorded(
        "time segment chamber", "m", "length of each chamber [left, right]", Rows("lengths")
    )
    command: FloatArray = recorded(
        "time segment chamber",
        "1",
        "contraction asked of each chamber [left, right], within its stroke",
        Entries("asked"),
    )
    contraction: FloatArray = recorded(
        "time segment chamber", "1", "contraction given by the actuators, after lag and limits", Entries("given")
    )
    hinge: FloatArray = recorded(
        "time inner_joint", "rad", "hinge angle given at joints 1 to N-1", Entries("given", 1, first_per_segment=4)
    )
    force: FloatArray = recorded(
        "time segment chamber",
        "N",
        "extra force of each chamber [left, right] given by the actuators",
        Entries("given", first_per_segment=2),
    )
    com: FloatArray = recorded("time axis", "m", "centre of mass of joints and apexes", Entries("momenta", 6))

    @derived("time axis", "m/s", "velocity of the centre of mass")
    def com_velocity(self) -> FloatArray:
        """Return the velocity of the centre of mass."""
        return self.momentum / self.worm.mass

    momentum: FloatArray = recorded("time axis", "kg m/s", "momentum", Entries("momenta"))
    angular_momentum: FloatArray = recorded(
        "time axis", "kg m^2/s", "angular momentum about the origin", Entries("momenta", 3)
    )

    @derived("time", "rad", "azimuth of the tail-to-head chord, unwrapped; NaN where it is vertical")
    def heading(self) -> FloatArray:
        """Return the azimuth of the tail-to-head chord."""
        return heading(self.joints)

    normal_load: FloatArray = recorded(
        "time segment apex", "N", "normal load of each apex", Points("point_in", "load_n")
    )
    slip: FloatArray = recorded(
        "time segment apex", "m", "metres slid by each apex since the previous row", Points("slid")
    )
    joint_load: FloatArray = recorded(
        "time joint",
        "N",
        "normal load of end faces and inner joints; clamped: of each joint, (P9)",
        Points("point_in", "load_n"),
        clamped=Entries("joint_load"),
    )
    joint_slip: FloatArray = recorded(
        "time joint", "m", "metres slid by end faces and inner joints since the previous row", Points("slid")
    )
    contact_force: FloatArray = recorded(
        "time segment point axis",
        "N",
        "force of the world on each point: normal load and friction",
        Points("contact_force"),
    )
    joint_friction: FloatArray = recorded(
        "time joint axis", "N", "friction (P10) on each joint of the clamped worm", Rows("joint_friction")
    )
    anchors: FloatArray = recorded(
        "time segment point axis", "m", "where the contacts stick", Points("point_in", "anchor")
    )

    @property
    def apexes(self) -> FloatArray:
        """Positions of the apexes in the order of NOTATION.md, shape (T, N, 6, 3) [m]."""
        return self.points[:, :, :6]

    @property
    def com_with_load(self) -> FloatArray:
        """Centre of mass of worm and payloads, shape (T, 3) [m]."""
        mass = self.worm.load_mass
        total = self.worm.mass * self.com + np.einsum("j,tjd->td", mass, self.joints)
        com: FloatArray = read_only(total / (self.worm.mass + mass.sum()))
        return com

    @property
    def end_load(self) -> FloatArray:
        """Load of the end faces [tail, head], shape (T, 2) [N]."""
        load: FloatArray = read_only(self.joint_load[:, [0, -1]])
        return load

    @cached_property
    def chamber_input(self) -> FloatArray:
        """Pressure [Pa] or cable force [N] of each chamber for `contraction` without load, shape (T, N, 2).

        ValueError if the segment law has no table of inputs.
        """
        table = self.worm.segment.require_table()
        found: FloatArray = read_only(np.interp(self.contraction, table.contraction, table.value))
        return found

    @cached_property
    def chamber_strain(self) -> FloatArray:
        """Strain of each chamber, which is length/(rest length) - 1, shape (T, N, 2)."""
        strain: FloatArray = read_only(self.chamber_length / self.worm.l0 - 1.0)
        return strain


@dataclass(frozen=True, eq=False, kw_only=True)
class Steps(ReadOnly):
    """Series of the S time steps of a run."""

    dt: float

    @derived("step", "s", "end of each time step")
    def step_time(self) -> FloatArray:
        """Return the end of each time step, counted from the start of the run."""
        return self.dt * np.arange(1.0, len(self.newton_iterations) + 1.0)

    newton_iterations: IntArray = recorded("step", "1", "evaluations with a new Jacobian, whole or in part")
    gradient_evaluations: IntArray = recorded("step", "1", "further evaluations of the residual")
    breakaways: IntArray = recorded("step", "1", "rounds of contacts that broke away")
    fallbacks: IntArray = recorded("step", "1", "times that Newton fell back to descent")
    halved_steps: int = recorded("", "1", "steps that were taken in parts")
    settling: float | None = recorded(
        "", "m", "largest motion of a joint while the worm was brought to rest before the run; NaN if it was not"
    )


COUNTERS = [name for name, series in series_of(Steps).items() if name != "step_time" and series.dims == ("step",)]
"""Series that the solver counts, in the order of its counters."""
