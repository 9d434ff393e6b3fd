"""Worms that several tests of the planar linkage use."""

from collections.abc import Callable

import numpy as np
import pytest

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
