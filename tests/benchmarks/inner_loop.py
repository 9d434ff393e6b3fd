"""What the inner loop is worth: worms of unequal, slow and soft chambers, with and without it, beside line-of-sight.

    python tests/benchmarks/inner_loop.py [--seed 100] [--count 30] [--duration 60] [--default]

Each draw is a worm: a gain of each chamber in [0.6, 1.1], lags 0.5 to 3 times the default ones and springs 0.7 to 1.3
times, one for each segment. It keeps to a line, a circle and an S-curve in turn, by the default worm's map. With
`--default` all worms are the default one. Printed are the median and the worst of each figure over the draws:

    bias [%]      mean speed over the reference less 1, by the run's summary
    first [%]     the same over the first six waves after the first one and a half
    settled       waves after which the speed of three waves stays within 5 %
    offset [BL]   rms offset from the path
    work [J]      work of the actuators
    fallen        runs in which the worm lay on its side; held: runs in which a segment was held still
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from multiprocessing import get_context

import numpy as np

from scenes.models.control.build import reference_of
from scenes.models.loading import load_scene
from scenes.running.runner import simulate

PATHS = ("path_line", "path_circle", "path_s_curve")
WAYS = {
    "inner loop": ("controller.kind=mpc",),
    "without": ("controller.kind=mpc", "controller.inner_loop=false"),
    "line-of-sight": ("controller.kind=pi_los",),
}
LAG, SPRING, SPEED, WAVE = 0.1, 13.0, 0.08, 1.25
FIGURES = ("bias", "first", "settled", "offset", "work")
Task = tuple[int, str, float, bool]


def overrides(seed: int) -> list[str]:
    """Return what makes the worm of a draw."""
    random = np.random.default_rng([33, seed])
    lags = LAG * np.exp(random.uniform(np.log(0.5), np.log(3.0), 6))
    springs = SPRING * random.uniform(0.7, 1.3, 6)
    chambers = "fault.unequal=true", f"fault.unequal_seed={seed}"
    return [*chambers, f"actuator.lag_s={lags.tolist()}", f"worm.spring_N={springs.tolist()}"]


def measured(task: Task) -> dict[str, float]:
    """Return the figures of one run."""
    seed, way, duration, default = task
    worm = [] if default else overrides(seed)
    common = [f"seed={seed}", "controller.map=default", f"run.duration_s={duration}", *WAYS[way]]
    scene = load_scene(PATHS[seed % len(PATHS)], [*common, *worm])
    run = simulate(scene)
    path, near, along = reference_of(scene.settings).path, None, []  # type: ignore[arg-type]
    assert path is not None
    for place in run["com"][:, :2]:
        near = float(path.project(place, near))
        along.append(near)
    time = np.arange(0.0, run["time"][-1], WAVE / 20.0)
    mean = np.convolve(np.interp(time, run["time"], along), np.full(20, 0.05), "valid")
    time = time[: len(mean)] + 9.5 * WAVE / 20.0
    first = float(np.diff(np.interp([1.5 * WAVE, 7.5 * WAVE], time, mean))[0]) / (6.0 * WAVE * SPEED) - 1.0
    off = np.abs((mean[60:] - mean[:-60]) / (3.0 * WAVE * SPEED) - 1.0) > 0.05
    last = int(np.flatnonzero(off)[-1]) + 1 if off.any() else 0
    kinds = [str(row["kind"]) for row in run.summary.faults]
    told = [str(row["advice"]) for row in run.summary.faults]
    return {
        "bias": 100.0 * abs(float(run.summary["speed_bias_relative"])),
        "first": 100.0 * abs(first),
        "settled": np.inf if last == len(off) else last / 20.0,
        "offset": float(run.summary["cross_track_rms_bl"]),
        "work": float(run.summary["work_contract_J"]),
        "fallen": float("on its side" in kinds),
        "held": float(any("held still" in each for each in told)),
    }


def lines(seeds: range, duration: float, default: bool, workers: int) -> Iterator[str]:
    """Yield a line for each way of control."""
    with get_context("spawn").Pool(workers) as pool:
        for way in WAYS:
            found = pool.map(measured, [(seed, way, duration, default) for seed in seeds], chunksize=1)
            both = [f"{np.median(column):.3g} / {np.max(column):.3g}" for column in
                    ([run[name] for run in found] for name in FIGURES)]  # fmt: skip
            counts = [f"{name} {sum(run[name] for run in found):.0f}" for name in ("fallen", "held")]
            yield (
                f"{way:14} "
                + "  ".join(f"{n} {v}" for n, v in zip(FIGURES, both, strict=True))
                + "  "
                + " ".join(counts)
            )


def main() -> None:
    """Print the lines."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--seed", type=int, default=100)
    parser.add_argument("--count", type=int, default=30)
    parser.add_argument("--duration", type=float, default=60.0)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--default", action="store_true")
    given = parser.parse_args()
    for line in lines(range(given.seed, given.seed + given.count), given.duration, given.default, given.workers):
        sys.stdout.write(line + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
