"""Measures of contact: slip of loaded contacts, anchoring of segments, wall load, penetration and roll.

Between two rows, each contact point p slides by s_p. N_p is the mean of its normal loads at both rows. The measures use
the last whole waves. In these waves the worm travels the distance D (`worm3d.measures.waves`):

    slip_per_metre      = sum over rows of (sum_p N_p s_p / sum_p N_p) / D                          (J4)
    backslide_per_metre = the same with s_p max(0, -cos a_p) in place of s_p                        (J5)
    anchoring_duty      = share of the time in which a segment is anchored, mean over the segments  (J6)

a_p is the angle between the displacement of the point and the direction of its segment towards the head. A segment is
anchored if it bears load and slides by at most `AT_REST` times the body length per period.

A worm that is dragged along has a slip of 1 m/m. A worm whose loaded contacts all stick has no slip.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from worm3d.measures.gait import way_made
from worm3d.measures.posture import ON_ITS_SIDE, rolled
from worm3d.measures.table import NoValueError, measure
from worm3d.measures.waves import Waves, waves_of
from worm3d.recorded.finished import FinishedRun
from worm3d.values.arrays import FloatArray

AT_REST = 1e-3
"""Largest slide of an anchored segment [body lengths per period]. Elastic motion of anchors does not count as slide.

The slide of a sliding segment is about 0.05. With half or twice this limit, the anchoring duty of the default worm is
the same.
"""
NO_WALL = "there is no world in which the worm could sink"
NO_GROUND = "the worm lies on no ground: there is none below it, or no gravity"


class Contacts(NamedTuple):
    """Contacts between consecutive rows: R intervals, P points (apexes, then end faces and inner joints)."""

    load: FloatArray
    """Mean normal load, shape (R, P) [N]."""
    slid: FloatArray
    """Distance that each point slides in the interval, shape (R, P) [m]."""

    def mean_slide(self, slid: FloatArray) -> FloatArray:
        """Return the mean of slides, weighted by load, shape (R,) [m]; 0 where nothing bears load.

        `slid` has the shape (R, P).
        """
        total = self.load.sum(axis=1)
        mean: FloatArray = (self.load * slid).sum(axis=1) / np.where(total > 0.0, total, 1.0)
        return mean


def contacts(result: FinishedRun, waves: Waves) -> Contacts:
    """Return the loads and slides between the rows of the last waves."""
    rows = slice(waves.first, None)
    apexes, joints = result.normal_load[rows].reshape(-1, 6 * result.worm.segments), result.joint_load[rows]
    load = np.hstack([apexes, joints])
    slid = np.hstack([result.slip[rows].reshape(apexes.shape), _joint_slides(result, rows)])
    return Contacts((load[1:] + load[:-1]) / 2.0, slid[1:])


def _joint_slides(result: FinishedRun, rows: slice) -> FloatArray:
    if result.world is None or not result.world.clamped:
        return result.joint_slip[rows]
    moved = np.diff(result.joints[rows, :, :2], axis=0, prepend=result.joints[rows][:1, :, :2])
    slides: FloatArray = np.linalg.norm(moved, axis=2)  # the clamped worm slides with its joints
    return slides


@measure("slip_per_metre", "distance that contacts slide per metre of way, as a mean weighted by load")
def _slip(result: FinishedRun) -> float:
    waves = waves_of(result)
    found = contacts(result, waves)
    return float(waves.weights @ found.mean_slide(found.slid)) / way_made(result, waves)


@measure("backslide_per_metre", "part of the slip that goes towards the tail")
def _backslide(result: FinishedRun) -> float:
    waves = waves_of(result)
    found = contacts(result, waves)
    backward = found.mean_slide(_backward(result, waves, found.slid))
    return float(waves.weights @ backward) / way_made(result, waves)


def _backward(result: FinishedRun, waves: Waves, slid: FloatArray) -> FloatArray:
    """Return the part of slides, an array (R, P), that is directed towards the tail [m]."""
    n = result.worm.segments
    row, point = np.nonzero(slid)
    k = waves.first + row  # the row before
    at_apex = point < 6 * n
    segment = np.where(at_apex, point // 6, np.clip(point - 6 * n, 0, n - 1))
    along = result.joints[k, segment + 1] - result.joints[k, segment]
    moved = np.empty((len(row), 3))
    apex = point[at_apex] % 6
    moved[at_apex] = (
        result.points[k[at_apex] + 1, segment[at_apex], apex] - result.points[k[at_apex], segment[at_apex], apex]
    )
    joint = point[~at_apex] - 6 * n
    moved[~at_apex] = result.joints[k[~at_apex] + 1, joint] - result.joints[k[~at_apex], joint]
    size = np.linalg.norm(moved, axis=1) * np.linalg.norm(along, axis=1)
    cosine = (moved * along).sum(axis=1) / np.where(size > 0.0, size, 1.0)
    backward = np.zeros_like(slid)
    backward[row, point] = slid[row, point] * np.maximum(0.0, -cosine)
    return backward


@measure(
    "anchoring_duty",
    "share of time in which a segment is anchored, bears load and does not slide; mean over the segments",
)
def _duty(result: FinishedRun) -> float:
    waves, n = waves_of(result), result.worm.segments
    found = contacts(result, waves)
    own = slice(6 * n, None) if result.world is not None and result.world.clamped else slice(6 * n)
    load, slid = (each[:, own].reshape(len(each), -1, 1 if own.stop is None else 6) for each in found)
    apart = float(result.time[1] - result.time[0])
    still = AT_REST * result.worm.length * apart / waves.period
    sliding = ((load > 0.0) & (slid > still)).any(axis=2)
    anchored = (load > 0.0).any(axis=2) & ~sliding
    return waves.mean(anchored.mean(axis=1))


@measure("peak_wall_load_N", "greatest normal load of a segment's feet (or of a joint) over the run")
def _peak(result: FinishedRun) -> float:
    return float(max(result.normal_load.sum(axis=2).max(), result.joint_load.max()))


@measure("largest_penetration", "largest depth of a loaded foot or joint in the world over the run, in segment lengths")
def _penetration(result: FinishedRun) -> float:
    if result.world is None or result.world.clamped:
        raise NoValueError(NO_WALL)
    points = result.points
    joints = np.concatenate([points[:, :, 6], points[:, -1:, 7]], axis=1)
    loaded = np.concatenate([points[:, :, :6][result.normal_load > 0.0], joints[result.joint_load > 0.0]])
    return float(-np.min(result.world.distance(loaded), initial=0.0)) / result.worm.l0


@measure("roll_max_deg", "largest roll over the run, to either side")
def roll_max(result: FinishedRun) -> float:
    """Return the largest roll of a worm [deg]; raise NoValueError if there is no ground."""
    largest = rolled(result).largest
    if largest is None:
        raise NoValueError(NO_GROUND)
    return float(np.rad2deg(largest))


@measure("roll_margin_deg", "roll from which a worm lies on its side, minus the largest roll; negative if it tipped")
def _margin(result: FinishedRun) -> float:
    return float(np.rad2deg(ON_ITS_SIDE)) - roll_max(result)
