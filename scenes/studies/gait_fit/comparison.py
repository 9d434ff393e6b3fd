"""Comparison of a fitted chain of neurons with all recordings, and with a wave whose delays are uniform."""

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
"""Relative random change of all constants of the chain, and number of chains with such changes."""


@dataclass(frozen=True)
class Row:
    """Time from the arrival of a wave at the middle band to its arrival at another band of the body, in a recording."""

    recording: str
    use: str
    """Use of the recording: "fitted", or "predicted" if the fit did not use it."""
    band: str
    delay_s: float
    """Median delay of the recorded waves [s]."""
    low_s: float
    """Lower end of the 90 % bootstrap interval of the median [s]."""
    high_s: float
    """Upper end of the same interval [s]."""
    network_s: float
    """Delay in the fitted chain at the period of the recording [s]."""
    uniform_s: float
    """Delay in a wave with equal delays between neighbouring bands [s]."""

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
        """Whether the error of the network is acceptable.

        A fitted delay may differ from the recorded delay by one video frame. A predicted delay may differ by 1.5
        frames, or lie in the interval of the recorded delay.
        """
        close = abs(self.network_error_s) <= (1.0 if self.use == "fitted" else 1.5) * FRAME
        return close or (self.use == "predicted" and self.low_s <= self.network_s <= self.high_s)


@dataclass(frozen=True)
class Pace:
    """Period of the waves of a recording, and period of the waves of the chain if it is set to this period."""

    recording: str
    use: str
    """As in `Row`."""
    waves: int
    """Number of recorded waves."""
    period_s: float
    """Period of the recorded waves [s]."""
    network_s: float
    """Period of the chain's waves [s]."""


@dataclass(frozen=True)
class Comparison:
    """Results of a comparison."""

    rows: tuple[Row, ...]
    paces: tuple[Pace, ...]
    carried: float
    """Fraction of randomly changed chains with waves in both directions, at the mean period of the
    recordings."""
    told: LeftOut | None = None
    """Errors of predicting each fitted recording from the others; None if only one recording was fitted."""

    def worst(self, use: str, attribute: str) -> float:
        """Return the largest error of the recordings with a given use [s], or NaN if there is no such recording.

        `attribute` is the name of an error of `Row`.
        """
        errors = [abs(getattr(row, attribute)) for row in self.rows if row.use == use]
        return max(errors, default=float("nan"))


def compared(
    gait: EiChain, even: Profile, recordings: Sequence[Recording], fitted: Sequence[str], told: LeftOut | None = None
) -> Comparison:
    """Return the comparison of a chain with recordings.

    Parameters
    ----------
    gait : EiChain
        The fitted chain.
    even : Profile
        The wave with uniform delays.
    recordings : sequence of Recording
    fitted : sequence of str
        Names of the recordings that were used in the fit.
    told : LeftOut, optional
        Errors of predicting each fitted recording from the others.
    """
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
    seed = 20261122  # the random changes differ from the random changes in the fit
    carried = carrying(middling, len(recordings[0].waves.bands), COMPARISON_NOISE, COMPARISON_DRAWS, seed)
    return Comparison(tuple(rows), tuple(paces), carried, told)


def sentences(found: Comparison) -> Iterator[str]:
    """Yield the conclusions of the comparison."""
    for use, allowed in (("fitted", "one frame"), ("predicted", "1.5 frames or the recording's own interval")):
        rows = [row for row in found.rows if row.use == use]
        if rows:
            kept = sum(row.kept for row in rows)
            yield (
                f"recordings {use}: {kept} of {len(rows)} delays within {allowed}; largest error of a delay: "
                f"{1e3 * found.worst(use, 'network_error_s'):.0f} ms with the network, "
                f"{1e3 * found.worst(use, 'uniform_error_s'):.0f} ms with uniform delays"
            )
    if found.told:
        yield from learnt(found.told)
    yield (
        f"noise of {COMPARISON_NOISE:.0%} in all constants: {round(found.carried * COMPARISON_DRAWS)} of "
        f"{COMPARISON_DRAWS} networks, none of which was in the fit, carry waves forward and backward"
    )


def learnt(told: LeftOut) -> Iterator[str]:
    """Yield conclusions from the errors with which each recording is predicted from the other recordings."""
    gain, ends = 1e3 * (told.uniform_s - told.shared_s), [1e3 * end for end in told.gain_s]
    yield (
        f"rms error of the delays of a recording that is left out: {1e3 * told.shared_s:.0f} ms with the delays that "
        f"the other recordings share, {1e3 * told.uniform_s:.0f} ms with uniform delays; difference {gain:.0f} ms, "
        f"90 % interval by sampling {ends[0]:.0f} to {ends[1]:.0f} ms"
    )
    yield (
        "learnt: the size of the delays, the exponent of the period in the delays "
        f"({told.exponents[0]:.2f} to {told.exponents[1]:.2f})"
        f"{' and a profile along the body' if told.learnt else ''}; not learnt: "
        f"{'a separate time constant for each segment' if told.learnt else 'any profile along the body'}"
    )
