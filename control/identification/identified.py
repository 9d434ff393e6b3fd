"""Where identified worms are kept: the default worm's with this package, others in the user's cache.

A file is named by a key of everything that it depends on: the parameters of worm, ground and schedule, and the design
of the runs.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import numpy as np

from control.gaits.steering import Mechanism, Schedule
from control.identification.fit import Design, Identified
from worm3d import Actuator, Coulomb, FirstOrder, Friction, FrictionLaw, Worm
from worm3d.machine import cache

FORMAT = 2
"""Of the files."""
FOLDER, SUFFIX = "identified", ".map"
"""In the user's cache."""
SHIPPED = Path(__file__).parent / "worms"
"""Folder of the files that come with the package, as `as_json` writes them."""

GREATEST: dict[Mechanism, float] = {"hinge": 0.12, "bias": 0.06}
"""Steering up to which the default worm is identified: it stays on its feet with room to spare."""

Part = Actuator | FrictionLaw
"""What is one of several classes."""
DEFAULTS: dict[str, Part] = {"law": Coulomb(), "actuator": FirstOrder(), "hinge_actuator": FirstOrder()}
"""Default parts of a worm and a ground."""


def key(worm: Worm, ground: Friction, schedule: Schedule, design: Design) -> str:
    """Return what names the file of a worm on a ground."""
    content = {
        "format": FORMAT,
        "worm": parameters(worm),
        "ground": parameters(ground),
        "schedule": asdict(schedule),
        "design": asdict(design),
        "greatest": GREATEST,
    }
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:24]


def parameters(thing: Worm | Friction | Part) -> dict[str, Any]:
    """Return the fields of a worm or ground as JSON can hold them; equal entries of an array become one number.

    Default parts go without saying: what was identified before there were others is found.
    """
    found = {field.name: _plain(getattr(thing, field.name)) for field in fields(thing)}
    return {name: value for name, value in found.items() if name not in DEFAULTS or value != _plain(DEFAULTS[name])}


def load(
    worm: Worm, ground: Friction | None = None, schedule: Schedule | None = None, design: Design | None = None
) -> Identified | None:
    """Return what is known of a worm on a ground; None if it has not been identified (`worm3d identify`).

    Parameters
    ----------
    worm : Worm
    ground : Friction, optional
    schedule : Schedule, optional
    design : Design, optional
        The defaults if left out.
    """
    name = key(worm, ground or Friction(), schedule or Schedule(), design or Design())
    shipped = SHIPPED / f"{name}.json"
    content = shipped.read_bytes() if shipped.is_file() else cache.load(cache.folder(FOLDER), name, SUFFIX)
    return None if content is None else Identified.from_dict(json.loads(content))


def store(identified: Identified, worm: Worm, ground: Friction, design: Design, folder: Path | None = None) -> bool:
    """Keep what was found, in the user's cache or another folder; return whether that was possible."""
    name = key(worm, ground, identified.schedule, design)
    return cache.store(folder or cache.folder(FOLDER), name, as_json(identified).encode(), SUFFIX)


def as_json(identified: Identified) -> str:
    """Return what was found as text, as the files that come with the package hold it."""
    return json.dumps(identified.as_dict(), indent=1, allow_nan=False) + "\n"


def _plain(value: Any) -> Any:
    if isinstance(value, Part):
        return {"name": value.name or type(value).__qualname__, **parameters(value)}
    if isinstance(value, np.ndarray):
        return float(value.flat[0]) if value.size and (value == value.flat[0]).all() else value.tolist()
    if isinstance(value, tuple):
        return list(map(_plain, value))
    return value if value is None or isinstance(value, bool | int) or np.isfinite(value) else repr(value)
