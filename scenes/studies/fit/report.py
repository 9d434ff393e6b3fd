"""The report of a fit: the printed text, `fit.json`, `fit.toml` and `fit.png`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

from scenes.records.text import Column, json_bytes
from scenes.running.report import Block, Items, Report, Table
from scenes.running.terminal import counted
from scenes.studies.fit.fitting import Fit, Fitted
from scenes.studies.fit.lack import LIMIT, Lack
from scenes.studies.fit.noise import HIGHEST_ORDER

MAX_LISTED_CHANNELS = 8
"""Largest number of channels whose residuals are printed in the terminal."""


KEY_COLUMNS = {
    "key": Column("varied.key"),
    "value": Column("value", ".5g"),
    "95 % interval": Column("interval_text"),
    "start": Column("varied.start", ".5g"),
    "unit": Column("unit"),
}
CHANNEL_COLUMNS = {
    "residuals of": Column("name"),
    "rms": Column("residual_rms", ".3g"),
    "of the peak": Column("residual_rms_over_peak", ".2%"),
    "autocorrelation at lag 1": Column("residual_autocorrelation_at_one_sample", ".2f"),
}
"""Columns of the two tables that are printed in the terminal."""


def report(fit: Fit) -> Report:
    """Return the report of a fit."""
    from scenes.studies.fit.figure import draw  # imports matplotlib

    return Report(
        said=list(_said(fit)),
        files={"fit.json": json_bytes(content(fit)), "fit.toml": scene(fit).encode()},
        pictures={"fit.png": draw(fit)[0]},
        warnings=list(warnings(fit)),
    )


def _said(fit: Fit) -> Iterator[Block]:
    yield f"{fit.name} to {fit.measured}: {outcome(fit)}"
    yield Table.of(KEY_COLUMNS, fit.keys)
    yield Items([f"{each.varied.key}: no interval, {each.reason}" for each in fit.keys if each.reason])
    yield Table.of(CHANNEL_COLUMNS, fit.channels[:MAX_LISTED_CHANNELS])
    if len(fit.channels) > MAX_LISTED_CHANNELS:
        yield f"and {counted(len(fit.channels) - MAX_LISTED_CHANNELS, 'channel')} more, in fit.json"
    if fit.left_out:
        yield f"left out {counted(len(fit.left_out), 'channel')} that no key moves, listed in fit.json"


def warnings(fit: Fit) -> Iterator[str]:
    """Yield the reasons to doubt the values or their intervals."""
    if not fit.finished:
        yield f"the minimum was not found within {counted(fit.runs, 'run')}: start nearer to it, or allow more --runs"
    if fit.exact:
        yield (
            "the data are met exactly, but for errors of integration: they are a simulation's own, without noise, and "
            "an interval of a value would mean nothing"
        )
    yield from (relation.sentence for relation in fit.relations)
    long = [channel.name for channel in fit.channels if channel.order_of_residuals == HIGHEST_ORDER and not fit.exact]
    if fit.lack.found:
        yield from doubts(fit.lack)
    elif long:
        yield (
            f"the residuals of {', '.join(long[:MAX_LISTED_CHANNELS])} are alike for longer than {HIGHEST_ORDER} "
            "samples, so the scene lacks something that the data have: intervals are those of a wrong model"
        )


def doubts(lack: Lack) -> Iterator[str]:
    """Yield sentences that explain a lack of fit, and advice."""
    yield (
        f"the scene does not follow the data: the model misses more than the noise explains, the slow part of the "
        f"residuals has {max(lack.ratio, lack.likely):.3g} times the power of noise; intervals are widened "
        f"{lack.widening:.2g} times and by what the first suspect would move the values, but hold for no wrong model: "
        "look at the residuals in fit.png"
    )
    if named := lack.suspects.named:
        yield (
            "vary next what takes most of the residuals' squares away: "
            f"{'; '.join(each.sentence for each in named)}{'' if lack.suspects.found else '; it may be something else'}"
        )
    else:
        yield "no other key that was tried takes the residuals away: the scene lacks something else"


def outcome(fit: Fit) -> str:
    """Return a short text that says how the fit ended."""
    how = "fitted" if fit.finished else "unfinished"
    failed = f", {fit.failed_runs} of them failed" if fit.failed_runs else ""
    return f"{how} ({counted(fit.runs, 'run')}{failed}; {counted(fit.measured_values, 'measured value')})"


def content(fit: Fit) -> dict[str, Any]:
    """Return the content of `fit.json`."""
    return {
        "status": "done" if fit.finished else "unfinished",
        "scene": fit.name,
        "measured": fit.measured,
        "runs": fit.runs,
        "failed_runs": fit.failed_runs,
        "measured_values": fit.measured_values,
        "met_exactly": fit.exact,
        "lack_of_fit": _lack(fit.lack),
        "keys": [_key(each) for each in fit.keys],
        "correlation": fit.correlation.tolist(),
        "cannot_tell_apart": [asdict(each) | {"sentence": each.sentence} for each in fit.relations],
        "channels": [asdict(each) for each in fit.channels],
        "left_out": fit.left_out,
        "warnings": list(warnings(fit)),
    }


def scene(fit: Fit) -> str:
    """Return the scene with the fitted values as TOML. Comments at the top list the fitted keys."""
    head = [f"# {fit.name} with values fitted to {fit.measured}:", *(f"# {_told(each)}" for each in fit.keys), ""]
    return "\n".join([*head, fit.scene])


def _lack(lack: Lack) -> dict[str, Any]:
    return {
        "found": lack.found,
        "slow_over_noise_power": lack.ratio,
        "slow_over_likely_noise_power": lack.likely,
        "limit": LIMIT,
        "chance_of_noise": lack.chance,
        "chance_of_noise_like_a_suspect": lack.suspects.chance,
        "intervals_widened": lack.widening,
        "suspects": [
            {"what": each.what, "value": each.value, "larger": each.larger, "share_of_squares": each.share}
            for each in lack.suspects.named
        ],
    }


def _key(each: Fitted) -> dict[str, Any]:
    low, high = each.interval or (None, None)
    found = {"key": each.varied.key, "unit": each.varied.unit, "start": each.varied.start, "value": each.value}
    found |= {"standard_error": each.standard_error, "low_95": low, "high_95": high}
    found |= {"least_allowed": each.varied.low, "greatest_allowed": each.varied.high}
    return found | {"reason": each.reason or None}


def _told(each: Fitted) -> str:
    if each.interval is None:
        return f"{each.varied.key} = {each.value:.6g}: no interval, {each.reason}"
    return f"{each.varied.key} = {each.value:.6g}, with a probability of 95 % from {each.interval_text}"
