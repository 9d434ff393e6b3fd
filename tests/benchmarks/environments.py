"""The named environments of Gymnasium: control periods in a second, and rewards of the policies that ship.

python tests/benchmarks/environments.py [--episodes 10] [--seed 1000]

The seeds are not those of the training. "map alone" is the action 0: the wave of the identified map for the reference.
"""

from __future__ import annotations

import argparse
import time

import gymnasium
import numpy as np
import typer

import scenes.gym_env  # noqa: F401  # registers the environments
from control.learned.policy import POLICY_OF, Policy
from scenes.studies.learn.named import NAMED, NAMESPACE

PERIODS = 300
"""Control periods of a timing."""


def rewards(name: str, policy: Policy | None, episodes: int, seed: int) -> tuple[float, float]:
    """Return the mean reward of a control period, and the root mean square of the last offsets [mm]."""
    env, earned, offsets = gymnasium.make(f"{NAMESPACE}/{name}"), [], []
    for k in range(episodes):
        seen, _ = env.reset(seed=seed + k)
        over = False
        while not over:
            action = np.zeros(2) if policy is None else policy(seen.astype(float))
            seen, reward, terminated, truncated, info = env.step(action.astype(np.float32))
            earned.append(reward)
            over = terminated or truncated
        offsets.append(1e3 * info["offset_m"])
    env.close()
    return float(np.mean(earned)), float(np.sqrt(np.mean(np.square(offsets))))


def speed(name: str, worms: int, threads: int) -> float:
    """Return the control periods of all worms in a second of wall time."""
    envs = gymnasium.make_vec(f"{NAMESPACE}/{name}", num_envs=worms, threads=threads)
    envs.reset(seed=0)
    action = np.zeros((worms, 2), dtype=np.float32)
    envs.step(action)
    began = time.perf_counter()
    for _ in range(PERIODS // worms):
        envs.step(action)
    taken = time.perf_counter() - began
    envs.close()
    return PERIODS // worms * worms / taken


def main() -> None:
    """Print a line for each environment."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--episodes", type=int, default=10)
    parser.add_argument("--seed", type=int, default=1000)
    given = parser.parse_args()
    typer.echo(
        "environment       periods/s   on 16 worms   2 threads   reward by the map (mm off)   paths   its policy"
    )
    for name in NAMED:
        one, many, both = (speed(name, *how) for how in ((1, 1), (16, 1), (16, 2)))
        file = POLICY_OF[f"{NAMESPACE}/{name}"]
        (plain, off), (paths, near), (trained, kept) = (
            rewards(name, each, given.episodes, given.seed) for each in (None, Policy.load(), Policy.load(file))
        )
        typer.echo(f"{name:16} {one:10.0f} {many:13.0f} {both:11.0f}", nl=False)
        typer.echo(f"{plain:20.2f} ({off:.0f}){paths:12.2f} ({near:.0f}){trained:9.2f} ({kept:.0f}) {file.name}")


if __name__ == "__main__":
    main()
