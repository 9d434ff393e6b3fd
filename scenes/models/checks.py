"""Checks for the scenes of several models: time steps, gait, memory."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from control.gaits import FeedbackGait, Gait
from scenes.language.checks import Check, Found
from scenes.language.schema import Section, keys_in
from scenes.language.toml import shown
from scenes.models.sections import gait_from
from worm3d.values import named, time_steps
from worm3d.values.arguments import MOST_MEMORY

AMPLITUDE_KEY = "gait.amplitude"

BODY = ("worm.half_height_m", "worm.length_m", "worm.segments")
"""Keys that determine the reach of the links of a chamber."""

CHECKING_METHODS = {"worm.segments": "require_body", "run.dt_s": "require_steps", "worm.stroke": "require_stroke"}
"""Methods of a gait that raise an error if the gait does not fit the value of a key."""


def _step_fits_run(dt_s: float, duration_s: float) -> Found:
    if time_steps.fits(dt_s, duration_s):
        return None
    return {
        "run.dt_s": f"got {dt_s} s: must be at most run.duration_s ({duration_s} s)",
        "run.duration_s": f"got {duration_s} s: must be at least run.dt_s ({dt_s} s)",
    }


def _recorded_to_the_end(record_every: int, duration_s: float, dt_s: float) -> Found:
    ratio = duration_s / dt_s
    if ratio < 0.5 or ratio > 1e12:
        return None  # other checks report this
    steps = max(1, round(ratio))
    if record_every > steps:
        text = f"must be at most run.duration_s / run.dt_s, the {steps} steps of the run"
    elif steps % record_every:
        below = _greatest_divisor(steps, record_every)
        text = (
            f"must divide the {steps} steps of the run (run.duration_s / run.dt_s), or its last state is not stored; "
            f"{below} does"
        )
    else:
        return None
    found = f"run.record_every ({record_every}) {text}"
    return {
        "run.record_every": f"got {record_every}: {text}",
        "run.duration_s": f"got {duration_s} s: {found}",
        "run.dt_s": f"got {dt_s} s: {found}",
    }


def _greatest_divisor(number: int, most: int) -> int:
    """Return the largest divisor of a number of at most 1e12 that is not larger than `most`."""
    small = [n for n in range(1, min(most, math.isqrt(number)) + 1) if number % n == 0]
    return max(divisor for n in small for divisor in (n, number // n) if divisor <= most)


def too_much_memory(
    needed: float,
    steps: float,
    segments: int,
    remedy: str = "a shorter run.duration_s, a longer run.dt_s or fewer worm.segments",
) -> Found:
    """Return an error if a run needs more memory than allowed; `needed` is the memory of the run in bytes."""
    if needed <= MOST_MEMORY:
        return None
    text = (
        f"got {steps:.3g} steps of {segments} segments, about {needed / 1e9:.3g} GB of memory: must be at most "
        f"{MOST_MEMORY / 1e9:g} GB; use {remedy}"
    )
    keys = ("run.dt_s", "run.duration_s", "worm.segments")
    return dict.fromkeys(keys, text)


def memory_check(bytes_per_step: Callable[[int], float]) -> Check:
    """Return the check that a run fits into memory, for a model that keeps every step until the end of the run."""

    def fits(dt_s: float, duration_s: float, segments: int) -> Found:
        steps = duration_s / dt_s
        return too_much_memory(steps * bytes_per_step(segments), steps, segments)

    return Check(("run.dt_s", "run.duration_s", "worm.segments"), fits)


RUN_CHECKS = (
    Check(("run.dt_s", "run.duration_s"), _step_fits_run),
    Check(("run.record_every", "run.duration_s", "run.dt_s"), _recorded_to_the_end),
)


Refusals = tuple[type[Exception], ...]


def building(make: Callable[..., object], *needs: str, refusals: Refusals = (ValueError,)) -> Check:
    """Return the check that the function `make` accepts the values of the sections and keys `needs`.

    `make` raises an error of a type in `refusals` if it does not. The error is reported at the keys that its message
    names, or at the first key of `needs` if the message names none.
    """
    return Check(needs, partial(_refused, make=make, needs=needs, refusals=refusals), builds=True)


def _refused(*values: Any, make: Callable[..., object], needs: tuple[str, ...], refusals: Refusals) -> Found:
    try:
        with np.errstate(all="ignore"):
            make(*values)
    except refusals as error:
        own = any(named.is_own(str(getattr(value, "kind", ""))) for value in values)
        if own and str(error).partition(":")[0] not in _keys(zip(needs, values, strict=True)):
            raise  # the caller adds the name of the user's own part
        single = [need for need, value in zip(needs, values, strict=True) if not isinstance(value, Section)]
        return by_key(str(error), _keys(zip(needs, values, strict=True)), single)
    return None


def _keys(needed: Iterable[tuple[str, Any]]) -> dict[str, str]:
    """Return the key of the scene for each parameter of a part.

    A parameter is listed by its name and as `section.name`. A name is left out if several keys of a section have it.
    """
    keys: dict[str, str] = {}
    for need, value in needed:
        if isinstance(value, Section):
            pairs = [(name, key) for key, known in keys_in(type(value)).items() for name in known.parameters]
            times = Counter(name for name, _ in pairs)
            single = {name: f"{need}.{key}" for name, key in pairs if times[name] == 1}
            keys = {**single, **keys, **{f"{need}.{name}": key for name, key in single.items()}}
        else:
            keys[need.partition(".")[2].removesuffix("_s")] = need
    return keys


def gait_checks(
    gait: type[Section], worm: type[Section], *, unlimited: tuple[str, ...] = (), can_sense: bool = True
) -> tuple[Check, ...]:
    """Return the checks that the section [gait] describes a valid gait, and that the worm of [worm] can perform it.

    Parameters
    ----------
    gait, worm : type
        Schemas of the two sections.
    unlimited : tuple of str
        Keys of the gait whose limits the model checks itself; the checks ignore their values.
    can_sense : bool
        Whether the model has sensor signals for the gait.
    """

    def ask(limit: Any, section: Any, *, method: str) -> None:
        getattr(gait_from(replace(section, **dict.fromkeys(unlimited, 0.0)), dt=1.0), method)(limit)

    stroke = ("worm.stroke",) if "stroke" in keys_in(worm) else ()
    body = (*BODY, *stroke, AMPLITUDE_KEY)
    has_links = "half_height_m" in keys_in(worm)
    keys = ("run.dt_s", *(f"worm.{key}" for key in keys_in(worm)))
    return (
        *(
            building(partial(ask, method=method), key, "gait")
            for key, method in CHECKING_METHODS.items()
            if key in keys
        ),
        *([] if can_sense else [Check(("gait",), _senses_nothing)]),
        *([Check((*body, "gait"), partial(_links_reach, body=body))] if has_links else []),
    )


def _asked(section: Any) -> Gait | None:
    """Return the gait of a section, or None if the gait is invalid, which another of the `gait_checks` reports."""
    with suppress(ValueError):
        return gait_from(section, dt=1.0)
    return None


def _senses_nothing(section: Any) -> Found:
    """Return an error for a gait that needs sensor signals, in a model without sensors."""
    gait = _asked(section)
    if not isinstance(gait, FeedbackGait) or not gait.senses:
        return None
    return {"gait.kind": f"got {gait.name!r}: it senses {', '.join(gait.senses)}; use model = 'worm_planar' or 'worm'"}


def _links_reach(*values: Any, body: tuple[str, ...]) -> Found:
    """Return an error for a gait that lengthens a chamber to more than its links allow."""
    given = dict(zip(body, values, strict=False))
    half_height_m, length_m, segments = (given[key] for key in BODY)
    gait = _asked(values[-1])
    if gait is None or not gait.lengthens:
        return None
    l0 = length_m / segments
    half_height = math.sqrt(3.0) / 4.0 * l0 if half_height_m is None else float(np.min(half_height_m))
    stroke = given.get("worm.stroke", (-math.inf, math.inf))
    longest = l0 * (1.0 + min(gait.amplitude * (1.0 + abs(gait.bias)), -stroke[0]))
    reach = 2.0 * math.hypot(half_height, l0 / 2.0)
    if longest < reach:
        return None
    what, one_of = (
        ("chamber", f"one of {AMPLITUDE_KEY} and -worm.stroke[0]")
        if "worm.stroke" in given
        else ("segment", AMPLITUDE_KEY)
    )
    text = (
        f"the gait lengthens a {what} to {longest:.4g} m, but its links end at {reach:.4g} m; "
        f"keep {one_of} below {reach / l0 - 1.0:.4g}, or let the gait only contract"
    )
    switches = {f"gait.{key}": value for key, value in values[-1] if isinstance(value, bool)}
    given |= {"gait.kind": values[-1].kind, **switches}
    keys = (AMPLITUDE_KEY, "worm.stroke", "worm.half_height_m", "gait.kind", *switches)
    return {key: f"got {shown(given[key])}: {text}" for key in keys if key in given}


def in_keys(sentence: str, keys: Mapping[str, str]) -> str:
    """Return a message with the names of parameters replaced by the keys of the scene.

    Only names with an underscore are replaced, since other names may be ordinary words.
    """
    for parameter, key in keys.items():
        if "_" in parameter:
            sentence = sentence.replace(parameter, key)
    return sentence


def by_key(sentence: str, keys: Mapping[str, str], single: Collection[str] = ()) -> Found:
    """Return an error message of a part, `parameter: got ...`, for the key of each parameter that the message names.

    If the message does not begin with a parameter in `keys`, return it as a text. If the first parameter belongs to a
    section, the other parameters are sought only among the keys of this section and among the keys `single`.
    """
    subject, _, rest = sentence.partition(": ")
    if subject not in keys:
        return in_keys(sentence, keys)
    section = keys[subject].partition(".")[0]
    near = keys
    if keys[subject] not in single:
        near = {name: key for name, key in keys.items() if key in single or key.startswith(f"{section}.")}
    others = [key for name, key in near.items() if re.search(rf"(?<!\bat )\b{name}\b", rest)]  # not "at least"
    rest = in_keys(rest, near)
    return {**dict.fromkeys(others, f"{keys[subject]}: {rest}"), keys[subject]: rest}
