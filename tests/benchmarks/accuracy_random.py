"""Error estimates of random runs: `python tests/benchmarks/accuracy_random.py [--seed 6] [--count 100]`.

Each run has a worm, a ground, a gait and an accuracy (0.01 or 0.03) of its own, on the flat, on slopes or in a bent
pipe. The truth is a run that is allowed a 64th of the error in each step. A line for each run has the error over the
estimate for distance, heading and work (more than 2: missed). The last lines have the share of runs within two
estimates, at least 95 % of each, and the median of estimate over error. How errors are estimated was chosen on the
seeds 1 to 4.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import Any

import numpy as np
from accuracy_bars import finished, say, variable

from scenes.language.errors import SceneError
from scenes.models.loading import load_scene
from scenes.models.worm.build import problem_of
from worm3d import Result
from worm3d.running import accuracy as runs
from worm3d.running.problem import Problem

FINER = 64.0
"""Error allowed in a step of the run that is asked for, over that of the truth."""
FIGURES = ("distance", "heading", "work")
NO_TURN = 1e-10
"""Turn of a run that is straight but for rounding [rad]; such runs have no heading to be judged."""


def drawn(rng: np.random.Generator) -> Problem:
    """Return a problem that has a solution by its scene's checks; SceneError if it has none."""
    scene = str(rng.choice(["flat", "flat", "flat", "turn", "slope_15", "pipe_bend"]))
    keys: dict[str, Any] = {"run.duration_s": rng.choice([2, 3]), "run.record_every": 1, "run.dt_s": 0.01}
    keys["gait.amplitude"], keys["gait.period_s"] = rng.uniform(0.12, 0.3), 10 ** rng.uniform(-0.2, 0.5)
    if scene in ("flat", "turn"):
        keys |= {"worm.segments": rng.integers(4, 8), "worm.kelvin_voigt_time_s": 10 ** rng.uniform(-2.3, -1.2)}
        keys |= {f"friction.{way}": 10 ** rng.uniform(-1.5, -0.2) for way in ("forward", "backward", "lateral")}
        keys["friction.static_ratio"] = rng.uniform(1.0, 1.6)
    if scene == "flat":
        keys |= {"gait.wavelength": rng.uniform(0.6, 2.0), "gait.bias": rng.uniform(-0.7, 0.7)}
        keys |= {"gait.hinge_deg": rng.uniform(-40.0, 40.0), "world.slope_deg": rng.uniform(-8.0, 8.0)}
        keys["gait.direction"] = rng.choice(["direct", "retrograde"])
    loaded: Any = load_scene(scene, tuple(f"{key}={value}" for key, value in keys.items())).settings
    return replace(problem_of(loaded), accuracy=float(rng.choice([0.01, 0.03])))


def figures(result: Result) -> np.ndarray[Any, Any]:
    """Return distance [m], turn [rad] and work [J] of a run, shape (3,)."""
    work = float(result.energy.work_contract.sum())
    return np.array([result.distance, result.heading[-1] - result.heading[0], work])


def judged(of: Problem) -> np.ndarray[Any, Any]:
    """Return error over estimate of each figure, shape (3,); NaN for the heading of a worm that keeps straight."""
    run = finished(runs.begin(of)())
    estimate = run.error_estimate
    assert estimate is not None
    truth = figures(variable(of, estimate.step_error / FINER))
    errors = np.abs(figures(run) - truth) / [estimate.distance, estimate.heading, estimate.work]
    return np.where([False, abs(truth[1]) < NO_TURN, False], np.nan, errors)


def main() -> None:
    """Run what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=6)
    parser.add_argument("--count", type=int, default=100)
    asked = parser.parse_args()
    found = []
    for case in range(asked.count):
        try:
            found.append(judged(drawn(np.random.default_rng([asked.seed, case]))))
            say(
                f"{case:4d} "
                + "  ".join(f"{name} {ratio:7.3f}" for name, ratio in zip(FIGURES, found[-1], strict=True))
            )
        except (SceneError, RuntimeError, ValueError) as error:
            say(f"{case:4d} {type(error).__name__}: {' '.join(str(error).split())[:120]}")
    for name, ratios in zip(FIGURES, np.array(found).T, strict=True):
        known = ratios[~np.isnan(ratios)]
        within = f"within two estimates {np.sum(known <= 2.0)} of {len(known)} ({np.mean(known <= 2.0):.1%})"
        say(f"{name:9} {within}, largest {known.max():.2f}, median of estimate over error {np.median(1 / known):.1f}")


if __name__ == "__main__":
    main()
