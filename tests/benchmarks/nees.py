"""Does the estimator know how wrong it is? Normalised estimation errors squared over random worms on the full plant.

    python tests/benchmarks/nees.py [SCENE] [--worms 8] [--seed 40] [--duration 30] [--map nearby] [-o KEY=VALUE ...]

Each worm has its own mass (+-20 %), springs and three coefficients of friction (+-30 % each), noise of the centre of
mass (2 to 20 mm, told to the controller) and errors of its sensors. With the error e of an estimate and its covariance
P,

    nees = e^T P^-1 e,   chi-squared with as many degrees of freedom as e has numbers,

of place and heading against the centre of mass and the chord's azimuth, each averaged over the wave about that instant,
since estimates have no rocking. Errors of one run are alike for seconds, those of different worms are not: the mean
over M worms at one instant lies within [chi2^-1(0.025; 3 M), chi2^-1(0.975; 3 M)]/M 19 times out of 20. (Bar-Shalom,
Li, Kirubarajan: Estimation with Applications to Tracking and Navigation, 5.4.2.) Printed is each worm's mean, the mean
over all, and at how many of the instants it lies within, below and above.

Six worms, seed 40, 24 s: place and heading together 0.46 to 0.85 of what is right, 0.67 in the mean; place 0.60 to
1.08, heading 0.21 to 0.55, NIS 0.86 to 1.08. The mean over the worms lies within the interval at 77 % of the instants,
below it at 23 % and never above: the estimator is not too sure of itself, and knows the heading better than it says.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from typing import NamedTuple
from unittest import mock

import numpy as np
import scipy

from control.estimation.estimate import Estimate
from control.estimation.estimator import Estimator
from scenes.language.errors import SceneError
from scenes.models.loading import load_scene
from scenes.running.runner import simulate
from worm3d import Friction, Worm
from worm3d.values.arrays import FloatArray

BEGIN = 6.0
"""Time from which estimates count, when the heading is known [s]."""
END = 2.0
"""Time before the end of a run from which they do not, for want of a whole wave [s]."""
EVERY = 0.2
"""Time between the estimates that count, the control period [s]."""
DEGREES = 3


class Errors(NamedTuple):
    """Normalised errors squared of one worm at K instants, each of shape (K,)."""

    time: FloatArray
    whole: FloatArray
    place: FloatArray
    heading: FloatArray
    nis: float


def worms(seed: int) -> Iterator[list[str]]:
    """Yield the overrides of one random worm after the other."""
    random, worm, ground = np.random.default_rng(seed), Worm(), Friction()
    while True:
        factor = random.uniform(-1.0, 1.0, 5)
        usual = {"forward": ground.forward, "backward": ground.backward, "lateral": ground.lateral}
        yield [
            f"worm.mass_kg={worm.mass * (1.0 + 0.2 * factor[0]):.5g}",
            f"worm.spring_N={float(np.mean(worm.k_spring)) * (1.0 + 0.3 * factor[1]):.5g}",
            *(f"friction.{k}={v * (1.0 + 0.3 * f):.5g}" for (k, v), f in zip(usual.items(), factor[2:], strict=True)),
            f"sensor.com_noise_m={np.exp(random.uniform(np.log(0.002), np.log(0.02))):.5g}",
            f"seed={random.integers(2**31)}",
        ]


def errors(scene: str, overrides: list[str]) -> Errors:
    """Return the normalised errors squared of a run."""
    known: list[Estimate] = []
    estimate = Estimator.estimate

    def written(self: Estimator, t: float) -> Estimate:
        known.append(estimate(self, t))
        return known[-1]

    with mock.patch.object(Estimator, "estimate", written):
        run = simulate(load_scene(scene, overrides))
    time, waves = run["time"], run["waves"]
    true = np.column_stack([run["com"][:, :2], np.unwrap(run["heading"])])
    rows = []
    for each in {round(e.time, 6): e for e in known}.values():
        if not (BEGIN <= each.time <= time[-1] - END and abs(each.time / EVERY - round(each.time / EVERY)) < 1e-6):
            continue
        now = np.interp(each.time, time, waves)
        about = np.linspace(*np.interp([now - 0.5, now + 0.5], waves, time), 51)
        mean = np.array([np.interp(about, time, column).mean() for column in true.T])
        e = np.array([*each.position, each.heading]) - mean
        e[2] = np.mod(e[2] + np.pi, 2.0 * np.pi) - np.pi
        P = each.covariance[:DEGREES, :DEGREES]
        rows.append(
            [
                each.time,
                e @ np.linalg.solve(P, e),
                e[:2] @ np.linalg.solve(P[:2, :2], e[:2]) / 2.0,
                e[2] ** 2 / P[2, 2],
            ]
        )
    columns = np.array(rows).T
    return Errors(*columns, float(run.summary.metrics["nis_mean"]))  # type: ignore[arg-type]


def say(text: str) -> None:
    """Print a line at once."""
    print(text, flush=True)  # noqa: T201


def main() -> int:
    """Run the worms, and print how their errors compare with what was believed of them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", nargs="?", default="path_s_curve")
    parser.add_argument("--worms", type=int, default=8)
    parser.add_argument("--seed", type=int, default=40)
    parser.add_argument("--duration", type=float, default=30.0)
    parser.add_argument("--map", default="nearby", help="as controller.map")
    parser.add_argument("-o", action="append", default=[], metavar="KEY=VALUE")
    asked = parser.parse_args()
    more = [f"run.duration_s={asked.duration:g}", f"controller.map={asked.map}", *asked.o]
    found: list[Errors] = []
    refusals = 0
    for worm in worms(asked.seed):
        say(" ".join(worm))
        try:
            made = errors(asked.scene, [*worm, *more])
        except SceneError as refused:
            say(f"    refused: {refused}")
            if (refusals := refusals + 1) > 3 * asked.worms:
                return 1
            continue
        found.append(made)
        means = made.whole.mean() / DEGREES, made.place.mean(), made.heading.mean(), made.nis / 2.0
        say("    nees/3 {:.2f}, place {:.2f}, heading {:.2f}, nis/2 {:.2f}".format(*means))
        if len(found) == asked.worms:
            break
    mean = np.mean([each.whole for each in found], axis=0) / DEGREES
    low, high = scipy.stats.chi2.ppf([0.025, 0.975], DEGREES * len(found)) / len(found) / DEGREES
    say(f"mean of nees/3 {mean.mean():.2f}; {len(found)} worms at one instant: {low:.2f} to {high:.2f}")
    shares = [np.mean(mean < low), np.mean((mean >= low) & (mean <= high)), np.mean(mean > high)]
    say("instants below, within and above: {:.0%}, {:.0%}, {:.0%}".format(*shares))
    return 0


if __name__ == "__main__":
    sys.exit(main())
