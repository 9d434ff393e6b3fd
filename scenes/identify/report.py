"""What `worm3d identify` says: how fast the worm can go, how it steers, and how good the map is."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from control.identification import Identified, SteeringMap
from scenes.identify.study import GOAL_DEG, Curve


def terminal_lines(identified: Identified, curves: Sequence[Curve], length: float) -> list[str]:
    """Return the lines for a person."""
    lines = []
    for mechanism, found in identified.maps.items():
        lags = identified.lags[mechanism]
        fit, check = found.misfits, found.checks
        low, high = speeds(found)
        lines += [
            f"{mechanism}: steering up to {found.ranges.steering:.3g}; straight ahead {low:.3f} to {high:.3f} body lengths/s "
            f"({low * length:.3f} to {high * length:.3f} m/s)",
            f"  fit, rms (fresh runs): speed {fit['distance'].rms_percent:.1f} % ({check['distance'].rms_percent:.1f} %), "
            f"turn {fit['turn'].rms_percent:.1f} % ({check['turn'].rms_percent:.1f} %), that is "
            f"{np.rad2deg(fit['turn'].rms):.2f}° ({np.rad2deg(check['turn'].rms):.2f}°) a wave",
            f"  lag: speed {lags.amplitude:.2f}, turn rate {lags.steering:.2f} waves",
        ]
    lines += [_line(curve) for curve in curves]
    return lines


def speeds(found: SteeringMap) -> tuple[float, float]:
    """Return the least and greatest speed straight ahead within the map's ranges [body lengths/s]."""
    amplitude, frequency = np.meshgrid(
        np.linspace(*found.ranges.amplitude, 21), np.linspace(*found.ranges.frequency, 21)
    )
    speed = found.speed(amplitude, frequency, 0.0)
    return float(speed.min()), float(speed.max())


def content(identified: Identified, curves: Sequence[Curve], worm: dict[str, Any], ground: dict[str, Any]) -> Any:
    """Return what `identified.json` holds."""
    return {
        "worm": worm,
        "ground": ground,
        **identified.as_dict(),
        "speed_range_bl_s": {mechanism: speeds(found) for mechanism, found in identified.maps.items()},
        "curves": [curve.as_dict() for curve in curves],
    }


def _line(curve: Curve) -> str:
    last = curve.useful[-1]
    kept = curve.speed_kept
    reached = (
        f"{GOAL_DEG:g}° a wave at {100.0 * kept:.0f} % of the speed" if kept is not None else "less than 10° a wave"
    )
    return (
        f"{curve.mechanism}, {curve.name}: {reached}; grows up to {last.turn_deg:.1f}° at {last.steering:g} "
        f"(roll {last.roll_deg:.0f}°)"
    )
