"""Worms that several tests of the planar linkage use."""

import json
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import least_squares

from planar import linkage
from planar.published_worm import NET_HALF_BANDWIDTH, Net


@pytest.fixture(scope="session")
def default_worm() -> linkage.Linkage:
    """Return the planar sibling of the default worm (no hinge springs)."""
    return linkage.Linkage(half_height=0.05, mass=0.1, k_torsion=10.0, k_apex=0.0)


@pytest.fixture(scope="session")
def uneven_worm() -> linkage.Linkage:
    """Return a worm in which every parameter counts and differs along the body."""
    rng = np.random.default_rng(3)
    return linkage.Linkage(
        segments=4,
        length=0.8,
        half_height=rng.uniform(0.05, 0.09, 4),
        mass=0.1,
        apex_mass_fraction=0.3,
        k_spring=rng.uniform(5.0, 30.0, 4),
        k_torsion=rng.uniform(1.0, 4.0, 3),
        cross0=rng.uniform(-0.1, 0.1, 3),
        k_apex=rng.uniform(0.05, 0.2, 4),
        kelvin_voigt_time=0.03,
        drag=0.2,
    )


@pytest.fixture
def dense_hessian() -> Callable[[Net, np.ndarray], np.ndarray]:
    """Return a function that gives the Hessian of a net as a full matrix."""

    def dense(net: Net, q: np.ndarray) -> np.ndarray:
        band = net.p7_gradient_and_band(q)[1]
        rows, columns = np.indices((q.size, q.size))
        offset = NET_HALF_BANDWIDTH + rows - columns
        inside = (offset >= 0) & (offset <= 2 * NET_HALF_BANDWIDTH)
        return np.where(inside, band[np.clip(offset, 0, 2 * NET_HALF_BANDWIDTH), columns], 0.0)

    return dense


L0, K, HALF_WIDE = 0.16, 13.0, 0.02
"""Length [m] and stiffness [N] at rest of the segment behind the learned law, and R_scale [m] of the law."""


def true_radius(length: np.ndarray, contraction: np.ndarray) -> np.ndarray:
    """Return the radius [m] of a segment that widens as it shortens, and by the pressure."""
    return 0.05 * (L0 / length) ** 0.7 * (1.0 + 0.5 * contraction)


def true_energy(length: np.ndarray, contraction: np.ndarray) -> np.ndarray:
    """Return the energy [J] of a segment that stiffens with the pressure and with the strain."""
    strain = 1.0 - length / (L0 * (1.0 - contraction))
    return strain**2 * (K * L0 / 2.0) * (1.0 + 1.5 * contraction + 0.5 * strain**2)


def by_matrices(weights: np.ndarray, layers: int, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return N(x, y) with matrices, row by row as in the file of a segment law."""
    value, at = np.stack([x, y]), 0
    for rows in [6] * layers + [1]:
        matrix = weights[at : at + rows * len(value)].reshape(rows, len(value))
        at += matrix.size
        value, at = matrix @ value + weights[at : at + rows, None], at + rows
        if rows > 1:
            value = value / np.sqrt(1.0 + value**2)
    return value[0]


def fitted(layers: int, target: np.ndarray, x: np.ndarray, y: np.ndarray) -> list[float]:
    """Return weights with which a network has the values `target`."""
    start = 0.7 * np.random.default_rng(layers).standard_normal(67 if layers == 2 else 25)
    found = least_squares(lambda each: by_matrices(each, layers, x, y) - target, start, method="lm", max_nfev=60)
    assert np.abs(found.fun).max() < 2e-3, "the fit is good enough for the tests"
    return list(found.x)


@pytest.fixture(scope="session")
def closed_form() -> SimpleNamespace:
    """Return the functions `energy` and `radius` behind the learned law, and a `network` computed with matrices."""
    return SimpleNamespace(energy=true_energy, radius=true_radius, network=by_matrices)


@pytest.fixture(scope="session")
def law_content() -> dict:
    """Return the content of the file of a learned law, fitted to a potential in closed form."""
    x, y = (grid.ravel() for grid in np.meshgrid(np.linspace(-1, 1, 12), np.linspace(-1, 1, 9)))
    length, contraction = L0 * (0.9 + 0.35 * x), 0.175 + 0.175 * y
    stiffer = 1.5 * contraction + 0.5 * (1.0 - length / (L0 * (1.0 - contraction))) ** 2
    radius = (true_radius(length, contraction) - 0.065) / HALF_WIDE
    return {
        "kind": "worm3d segment law",
        "version": 1,
        "rest_length_m": L0,
        "chamber_offset_m": 0.03,
        "plate_radius_m": 0.02,
        "rest_radius_m": 0.05,
        "input": {"name": "pressure", "unit": "Pa", "contraction": [0.0, 0.35], "value": [0.0, 4500.0]},
        "free_volume_m3": None,
        "stiffness_N": K,
        "scales": {
            "x_mid": 0.9,
            "x_half": 0.35,
            "y_mid": 0.175,
            "y_half": 0.175,
            "energy_J": K * L0 / 4.0,
            "radius_mid_m": 0.065,
            "radius_m": HALF_WIDE,
        },
        "energy": {"sizes": [2, 6, 6, 1], "weights": fitted(2, stiffer, x, y)},
        "radius": {"sizes": [2, 6, 1], "weights": fitted(1, radius, x, y)},
        "bending_Nm": [0.1, 0.0, 0.0, 0.0, 0.0, 0.0],
        "domain": {"length_m": [0.55 * L0, 1.25 * L0], "contraction": [0.0, 0.35]},
        "ensemble": [],
    }


@pytest.fixture(scope="session")
def law_file(law_content: dict, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the path of the file of a learned law."""
    path = tmp_path_factory.mktemp("law") / "barrel.json"
    path.write_text(json.dumps(law_content))
    return path


@pytest.fixture(scope="session")
def law_worm(law_file: Path) -> linkage.Linkage:
    """Return a worm of four segments with a learned law."""
    return linkage.Linkage(segments=4, mass=0.07, k_torsion=10.0, segment=law_file)
