"""Random planar worms, run by `planar.linkage` and by `worm3d`: do two programs, written independently, agree?

    python tests/worm3d/planar_worms.py [--seed 1] [--count 200] [--steps 300] [--only INDEX]
                                        [--ratio 1.8]

A study; `test_planar_worms.py` runs it with fewer steps. Worm `index` of a seed is always the same. A third of them is
uneven along the body, a quarter has a coefficient of 0 or close to it, three quarters have a static ratio above 1.
Both take implicit Euler, which is all that `planar.linkage` has.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

import worm3d
from planar import linkage
from planar.linkage.ground import Ground
from planar.linkage.newton import loads
from planar.linkage.shape import apexes
from planar.linkage.step import ContactStepper, State

GRAVITY = 9.81
AGREE = 1e-9
"""Largest distance of joints that agree [m]."""

NEAR = 1e-8
"""Largest distance of a solution from the joints that a program found [m]: what both start from differs by `AGREE`."""

BALANCED = 1e-6
"""Largest force that is left at a joint where forces balance, as a fraction of the weight: a contact carries it within
1e-5 of a segment, so that 1e-12 of the body, to which Newton's method is exact, are 1e-7 of it."""


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
        Neither program begins: the worm's weight would flatten it, or it does not come to rest.
    agree : bool
        Joints within `AGREE` after each step, as many steps, and the same end; or both refuse the same step, each with
        the word for its own solution.
    step : int
        First one in which they do not.
    solved : tuple of bool
        Whether what `planar.linkage` and `worm3d` found solves that step, undivided.
    """

    refused: bool
    agree: bool = True
    step: int = 0
    solved: tuple[bool, bool] = (True, True)
    sentence: str = ""
    apart: float = 0.0
    """Largest distance of the two solutions from each other [m]."""
    end: float = 0.0
    """Largest distance of the joints at the end of the runs [m]; infinite where they do not end alike."""

    @property
    def two_solutions(self) -> bool:
        """Whether that step has two solutions, each program's own."""
        return all(self.solved) and self.apart > 10.0 * NEAR


def case(seed: int, index: int, ratio: float | None = None) -> Case:
    """Return worm number `index` of a seed, with its own static ratio or another one."""
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
    own = float(rng.choice([1.0, *rng.uniform(1.0, 2.0, 3)]))
    ratio = own if ratio is None else ratio
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
    ends = {oracle.status.name, result.status.name}
    if len(joints) == len(oracle.joints) == 1 and "DONE" not in ends:
        return Outcome(refused=True)
    away = np.abs(joints[:both] - oracle.joints[:both]).max(axis=(1, 2))
    same_end = len(ends) == 1 or (len(joints) == len(oracle.joints) and "DONE" not in ends)
    if (away <= AGREE).all() and same_end:
        return Outcome(refused=False)
    step = int(np.argmax(away > AGREE)) if (away > AGREE).any() else both
    found = [_planar_solution(it, oracle, step)]
    if step < len(joints):
        found.append(solution_near(it, oracle, step, joints[step], result.slip[step, :, :2]))
    solved = found[0] is not None, len(found) > 1 and found[1] is not None
    apart = float(np.abs(found[0] - found[1]).max()) if all(solved) else 0.0
    parts = len(oracle.steps[step - 1]) if step <= len(oracle.steps) else 0
    ends_as = f"{oracle.status.name} in {parts} parts/{result.status.name}, {result.halved_steps} steps halved"
    end = float(away[-1]) if same_end else np.inf
    return Outcome(False, False, step, solved, f"{it.sentence}; {ends_as}", apart, end)


def _stepper(it: Case) -> ContactStepper:
    worm = linkage.Linkage(**it.worm)
    ground = Ground.of(worm, linkage.Friction(*it.friction), GRAVITY)
    weight = GRAVITY * np.array([-np.sin(it.slope), -np.cos(it.slope)])
    return ContactStepper(worm, weight, ground, np.zeros((worm.segments + 1, 2), dtype=bool))


def _start(oracle: linkage.Run, step: int) -> State:
    """Return the state of `planar.linkage` from which a step begins."""
    return oracle.steps[step - 1][0].start if step <= len(oracle.steps) else oracle.steps[-1][-1].end


def _planar_solution(it: Case, oracle: linkage.Run, step: int) -> np.ndarray | None:
    """Return the joints with which `planar.linkage` solves a step, though its guard refuse them; None without any."""
    if step < len(oracle.joints):
        return solution_near(it, oracle, step, oracle.joints[step], oracle.slip[step - 1])
    stepper, worm = _stepper(it), linkage.Linkage(**it.worm)
    command, force = worm.l0 * (1.0 - it.gait(step * it.dt)), np.zeros((worm.segments + 1, 2))
    taken = stepper.step(_start(oracle, step), command, force, it.dt)
    return solution_near(it, oracle, step, taken.end.joints, taken.slip) if taken.solution.converged else None


def solution_near(it: Case, oracle: linkage.Run, step: int, q: np.ndarray, slipped: np.ndarray) -> np.ndarray | None:
    """Return the solution of an undivided step, from the state of `planar.linkage`, next to joints q (N+1, 2).

    None where Newton's method leads further than `NEAR` from q, or to what does not solve the step: forces balance,
    with friction by the law (G2), which keeps it inside its set: kinetic for what was stuck and has `slipped` (N, 2),
    else static. No load pulls, friction is against the motion where an anchor moves, and no anchor of what sticks does.
    """
    stepper, start, worm = _stepper(it), _start(oracle, step), linkage.Linkage(**it.worm)
    command, force = worm.l0 * (1.0 - it.gait(step * it.dt)), np.zeros((worm.segments + 1, 2))
    static = start.stuck & (slipped == 0.0)
    now = stepper._now(start, command, force, np.where(static, it.friction[2], 1.0), it.dt)
    near, _, converged = stepper.newton._polish(q.ravel(), now)
    if not converged or np.abs(near - q.ravel()).max() > NEAR:
        return None
    load = loads(near, stepper.body, stepper.ground, now)
    slip, _ = stepper._return_map(near, now, load)
    q = near.reshape(-1, 2)
    moved = now.direction[:, None] * (apexes(q, worm.link_length)[..., 0] - now.anchor)  # friction is against it
    balanced = np.abs(stepper.newton.residual(near, now)).max() < BALANCED * worm.total_mass * GRAVITY
    rests = (slip[static] == 0.0).all()
    against = (slip * moved >= 0.0).all()
    return q if balanced and rests and against and (load >= 0.0).all() else None


def main() -> None:
    """Run the study and print what does not agree."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--steps", type=int, default=300)
    parser.add_argument("--only", type=int)
    parser.add_argument("--ratio", type=float, help="static ratio of all worms; their own if left out")
    given = parser.parse_args()
    indices = range(given.count) if given.only is None else [given.only]
    ends: Counter[str] = Counter()
    for index in indices:
        one = outcome(case(given.seed, index, given.ratio), given.steps)
        ends["refused" if one.refused else "agree" if one.agree else "two" if one.two_solutions else "differ"] += 1
        if not one.agree:
            found = f"solved {one.solved}, {one.apart:.2g} m apart, at the end {one.end:.2g} m"
            sys.stdout.write(f"{given.seed}/{index}: step {one.step}, {found}: {one.sentence}\n")
            sys.stdout.flush()
    sys.stdout.write(
        f"{ends['agree']} of {ends.total() - ends['refused']} agree to {AGREE:g} m over {given.steps} steps; "
        f"{ends['two']} have a step with two solutions, {ends['differ']} differ\n"
    )


if __name__ == "__main__":
    main()
