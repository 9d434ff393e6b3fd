"""Constants of the published program."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from planar.net import Net
from worm3d.values.parameters import check, documented, parameter

LARGEST = 1e100
"""Largest size of a parameter, and the inverse of the smallest: the program takes masses of any size for points."""


@documented
@dataclass(frozen=True)
class Parameters:
    """Constants of the author's program; the defaults give the paper's results.

    Raises
    ------
    ValueError
        A value that is not finite, or out of its range.
    """

    length: float = parameter(1.0, meaning="length at rest", unit="m", gt=0)
    k_spring: float = parameter(13.0, meaning="stiffness k of a segment's spring, (P7)", unit="N", gt=0, key="spring_N")
    k_link: float = parameter(1e4, meaning="stiffness k of each link of a rhombus, (P7)", unit="N", gt=0, key="link_N")
    mass: float = parameter(1e-8, meaning="mass of the whole worm", unit="kg", gt=0)
    connector_mass: float = parameter(1e-11, meaning="part of the mass that the connectors share", unit="kg", gt=0)
    gravity: float = parameter(9.8, meaning="g, only in the normal load N_i = m_i g", unit="m/s^2", ge=0)
    mu_forward: float = parameter(
        0.03, meaning="coefficient of (P10) for motion towards the head, +x", ge=0, key="forward"
    )
    mu_backward: float = parameter(
        0.20, meaning="coefficient of (P10) for motion towards the tail, -x", ge=0, key="backward"
    )
    velocity_threshold: float = parameter(1e-6, meaning="eps of (P10): no friction below this speed", unit="m/s", ge=0)
    normal_load: Literal["weight", "residual"] = parameter(
        "weight",
        meaning="N_i of (P10): weight, m_i g (the program), or residual, |r_y,i| (P9, the text)",
    )
    contraction_force: float = parameter(
        10.0, meaning="force on a connector at activation 1", unit="N", key="force_N", aka=("amplitude_N",)
    )
    wavelength: float = parameter(
        1.0, meaning="length of the travelling wave", unit="m", gt=0, aka=("lambda_m", "wave_length_m")
    )
    ground_clearance: float = parameter(
        0.02, meaning="height of the lowest connector at rest above the ground", unit="m", ge=0, key="clearance_m"
    )
    snap: bool = parameter(
        True,
        meaning="whether nodes whose contact changed are set on the ground in the start configuration of the corrector",
    )
    elastic_sign: float = parameter(-1.0, meaning="sign of the elastic force: -1 as the program, 1 as in mechanics")
    rectified: bool = parameter(True, meaning="whether the default wave is max(0, sin) (the program) or sin (the text)")
    tolerance: float = parameter(
        1e-6, meaning="norm of the residual to reach; Newton stops after the update that follows", unit="N", gt=0
    )
    max_iterations: int = parameter(100, meaning="iterations after which the step is kept, converged or not", ge=1)

    def __post_init__(self) -> None:
        check(self, largest=LARGEST)
        if not 0 < self.connector_mass < self.mass:
            raise ValueError(
                f"connector_mass: got {self.connector_mass!r} kg, must lie between 0 and mass ({self.mass!r} kg)"
            )
        if self.elastic_sign not in (-1.0, 1.0):
            raise ValueError(f"elastic_sign: got {self.elastic_sign!r}, must be -1 (the program) or +1 (mechanics)")

    def ground_height(self, net: Net) -> float:
        """Return the height of the ground under a worm [m]."""
        return float(net.rest[:, 1].min()) - self.ground_clearance
