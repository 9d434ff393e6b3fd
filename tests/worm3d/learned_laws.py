"""Files of learned segment laws for tests: fits to an energy in closed form, and their evaluation with NumPy."""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from worm3d.values.arrays import FloatArray

L0, B, H0, K, MOST = 1.0 / 6.0, 0.03, 0.05, 13.0, 0.45
"""Rest length, offset, half-height [m] and stiffness [N] of the default worm, and greatest contraction of the law."""
R0 = float(np.hypot(H0, B))
SCALES = {
    "x_mid": 0.85,
    "x_half": 0.35,
    "y_mid": 0.225,
    "y_half": 0.225,
    "energy_J": K * L0 / 4.0,
    "radius_mid_m": 1.15 * R0,
    "radius_m": 0.2 * R0,
}
BENDING = [0.02, 0.004, 0.006, 0.001, -0.002, 0.003]


def true_energy(length: FloatArray, contraction: FloatArray) -> FloatArray:
    """Return the energy of a chamber: a spring that stiffens with its strain and with the contraction [J]."""
    s = 1.0 - length / (L0 * (1.0 - contraction))
    found: FloatArray = s**2 * K * L0 / 4.0 * (1.0 + 0.8 * s**2 + 0.5 * contraction)
    return found


def true_radius(length: FloatArray, contraction: FloatArray) -> FloatArray:
    """Return a radius that grows with the contraction at constant length, and with shortening [m]."""
    found: FloatArray = R0 * (1.0 + 0.4 * contraction + 0.35 * (1.0 - length / L0))
    return found


def _layer(weights: FloatArray, bias: FloatArray, x: FloatArray) -> FloatArray:
    found: FloatArray = weights @ x + bias[:, None]
    return found


def _bent(v: FloatArray) -> FloatArray:
    found: FloatArray = v / np.sqrt(1.0 + v**2)
    return found


def _fitted(sizes: list[int], inputs: FloatArray, wanted: FloatArray) -> list[float]:
    """Return the weights of the best of 200 networks: the last layer by least squares, the other layers at random."""
    rng, best, least = np.random.default_rng(1), list[float](), np.inf
    for _ in range(200):
        x, weights = inputs, list[float]()
        for old, new in pairwise(sizes[:-1]):
            matrix, bias = rng.normal(size=(new, old)), rng.normal(size=new)
            x = _bent(_layer(matrix, bias, x))
            weights += [*matrix.ravel(), *bias]
        features = np.vstack([x, np.ones(x.shape[1])]).T
        last = np.linalg.lstsq(features, wanted, rcond=None)[0]
        error = float(np.abs(features @ last - wanted).max())
        if error < least:
            best, least = [*weights, *last], error
    return [float(weight) for weight in best]


def law() -> dict[str, Any]:
    """Return the content of a file of a law, fitted to `true_energy` and `true_radius`."""
    grid = np.meshgrid(np.linspace(0.5, 1.2, 30) * L0, np.linspace(0.0, MOST, 30))
    length, a = (each.ravel() for each in grid)
    inputs = np.array([(length / L0 - SCALES["x_mid"]) / SCALES["x_half"], (a - SCALES["y_mid"]) / SCALES["y_half"]])
    s = 1.0 - length / (L0 * (1.0 - a))
    table = np.linspace(0.0, MOST, 6)
    return {
        "kind": "worm3d segment law",
        "version": 1,
        "rest_length_m": L0,
        "chamber_offset_m": B,
        "plate_radius_m": 0.05,
        "rest_radius_m": R0,
        "input": {"name": "pressure", "unit": "Pa", "contraction": table.tolist(), "value": (4e3 * table).tolist()},
        "free_volume_m3": None,
        "stiffness_N": K,
        "scales": SCALES,
        "energy": {"sizes": [2, 6, 6, 1], "weights": _fitted([2, 6, 6, 1], inputs, 0.8 * s**2 + 0.5 * a)},
        "radius": {
            "sizes": [2, 6, 1],
            "weights": _fitted([2, 6, 1], inputs, (true_radius(length, a) / R0 - 1.15) / 0.2),
        },
        "bending_Nm": BENDING,
        "domain": {"length_m": [0.5 * L0, 1.2 * L0], "contraction": [0.0, MOST]},
        "ensemble": [],
        "spread": {"force_N": 0.1, "radius_m": 1e-4},
        "errors": {},
        "source": "an energy in closed form",
        "table_sha256": "",
        "made": "by a test",
    }


def written(folder: Path, content: dict[str, Any] | None = None, name: str = "barrel.json") -> Path:
    """Write a law to a file, and return the path."""
    path = folder / name
    path.write_text(json.dumps(law() if content is None else content))
    return path


def without_network(content: dict[str, Any]) -> dict[str, Any]:
    """Return a law whose energy and bending are those of the spring (E4)."""
    return {**content, "energy": {"sizes": [2, 6, 6, 1], "weights": [0.0] * 67}, "bending_Nm": [0.0] * 6}


def _network(given: dict[str, Any], inputs: FloatArray) -> FloatArray:
    """Return the output of a network, in matrices; independent of `worm3d.physics.segment_laws.network`."""
    x, rest = inputs, np.array(given["weights"])
    for k, (old, new) in enumerate(zip(given["sizes"][:-1], given["sizes"][1:], strict=True)):
        weights, bias, rest = np.split(rest, [old * new, old * new + new])
        x = _layer(weights.reshape(new, old), bias, x)
        x = x if k == len(given["sizes"]) - 2 else _bent(x)
    return x[0]


def evaluated(content: dict[str, Any], length: FloatArray, contraction: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return energy [J] and radius [m] of chambers according to the file."""
    c, l0 = content["scales"], content["rest_length_m"]
    inputs = np.array([(length / l0 - c["x_mid"]) / c["x_half"], (contraction - c["y_mid"]) / c["y_half"]])
    s = 1.0 - length / (l0 * (1.0 - contraction))
    energy = s**2 * (content["stiffness_N"] * l0 / 4.0 + c["energy_J"] * _network(content["energy"], inputs))
    return energy, c["radius_mid_m"] + c["radius_m"] * _network(content["radius"], inputs)


def bending_stiffness(content: dict[str, Any], length: FloatArray, contraction: FloatArray) -> FloatArray:
    """Return m of a segment according to the file [N m/rad]."""
    c = content["scales"]
    x, y = (length / content["rest_length_m"] - c["x_mid"]) / c["x_half"], (contraction - c["y_mid"]) / c["y_half"]
    terms = np.array([np.ones_like(x), x, y, x**2, x * y, y**2])
    return np.tensordot(np.array(content["bending_Nm"]), terms, axes=1)
