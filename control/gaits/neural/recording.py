"""Waves in recordings of crawling animals: the times at which each band of the body moves, and the delays of bands.

A trough of a band is a minimum that is deeper than DEPTH robust standard deviations, or deeper than two thirds of the
deepest value, whichever is easier to reach. The robust standard deviation is 1.4826 times the median of the absolute
deviations of the measured values from their median. Values of exactly 0 count as not measured. If less than 5 % of the
values of a band have one sign, as for a length, the values are taken relative to their median. The time of a trough is
the minimum of the parabola through three samples.

A wave begins with a trough of the middle band that is at least LEAST_GAP away from deeper troughs. From band to band
outwards, the wave continues with the deepest trough within MAX_DELAY in the direction of the wave, or within
MAX_REVERSE_DELAY in the other direction.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import groupby, pairwise

import numpy as np
from numpy.typing import NDArray

from worm3d.values.arrays import FloatArray

DEPTH = 2.0
"""Minimum depth of a trough, in robust standard deviations. With 1.5 or 3, no median delay changes by more than 7
ms."""
LEAST_GAP = 1.0
"""Minimum time between two waves [s]."""
MAX_DELAY, MAX_REVERSE_DELAY = 0.4, 0.1
"""Maximum delay between neighbouring bands in the direction of the wave, and against it [s]."""
MIN_PAUSE = 1.5
"""Minimum duration of a pause [s]. During a pause all bands stay within a robust standard deviation. Flashes stop a
larva for 2 to 12 s. Between two waves of slow crawling a larva is quiet for less than 1 s."""
INTERVAL = (50.0 * (1.0 - 0.9), 50.0 * (1.0 + 0.9))
"""Percentiles at the ends of the sampling intervals, which contain 90 %."""


@dataclass(frozen=True)
class Waves:
    """Waves of a recording, with the bands in the order of the waves."""

    bands: tuple[str, ...]
    """Names of the bands. The first band moves first."""
    times: FloatArray
    """Time of each band's trough [s], shape (K, bands). NaN if the band has none."""
    periods: FloatArray
    """Times from one wave to the next, except across pauses [s]."""

    @property
    def middle(self) -> int:
        """Index of the reference band of the delays."""
        return len(self.bands) // 2

    @property
    def period(self) -> float:
        """Median period [s]."""
        return float(np.median(self.periods))

    @property
    def delays(self) -> FloatArray:
        """Delay of each band behind the middle band in each wave [s], shape (K, bands)."""
        return np.asarray(self.times - self.times[:, [self.middle]])

    def median(self) -> FloatArray:
        """Return the median delay of each band [s], shape (bands,)."""
        return median_of(self.delays)

    def interval(self, seed: int = 0) -> FloatArray:
        """Return the bootstrap interval of each median delay, waves drawn with replacement [s], shape (2, bands)."""
        random, delays = np.random.default_rng(seed), self.delays
        draws = random.integers(0, len(delays), (2000, len(delays)))
        medians = np.array([median_of(delays[draw]) for draw in draws])
        return np.asarray(np.nanpercentile(medians, INTERVAL, axis=0))


def pick(time: FloatArray, values: FloatArray, bands: tuple[str, ...]) -> Waves:
    """Return the waves of a recording.

    Parameters
    ----------
    time : ndarray, shape (T,)
        Evenly spaced times [s].
    values : ndarray, shape (T, bands)
        Recorded values with the events as troughs, in any unit. 0 and NaN mark values that were not measured.
    bands : tuple of str
        Name of each column, in the order of the wave.

    Raises
    ------
    ValueError
        There are fewer than three bands, fewer than ten times, uneven times, fewer than four waves, or fewer than
        three periods without a pause; no wave reaches one of the bands; or all bands have their troughs at once.
    """
    dt = float(np.median(np.diff(time))) if len(time) > 1 else 0.0
    if len(bands) < 3 or len(time) < 10 or not (dt > 0.0 and np.allclose(np.diff(time), dt, rtol=0.01)):
        raise ValueError(
            f"recording: got {len(bands)} bands at {len(time)} times, must be at least 3 bands, and at least 10 "
            "ascending, evenly spaced times"
        )
    scaled = _scaled(np.nan_to_num(values))
    middle, times = len(bands) // 2, []
    for k in _troughs(scaled[:, middle], round(LEAST_GAP / dt)):
        wave = np.full(len(bands), np.nan)
        wave[middle] = _refined(scaled[:, middle], k)
        for side in (-1, 1):
            _follow(scaled, wave, k, middle, side, (round(MAX_DELAY / dt), round(MAX_REVERSE_DELAY / dt)))
        times.append(time[0] + dt * wave)
    starts = np.array([wave[middle] for wave in times])
    calm = np.abs(scaled).max(axis=1) < 1.0
    periods = [b - a for a, b in pairwise(starts) if _longest(calm[(time > a) & (time < b)]) * dt < MIN_PAUSE]
    if len(times) < 4 or len(periods) < 3:
        raise ValueError(
            f"recording: found {len(times)} waves, must be 4 or more, three of them without a pause before; a "
            f"wave is a trough of each band in turn, {LEAST_GAP:g} s or more after the last one, and within "
            f"{MAX_DELAY:g} s from band to band"
        )
    waves = Waves(bands, np.array(times), np.array(periods))
    median = waves.median()
    if missed := [band for band, delay in zip(bands, median, strict=True) if not np.isfinite(delay)]:
        raise ValueError(f"recording: no wave reaches {', '.join(missed)}; each band must be part of a wave")
    if np.ptp(median) < dt:
        raise ValueError("recording: all bands have their troughs at once, must have waves that run along the body")
    return waves


def _scaled(values: FloatArray) -> FloatArray:
    """Return each column divided by its robust standard deviation or by a fraction of its depth, whichever is less.

    A constant column becomes 0.
    """
    scaled = np.zeros_like(values)
    for j, column in enumerate(values.T):
        measured = column[column != 0.0]
        if not len(measured):
            continue
        middle = np.median(measured)
        share = np.mean(measured < 0.0)
        base = middle if min(share, 1.0 - share) < 0.05 else 0.0
        spread = min(1.4826 * np.median(np.abs(measured - middle)), (base - measured.min()) / (1.5 * DEPTH))
        if spread > 0.0:
            scaled[:, j] = np.where(column != 0.0, column - base, 0.0) / spread
    return scaled


def _least(x: FloatArray) -> NDArray[np.intp]:
    """Return the samples with a sufficiently deep trough."""
    inner = (x[1:-1] < -DEPTH) & (x[1:-1] <= x[:-2]) & (x[1:-1] < x[2:])
    return 1 + np.flatnonzero(inner)


def _troughs(x: FloatArray, gap: int) -> list[int]:
    """Return the troughs that lie at least `gap` samples from any deeper trough, in ascending order."""
    found: list[int] = []
    for k in sorted(_least(x), key=lambda k: float(x[k])):
        if all(abs(k - other) >= gap for other in found):
            found.append(int(k))
    return sorted(found)


def _follow(x: FloatArray, wave: FloatArray, k: int, band: int, side: int, reach: tuple[int, int]) -> None:
    """Store the troughs of the bands on one side of `band`, up to the first band without a trough.

    The trough of `band` is at sample k.
    """
    candidates = [_least(column) for column in x.T]
    for j in range(band + side, len(wave) if side > 0 else -1, side):
        near = [q for q in candidates[j] if -reach[1] <= side * (q - k) <= reach[0]]
        if not near:
            return
        k = int(min(near, key=lambda q: float(x[q, j])))
        wave[j] = _refined(x[:, j], k)


def _refined(x: FloatArray, k: int) -> float:
    """Return the place of the minimum of the parabola through sample k and the samples beside k."""
    bend = x[k - 1] - 2.0 * x[k] + x[k + 1]
    return k + (0.5 * float((x[k - 1] - x[k + 1]) / bend) if bend > 0.0 else 0.0)


def _longest(flags: NDArray[np.bool_]) -> int:
    """Return the length of the longest run of true flags."""
    return max((len([*run]) for flag, run in groupby(flags) if flag), default=0)


def median_of(values: FloatArray) -> FloatArray:
    """Return the median of each column, ignoring NaN; NaN for a column of NaN only."""
    some = np.isfinite(values).any(axis=0)
    median = np.full(values.shape[1], np.nan)
    median[some] = np.nanmedian(values[:, some], axis=0)
    return median
