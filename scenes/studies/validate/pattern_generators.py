"""Comparisons of pattern generators with published numbers.

The generators are the neural network of the fly larva, and stable heteroclinic cycles (SHC). In an SHC, the nodes (the
saddles of the dynamics) are active one after the other, and noise decides how long each node stays active.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from control.gaits.larva_ei.network import crawling
from control.gaits.shc.cycle import Cycle, Walk, sojourns
from scenes.studies.validate.rows import Row

PEHLEVAN = "Pehlevan, Paoletti, Mahadevan, eLife 5 (2016) e11031, table 1, computed anew from its equations"
HORCHLER = "Horchler, Daltorio, Chiel, Quinn, Bioinspir. Biomim. 10 (2015) 026001; passage time of Stone and Holmes"
KIND = "pattern generator"
CYCLES = ((3, 2.0, 1.5, 1e-8), (6, 2.0, 1.5, 1e-8), (3, 2.0, 3.0, 1e-8), (4, 1.0, 6.0, 1e-12))
"""Number of nodes, alpha, nu and noise of the compared cycles."""
NOISE_LEVELS = np.geomspace(1e-8, 1e-4, 5)


def rows(quick: bool) -> Iterator[Row]:
    """Run all generators and yield their rows, also with `quick`; see `scenes.studies.validate.rows.Chapter`."""
    yield from larva()
    yield from cycles()


def larva() -> Iterator[Row]:
    """Yield the rows of the larva's network, which moves the published mechanical model of a larva."""
    found = crawling(200.0)
    figures = (
        ("waves", 1.0 / found.period, 0.0378, "1/tau_E"),
        ("speed", found.speed, 0.0368, "L/tau_E"),
        ("largest contraction", found.peak_contraction, 0.298, "1"),
        ("segments that are lifted, median", found.lifted, 3.0, "1"),
    )
    note = "ten segments with the mechanics of the source; the source's text gives about 0.04, 0.04, 30 % and 3"
    command = "control.gaits.larva_ei.network.crawling()"
    for name, model, published, unit in figures:
        yield Row(
            f"Larva's network: {name}", model, published, 0.02, PEHLEVAN, note, unit=unit, scene=command, kind=KIND
        )


def cycles() -> Iterator[Row]:
    """Yield the rows of the cycles: the mean time from saddle to saddle, and its change with the noise."""
    for nodes, alpha, nu, noise in CYCLES:
        cycle = Cycle(nodes, alpha=alpha, nu=nu, noise=noise)
        found, what = sample(cycle), f"alpha = {alpha:g}, nu = {nu:g}, noise {noise:g}, N = {nodes}"
        yield Row(
            f"SHC: sub-period, {what}",
            found,
            cycle.formula_period / nodes,
            0.03,
            HORCHLER,
            "published: the sum of the passage time and the least transition time; the limit of small noise, derived "
            f"here, is {cycle.mean_period / nodes:.4g} s",
            unit="s",
            scene=f"control.gaits.shc.cycle.Cycle({nodes}, ...)",
            kind=KIND,
        )
    times = [sample(Cycle(3, noise=each), seed) for seed, each in enumerate(NOISE_LEVELS)]
    slope = float(np.polyfit(-np.log(NOISE_LEVELS), times, 1)[0])
    what = "SHC: sub-period over -ln(noise), alpha = 2, nu = 1.5, noise 1e-8 to 1e-4"
    scene = "control.gaits.shc.cycle.Cycle(3, ...)"
    yield Row(what, slope, 0.75, 0.02, HORCHLER, "nu/alpha", unit="s", scene=scene, kind=KIND)


def sample(cycle: Cycle, seed: int = 1) -> float:
    """Return the mean time from saddle to saddle in 3000 random passages [s]. Its standard error is 0.1 to 0.2 %."""
    return float(sojourns(Walk(cycle, seed), 3000).mean())
