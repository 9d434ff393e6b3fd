"""The report of `worm3d study identify`: the speed range of the worm, its steering, and the accuracy of the map."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from control.identification.identified import Identified, SteeringMap
from scenes.records.text import Cells
from scenes.running.report import Block, Heading, Picture, Table
from scenes.studies.identify.study import GOAL_DEG, Curve


def sentences(identified: Identified, curves: Sequence[Curve], length: float) -> list[str]:
    """Return sentences on the speeds, errors and lags of each map, and on the turn that each curve reaches."""
    lines = []
    for mechanism, found in identified.maps.items():
        lags = identified.lags[mechanism]
        fit, check = found.misfits, found.checks
        low, high = speeds(found)
        lines += [
            f"{mechanism}: steering up to {found.ranges.steering:.3g}; straight ahead {low:.3f} to {high:.3f} body "
            f"lengths/s ({low * length:.3f} to {high * length:.3f} m/s)",
            f"rms of the fit (fresh runs): speed {fit['distance'].rms_percent:.1f} % "
            f"({check['distance'].rms_percent:.1f} %), "
            f"turn {fit['turn'].rms_percent:.1f} % ({check['turn'].rms_percent:.1f} %), that is "
            f"{np.rad2deg(fit['turn'].rms):.2f}° ({np.rad2deg(check['turn'].rms):.2f}°) a wave",
            f"lag: speed {lags.amplitude:.2f} waves, turn rate {lags.steering:.2f} s",
        ]
    lines += [_line(curve) for curve in curves]
    return lines


def speeds(found: SteeringMap) -> tuple[float, float]:
    """Return the lowest and the highest speed straight ahead within the ranges of a map [body lengths/s]."""
    amplitude, frequency = np.meshgrid(
        np.linspace(*found.ranges.amplitude, 21), np.linspace(*found.ranges.frequency, 21)
    )
    speed = found.speed(amplitude, frequency, 0.0)
    return float(speed.min()), float(speed.max())


def page(identified: Identified, curves: Sequence[Curve], picture: str) -> list[Block]:
    """Return the blocks of the page: the figure, a table of the curves, and a table of the errors of the maps."""
    return [
        Heading("How the worm crawls and turns", 1),
        Picture(picture, "Turn, speed and slip against the steering"),
        Table(
            ("steering", "wave", f"speed kept at {GOAL_DEG:g}° a wave", "turn grows up to", "at", "roll there"),
            [_curve_row(curve) for curve in curves],
        ),
        Table(
            ("map", "quantity", "rms of the fit", "of its size", "rms at fresh runs", "worst of them"),
            [row for mechanism, found in identified.maps.items() for row in _accuracy_rows(mechanism, found)],
        ),
    ]


def _accuracy_rows(mechanism: str, found: SteeringMap) -> Iterator[Cells]:
    for name, (unit, scale) in QUANTITY_UNITS.items():
        if name not in found.misfits:
            continue
        fit, check = found.misfits[name], found.checks[name]
        sizes = (f"{scale * fit.rms:.3g}", f"{fit.rms_percent:.1f} %", f"{scale * check.rms:.3g}")
        yield mechanism, f"{name} [{unit}]", *sizes, f"{scale * check.worst:.3g}"


QUANTITY_UNITS = {
    "distance": ("body lengths a wave", 1.0),
    "turn": ("° a wave", float(np.rad2deg(1.0))),
    "drift": ("body lengths a wave", 1.0),
    "roll": ("°", float(np.rad2deg(1.0))),
}


def _curve_row(curve: Curve) -> Cells:
    kept, last = curve.speed_kept, curve.useful[-1]
    share = "not reached" if kept is None else f"{100.0 * kept:.0f} %"
    if len(curve.useful) == 1:
        return curve.mechanism, curve.name, share, _astray(curve), "", ""
    return curve.mechanism, curve.name, share, f"{last.turn_deg:.1f}°", f"{last.steering:g}", f"{last.roll_deg:.0f}°"


def _line(curve: Curve) -> str:
    kept, last = curve.speed_kept, curve.useful[-1]
    name = f"{curve.mechanism}, {curve.name}"
    if len(curve.useful) == 1:
        return f"{name}: {_astray(curve)}"
    reached = f"less than {GOAL_DEG:g}°" if kept is None else f"{GOAL_DEG:g}° at {100.0 * kept:.0f} % of the speed"
    return (
        f"{name}: {reached}; grows up to {last.turn_deg:.1f}° a wave at {last.steering:g} (roll {last.roll_deg:.0f}°)"
    )


def _astray(curve: Curve) -> str:
    """Return a text on a curve whose worm does not turn to the left with little steering."""
    steered = curve.standing[1:]
    if not steered:
        return "the worm tips over from the start"
    least, most = (choose(steered, key=lambda point: point.turn_deg) for choose in (min, max))
    if most.turn_deg <= 0.0:
        return f"turns the other way, by up to {-least.turn_deg:.1f}° a wave at {least.steering:g}"
    wrong = max((point.steering for point in steered if point.turn_deg <= 0.0), default=0.0)
    return (
        f"turns the other way, or not, up to {wrong:g}; then to the left, by up to {most.turn_deg:.1f}° a wave at "
        f"{most.steering:g} (roll {most.roll_deg:.0f}°)"
    )
