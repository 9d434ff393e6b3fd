"""How often the intervals of `worm3d fit` hold: `python tests/benchmarks/fit_coverage.py [--repeats 100]`.

A 3D crawl is seen by a camera with noise, white or autocorrelated, and three keys are fitted to it, from a start that
is off. Written are, for each key, in how many fits the 95 % interval held the truth (bar: 90 to 99 of 100), the mean
half-width over 1.96 standard deviations of the values (bar: 0.8 to 1.25), and the errors (bar: 2 %). Ends with 1 if a
bar is not kept. Takes some 40 minutes for 100 repeats with both kinds of noise.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from scenes.models.loading import load_scene
from scenes.running.runner import simulate
from scenes.studies.fit.fitting import Fit, fit

SCENE = "flat"
CRAWL = ("worm.segments=4", "worm.mass_kg=0.06", "run.duration_s=2.0", "gait.period_s=1.0")
TRUTH = {"friction.forward": 0.03, "gait.amplitude": 0.2, "worm.kelvin_voigt_time_s": 0.05}
START = {"friction.forward": 0.035, "gait.amplitude": 0.19, "worm.kelvin_voigt_time_s": 0.06}
NOISE_M = 2e-4
"""Standard deviation of the positions [m], as of a good camera."""
CORRELATION = {"white": 0.0, "AR(1)": 0.8}
"""Correlation of noise from one instant to the next."""
HELD, WIDTH, ERROR = (0.90, 0.99), (0.8, 1.25), 0.02


def seen(noise: float, repeat: int, folder: Path) -> Path:
    """Write what the camera sees: x of four joints and of the centre of mass, and the height of the tail."""
    record = simulate(load_scene(SCENE, CRAWL))
    joints = record["joints"]
    truth = np.column_stack([record["com"][:, 0], joints[:, [0, 1, 3, 4], 0], joints[:, 0, 2]])
    random = np.random.default_rng([repeat, int(100 * noise)])
    innovations = np.sqrt(1.0 - noise**2) * random.standard_normal((len(truth) + 100, truth.shape[1]))
    series = np.zeros_like(innovations)
    for k in range(1, len(series)):
        series[k] = noise * series[k - 1] + innovations[k]
    table = np.column_stack([record["time"], truth + NOISE_M * series[100:]])
    names = "time_s,com_x_m,joints_0_x_m,joints_1_x_m,joints_3_x_m,joints_4_x_m,joints_0_z_m"
    path = folder / "seen.csv"
    np.savetxt(path, table, delimiter=",", header=names, comments="")
    return path


def report(name: str, fits: list[Fit]) -> bool:
    """Write what fits came to and return whether they keep the bars."""
    truth = np.array(list(TRUTH.values()))
    values = np.array([list(each.values.values()) for each in fits])
    intervals = np.array([[key.interval or (np.nan, np.nan) for key in each.keys] for each in fits])
    held = ((intervals[..., 0] <= truth) & (truth <= intervals[..., 1])).mean(axis=0)
    width = np.diff(intervals, axis=2)[..., 0].mean(axis=0) / 2.0 / 1.96 / values.std(axis=0)
    errors = np.abs(values / truth - 1.0)
    sys.stdout.write(f"{name}, {len(fits)} fits of {np.mean([each.runs for each in fits]):.0f} runs\n")
    for k, key in enumerate(TRUTH):
        sys.stdout.write(
            f"  {key:26} held {held[k]:.0%}, width over scatter {width[k]:.2f}, error: rms "
            f"{np.sqrt(np.mean(errors[:, k] ** 2)):.2%}, largest {errors[:, k].max():.2%}\n"
        )
    inside = [np.all((low <= each) & (each <= high)) for each, (low, high) in ((held, HELD), (width, WIDTH))]
    return bool(all(inside) and errors.max() <= ERROR)


def main() -> int:
    """Run the study and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=100)
    parser.add_argument("--noise", choices=tuple(CORRELATION), nargs="*", default=list(CORRELATION))
    given, kept = parser.parse_args(), True
    overrides = [*CRAWL, *(f"{key}={value}" for key, value in START.items())]
    for name in given.noise:
        fits, begin = [], time.process_time()
        for repeat in range(given.repeats):
            with tempfile.TemporaryDirectory() as folder:
                fits.append(fit(SCENE, seen(CORRELATION[name], repeat, Path(folder)), list(TRUTH), overrides))
            if repeat % 10 == 9:
                sys.stderr.write(f"{repeat + 1} fits in {time.process_time() - begin:.0f} s of CPU\n")
                report(name, fits)
        kept = report(name, fits) and kept
    return 0 if kept else 1


if __name__ == "__main__":
    sys.exit(main())
