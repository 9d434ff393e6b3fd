"""Random worms of a fixed generator: how each of them ends. A study; `test_random_worms.py` runs part of it.

    python tests/worm3d/random_worms.py [--seed 4] [--count 200] [--only INDEX] [--kind NAME]

Worm `index` of a seed is always the same: `case(seed, index)`. Kinds: "default" has the mass and height of the default
worm and one stiffness for all segments; "uneven" draws mass and height too, and a value for every segment or joint.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from dataclasses import dataclass
from time import perf_counter

import numpy as np

import worm3d
from control.gaits import TravellingWave

REFUSALS = ("LIMIT_POINT", "FLATTENED", "FOLDED", "SUNK", "UNSETTLED")
"""Ends that guards name: the worm is not one that the model stands for."""


@dataclass(frozen=True)
class Case:
    """A random worm and what it does."""

    worm: worm3d.Worm
    ground: worm3d.Friction
    gait: TravellingWave
    dt: float
    integrator: str

    @property
    def sentence(self) -> str:
        """One line with all that was drawn."""
        w, f, g = self.worm, self.ground, self.gait
        stiff = {name: _range(getattr(w, name)) for name in ("k_spring", "k_torsion", "k_yaw", "k_twist")}
        return (
            f"N={w.segments} m={w.mass:.4g} h={_range(w.half_height)} {stiff} friction={f.forward:.4g}/"
            f"{f.backward:.4g}/{f.lateral:.4g} ratio={f.static_ratio} A={g.amplitude:.4g} T={g.period:.4g} "
            f"{g.direction} rectified={g.rectified} bias={g.bias:.4g} hinge={g.hinge:.4g} dt={self.dt:.4g} "
            f"{self.integrator}"
        )


@dataclass(frozen=True)
class Outcome:
    """How a case ended."""

    end: str
    finite: bool = True
    halved: int = 0
    penetration: float = 0.0
    """Greatest, as a fraction of the segment length."""
    worst_iterations: int = 0
    mean_iterations: float = 0.0
    balance_error: float = 0.0
    wall_s: float = 0.0
    sentence: str = ""
    deepest_penetration_of_joints: float = 0.0

    @property
    def refused(self) -> bool:
        """Whether a guard ended it."""
        return self.end in REFUSALS

    @property
    def good(self) -> bool:
        """Whether it finished, every step converged, with little penetration."""
        return self.end == "DONE" and self.finite and self.penetration < 1e-3


def case(seed: int, index: int, kind: str = "default") -> Case:
    """Return worm number `index` of a seed."""
    rng = np.random.default_rng([seed, index])
    n = int(rng.integers(2, 31))
    uneven = kind == "uneven"

    def decades(low: float, high: float, size: int) -> np.ndarray | float:
        return 10.0 ** rng.uniform(low, high, size if uneven else None)

    worm = worm3d.Worm(
        segments=n,
        mass=10.0 ** rng.uniform(-2.0, -0.5) if uneven else 0.1,
        half_height=rng.uniform(0.3, 1.2) / n if uneven else 0.05,
        k_spring=decades(0.0, 4.0, n),
        k_torsion=decades(-3.0, 4.0, n - 1),
        k_yaw=decades(-3.0, 4.0, n - 1),
        k_twist=decades(-3.0, 4.0, n - 1),
    )
    gait = TravellingWave(
        amplitude=float(rng.uniform(0.0, worm.stroke[1])),
        period=float(rng.uniform(0.5, 4.0)),
        direction=str(rng.choice(["direct", "retrograde"])),
        rectified=bool(rng.random() < 0.75),
        bias=float(rng.uniform(-1.0, 1.0) * (rng.random() < 0.7)),
        hinge=float(rng.uniform(-1.0, 1.0) * (rng.random() < 0.5)),
    )
    forward, backward, lateral = rng.uniform(0.0, 1.5, 3)
    return Case(
        worm=worm,
        ground=worm3d.Friction(forward, backward, lateral, static_ratio=float(rng.choice([1.0, 1.2]))),
        gait=gait,
        dt=float(10.0 ** rng.uniform(-3.0, np.log10(0.05))),
        integrator=str(rng.choice(["bdf2", "bdf2", "bdf2", "implicit_euler"])),
    )


def simulate(it: Case, duration: float = 2.0) -> worm3d.Result:
    """Return the run of a case."""
    return worm3d.simulate(
        it.worm, worm3d.Plane(), it.ground, actuation=it.gait, duration=duration, dt=it.dt, integrator=it.integrator
    )


def outcome(it: Case, duration: float = 2.0) -> Outcome:
    """Run a case and say how it ended."""
    began = perf_counter()
    try:
        run = simulate(it, duration)
    except worm3d.LimitPointError:
        return Outcome("LIMIT_POINT")
    arrays = [run.joints, run.normal_load, run.slip, run.momentum, run.bend, run.energy.residual]
    heights = run.world.distance(run.points)
    steps = len(run.newton_iterations)
    return Outcome(
        end=run.status.name,
        finite=all(bool(np.isfinite(array).all()) for array in arrays),
        halved=run.halved_steps,
        penetration=float(max(0.0, -heights.min())) / it.worm.l0,
        worst_iterations=int(run.newton_iterations.max()) if steps else 0,
        mean_iterations=float(run.newton_iterations.mean()) if steps else 0.0,
        balance_error=run.energy.balance_error,
        wall_s=perf_counter() - began,
        sentence=run.stop.sentence,
        deepest_penetration_of_joints=float(max(0.0, -heights[:, :, 6:].min())) / it.worm.l0,
    )


def _range(values: object) -> str:
    array = np.unique(np.asarray(values))
    return f"{array[0]:.4g}" if len(array) == 1 else f"{array[0]:.3g}..{array[-1]:.3g}"


def main() -> None:
    """Run the study and print its table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=4)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--only", type=int)
    parser.add_argument("--kind", choices=["default", "uneven"], default="default")
    given = parser.parse_args()
    indices = range(given.count) if given.only is None else [given.only]
    ends: Counter[str] = Counter()
    admitted = good = 0
    for index in indices:
        it = case(given.seed, index, given.kind)
        one = outcome(it)
        ends[one.end] += 1
        admitted += not one.refused
        good += one.good
        if not one.good or one.halved or one.balance_error > 1e-9 or one.wall_s > 10.0 or given.only is not None:
            sys.stdout.write(f"{given.kind} {given.seed}/{index}: {one}\n    {it.sentence}\n")
            sys.stdout.flush()
    refused = len(indices) - admitted
    sys.stdout.write(f"{dict(ends)}: {refused} refused by guards, {good} of {admitted} admitted are good\n")


if __name__ == "__main__":
    main()
