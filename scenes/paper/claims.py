"""The paper's claims, each judged by the runs of the published program."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise

import numpy as np

from planar import published
from planar.published import Parameters, Run
from scenes.paper.tables import PERIODS, SEGMENTS, Key, Row


@dataclass(frozen=True)
class Claim:
    """What the paper says, whether the published program bears it out, and the numbers."""

    claim: str
    source: str
    verdict: str
    evidence: str

    def as_dict(self) -> dict[str, str]:
        """Return the claim with its field names as keys."""
        return asdict(self)


def claims(runs: Mapping[Key, Run], rows: Sequence[Row]) -> list[Claim]:
    """Return every claim of the paper with its verdict; makes two further runs of the program."""
    table_2 = [next(r for r in rows if (r.n, r.T_wave_s) == (n, 2.0)) for n in SEGMENTS]
    table_3 = [next(r for r in rows if (r.n, r.T_wave_s) == (6, T)) for T in PERIODS]
    return [
        *_segment_claims(table_2),
        *_period_claims(table_3),
        _friction_claim(),
        _mechanism_claim(runs[6, 2.0]),
        _wave_claim(runs[6, 2.0]),
        _mass_claim(runs[6, 2.0]),
    ]


def by_segments(what: str, values: Sequence[float | None]) -> Claim:
    """Judge that something rises with the number of segments up to 6 and drops at 7; None for no value."""
    return Claim(
        claim=f"{what} rises with the number of segments up to 6 and drops at 7",
        source="IV.A, Fig. 10 and 11",
        verdict=verdict(_rises_then_drops(_numbers(values))),
        evidence="n = " + listed(SEGMENTS, values),
    )


def by_period(what: str, values: Sequence[float | None]) -> Claim:
    """Judge that a shorter wave period means more of something; None for no value."""
    return Claim(
        claim=f"a shorter wave period means {what}",
        source="IV.B, Fig. 12 and 13",
        verdict=verdict(_rises(_numbers(values)[::-1])),
        evidence="T_wave = " + listed([f"{T:g} s" for T in PERIODS], values),
    )


def verdict(holds: bool) -> str:
    """Return the verdict in words."""
    return "holds" if holds else "does not hold"


def _rises_then_drops(values: Sequence[float]) -> bool:
    """Whether the values rise up to the last but one and the last is below that."""
    return all(a < b for a, b in pairwise(values[:-1])) and values[-1] < values[-2]


def _rises(values: Sequence[float]) -> bool:
    return all(a < b for a, b in pairwise(values))


def _numbers(values: Sequence[float | None]) -> list[float]:
    """Return the values, NaN for none: it neither rises nor drops."""
    return [float("nan") if value is None else value for value in values]


def listed(labels: Sequence[object], values: Sequence[float | None]) -> str:
    """Return labels and values in one line."""
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


def _friction_claim() -> Claim:
    isotropic = published.simulate(parameters=Parameters(mu_forward=0.2, mu_backward=0.2)).true_displacement
    directional = published.simulate().true_displacement
    return Claim(
        claim="friction propels the worm by anchoring it (rather than momentum transfer inside the body)",
        source="II.A",
        verdict=verdict(abs(isotropic) < 0.05 * directional),
        evidence=f"true displacement {directional:.4f} m with friction 0.03 forward and 0.20 backward, "
        f"{isotropic:.4f} m with 0.20 both ways: in this program the direction of the friction drives it; "
        "no load anchors, since the normal loads are constant",
    )


def _mechanism_claim(run: Run) -> Claim:
    net, active, passive = run.net, run.activation > 0.99, run.activation == 0.0
    length = np.diff(run.q[1:, net.main, 0], axis=1)
    height = run.q[1:, net.top, 1] - run.q[1:, net.bottom, 1]
    pressed = bool((run.contraction_force[:, net.top, 1] <= 0.0).all())
    wider, shorter = (
        height[active].mean() > height[passive].mean(),
        length[active].mean() < length[passive].mean(),
    )
    return Claim(
        claim="an active segment expands vertically and shortens horizontally",
        source="II.E",
        verdict="holds only by the inverted sign" if pressed and wider and shorter else verdict(wider and shorter),
        evidence=f"at full activation {length[active].mean():.4f} m long and {height[active].mean():.4f} m high, "
        f"passive {length[passive].mean():.4f} m and {height[passive].mean():.4f} m; the forces press the connectors "
        "together and would do the opposite with the right sign of the elastic force",
    )


def _wave_claim(run: Run) -> Claim:
    forward = run.true_displacement > 0.0
    return Claim(
        claim="the wave travels from the head (x = 0) to the tail (x = 1)",
        source="III.C",
        verdict="does not hold" if forward else "holds",
        evidence=f"the worm moves by {run.true_displacement:+.4f} m, away from index 0, which so is its tail: "
        "the wave runs tail to head (direct)",
    )


def _mass_claim(run: Run) -> Claim:
    mass = run.parameters.mass
    on_nodes = published.simulate(parameters=Parameters(connector_mass=mass * 1e-12))
    stands = not on_nodes.status.diverged and on_nodes.unconverged_steps == 0
    return Claim(
        claim="concentrating the mass at the nodes leads to unstable, collapsed states",
        source="IV.C",
        verdict="does not hold for the published runs" if stands else "holds",
        evidence=f"with all but 1e-12 of the mass on the main nodes: {on_nodes.stop.sentence}, "
        f"{on_nodes.unconverged_steps} steps unconverged, true displacement {on_nodes.true_displacement:.4f} m "
        "(the published runs have 99.9 % there)",
    )
