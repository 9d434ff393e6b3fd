"""What strains are worth to the estimator, by its own covariance.

    python tests/benchmarks/strain_worth.py [SCENE ...] [--seed 10]

The measurements of one controlled run are given to three estimators, after the run:

- "with": the one that ships. The strains give the wave that rocks the centre of mass, and the height of the axis.
- "without": strains are not given. The rocking of the centre of mass is noise then, which is found from the samples.
- "at most": as "with", and the strains were an odometer too, one that knows what motion of feet that hold would be. On
  the default worm, whose feet slide, that explains half of the variance of the speed within a wave and a fifth of that
  of the turn rate (`control.estimation.estimator`), so that the process noises of those lose as much of their variance.

Printed are the means after ten seconds of the standard deviations that the covariance says and of the NIS, and the
noise of the centre of mass that was found. With seed 10, on a line and an S-curve: without strains the place is known
worse by 1.16 and 1.14 times, the heading by 1.38 and 1.27 times, and the filter trusts itself too much (NIS 2.7 and
2.5, 2 being right). Odometry would add 2 % for the place and 1 % for the heading at most.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any
from unittest import mock

import numpy as np
from measuring import options, say

from control.estimation.estimator import Estimator
from control.estimation.kalman import RIPPLE, Uncertainty
from control.estimation.reduced import ReducedModel
from control.gaits.steering import GaitParameters
from control.sensing.sensors import Measurement
from scenes.models.control.build import identified_of
from scenes.models.control.schema import ControlScene
from scenes.models.loading import Scene, load_scene
from scenes.models.worm.build import worm_of
from scenes.running.runner import simulate

Taken = tuple[float, Measurement, GaitParameters, float]


def recorded(scene: Scene) -> list[Taken]:
    """Run a scene, and return what its estimator was given."""
    taken: list[Taken] = []
    take = Estimator.take

    def written(self: Estimator, *given: Any) -> None:
        taken.append(given)  # type: ignore[arg-type]
        take(self, *given)

    with mock.patch.object(Estimator, "take", written):
        simulate(scene)
    return taken


def replayed(estimator: Estimator, taken: Iterable[Taken], *, strain: bool) -> dict[str, float]:
    """Return the mean standard deviations of the place to the side and of the heading, and the NIS."""
    deviations = []
    for k, (t, measurement, parameters, phase) in enumerate(taken):
        given = measurement if strain else measurement.changed(strain=(None, float("nan")))
        estimator.take(t, given, parameters, phase)
        if t > 10.0 and k % 20 == 0:
            deviations.append(estimator.estimate(t).deviations[:3])
    nis = [value for t, value in estimator.innovations if t > 10.0]
    x, y, heading = np.mean(deviations, axis=0)
    return {"place_mm": 1e3 * float(np.hypot(x, y) / np.sqrt(2.0)), "heading_deg": float(np.rad2deg(heading)),
            "nis": float(np.mean(nis)), "noise_mm": 1e3 * estimator.noise.deviation}  # fmt: skip


def main() -> None:
    """Print a line for each estimator and scene."""
    given = options(__doc__, ("path_line", "path_circle", "path_s_curve"), seed=10)
    for name in given.names:
        whole = load_scene(name, [f"seed={given.seed}"])
        scene, taken = whole.settings, recorded(whole)
        assert isinstance(scene, ControlScene)
        found, worm = identified_of(scene), worm_of(scene)
        assert found is not None
        trust = replace(Uncertainty().sized(worm.length), com=max(scene.sensor.com_noise_m, RIPPLE * worm.length))
        most = replace(
            trust,
            speed=trust.speed * np.sqrt(0.5),
            **{key: getattr(trust, key) * np.sqrt(0.8) for key in ("turn_rate", "turning", "heading")},
        )
        for label, each, strain in (("with", trust, True), ("without", trust, False), ("at most", most, True)):
            model = ReducedModel.of(worm, found, scene.controller.mechanism)
            estimator = Estimator(worm, model, found.schedule, uncertainty=each)
            seen = replayed(estimator, taken, strain=strain)
            say(f"{name:14} {label:8} {'  '.join(f'{k} {v:.2f}' for k, v in seen.items())}")


if __name__ == "__main__":
    main()
