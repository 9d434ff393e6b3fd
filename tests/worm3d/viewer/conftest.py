"""Synthetic crawling worms, in plain NumPy: no simulator is involved."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from worm3d.viewer import Frames, plane

L0, B, H0 = 1.0 / 6.0, 0.03, 0.05
LINK = float(np.sqrt(H0**2 + L0**2 / 4.0))


def crawl(
    *,
    segments: int = 6,
    duration: float = 10.0,
    fps: float = 25.0,
    turn: float = 1.0,
    offset: float = B,
    heading: float = 0.0,
    **more: Any,
) -> Frames:
    """Return a worm that crawls in an arc to the left with a retrograde wave; its links are rigid, of length LINK."""
    time = np.linspace(0.0, duration, round(duration * fps) + 1)
    phase = 2.0 * np.pi * (np.arange(segments)[None, :] / segments + time[:, None] / 2.0)
    length = L0 * (1.0 - 0.15 * (1.0 + np.sin(phase)))
    bend = turn * (0.12 + 0.1 * np.sin(phase))
    chamber = length[:, :, None] - offset * bend[:, :, None] * np.array([1.0, -1.0])
    azimuth = heading + np.cumsum(bend, axis=1) - bend / 2.0
    t = np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros_like(azimuth)], axis=2)
    d = np.stack([-np.sin(azimuth), np.cos(azimuth), np.zeros_like(azimuth)], axis=2)
    joints = np.zeros((len(time), segments + 1, 3))
    joints[:, 1:] = np.cumsum(length[..., None] * t, axis=1)
    joints += 0.05 * time[:, None, None] * np.array([np.cos(heading), np.sin(heading), 0.0])
    joints[..., 2] += 0.09
    touching = np.zeros((len(time), segments, 6), dtype=bool)
    touching[:, :, [0, 3]] = chamber.mean(axis=2, keepdims=True) < 0.83 * L0
    arrays: dict[str, Any] = {
        "time": time,
        "joints": joints,
        "apexes": _apexes(joints, d, chamber, offset),
        "directors": d,
        "chamber_strain": chamber / L0 - 1.0,
        "contact_force": np.where(touching[..., None], np.array([0.02, 0.0, 0.1]), 0.0),
        "anchored": touching,
        "com": joints.mean(axis=1),
        "period": 2.0,
    }
    return Frames(**{**arrays, **more})


def _apexes(
    joints: NDArray[np.float64], d: NDArray[np.float64], chamber: NDArray[np.float64], b: float
) -> NDArray[np.float64]:
    middle = 0.5 * (joints[:, 1:] + joints[:, :-1])
    up = np.array([0.0, 0.0, 1.0])
    apexes = np.zeros((*d.shape[:2], 6, 3))
    for c, side in enumerate((1.0, -1.0)):
        h = np.sqrt(LINK**2 - chamber[:, :, c] ** 2 / 4.0)[..., None]
        apexes[:, :, 3 * c] = middle + side * b * d - h * up
        apexes[:, :, 3 * c + 1] = middle + side * b * d + h * up
        apexes[:, :, 3 * c + 2] = middle + side * (b + h) * d
    return apexes


@pytest.fixture(scope="session")
def make_crawl() -> Callable[..., Frames]:
    return crawl


@pytest.fixture(scope="session")
def short() -> Frames:
    """Two seconds of everything that can be shown."""
    centre = crawl(duration=2.0, fps=10.0).centre
    horizon = centre[:, None] + 0.05 * np.arange(1, 9)[None, :, None] * np.array([1.0, 0.3, 0.0])
    x = np.linspace(-0.5, 1.5, 30)
    return crawl(
        duration=2.0,
        fps=10.0,
        path=np.stack([x, 0.3 * x**2, 0.005 + 0.0 * x], axis=1),
        horizon=horizon,
        world=plane(np.array([0.5, 0.2, 0.0]), np.array([0.0, 0.0, 1.0]), length=3.0, width=2.0, tile=0.1),
    )
