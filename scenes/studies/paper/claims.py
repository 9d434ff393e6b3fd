"""The paper's claims, each tested with runs of the published program."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from control.gaits import ContractionEngine_segmentdriven
from planar import published
from planar.published import Parameters, Run
from scenes.studies.paper.cases import PAPER_PERIODS_S, SEGMENTS, Key, Row


@dataclass(frozen=True)
class Claim:
    """A claim of the paper, its place in the paper, the verdict of the runs, and the numbers behind the verdict."""

    claim: str
    source: str
    verdict: str
    evidence: str


def claims(runs: Mapping[Key, Run], rows: Sequence[Row]) -> list[Claim]:
    """Return all claims of the paper with their verdicts. This makes about ten additional runs of the program."""
    table_2 = [next(r for r in rows if (r.n, r.T_wave_s) == (n, 2.0)) for n in SEGMENTS]
    table_3 = [next(r for r in rows if (r.n, r.T_wave_s) == (6, T)) for T in PAPER_PERIODS_S]
    return [
        *_segment_claims(table_2),
        *_period_claims(table_3),
        *_friction_claims(runs[6, 2.0]),
        _mechanism_claim(runs[6, 2.0]),
        _wave_claim(runs[6, 2.0]),
        _alternating_claim(),
        _loads_claim(runs[6, 2.0]),
        _mass_claim(runs[6, 2.0]),
        Claim(
            claim="an extremely high torsional stiffness destabilises Newton's method",
            source="IV.C",
            verdict="not testable here",
            evidence="the program has its torsional springs switched off; the corrected worm below has them",
        ),
    ]


def by_segments(what: str, values: Sequence[float | None]) -> Claim:
    """Test whether a quantity rises with the number of segments up to 6 and drops at 7.

    `values` has the quantity for each number in `SEGMENTS`, or None if a run has no value.
    """
    return Claim(
        claim=f"{what} rises with the number of segments up to 6 and drops at 7",
        source="IV.A, Fig. 10 and 11",
        verdict=verdict(_rises(values[:-1]) and _rises(values[:-3:-1])),
        evidence="n = " + listed(SEGMENTS, values) + _change_to_the_last(*values[-2:]),
    )


def by_period(what: str, values: Sequence[float | None]) -> Claim:
    """Test whether a shorter wave period increases a quantity.

    `values` has the quantity for each period in `PAPER_PERIODS_S`, or None if a run has no value.
    """
    return Claim(
        claim=f"a shorter wave period means {what}",
        source="IV.B, Fig. 12 and 13",
        verdict=verdict(_rises(values[::-1])),
        evidence="T_wave = " + listed([f"{T:g} s" for T in PAPER_PERIODS_S], values),
    )


def verdict(holds: bool) -> str:
    """Return the verdict as text."""
    return "holds" if holds else "does not hold"


def _rises(values: Sequence[float | None]) -> bool:
    """Return whether each value is larger than the previous value; False if a value is missing."""
    return bool((np.diff(np.array(values, dtype=float)) > 0.0).all())


def _change_to_the_last(before: float | None, last: float | None) -> str:
    if before is None or last is None or not (before > 0.0 and np.isfinite(last)):
        return ""
    return f" ({last / before - 1.0:+.0%} from 6 to 7)"


def listed(labels: Sequence[object], values: Sequence[float | None]) -> str:
    """Return pairs of labels and values as text in one line."""
    cells = ("none" if value is None else f"{value:.6g}" for value in values)
    return ", ".join(f"{label}: {cell}" for label, cell in zip(labels, cells, strict=True))


def _segment_claims(rows: Sequence[Row]) -> list[Claim]:
    return [
        by_segments("the reported distance [m]", [r.reported_distance_m for r in rows]),
        by_segments("the true displacement [m]", [r.true_displacement_m for r in rows]),
        by_segments("the cumulative cost of transport [J/m] that is plotted", [r.cumulative_cot_J_per_m for r in rows]),
        by_segments("the work per distance [J/m]", [r.total_cot_J_per_m for r in rows]),
    ]


def _period_claims(rows: Sequence[Row]) -> list[Claim]:
    return [
        by_period("more work in a given time [J]", [r.work_J for r in rows]),
        by_period("a higher cumulative cost of transport [J/m], as plotted", [r.cumulative_cot_J_per_m for r in rows]),
        by_period("more work per distance [J/m]", [r.total_cot_J_per_m for r in rows]),
    ]


def _friction_claims(run: Run) -> list[Claim]:
    without = published.simulate(parameters=Parameters(mu_forward=0.0, mu_backward=0.0)).true_displacement
    equal = (0.03, 0.10, 0.20)
    moved = [published.simulate(parameters=Parameters(mu_forward=mu, mu_backward=mu)) for mu in equal]
    displacements = [other.true_displacement for other in moved]
    anchors = max(map(abs, displacements)) > 0.5 * run.true_displacement
    return [
        Claim(
            claim="friction propels the worm, not momentum transfer inside the body (called a contentious topic)",
            source="II.A",
            verdict=verdict(abs(without) < 1e-3 * run.true_displacement),
            evidence=f"true displacement without friction {without:.2g} m, with it {run.true_displacement:.4f} m",
        ),
        Claim(
            claim="friction does so by a stationary anchor for the segments in front",
            source="II.A",
            verdict=verdict(anchors),
            evidence="no load anchors here, since the normal loads are constant: with equal coefficients both ways, "
            f"{listed(equal, displacements)} m; it is the ratio of the coefficients that drives this worm",
        ),
    ]


def _shape(run: Run, chosen: NDArray[np.bool_]) -> tuple[float, float]:
    """Return the mean length and height of segments [m], over the steps and segments that `chosen`, (S, n), selects."""
    length = np.diff(run.q[1:, run.net.main, 0], axis=1)
    height = run.q[1:, run.net.top, 1] - run.q[1:, run.net.bottom, 1]
    return float(length[chosen].mean()), float(height[chosen].mean())


def _widens(run: Run) -> tuple[bool, str]:
    """Return whether active segments are shorter and higher than passive segments, and their sizes as text."""
    active, passive = _shape(run, run.activation > 0.99), _shape(run, run.activation == 0.0)
    sizes = f"active {active[0]:.4f} m long, {active[1]:.4f} m high, passive {passive[0]:.4f} m and {passive[1]:.4f} m"
    return active[0] < passive[0] and active[1] > passive[1], sizes


def _mechanism_claim(run: Run) -> Claim:
    widens, sizes = _widens(run)
    gentle = Parameters(contraction_force=1.0, elastic_sign=-run.parameters.elastic_sign)
    other_widens, other_sizes = _widens(published.simulate(parameters=gentle))
    only_by_sign = widens and not other_widens
    return Claim(
        claim="an active segment expands vertically and shortens horizontally",
        source="II.E",
        verdict="holds only by the inverted sign" if only_by_sign else verdict(widens),
        evidence=f"{sizes}; with the sign of the elastic force changed, and 1 N, which leaves the rhombi the right way "
        f"out: {other_sizes}; the forces press the connectors together",
    )


def _wave_claim(run: Run) -> Claim:
    period = round(2.0 / run.dt)
    peaks = run.activation[:period].argmax(axis=0)
    later = int((peaks[1] - peaks[0]) % period)
    from_zero = later < period / 2
    x = (np.arange(run.n) + 0.5) / run.n
    reversed_wave = published.simulate(activation=lambda t: np.maximum(0.0, np.sin(2 * np.pi * (x + t / 2.0))))
    head_is_zero = run.true_displacement < 0.0
    return Claim(
        claim="the wave travels from the head (x = 0) to the tail (x = 1)",
        source="III.C",
        verdict=verdict(from_zero == head_is_zero),
        evidence=f"segment 1 peaks {later * run.dt:.2f} s after segment 0: the wave runs "
        f"{'away from' if from_zero else 'towards'} index 0; the worm moves by {run.true_displacement:+.4f} m, so "
        f"index 0 is its {'head' if head_is_zero else 'tail'}; with the wave reversed it moves by "
        f"{reversed_wave.true_displacement:+.4f} m: the friction, not the wave, decides the direction",
    )


def _alternating_claim() -> Claim:
    def displacement(alternating: bool) -> float:
        engine = ContractionEngine_segmentdriven(contractType="square", T_contract=1 / 3, alternating=alternating)
        return published.simulate(activation=lambda t: engine.activation(t, 6)).true_displacement

    with_signs, without = displacement(True), displacement(False)
    return Claim(
        claim="alternating signs along the body produce the net directional force",
        source="III.C",
        verdict=verdict(abs(without) < 0.5 * abs(with_signs)),
        evidence=f"segment-driven square pulses of 1/3 s: true displacement {with_signs:.4f} m with alternating signs, "
        f"{without:.4f} m without",
    )


def _loads_claim(run: Run) -> Claim:
    ratio = np.abs(run.friction_force[:, run.net.main, 0]) / (run.net.mass[run.net.main] * run.parameters.gravity)
    used = np.unique(np.round(ratio, 6))
    constant = set(used) <= {0.0, run.parameters.mu_forward, run.parameters.mu_backward}
    return Claim(
        claim="the predictor is crucial for the normal loads of the friction",
        source="III.B",
        verdict=verdict(not constant),
        evidence=f"the friction is {', '.join(f'{value:g}' for value in used)} times m g throughout: "
        "the loads are constant, nothing of the predictor enters them",
    )


def _mass_claim(run: Run) -> Claim:
    on_nodes = published.simulate(parameters=Parameters(connector_mass=run.parameters.mass * 1e-12))
    collapsed = on_nodes.status.diverged or on_nodes.inverted_steps > 0
    return Claim(
        claim="concentrating the mass at the nodes leads to unstable, collapsed states",
        source="IV.C",
        verdict="holds" if collapsed else "does not hold for the inverted sign",
        evidence=f"with all but 1e-12 of the mass on the main nodes: {on_nodes.stop.sentence}, "
        f"{on_nodes.unconverged_steps} steps unconverged, segments inside out in {on_nodes.inverted_steps} steps, true "
        f"displacement {on_nodes.true_displacement:.4f} m (the published runs have 99.9 % of the mass there)",
    )
