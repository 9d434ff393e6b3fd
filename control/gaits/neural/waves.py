"""Waves of a chain of neurons that feels nothing: timing, and the share of noisy networks that carry waves."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import get_args

import numpy as np

from control.gaits.gait import Direction
from control.gaits.neural.chain import EiChain
from control.gaits.neural.kernel import onsets
from control.gaits.neural.network import Network
from worm3d.values.arrays import FloatArray


@dataclass(frozen=True)
class Timing:
    """Timing of waves."""

    period: float
    """Time between the last two bursts of the segment that begins the waves [s]."""
    delays: FloatArray
    """Delay of each segment behind the middle segment in the last wave [s], in the order of the wave, shape (N,)."""
    duty: float
    """Share of the time during which a segment is active, averaged over the segments."""


def timing_of(gait: EiChain, segments: int) -> Timing:
    """Return the timing of a chain's waves; ValueError if no waves run along all segments."""
    times, duty = _watched(gait, gait.network(segments), gait.drives(segments))
    if not _runs(times):
        raise ValueError(
            f"period: got {gait.period} s, must be a period at which waves run along all segments; tau_e or the "
            "couplings are too small or too large for the period"
        )
    last = int(np.isfinite(times[:, 0]).sum(axis=-1).min()) - 1
    wave = times[:, 0, last]
    return Timing(float(times[0, 0, last] - times[0, 0, last - 1]), wave - wave[segments // 2], duty)


def carrying(gait: EiChain, segments: int, noise: float, draws: int, seed: int = 0) -> float:
    """Return the share of noisy networks that carry waves, both direct and retrograde waves.

    Each constant of each population, and the drive, is multiplied by 1 + noise N(0, 1).

    Parameters
    ----------
    gait : EiChain
    segments : int
    noise : float
        Standard deviation.
    draws, seed : int
        Number of networks and seed of their noise.
    """
    random = np.random.default_rng(seed)
    ways = [replace(gait, direction=direction) for direction in get_args(Direction)]
    try:
        networks = [(way, way.network(segments), way.drives(segments)) for way in ways]
    except ValueError:  # without noise there are no waves either
        return 0.0
    good = 0
    for _ in range(draws):
        state = random.bit_generator.state
        for way, network, drives in networks:  # both directions use the same noisy network, with different inputs
            random.bit_generator.state = state
            noisy = network.noisy(noise, random)
            driven = drives * (1.0 + noise * random.standard_normal(drives.shape))
            if not _runs(_watched(way, noisy, driven)[0]):
                break
        else:
            good += 1
    return good / draws


def _watched(gait: EiChain, network: Network, drives: FloatArray) -> tuple[FloatArray, float]:
    """Return the onsets of bursts, segments in the order of the wave, shape (N, 2, M) [s], and the mean duty.

    The network is observed for six periods of the gait; a noisy network has a period of its own.
    """
    dt = network.step
    times, on = onsets(network.start(), network.packed(), drives, dt, int(6.0 * gait.period / dt))
    return times[:: 1 if gait.source == 0 else -1], float(on.mean())


def _runs(times: FloatArray) -> bool:
    """Return whether the source bursts at least three times, and all bursts run from segment to segment on both sides.

    The last burst need not have reached the other end.
    """
    counts = np.isfinite(times).sum(axis=-1)
    if counts[0].min() < 3 or (np.diff(counts, axis=0) > 0).any() or (counts[0] - counts[-1]).max() > 1:
        return False
    behind, ahead = times[1:], times[:-1]
    return bool(((behind > ahead) | np.isnan(behind)).all())
