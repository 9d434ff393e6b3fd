"""`worm3d optimise` for drawn worms and grounds: is any optimised gait worse than the best simple gait?

`python tests/benchmarks/optimised_draws.py [--draws 3] [--budget 600]` prints a table. The values of the
goal "speed" are those of runs of six waves. An accurate run confirms the value of the optimised gait.
"""

from __future__ import annotations

import argparse

import numpy as np
import typer

import worm3d
from scenes.records.text import markdown_table


def draw(seed: int) -> list[str]:
    """Return the changes of the scene `flat` for a worm and a ground."""
    random = np.random.default_rng([46, seed])
    forward, ratio = random.uniform(0.02, 0.1), random.uniform(2.0, 8.0)
    return [
        f"worm.segments={random.integers(4, 9)}",
        f"worm.mass_kg={random.uniform(0.05, 0.11):.3f}",
        f"worm.spring_N={random.uniform(10.0, 30.0):.1f}",
        f"friction.forward={forward:.3f}",
        f"friction.backward={ratio * forward:.3f}",
        f"friction.lateral={ratio * forward:.3f}",
        f"world.slope_deg={random.uniform(0.0, 5.0):.1f}",
        f"gait.amplitude={random.uniform(0.15, 0.3):.2f}",
    ]


def row(seed: int, budget: int) -> tuple[str, ...]:
    """Return the row of a draw in the table."""
    changes = draw(seed)
    card = worm3d.optimise("flat", "speed", changes, budget=budget, seed=seed, searches=1)
    first = card.measure()[0]
    gain = f"{first.value / first.simple:.2f}" if first.simple > 0.0 else "-"
    told = card.confirmation(first).partition(":")[0].strip("*")
    keys = ", ".join(each.partition(".")[2] for each in changes)
    return keys, f"{first.simple:.4g}", f"{first.value:.4g}", gain, told


def main() -> None:
    """Print the table."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--draws", type=int, default=3)
    options.add_argument("--budget", type=int, default=600)
    given = options.parse_args()
    header = ("draw", "best simple gait [BL/wave]", "optimised [BL/wave]", "gain", "accurate run")
    typer.echo("\n".join(markdown_table(header, [row(seed, given.budget) for seed in range(given.draws)])))


if __name__ == "__main__":
    main()
