"""Measures of a gait over the last whole periods of a run (`worm3d.measures.waves`): stride, turn and drift.

For period k, let d_k be the displacement of the centre of mass along the ground, e_k the mean heading (a unit vector in
the tangent plane of the ground), n_k the unit vector to the left of e_k in this plane, and phi_k the turn. L is the
body length. Means and sums are over the periods:

    stride_bl           = mean d_k.e_k / L                                                        (J1)
    degrees_per_wave    = mean phi_k
    turning_radius_bl   = mean |d_k| / (2 L |sin(phi/2)|),  phi = mean phi_k                       (J2)
    drift_per_metre     = sum d_k.n_k / sum |d_k|                                                 (J3)

The centre of mass moves on a circle with the radius (J2). The displacement |d_k| is a chord of this circle. In
a pipe, d_k.e_k and |d_k| are measured along the centre line.
"""

from __future__ import annotations

import numpy as np

from worm3d.measures.table import NoValueError, measure
from worm3d.measures.waves import Waves, waves_of
from worm3d.measures.way import NO_WAY
from worm3d.recorded.finished import FinishedRun

MIN_STRAIGHT_RADIUS = 1000.0
"""A worm is considered to crawl straight above this turning radius [body lengths]."""
IN_A_PIPE = "in a pipe the wall determines the direction of the worm"


@measure("stride_bl", "distance forward per wave, in body lengths")
def stride(result: FinishedRun) -> float:
    """Return (J1) [body lengths]."""
    waves = waves_of(result)
    forward = (waves.steps * waves.forward).sum(axis=1) if waves.course is None else waves.course
    return float(forward.mean()) / result.worm.length


@measure("speed_bl_s", "forward speed, as a mean over the last waves")
def _speed(result: FinishedRun) -> float:
    return stride(result) / waves_of(result).period


@measure("degrees_per_wave_deg", "turn to the left per wave")
def _turn(result: FinishedRun) -> float:
    return float(np.rad2deg(waves_of(result).turns.mean()))


@measure("turning_radius_bl", "radius of the circle on which the centre of mass moves")
def _radius(result: FinishedRun) -> float:
    waves = waves_of(result)
    if waves.course is not None:
        raise NoValueError(IN_A_PIPE)
    sine = abs(float(np.sin(waves.turns.mean() / 2.0)))
    chord = float(waves.path.mean()) / result.worm.length
    if chord >= 2.0 * MIN_STRAIGHT_RADIUS * sine:
        raise NoValueError(f"the worm crawls straight: the radius is at least {MIN_STRAIGHT_RADIUS:g} body lengths")
    return chord / (2.0 * sine)


@measure("drift_per_metre", "displacement to the left divided by the path length")
def _drift(result: FinishedRun) -> float:
    waves = waves_of(result)
    if waves.course is not None:
        raise NoValueError(IN_A_PIPE)
    up = np.array([0.0, 0.0, 1.0])
    if result.world is not None:
        up = result.world.normal(result.joints[-1].mean(axis=0), result.worm.length)
    sideways = (waves.steps * np.cross(up, waves.forward)).sum()
    return float(sideways) / way_made(result, waves)


def way_made(result: FinishedRun, waves: Waves) -> float:
    """Return the path length of the centre of mass in the waves [m].

    Raises
    ------
    NoValueError
        The worm did not move.
    """
    made = float(waves.path.sum())
    if made <= NO_WAY * result.worm.length * waves.count:
        raise NoValueError(f"the worm did not move in its last waves (path length {made:.4g} m)")
    return made
