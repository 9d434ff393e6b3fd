"""Measures that every run has: how the run ended, the distance of the worm, and what the work was used for.

A measure is a number in the summary of a run. If a measure has no value, its function raises NoValueError with the
reason.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from worm3d.measures.spread import UNEVEN_GROUND_ADVICE, rough
from worm3d.measures.table import NoValueError, measure
from worm3d.measures.way import NO_HEADING, NO_PERIOD, NO_WAY, along_the_ground, distance, distance_of
from worm3d.recorded.energy import TERMS, Energy
from worm3d.recorded.estimate import ErrorEstimate
from worm3d.recorded.finished import FinishedRun
from worm3d.values.arrays import FloatArray
from worm3d.values.period_means import SHORT_RUN, averaged, path_length

SPARSE = "the stored rows of the result are more than two periods of the gait apart: store more rows (record_every)"
NOT_SETTLED = (
    "the worm was not brought to rest before the run: it touched nothing, was moving, continued an earlier run, or was "
    "to start without settling"
)
FIXED = "the time steps have a fixed length, so the errors are not known: set an accuracy to estimate them"
NO_STEP = "no step was finished"
NO_PAYLOAD = "the worm carries no payload"

USES = tuple(Energy.of(np.zeros((1, len(TERMS)))).uses)
"""Names of the uses of the work, such as friction."""
USE_MEANINGS = {
    "hysteresis": "friction in the joints of the chambers",
    "damping": "damping of the material, the medium and the contacts, and losses within the actuators",
    "impact": "impacts on the world",
    "numerical": "numerical loss of the time steps, positive or negative",
    "gained": "increase of the stored energy from the start to the end",
    "friction": "friction on the world",
}
"""Meaning of each use of the work."""


@measure("status", "how the run ended")
def _status(result: FinishedRun) -> str:
    return result.status.name.lower()


@measure("duration_s", "simulated time")
def _duration(result: FinishedRun) -> float:
    return float(result.time[-1] - result.time[0])


@measure("distance_m", "displacement of the centre of mass along the initial heading")
def _distance(result: FinishedRun) -> float:
    return _forward(result, result.com)


@measure("path_length_m", "length of the path of the centre of mass, whose position is averaged over a period")
def _path_length(result: FinishedRun) -> float:
    if result.period is None or _sparse(result):
        raise NoValueError(_no_mean(result))
    return path_length(along_the_ground(result), result.time, result.period)


@measure("mean_speed_m_s", "mean speed along the initial heading of the centre of mass, averaged over a period")
def _mean_speed(result: FinishedRun) -> float:
    window = 0
    if result.period is not None and len(result.time) > 1:
        window = round(result.period / float(result.time[1] - result.time[0]))
    if not 1 <= window < len(result.time):
        raise NoValueError(_no_mean(result))
    return _forward(result, averaged(result.com, window)) / float(result.time[-1] - result.time[window - 1])


@measure("heading_change_deg", "change of the heading over the run, positive to the left")
def _heading_change(result: FinishedRun) -> float:
    turned = float(np.rad2deg(result.heading[-1] - result.heading[0]))
    if np.isnan(turned):
        raise NoValueError("a vertical body has no heading")
    return turned


@measure(
    "work_contract_J",
    "net work of the actuators; of actuators with a source of energy, the energy drawn from the source",
)
def _work(result: FinishedRun) -> float:
    return float(result.energy.work_contract.sum())


@measure("work_friction_J", "work dissipated by friction on the world")
def _friction(result: FinishedRun) -> float:
    return result.energy.uses["friction"]


@measure("cost_of_transport", "net work of the actuators, work_contract_J, divided by (weight times distance)")
def _cost(result: FinishedRun) -> float:
    work = _work(result)
    if work < -_rounding(result):
        raise NoValueError(f"the net work of the actuators is negative ({work:.4g} J): the worm drove its actuators")
    return max(0.0, work) / carried(result)


@measure("energy_balance_error", "residual of the energy ledger divided by the sum of the absolute values of its terms")
def _balance(result: FinishedRun) -> float:
    return result.energy.balance_error


@measure("newton_iterations_mean", "mean number of iterations of Newton's method per step")
def _iterations(result: FinishedRun) -> float:
    if not len(result.newton_iterations):
        raise NoValueError(NO_STEP)
    solved = len(result.newton_iterations) if result.error_estimate is None else result.error_estimate.steps
    return float(result.newton_iterations.sum()) / solved


def _error(result: FinishedRun) -> ErrorEstimate:
    if result.error_estimate is None:
        raise NoValueError(f"{FIXED}; {UNEVEN_GROUND_ADVICE}" if rough(result) else FIXED)
    return result.error_estimate


@measure("distance_error_m", "estimated error of the distance")
def _distance_error(result: FinishedRun) -> float:
    return _error(result).distance


@measure("heading_error_deg", "estimated error of the change of the heading")
def _heading_error(result: FinishedRun) -> float:
    return float(np.rad2deg(_error(result).heading))


@measure("work_error_J", "estimated error of the net work of the actuators")
def _work_error(result: FinishedRun) -> float:
    return _error(result).work


@measure("real_time_factor", "simulated time divided by computing time")
def _real_time(result: FinishedRun) -> float:
    if not len(result.newton_iterations) or result.wall_s <= 0.0:
        raise NoValueError(NO_STEP)
    return len(result.newton_iterations) * result.dt / result.wall_s


def _total(result: FinishedRun, term: str) -> float:
    return float(getattr(result.energy, term).sum())


def _use(result: FinishedRun, name: str) -> float:
    return result.energy.uses[name]


def _share(result: FinishedRun, name: str) -> float:
    _cost(result)  # raises NoValueError if the cost of transport has no value; then its parts have no value either
    return result.energy.uses[name] / carried(result)


for _term in ("work_contract_positive", "work_contract_p11", "work_friction_p13"):
    _meaning = str(Energy.__dataclass_fields__[_term].metadata["series"].meaning)
    measure(f"{_term}_J", _meaning)(partial(_total, term=_term))


@measure("halved_steps", "number of time steps that were divided into shorter steps")
def _halved(result: FinishedRun) -> float:
    return float(result.halved_steps)


measure("work_external_J", "work of external forces")(partial(_total, term="work_external"))
for _name in USES:
    if _name != "friction":
        measure(f"work_{_name}_J", f"part of the work: {USE_MEANINGS[_name]}")(partial(_use, name=_name))
measure("work_damping_medium_J", "work dissipated by damping in the medium")(partial(_total, term="drag_loss"))


@measure("work_damping_material_J", "part of the damping outside the medium: material, contacts and actuators")
def _material(result: FinishedRun) -> float:
    return result.energy.uses["damping"] - float(result.energy.drag_loss.sum())


for _name in USES:
    measure(f"cost_of_transport_{_name}", f"part of the cost of transport: {USE_MEANINGS[_name]}")(
        partial(_share, name=_name)
    )


@measure("settling_m", "largest motion of a joint while the worm was brought to rest before the run")
def _settling(result: FinishedRun) -> float:
    if result.settling is None:
        raise NoValueError(NOT_SETTLED)
    return result.settling


@measure(
    "distance_with_load_m", "displacement of the common centre of mass of worm and payloads along the initial heading"
)
def _distance_with_load(result: FinishedRun) -> float:
    if not result.worm.load_mass.any():
        raise NoValueError(NO_PAYLOAD)
    return _forward(result, result.com_with_load)


@measure(
    "cost_of_transport_with_load", "net work of the actuators divided by (total weight times distance), with payloads"
)
def _cost_with_load(result: FinishedRun) -> float:
    both, moved = result.worm.mass + float(result.worm.load_mass.sum()), _distance_with_load(result)
    if moved <= NO_WAY * result.worm.length:
        raise NoValueError(f"worm and payloads did not move forward (distance {moved:.4g} m)")
    return _cost(result) * carried(result) / (both * float(np.linalg.norm(result.gravity)) * moved)


def _forward(result: FinishedRun, com: FloatArray) -> float:
    """Return the displacement of a centre of mass from its first to its last row, along the initial heading [m]."""
    made = distance_of(com, result.joints[0], result.world)
    if np.isnan(made):
        raise NoValueError(NO_HEADING)
    return made


def carried(result: FinishedRun) -> float:
    """Return weight times distance [J], the divisor of work in a cost of transport.

    Raises
    ------
    NoValueError
        The worm did not move forward, or has no weight or no heading.
    """
    weight = result.worm.mass * float(np.linalg.norm(result.gravity))
    if distance(result) <= NO_WAY * result.worm.length:
        raise NoValueError(f"the worm did not move forward ({distance(result):.4g} m)")
    if weight == 0.0 or np.isnan(distance(result)):
        raise NoValueError("the worm has no weight, or no heading at the start")
    return weight * distance(result)


def _no_mean(result: FinishedRun) -> str:
    if result.period is None:
        return NO_PERIOD
    return SPARSE if _sparse(result) else SHORT_RUN


def _sparse(result: FinishedRun) -> bool:
    return len(result.time) > 1 and bool(result.time[1] - result.time[0] > 2.0 * (result.period or np.inf))


def _rounding(result: FinishedRun) -> float:
    """Return the bound of rounding errors of the work [J]."""
    stored = float(np.sum(result.worm.k_spring)) * result.worm.l0  # the scale of the springs' energy
    return 1e-12 * float(np.abs(result.energy.work_contract).sum()) + 1e-15 * stored
