"""How far a worm with a learned segment law crawls and turns, compared with finite elements.

    python tests/benchmarks/soft_segments.py [--folder DIR] [--states 2000] [--bent 200]

The law is the shipped one, which `worm3d law` fitted to 100 straight and 24 bent states, and fits of the same states
with other seeds. There are two comparisons:

* In 3D, with the same worm whose energy and radius interpolate thousands of states (`interpolated_law.py`) and whose
  bending follows hundreds of bent states. Ingredients of the law are exchanged one by one.
* On a line, at a slow period, with a chain of axisymmetric finite elements without a law (`soft_chain.py`), on stiff
  contacts, and on the contact of a wall that flat ground presses.

The program prints Markdown. Tables of finite elements are kept in the folder and read by the next run.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from time import perf_counter
from typing import Annotated, Any, NamedTuple

import numpy as np
import soft_tables
import typer
from interpolated_law import (
    MOMENT_FLOOR,
    STRAINS,
    Bent,
    FreeCurve,
    Interpolated,
    Points,
    bending,
    energy_and_radius,
    of_learned,
)
from scipy.constants import g
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize_scalar
from scipy.spatial import ConvexHull
from soft_chain import Contact, Elastic, FiniteElements, Ground, OfLaw, Segments, Stand, Walk, walk

import worm3d
from control import gaits
from scenes.records.text import markdown_table
from scenes.studies.fem.command import DATA, load
from scenes.studies.law import law as laws
from scenes.studies.law import table as tables
from scenes.studies.law.free import States
from scenes.studies.law.prepared import Prepared, prepared
from worm3d.fem.axisymmetric import Wall
from worm3d.fem.table import POINTS_OF_A_SEGMENT
from worm3d.physics.friction import ContactConstants
from worm3d.values.arrays import FloatArray

SHIPPED = "barrel.json"
SEEDS = (1, 2)
"""Seeds of further fits of the shipped table. The shipped law has the seed 0."""

MORE_STATES = 200
"""Number of straight states of a further fit: the first states of the dense table, with the shipped bent states."""

SOFT = 0.15
"""Bending stiffness [N m/rad] below which a bent state counts as soft: low pressure, or pressed together."""

STEPPED = ("base", "bias 0.3")
"""Cases that are run with smaller time steps, too."""

WAVES, DT = 5, 0.01
"""Number of waves of a run, of which the last is measured, and time step [s]."""

DISTANCE_BAR, TURN_BAR_DEG = 0.02, 0.7
"""Largest difference between law and reference: of the distance per wave, relative, and of the turn per wave."""

HELD_OUT, HULL = 0.1, 0.02
"""Share of the inner states that is held out for the error of the interpolation, and distance of inner states from the
hull, over half of the ranges. Splines do not extrapolate."""

SLOW_PERIOD, CHAIN_STEPS, CHAIN_WAVES = 20.0, 50, 2
"""Period of the chain [s], its steps per wave, and its waves, of which the last is measured."""


@dataclass(frozen=True)
class Case:
    """A worm and a gait."""

    name: str
    gait: Any
    worm: Mapping[str, Any] = field(default_factory=dict)

    def run(self, segment: worm3d.Learned, dt: float = DT) -> Wave:
        """Return the last wave of a run on a plane; NaN if the run stops before."""
        worm = worm3d.Worm(segment=segment, **self.worm)
        result = worm3d.simulate(worm, worm3d.Plane(), actuation=self.gait, duration=WAVES * self.gait.period, dt=dt)
        if result.status is not worm3d.Status.DONE:
            return Wave(np.nan, np.nan)
        rows = [-1 - round(self.gait.period / dt), -1]
        (begin, end), (before, after) = result.com[rows, :2], result.heading[rows]
        return Wave(float(np.linalg.norm(end - begin)), float(np.rad2deg(after - before)))


class Wave(NamedTuple):
    """Motion in a wave."""

    distance: float
    """Displacement of the centre of mass [m]."""
    turn: float
    """Change of the heading [deg]."""


def _wave(**changes: Any) -> gaits.TravellingWave:
    return gaits.TravellingWave(**{"period": 2.0, "wavelength": 1.0, "amplitude": 0.2, **changes})


CASES = (
    Case("base", _wave()),
    Case("amplitude 0.1", _wave(amplitude=0.1)),
    Case("amplitude 0.26", _wave(amplitude=0.26)),
    Case("mass 0.3 kg", _wave(), {"mass": 0.3}),
    Case("period 1 s", _wave(period=1.0)),
    Case("period 4 s", _wave(period=4.0)),
    Case("bias 0.1", _wave(bias=0.1)),
    Case("bias 0.3", _wave(bias=0.3)),
    Case("hinge 15 deg", _wave(hinge=np.deg2rad(15.0))),
    Case("steered, bias 0.08", gaits.Steered(period=1.25, amplitude=0.25, wavelength=0.7, bias=0.08)),
    Case("steered, hinge 0.15 rad", gaits.Steered(period=1.25, amplitude=0.25, wavelength=0.7, hinge=0.15)),
)


def main(
    folder: Annotated[Path, typer.Option(help="Folder of the tables of finite elements.")] = Path("runs/soft_segments"),
    states: Annotated[int, typer.Option(help="Straight states of the dense table.", min=500)] = 2000,
    bent: Annotated[int, typer.Option(help="Bent states.", min=100)] = 200,
) -> None:
    """Compare learned laws with finite elements."""
    folder.mkdir(parents=True, exist_ok=True)
    shipped = worm3d.Learned(SHIPPED)
    with _timed("finite elements"):
        straight, curve = soft_tables.straight(folder, states), soft_tables.free(folder)
        curved = soft_tables.bent(folder, curve, bent)
    with _timed("interpolation"):
        splines = energy_and_radius(shipped.law, straight, curve)
        splines |= bending(shipped.law, splines["energy"], curved)
        reference = Interpolated(SHIPPED, splines=splines)
        _say(straight_errors(shipped, straight, curve))
        _say(("", *bent_errors(shipped, splines["energy"], curved)))
    with _timed("further fits"):
        given = prepared(tables.load(DATA / "barrel.nc"))
        more = replace(given, states=straight.part(np.arange(MORE_STATES)))
        fits = {f"seed {seed}": _fit(folder / f"seed_{seed}.json", given, seed) for seed in SEEDS}
        fits |= {f"{MORE_STATES} states": _fit(folder / f"states{MORE_STATES}.json", more, 0)}
    with _timed("motion per wave"):
        _say(against(reference, {"law": shipped, **fits}))
        typer.echo(f"\nBars: {DISTANCE_BAR:.0%} of the distance, {TURN_BAR_DEG:g} degrees of the turn.")
    with _timed("exchange of ingredients"):
        _say(against(reference, exchanged(reference, shipped)))
    with _timed("another offset"):
        for name, each in {"law": shipped, **fits}.items():
            moved = refitted(each, curved)
            offset = moved.law.chamber_offset
            typer.echo(
                f"\nAll bent states give m and the offset, {1e3 * offset:.2f} mm. The reference has this offset.\n"
            )
            _say(against(replace(reference, offset=offset), {name: moved}))
    with _timed("time steps"):
        _say(time_steps({"reference": reference, "law": shipped}))
    with _timed("chain"):
        _say(chains(shipped))


@contextmanager
def _timed(what: str) -> Iterator[None]:
    began = perf_counter()
    typer.echo(f"\n### {what[:1].upper()}{what[1:]}\n")
    yield
    typer.echo(f"\nTime of this part: {perf_counter() - began:.0f} s")


def _say(lines: Iterable[str]) -> None:
    for line in lines:
        typer.echo(line)


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def straight_errors(learned: worm3d.Learned, states: States, free: FreeCurve) -> Iterator[str]:
    """Yield the errors of the interpolation and of the law, at straight states that the interpolation has not seen."""
    law, held = learned.law, _held_out(states)
    of_table, size = CubicSpline(law.value, law.contraction), _rms(states.force)
    strain = Points(law, states.length, free.contraction(states.input)).strain[0]
    near = held & (strain > STRAINS[0]) & (strain < STRAINS[1])
    rest, peak = states.part(near), np.abs(states.force).max()
    band = np.abs(rest.force) < laws.BAND * peak
    rows = []
    for name, splines, a in (
        ("splines", energy_and_radius(law, states.part(~held), free), free.contraction(rest.input)),
        ("law", of_learned(learned), of_table(rest.input)),
    ):
        points = Points(law, rest.length, a)
        miss = points.force(splines["energy"]) - rest.force
        width = 1e3 * (points.value("radius", splines["radius"]) - rest.radius)
        relative = (f"{100 * _rms(miss) / size:.3f}", f"{100 * _rms(miss[band]) / _rms(rest.force[band]):.3f}")
        rows.append((name, *relative, f"{_rms(width):.4f}", f"{np.abs(width).max():.3f}"))
    yield f"{len(states)} straight states; {near.sum()} held out with strains of the splines, {band.sum()} in the band."
    yield ""
    titles = ("", "force, of the rms of all [%]", "in the band, of its rms [%]", "radius rms [mm]", "peak [mm]")
    yield from markdown_table(titles, rows)
    grid = np.linspace(0.0, law.value[-1], 500)
    apart = np.abs(of_table(grid) - free.contraction(grid)).max()
    yield ""
    yield f"The free contractions of law and finite elements differ by {apart:.1e} or less."


def bent_errors(learned: worm3d.Learned, energy: FloatArray, bent: Bent) -> Iterator[str]:
    """Yield the errors of moments and axial forces at bent states; a fifth is held out for the splines of m."""
    law, held = learned.law, np.arange(len(bent.bend)) % 5 == 0
    own = {"energy": energy, **bending(law, energy, bent.part(~held))}
    rest, rows = bent.part(held), []
    soft = rest.moment < SOFT * rest.bend
    for name, splines, offset in (("splines", own, 0.0), ("law", of_learned(learned), law.chamber_offset)):
        force, moment = rest.answer(law, splines, offset)
        miss = (moment - rest.moment) / rest.bend
        relative = [f"{100 * _rms(miss[at]) / _rms((rest.moment / rest.bend)[at]):.2f}" for at in (soft, ~soft)]
        rows.append((name, *relative, f"{_rms(force - rest.force):.3f}"))
    yield f"{len(bent.bend)} bent states; {held.sum()} held out, {soft.sum()} soft; force rms {_rms(rest.force):.2f} N."
    yield ""
    yield from markdown_table(("", "moment/bend, soft [%]", "others [%]", "force rms [N]"), rows)


def _held_out(states: States) -> FloatArray:
    points = np.column_stack([2.0 * each / np.ptp(each) for each in (states.length, states.input)])
    planes = ConvexHull(points).equations
    inner = (points @ planes[:, :2].T + planes[:, 2]).max(axis=1) < -HULL
    return inner & (np.random.default_rng(0).random(len(states)) < HELD_OUT)


def _fit(path: Path, given: Prepared, seed: int) -> worm3d.Learned:
    """Return a law that is fitted to some states, from its file if there is one."""
    if not path.exists():
        path.write_text(json.dumps(laws.content(laws.make(given, seed))))
    return worm3d.Learned(str(path))


def against(exact: Interpolated, others: Mapping[str, worm3d.Learned]) -> Iterator[str]:
    """Yield the table of the motion per wave in all cases, with the differences of other segments."""
    units = [f"{name} [{unit}]" for unit in ("%", "deg") for name in others]
    titles = ["case", "reference [mm]", *units[: len(others)], "turn [deg]", *units[len(others) :]]
    rows = []
    for case in CASES:
        own, found = case.run(exact), [case.run(each) for each in others.values()]
        apart = [f"{100 * (each.distance / own.distance - 1.0):+.2f}" for each in found]
        turns = [f"{each.turn - own.turn:+.2f}" for each in found]
        rows.append([case.name, f"{1e3 * own.distance:.2f}", *apart, f"{own.turn:.2f}", *turns])
    yield from markdown_table(titles, rows)


def exchanged(reference: Interpolated, learned: worm3d.Learned) -> dict[str, worm3d.Learned]:
    """Return the reference with one ingredient of the law each. The moment is m and both chambers with the offset b."""
    own, given = dict(reference.splines), of_learned(learned)
    moment = {name: given[name] for name in ("bending", "cubic")}
    return {
        "energy": replace(reference, splines=own | {"energy": given["energy"]}),
        "radius": replace(reference, splines=own | {"radius": given["radius"]}),
        "moment": replace(reference, splines=own | moment, whole=0.0),
        "all three": replace(reference, splines=given, whole=0.0),
        "b + 10 %": replace(reference, offset=1.1 * learned.law.chamber_offset),
    }


def refitted(learned: worm3d.Learned, bent: Bent) -> worm3d.Learned:
    """Return a law with the offset and m of (SL7) that fit bent states best together, by relative errors."""
    law = learned.law
    x = (bent.length / law.rest_length - law.scales["x_mid"]) / law.scales["x_half"]
    y = (bent.contraction - law.scales["y_mid"]) / law.scales["y_half"]
    w = 1.0 / (MOMENT_FLOOR * bent.bend + bent.moment)
    terms = (w * bent.bend)[:, None] * np.column_stack([np.ones_like(x), x, y, x * x, x * y, y * y])
    straight = {name: each if name == "energy" else 0.0 * each for name, each in of_learned(learned).items()}

    def fitted(offset: float) -> tuple[FloatArray, float]:
        rest = w * (bent.moment - bent.answer(law, straight, offset)[1])
        found = np.linalg.lstsq(terms, rest, rcond=None)[0]
        return found, _rms(terms @ found - rest)

    offset = float(minimize_scalar(lambda b: fitted(b)[1], bounds=(0.1 * law.plate_radius, law.plate_radius)).x)
    own = json.loads(learned.content) | {"chamber_offset_m": offset, "bending_Nm": fitted(offset)[0].tolist()}
    return worm3d.Learned(file="refitted", content=json.dumps(own))


def time_steps(segments: Mapping[str, worm3d.Learned]) -> Iterator[str]:
    """Yield the motion per wave at smaller time steps."""
    rows = []
    for case in CASES:
        if case.name not in STEPPED:
            continue
        for name, segment in segments.items():
            waves = [case.run(segment, dt) for dt in (DT, DT / 2.0, DT / 4.0)]
            texts = [f"{1e3 * each.distance:.2f} / {each.turn:.2f}" for each in waves]
            rows.append([case.name, name, *texts])
    yield from markdown_table(("case", "segment", "10 ms [mm / deg]", "5 ms", "2.5 ms"), rows)


def chains(learned: worm3d.Learned) -> Iterator[str]:
    """Yield the comparison of chains and of the 3D worm at a slow period, with stiff contacts and with soft ones."""
    law, (point, patch) = learned.law, soft_tables.patch()
    stiff, soft = _slow(learned, None), _slow(learned, point)
    fine = np.linspace(0.0, law.value[-1], 20001)
    pressure = np.interp(stiff.contraction.mean(axis=2)[1:], CubicSpline(law.value, law.contraction)(fine), fine)
    rigid = float(ContactConstants.of(stiff.worm, worm3d.Friction(), g).stiffness[0])
    elements, rows = FiniteElements(Wall(load(soft_tables.SEGMENT)), pressure.shape[1]), []
    for name, exact, constant, worm in (
        ("stiff", Elastic(POINTS_OF_A_SEGMENT * rigid), rigid, stiff),
        ("soft", patch, point, soft),
    ):
        contacts = {"law": exact, f"law, {constant:.3g} N/m": Elastic(POINTS_OF_A_SEGMENT * constant)}
        walks = {each: _walk(OfLaw(learned), learned, stiff, pressure, contact) for each, contact in contacts.items()}
        reference = _walk(elements, learned, stiff, pressure, exact, walks["law"])
        walks = {"finite elements": reference, **walks, "3D worm": _of_worm(learned, worm, pressure)}
        rows += [_chain_row(f"{name}, {each}", found, reference) for each, found in walks.items()]
    yield from markdown_table(CHAIN_COLUMNS, rows)
    yield ""
    yield f"{elements.solutions} solutions of a segment by finite elements."


CHAIN_COLUMNS = (
    "chain",
    "distance [mm]",
    "force rms [N]",
    "error rms [N]",
    "error [%]",
    "length rms [mm]",
    "radius rms [mm]",
    "radius peak [mm]",
    "load rms [N]",
)


def _chain_row(name: str, found: Walk, exact: Walk) -> tuple[str, ...]:
    """Return the row of a chain in the last wave, with differences from finite elements."""
    last = slice(-CHAIN_STEPS, None)
    moved = found.joints[-1].mean() - found.joints[-1 - CHAIN_STEPS].mean()
    force, length, radius, load = (
        getattr(found, what)[last] - getattr(exact, what)[last] for what in ("force", "length", "radius", "load")
    )
    size = _rms(exact.force[last])
    numbers = (_rms(found.force[last]), _rms(force), 100 * _rms(force) / size)
    widths = (1e3 * _rms(length), 1e3 * _rms(radius), 1e3 * float(np.abs(radius).max()))
    texts = (*(f"{each:.4f}" for each in numbers), *(f"{each:.3f}" for each in widths), f"{_rms(load):.4f}")
    return name, f"{1e3 * moved:.2f}", *texts


def _slow(learned: worm3d.Learned, stiffness: float | None) -> worm3d.Result:
    """Return a run of the 3D worm with contacts of this stiffness [N/m], or with the default.

    The chain has neither dampers nor a static friction above the kinetic one, and does not roll. So does this worm.
    """
    return worm3d.simulate(
        worm3d.Worm(segment=learned, kelvin_voigt_time=0.0),
        worm3d.Plane(),
        worm3d.Friction(static_ratio=1.0, contact_stiffness=stiffness),
        actuation=_wave(period=SLOW_PERIOD),
        duration=CHAIN_WAVES * SLOW_PERIOD,
        dt=DT,
        record_every=round(SLOW_PERIOD / CHAIN_STEPS / DT),
        held=worm3d.Held(roll=True),
    )


def _walk(
    segments: Segments,
    learned: worm3d.Learned,
    result: worm3d.Result,
    pressure: FloatArray,
    contact: Contact,
    guess: Walk | None = None,
) -> Walk:
    """Return the path of a chain with the weights, joints and friction of the worm of a run."""
    worm, friction = result.worm, worm3d.Friction()
    apexes = worm.apex_mass.sum(axis=1) / 2.0
    stand = Stand(g * (worm.joint_mass + np.append(apexes, 0.0) + np.append(0.0, apexes)), worm.k_torsion[0], contact)
    ground = Ground(friction.forward, friction.backward, learned.law.chamber_offset, stand)
    return walk(segments, learned.law.rest_length * np.arange(worm.segments + 1), pressure, ground, guess)


def _of_worm(learned: worm3d.Learned, result: worm3d.Result, pressure: FloatArray) -> Walk:
    """Return the path of the 3D worm, with the forces of the law."""
    length, contraction = (each.mean(axis=2)[1:] for each in (result.chamber_length, result.contraction))
    force = np.array([OfLaw(learned).at(*each).force for each in zip(length, pressure, strict=True)])
    radius, load = learned.law.radius_at(length, contraction), result.normal_load.sum(axis=2)[1:]
    return Walk(result.joints[1:, :, 0], force, radius, length, load)


if __name__ == "__main__":
    typer.run(main)
