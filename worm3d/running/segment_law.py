"""Force and energies of a single segment whose ends follow a given motion, without masses, weight and contact.

The force is computed step by step with implicit Euler, from the same compiled kernels as in a simulation (springs,
dampers, apex hinges, the friction in the joints). A test of a segment in a load frame can therefore be compared with
the segments of a simulated worm.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from worm3d.physics.actuators import FirstOrder
from worm3d.physics.hysteresis import HYSTERESIS_PREFIX
from worm3d.physics.kernels import actuator, segment
from worm3d.physics.segment_laws.law import columns_of
from worm3d.physics.worm import Worm
from worm3d.running.plant import DOMAIN_ROUNDING, kernels
from worm3d.solver.segment_way import KERNELS, follow
from worm3d.values import arguments
from worm3d.values.arrays import FloatArray
from worm3d.values.read_only import ReadOnly


@dataclass(frozen=True, eq=False)
class Stretch(ReadOnly):
    """Response of a segment to a motion, at T instants.

    Energies belong to the step that ends at the instant, and are 0 at the first instant.
    """

    length: FloatArray
    """Length of the segment, shape (T,) [m]."""
    force: FloatArray
    """Force on the ends, positive if it would lengthen the segment, shape (T,) [N]."""
    elastic: FloatArray
    """Change of the elastic energy, including the energy that friction in the joints stores, shape (T,) [J]."""
    viscous_loss: FloatArray
    """Loss to damping, shape (T,) [J]."""
    hysteresis_loss: FloatArray
    """Loss to friction in the joints, shape (T,) [J]."""


def stretch_segment(worm: Worm, length: ArrayLike, time: ArrayLike) -> Stretch:
    """Move the ends of a worm's first segment along a line, and return the force and energies.

    Both chambers have the same length, and the contraction without an input. Before the motion, the segment has been
    at rest at the first length, without stress from friction in its joints.

    Parameters
    ----------
    worm : Worm
        The actuator must be `FirstOrder`, which has no effect here.
    length : array_like, shape (T,)
        Distance of the joints at each instant, for which the segment law has a shape at the contraction without an
        input [m]. With a rhombus the distance is above 0 and below twice the length of the links.
    time : array_like, shape (T,)
        Increasing times [s].

    Raises
    ------
    ValueError
        An array has the wrong shape, fewer than two instants, or numbers out of range, or the actuator is not
        `FirstOrder`.
    """
    lengths, times = arguments.floats("length", length), arguments.floats("time", time)
    if lengths.ndim != 1 or len(lengths) < 2 or lengths.shape != times.shape:
        raise ValueError(f"length: got shape {lengths.shape}, must be (T,) as time, {times.shape}, with T at least 2")
    law, free = worm.segment, worm.segment.passive_contraction
    low, high = (float(each[0, 0]) for each in law.possible(worm, np.full((worm.segments, 1), free)))
    room = 0.0 if worm.segment.has_links else DOMAIN_ROUNDING * worm.l0
    if not ((lengths > max(low - room, 0.0)) & (lengths < high + room)).all():
        raise ValueError(
            f"length: got {lengths.min():.6g} to {lengths.max():.6g} m, must be above {low:.6g} and below "
            f"{high:.6g} m, {law.bounded_by} at the contraction without an input, {free:.4g}; stay within these "
            "lengths, or use a law with more states there"
        )
    if not ((np.diff(times) > 0.0).all() and np.isfinite(times).all()):
        raise ValueError("time: must be finite and ascend")
    if type(worm.actuator) is not FirstOrder:
        raise ValueError(f"actuator: got {type(worm.actuator).__name__}, must be FirstOrder")
    return _along(worm, lengths, times)


def _along(worm: Worm, lengths: FloatArray, times: FloatArray) -> Stretch:
    """Return the response of the segment along a motion, from rest."""
    friction = worm.hysteresis
    law, layout = type(worm.segment), actuator.chambers(FirstOrder, type(friction), type(worm.segment))
    made = kernels(own=type(friction), segment_law=law)
    rows = made["segment_gradient"].allocate(1)[0]
    known: dict[str, Any] = {segment.ACTUATOR_PREFIX + actuator.HASTE: 1.0}
    known |= {
        segment.ACTUATOR_PREFIX + HYSTERESIS_PREFIX + name: value for name, value in friction.parameters().items()
    }
    passive = worm.l0 * (1.0 - worm.segment.passive_contraction)
    for name, value in {**known, "commanded": passive, "commanded_n": passive}.items():
        layout.of(name, rows)[:, 0] = np.ravel(value)[0]
    for name, column in columns_of(worm.segment, worm).items():
        layout.of(segment.kernel_name(law, name), rows)[:, 0] = column[:, 0]
    layout.of("t_ref", rows)[0], layout.of("d_ref", rows)[1] = 1.0, 1.0
    steps, found = np.diff(times, prepend=2.0 * times[0] - times[1]), np.zeros((4, len(lengths)))
    slope, terms = (made[name].allocate(1)[1] for name in ("segment_gradient", "segment_ledger"))
    end = made["actuator_end"].allocate(1)[1] if friction.states else np.zeros((0, 1))
    addresses = np.array([made[name].address if name in made else 0 for name in KERNELS])
    states = actuator.CHAMBER_COMMANDS[-1] + actuator.ACTUATORS_PER_SEGMENT + segment.law_rows(law)
    places = made["segment_ledger"].rows_in, states, len(friction.states)
    follow(addresses, rows, slope, terms, end, places, law.has_links, lengths, steps, found)
    return Stretch(lengths, *found)
