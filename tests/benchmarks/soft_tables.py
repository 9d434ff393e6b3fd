"""Tables of finite elements for `soft_segments.py`: dense straight states, free states, and bent states of the barrel.

Each table is computed once and kept in a folder. The dense table takes 10 to 20 minutes, the bent states take 5 to 10.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from interpolated_law import Bent, FreeCurve
from scipy.interpolate import CubicSpline

from scenes.records.folder import written_whole
from scenes.studies.fem.command import load
from scenes.studies.law import table as tables
from scenes.studies.law.free import States
from scenes.studies.law.prepared import prepared
from worm3d.fem import table
from worm3d.fem.axisymmetric import Wall, rest
from worm3d.fem.bending import bent_states
from worm3d.fem.sweep import free_length, sweep
from worm3d.values.arrays import FloatArray

SEGMENT = "barrel"
"""Name of the shipped description of a segment."""

FREE_PRESSURES = 91
"""Number of pressures with a state without axial force. Half as many change a(p) by up to 4e-5."""

STRAINS, BENDS = (-0.06, 0.06), (0.1, 0.2, 0.3, 0.45)
"""Strains, as l/l_free = 1 - strain, and bends [rad] of bent states: the worms of `soft_segments.py` stay within."""

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
                    table.write(file, segment, table.columns(progress.rows), f"{count} states", 0.0)
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


def _read(path: Path) -> FloatArray:
    return np.loadtxt(path, delimiter=",", skiprows=1).T
