"""Tables of finite elements for `soft_segments.py`: dense and compressed straight states, free and bent states.

Each table is computed once and kept in a folder. The dense table takes 10 to 20 minutes, the bent states take 5 to 10,
and the compressed states 2.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from interpolated_law import Bent, FreeCurve
from scipy.interpolate import CubicSpline
from scipy.io import netcdf_file
from soft_chain import Patch

from scenes.records.folder import written_whole
from scenes.studies.fem.command import DATA, load
from scenes.studies.law import table as tables
from scenes.studies.law.free import States
from scenes.studies.law.prepared import prepared
from worm3d.fem import table
from worm3d.fem.axisymmetric import Wall, rest
from worm3d.fem.bending import bent_states
from worm3d.fem.sweep import Domain, free_length, reached, sweep
from worm3d.values.arrays import FloatArray

SEGMENT = "barrel"
"""Name of the shipped description of a segment."""

FREE_PRESSURES = 91
"""Number of pressures with a state without axial force. Half as many change a(p) by up to 4e-5."""

STRAINS, BENDS = (-0.06, 0.06), (0.1, 0.2, 0.3, 0.45)
"""Strains, as l/l_free = 1 - strain, and bends [rad] of bent states. The worms of `soft_segments.py` stay within the
bends. Worms that turn have strains from -0.08 to 0.096, for which the bending stiffness is extrapolated."""

COMPRESSIONS, COMPRESSED_PRESSURES = (0.04, 0.055, 0.065, 0.075, 0.085, 0.095, 0.105, 0.115, 0.125), 31
"""Strains of compressed straight states, and number of their pressures, which are closer at small pressures. The dense
table ends at strains of 0.06 to 0.08. Worms that turn compress their chambers by up to 0.096."""

MOST_FORCE = 8.0
"""Greatest force of bent states [N]. Worms have smaller ones, and taut walls bend in another way."""

SPREAD = np.array([0.7548776662466927, 0.5698402909980532])
"""Steps, modulo 1, of points that fill a square evenly."""

CHECKPOINT = 100
"""Number of states after which the dense table is written."""


def dense(folder: Path, count: int) -> States:
    """Return stable straight states from `count` or more states by farthest points."""
    path, segment = folder / "dense.nc", load(SEGMENT)
    if not path.exists():
        part = folder / "dense_part.nc"
        for progress in sweep(Wall(segment), count):
            if progress.stable % CHECKPOINT == 0 or progress.stable == count:
                with written_whole(part) as file:
                    table.write(file, segment, table.columns(progress.states), f"{count} states", 0.0)
        part.rename(path)
    return prepared(tables.load(path)).states


def free(folder: Path) -> FreeCurve:
    """Return the free contraction and the free volume."""
    path, segment = folder / "free.csv", load(SEGMENT)
    if not path.exists():
        states = [rest(Wall(segment))]
        for pressure in np.linspace(0.0, segment.load.values[1], FREE_PRESSURES)[1:]:
            found = free_length(states[-1], float(pressure))
            if found is None:
                raise ArithmeticError(f"no state without axial force at {pressure:g} Pa")
            states.append(found)
        rows = [(each.input, 1.0 - each.length / segment.rest_length, each.volume) for each in states]
        np.savetxt(path, rows, delimiter=",", header="pressure_Pa,contraction,volume_m3", comments="")
    pressure, contraction, volume = _read(path)
    return FreeCurve(CubicSpline(pressure, contraction), CubicSpline(pressure, volume))


def compressed(folder: Path) -> States:
    """Return stable straight states below the lengths of the dense table, each from the state before it."""
    path, segment = folder / "compressed.csv", load(SEGMENT)
    if not path.exists():
        free, rows, rest_length = rest(Wall(segment)), [], segment.rest_length
        domain = Domain((0.6 * rest_length, 1.1 * rest_length), segment.load.values)
        for part in np.linspace(0.0, 1.0, COMPRESSED_PRESSURES):
            found = free_length(free, float(part**2 * segment.load.values[1]))
            if found is None:
                raise ArithmeticError(f"no state without axial force at {100 * part**2:.3g} % of the greatest pressure")
            state = free = found
            for strain in COMPRESSIONS:
                state = reached(state, free.length * (1.0 - strain), free.input, domain).state
                if state.stable:
                    rows.append((state.length, state.input, state.force, state.radius, state.volume))
        header = "length_m,pressure_Pa,force_N,radius_m,volume_m3"
        np.savetxt(path, rows, delimiter=",", header=header, comments="")
    return States(*_read(path))


def straight(folder: Path, count: int) -> States:
    """Return the states of `dense`, then those of `compressed`."""
    tables = [vars(each) for each in (dense(folder, count), compressed(folder))]
    return States(**{name: np.concatenate([each[name] for each in tables]) for name in tables[0]})


def bent(folder: Path, curve: FreeCurve, count: int) -> Bent:
    """Return bent states about the free lengths."""
    path, segment = folder / "bent.csv", load(SEGMENT)
    names = ("length_m", "pressure_Pa", "bend_rad", "force_N", "moment_Nm")
    if not path.exists():
        unit = (0.5 + np.arange(count)[:, None] * SPREAD) % 1.0
        pressure = segment.load.values[1] * unit[:, 0]
        strain = STRAINS[0] + (STRAINS[1] - STRAINS[0]) * unit[:, 1]
        length = segment.rest_length * (1.0 - curve.contraction(pressure)) * (1.0 - strain)
        bend = np.resize(BENDS, count)
        rows = bent_states(segment, zip(length.tolist(), bend.tolist(), pressure.tolist(), strict=True))
        kept = [[row[name] for name in names] for row in rows if row["stable"]]
        np.savetxt(path, kept, delimiter=",", header=",".join(names), comments="")
    length, pressure, bend, force, moment = _read(path)
    every = Bent(length, curve.contraction(pressure), bend, force, moment)
    return every.part(force < MOST_FORCE)


def patch() -> tuple[float, Patch]:
    """Return the stiffness of a contact point [N/m], and the contact of a segment, of the shipped table."""
    with netcdf_file(DATA / f"{SEGMENT}.nc", mmap=False) as file:
        columns = {name: np.array(each[:]) for name, each in file.variables.items() if name.startswith(table.PRESSED)}
    stiffness = table.contact_stiffness(columns)
    assert stiffness is not None
    return stiffness, Patch(*(columns[f"{table.PRESSED}{name}"] for name in ("pressure_Pa", "indentation_m", "load_N")))


def _read(path: Path) -> FloatArray:
    return np.loadtxt(path, delimiter=",", skiprows=1).T
