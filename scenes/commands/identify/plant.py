"""Identify a worm: the design's runs, their fit, runs that check it, and the lags."""

from __future__ import annotations

from collections.abc import Callable
from types import MappingProxyType

import numpy as np

import worm3d
from control.gaits.steering import MECHANISMS, GaitParameters, Mechanism, Schedule, SteeredWave
from control.identification.identified import MAX_STEERING, Design, Identified, Lags, Sample, SteeringMap, fit_map
from control.identification.surrogate import Ranges
from scenes.commands.identify.runs import DT, measure_lags, samples, steady
from scenes.language.errors import SceneError

SHRINK = 0.7
"""By which the greatest steering is reduced while the worm tips."""
TRIES = 4
CHECKS = 12
"""Runs at random places that check a map."""

Watch = Callable[[int], None]


def identify(
    worm: worm3d.Worm, ground: worm3d.Friction, schedule: Schedule, design: Design, watch: Watch = lambda done: None
) -> Identified:
    """Identify a worm on level ground; `watch` is called with the number of finished mechanisms.

    Raises
    ------
    SceneError
        It does not crawl on its feet, however little it steers.
    """
    maps: dict[Mechanism, SteeringMap] = {}
    lags: dict[Mechanism, Lags] = {}
    for done, mechanism in enumerate(MECHANISMS, start=1):
        found = _map(worm, ground, schedule, design, mechanism)
        maps[mechanism] = found
        lags[mechanism] = measure_lags(worm, ground, schedule, mechanism, found.ranges.steering / 2.0)
        watch(done)
    return Identified(schedule, MappingProxyType(maps), MappingProxyType(lags))


def _map(
    worm: worm3d.Worm, ground: worm3d.Friction, schedule: Schedule, design: Design, mechanism: Mechanism
) -> SteeringMap:
    for attempt in range(TRIES):
        greatest = MAX_STEERING[mechanism] * SHRINK**attempt
        ranges = design.ranges(greatest)
        fitted = _run(worm, ground, schedule, design, design.parameters(mechanism, greatest))
        checks = fitted and _run(worm, ground, schedule, design, check_parameters(ranges, mechanism))
        if fitted and checks:
            return fit_map(mechanism, ranges, fitted, checks)
    raise SceneError(
        f"worm3d identify: the worm tips over, folds or flattens even when it steers by {greatest:.3g} ({mechanism}) "
        "only; give it a wider stance (worm.chamber_offset_m), a lower body (worm.half_height_m) or stiffer springs"
    )


def _run(
    worm: worm3d.Worm, ground: worm3d.Friction, schedule: Schedule, design: Design, parameters: list[GaitParameters]
) -> list[Sample] | None:
    waves = [SteeredWave(each, schedule) for each in parameters]
    return samples(steady(worm, ground, waves, design.waves, design.skipped), parameters)


def check_parameters(ranges: Ranges, mechanism: Mechanism) -> list[GaitParameters]:
    """Return random parameters within the ranges, with whole steps in a period; always the same ones."""
    random = np.random.default_rng([7, len(mechanism)])
    amplitudes = random.uniform(*ranges.amplitude, CHECKS)
    periods = DT * np.round(1.0 / random.uniform(*ranges.frequency, CHECKS) / DT)
    steerings = random.uniform(-ranges.steering, ranges.steering, CHECKS)
    return [
        GaitParameters(float(a), float(1.0 / t)).steered(mechanism, float(s))
        for a, t, s in zip(amplitudes, periods, steerings, strict=True)
    ]
