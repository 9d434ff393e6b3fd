"""Random planar worms, run by `planar.linkage` and by `worm3d`: do two programs, written independently, agree?

    python tests/worm3d/planar_worms.py [--seed 1] [--count 200] [--steps 300] [--only INDEX]

A study; `test_planar_worms.py` runs it with fewer steps. Worm `index` of a seed is always the same. A third of them is
uneven along the body, a quarter has a coefficient of 0 or close to it, three quarters have a static ratio above 1.
Both take implicit Euler, which is all that `planar.linkage` has.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

import worm3d
from planar import linkage
from planar.linkage.ground import Ground
from planar.linkage.newton import loads
from planar.linkage.shape import apexes
from planar.linkage.step import ContactStepper

GRAVITY = 9.81
AGREE = 1e-9
"""[m]"""


@dataclass(frozen=True)
class Case:
    """A random worm, its ground and what it does."""

    worm: dict[str, Any]
    friction: tuple[Any, Any, float]
    gait: Callable[[float], np.ndarray]
    slope: float
    dt: float
    sentence: str


@dataclass(frozen=True)
class Outcome:
    """How far both programs agree.

    Attributes
    ----------
    refused : bool
        The worm's weight would flatten it: neither begins.
    agree : bool
        Joints within `AGREE` after each step, as many steps, and the same end (where no shape solves a step it is
        either program's word what the worm was about to do).
    step : int
        First one in which they do not.
    solved : tuple of bool
        Whether the solution of `planar.linkage` and that of `worm3d` solve that step, undivided.
    """

    refused: bool
    agree: bool = True
    step: int = 0
    solved: tuple[bool, bool] = (True, True)
    sentence: str = ""


def case(seed: int, index: int) -> Case:
    """Return worm number `index` of a seed."""
    rng = np.random.default_rng([seed, index])
    n, uneven = int(rng.integers(2, 13)), bool(rng.random() < 0.3)

    def decades(low: float, high: float, size: int) -> Any:
        return 10.0 ** rng.uniform(low, high, size if uneven else None)

    worm = {
        "segments": n,
        "half_height": float(rng.uniform(0.15, 0.45)) / n,
        "mass": float(10.0 ** rng.uniform(-2.0, -0.7)),
        "k_spring": decades(1.0, 3.0, n),
        "k_torsion": decades(-2.0, 2.0, n - 1),
        "k_apex": float(rng.choice([0.0, 0.02])),
        "apex_mass_fraction": float(rng.choice([0.3, 0.5, 1.0])),
        "kelvin_voigt_time": float(rng.choice([0.0, 0.05])),
        "drag": float(rng.choice([0.0, 0.1])),
    }
    mu = [10.0 ** rng.uniform(-2.0, 0.2) * (rng.uniform(0.5, 1.5, n) if uneven else 1.0) for _ in range(2)]
    for side in range(2):
        if rng.random() < 0.15:
            mu[side] = float(rng.choice([0.0, 0.0, 1e-9, 1e-3]))
    if rng.random() < 0.15:
        mu[1] = mu[0]
    ratio = float(rng.choice([1.0, *rng.uniform(1.0, 2.0, 3)]))
    rectified = bool(rng.random() < 0.7)
    amplitude, period = float(rng.uniform(0.0, 0.3 if rectified else 0.1)), float(rng.uniform(0.5, 4.0))
    way, waves = float(rng.choice([-1.0, 1.0])), float(rng.choice([0.0, 1.0, 1.0, 2.0]))
    phase, slope = float(rng.choice([0.0, rng.uniform()])), float(rng.choice([0.0, rng.uniform(-0.3, 0.3)]))
    dt, x = float(rng.choice([0.002, 0.005, 0.01, 0.02, 0.05])), (np.arange(n) + 0.5) / n

    def gait(t: float) -> np.ndarray:
        wave = np.sin(2.0 * np.pi * (waves * x + way * t / period + phase))
        return amplitude * (np.maximum(0.0, wave) if rectified else wave)

    sentence = (
        f"N={n} mu={np.max(mu[0]):.4g}/{np.max(mu[1]):.4g} uneven={uneven} ratio={ratio:.4g} A={amplitude:.3g} "
        f"T={period:.3g} way={way:g} waves={waves:g} rectified={rectified} slope={slope:.3g} dt={dt:g}"
    )
    return Case(worm, (mu[0], mu[1], ratio), gait, slope, dt, sentence)


def outcome(it: Case, steps: int) -> Outcome:
    """Run a case by both programs."""
    duration, plane = steps * it.dt, worm3d.Plane(slope=it.slope)
    try:
        oracle = linkage.simulate(
            linkage.Linkage(**it.worm),
            it.gait,
            duration=duration,
            dt=it.dt,
            friction=linkage.Friction(*it.friction),
            slope=it.slope,
        )
    except linkage.LimitPointError:
        return Outcome(refused=True)
    result = worm3d.simulate(
        worm3d.Worm.planar(**it.worm),
        plane,
        worm3d.Friction(*it.friction[:2], lateral=0.7, static_ratio=it.friction[2]),
        actuation=lambda t: worm3d.Command(np.column_stack([it.gait(t), it.gait(t)])),
        duration=duration,
        dt=it.dt,
        integrator="implicit_euler",
    )
    joints = (result.joints @ plane.axes.T)[..., [0, 2]]
    both = min(len(joints), len(oracle.joints))
    away = np.abs(joints[:both] - oracle.joints[:both]).max(axis=(1, 2))
    ends = {oracle.status.name, result.status.name}
    same_end = len(ends) == 1 or (len(joints) == len(oracle.joints) and "NO_CONVERGENCE" in ends)
    if (away <= AGREE).all() and same_end:
        return Outcome(refused=False)
    step = int(np.argmax(away > AGREE)) if (away > AGREE).any() else both
    solved = (step < len(oracle.joints), step < len(joints))
    if all(solved):
        found = (oracle.joints[step], oracle.slip[step - 1]), (joints[step], result.slip[step, :, :2])
        solved = solves(it, oracle, step, *found[0]), solves(it, oracle, step, *found[1])
    parts = len(oracle.steps[step - 1]) if step <= len(oracle.steps) else 0
    ends_as = f"{oracle.status.name} in {parts} parts/{result.status.name}, {result.halved_steps} steps halved"
    return Outcome(False, False, step, solved, f"{it.sentence}; {ends_as}")


def solves(it: Case, oracle: linkage.Run, step: int, q: np.ndarray, slipped: np.ndarray) -> bool:
    """Return whether joints (N+1, 2) solve a step from the state of `planar.linkage` before it, undivided.

    Forces balance, with friction by the law (G2), which keeps it inside its set: kinetic for what was stuck and has
    `slipped` (N, 2), else static. No load pulls, friction is against the motion where an anchor moves, and no anchor of
    what sticks does.
    """
    worm = linkage.Linkage(**it.worm)
    ground = Ground.of(worm, linkage.Friction(*it.friction), GRAVITY)
    weight = GRAVITY * np.array([-np.sin(it.slope), -np.cos(it.slope)])
    stepper = ContactStepper(worm, weight, ground, np.zeros((worm.segments + 1, 2), dtype=bool))
    start = oracle.steps[step - 1][0].start
    command, force = worm.l0 * (1.0 - it.gait(step * it.dt)), np.zeros((worm.segments + 1, 2))
    static = start.stuck & (slipped == 0.0)
    now = stepper._now(start, command, force, np.where(static, it.friction[2], 1.0), it.dt)
    load = loads(q.ravel(), stepper.body, stepper.ground, now)
    slip, _ = stepper._return_map(q.ravel(), now, load)
    moved = now.direction[:, None] * (apexes(q, worm.link_length)[..., 0] - now.anchor)  # friction is against it
    balanced = np.abs(stepper.newton.residual(q.ravel(), now)).max() < 1e-5 * worm.total_mass * GRAVITY
    rests = (slip[static] == 0.0).all()
    against = (slip * moved >= 0.0).all()
    return bool(balanced and rests and against and (load >= 0.0).all())


def main() -> None:
    """Run the study and print what does not agree."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--steps", type=int, default=300)
    parser.add_argument("--only", type=int)
    given = parser.parse_args()
    indices = range(given.count) if given.only is None else [given.only]
    refused = agree = 0
    for index in indices:
        one = outcome(case(given.seed, index), given.steps)
        refused, agree = refused + one.refused, agree + (one.agree and not one.refused)
        if not one.agree:
            sys.stdout.write(f"{given.seed}/{index}: step {one.step}, solved {one.solved}: {one.sentence}\n")
            sys.stdout.flush()
    sys.stdout.write(f"{agree} of {len(indices) - refused} agree to {AGREE:g} m over {given.steps} steps\n")


if __name__ == "__main__":
    main()
