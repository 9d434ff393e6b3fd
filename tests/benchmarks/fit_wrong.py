"""How often `worm3d fit` warns of a wrong scene and of a right one: `python tests/benchmarks/fit_wrong.py --draws 10`.

A crawl of a worm that differs from the scene in one thing is seen by a camera with noise, white and autocorrelated by
turns, and two keys are fitted to it. Written are in how many draws the fit warns (bars: 9 of 10 of each wrong scene, at
most 1 of 20 of the right one, of which there are twice as many draws), how often the key that is wrong is among the
suspects, and how often the widened intervals hold the truth. Ends with 1 if a bar is not kept. Its seeds are not those
with which the limits of `lack` and `suspects` in `scenes.studies.fit` were chosen. Takes 15 minutes of a processor.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

import numpy as np

from scenes.models.loading import load_scene
from scenes.running.runner import simulate
from scenes.studies.fit.fitting import Fit, fit

SCENE, CRAWL = "flat", ("run.duration_s=4.0",)
EVERY = 4
"""Steps from one picture to the next: 25 pictures a second."""
NOISE_M = 2e-4
"""Standard deviation of the positions [m]; at 5e-4 the error by viscous friction, 1.5e-4 m, is lost in the noise."""
CORRELATIONS = (0.0, 0.8)
"""Correlations of the noise from one picture to the next."""
TRUTH = {"friction.forward": 0.03, "gait.amplitude": 0.2}
START = {"friction.forward": 0.035, "gait.amplitude": 0.19}
WRONG = {
    "right": (),
    "mass doubled": ("worm.mass_kg=0.2",),
    "static ratio 2.5": ("friction.static_ratio=2.5",),
    "torsion a tenth": ("worm.torsion_J=1.0",),
    "lag 0.25 s": ("worm.actuator_lag_s=0.25",),
    "viscous friction": ("friction.law=viscous",),
    "joint friction": ("hysteresis.kind=jenkins",),
}
SEED = 4000


def seen(name: str, draw: int, folder: Path) -> Path:
    """Write what the camera sees: x of the centre of mass, of the tail and of the head."""
    record = simulate(load_scene(SCENE, (*CRAWL, *WRONG[name])))
    truth = np.column_stack([record["com"][:, 0], record["joints"][:, [0, -1], 0]])[::EVERY]
    noise, random = CORRELATIONS[draw % 2], np.random.default_rng([SEED, draw, *name.encode()])
    innovations = np.sqrt(1.0 - noise**2) * random.standard_normal((len(truth) + 100, truth.shape[1]))
    series = np.zeros_like(innovations)
    for k in range(1, len(series)):
        series[k] = noise * series[k - 1] + innovations[k]
    table = np.column_stack([record["time"][::EVERY], truth + NOISE_M * series[100:]])
    path = folder / "seen.csv"
    np.savetxt(path, table, delimiter=",", header="time_s,com_x_m,joints_0_x_m,joints_6_x_m", comments="")
    return path


def report(name: str, fits: list[Fit]) -> bool:
    """Write what fits came to and return whether they keep the bar."""
    warned = sum(each.lack.found for each in fits)
    key = WRONG[name][0] if name != "right" else ""
    named = sum(any(s.what in (key, key.partition("=")[0]) for s in each.lack.suspects.named) for each in fits)
    held = [k.interval is None or k.interval[0] <= TRUTH[k.varied.key] <= k.interval[1] for f in fits for k in f.keys]
    sys.stdout.write(
        f"{name:18} {warned} of {len(fits)} warned; named {named}; intervals hold the truth {np.mean(held):.0%}\n"
    )
    sys.stdout.flush()
    return warned <= len(fits) / 20 if name == "right" else warned >= 0.9 * len(fits)


def main() -> int:
    """Run the study and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=10)
    parser.add_argument("--only", choices=tuple(WRONG), nargs="*", default=list(WRONG))
    given, kept = parser.parse_args(), True
    overrides = [*CRAWL, *(f"{key}={value}" for key, value in START.items())]
    for name in given.only:
        fits = []
        for draw in range(given.draws * (2 if name == "right" else 1)):
            with tempfile.TemporaryDirectory() as folder:
                fits.append(fit(SCENE, seen(name, draw, Path(folder)), list(TRUTH), overrides))
        kept = report(name, fits) and kept
    return 0 if kept else 1


if __name__ == "__main__":
    sys.exit(main())
