"""A fitted chain beside the fitted recordings, beside other recordings, and beside a wave of uniform delays."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from control.gaits.neural.chain import EiChain
from control.gaits.neural.shared import LeftOut, Profile
from control.gaits.neural.training import FRAME
from control.gaits.neural.waves import carrying, timing_of
from scenes.studies.gait_fit.recordings import Recording

COMPARISON_NOISE, COMPARISON_DRAWS = 0.1, 40
"""Relative noise of all constants, and number of networks."""


@dataclass(frozen=True)
class Row:
    """Delay of a band behind the middle band in a recording."""

    recording: str
    use: str
    """Use of the recording: fitted or predicted."""
    band: str
    delay_s: float
    """Median of the recording's waves [s]."""
    low_s: float
    high_s: float
    """Bootstrap interval of 90 % of the median [s]."""
    network_s: float
    """Delay of the fitted chain at the recording's pace [s]."""
    uniform_s: float
    """Delay of a wave of uniform delays [s]."""

    @property
    def network_error_s(self) -> float:
        """Error of the network [s]."""
        return self.network_s - self.delay_s

    @property
    def interval_text(self) -> str:
        """The bootstrap interval [ms]."""
        return f"{1e3 * self.low_s:.0f} to {1e3 * self.high_s:.0f}"

    @property
    def uniform_error_s(self) -> float:
        """Error of the uniform wave [s]."""
        return self.uniform_s - self.delay_s

    @property
    def kept(self) -> bool:
        """Whether the network is within one frame; for predictions, within 1.5 frames or the recording's interval."""
        close = abs(self.network_error_s) <= (1.0 if self.use == "fitted" else 1.5) * FRAME
        return close or (self.use == "predicted" and self.low_s <= self.network_s <= self.high_s)


@dataclass(frozen=True)
class Pace:
    """Period of the waves of a recording, and period of the chain at the same pace."""

    recording: str
    use: str
    waves: int
    period_s: float
    network_s: float


@dataclass(frozen=True)
class Comparison:
    """Results of a fit."""

    rows: tuple[Row, ...]
    paces: tuple[Pace, ...]
    carried: float
    """Share of noisy chains that carry waves both ways, at the middle pace of the recordings."""
    told: LeftOut | None = None
    """How well the fitted recordings predict each other; None for a single recording."""

    def worst(self, use: str, attribute: str) -> float:
        """Return the largest error of the recordings with a given use [s]; NaN if there are none."""
        errors = [abs(getattr(row, attribute)) for row in self.rows if row.use == use]
        return max(errors, default=float("nan"))


def compared(
    gait: EiChain, even: Profile, recordings: Sequence[Recording], fitted: Sequence[str], told: LeftOut | None = None
) -> Comparison:
    """Return the comparison of a chain and of a wave of uniform delays, `even`, with recordings."""
    rows, paces = [], []
    for each in recordings:
        waves, use = each.waves, "fitted" if each.name in fitted else "predicted"
        timing = timing_of(replace(gait, period=waves.period), len(waves.bands))
        medians, (low, high) = waves.median(), waves.interval()
        uniform = even.delays(waves.period)
        for k, band in enumerate(waves.bands):
            if k != waves.middle:
                numbers = (float(series[k]) for series in (medians, low, high, timing.delays, uniform))
                rows.append(Row(each.name, use, band, *numbers))
        paces.append(Pace(each.name, use, len(waves.times), waves.period, timing.period))
    middling = replace(gait, period=float(np.exp(np.mean([np.log(pace.period_s) for pace in paces]))))
    seed = 20261122  # the fit has other draws
    carried = carrying(middling, len(recordings[0].waves.bands), COMPARISON_NOISE, COMPARISON_DRAWS, seed)
    return Comparison(tuple(rows), tuple(paces), carried, told)


def sentences(found: Comparison) -> Iterator[str]:
    """Yield the conclusions of the comparison."""
    for use, allowed in (("fitted", "one frame"), ("predicted", "1.5 frames or the recording's own interval")):
        rows = [row for row in found.rows if row.use == use]
        if rows:
            kept = sum(row.kept for row in rows)
            yield (
                f"recordings {use}: {kept} of {len(rows)} delays within {allowed}, the worst "
                f"{1e3 * found.worst(use, 'network_error_s'):.0f} ms off; uniform delays "
                f"{1e3 * found.worst(use, 'uniform_error_s'):.0f} ms"
            )
    if found.told:
        yield from learnt(found.told)
    yield (
        f"noise of {COMPARISON_NOISE:.0%} in all constants: {round(found.carried * COMPARISON_DRAWS)} of "
        f"{COMPARISON_DRAWS} networks, none of them of the fit, carry waves forward and backward"
    )


def learnt(told: LeftOut) -> Iterator[str]:
    """Yield the conclusions about learning from the errors with one recording left out at a time."""
    gain, ends = 1e3 * (told.uniform_s - told.shared_s), [1e3 * end for end in told.gain_s]
    yield (
        f"a recording left out is missed by {1e3 * told.shared_s:.0f} ms rms with the delays that the others "
        f"share, by {1e3 * told.uniform_s:.0f} ms with uniform ones: {gain:.0f} ms less, {ends[0]:.0f} to "
        f"{ends[1]:.0f} with a probability of 90 % by sampling"
    )
    yield (
        f"learnt: the size of the delays, the exponent of pace ({told.exponents[0]:.2f} to {told.exponents[1]:.2f})"
        f"{' and a profile along the body' if told.learnt else ''}; not learnt: "
        f"{'a time constant of each segment by itself' if told.learnt else 'any profile along the body'}"
    )
