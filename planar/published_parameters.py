"""Constants of the published program."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from planar.net import Net
from worm3d.values import arguments

LARGEST = 1e100
"""Largest size of a parameter, and the inverse of the smallest: the program takes masses of any size for points."""


@dataclass(frozen=True)
class Parameters:
    """Constants of the author's program; the defaults give the paper's results.

    Attributes
    ----------
    length : float
        Rest length of the worm [m].
    k_spring, k_link : float
        Stiffness of the horizontal spring and of each of the four links of a rhombus, in (P7) [N].
    mass, connector_mass : float
        Mass of the whole worm, and the part of it that the top and bottom connectors share [kg].
    gravity : float
        Only in the normal load of the friction, N_i = m_i g [m/s^2].
    mu_forward, mu_backward : float
        Friction coefficients of (P10) for motion along +x and -x.
    velocity_threshold : float
        eps of (P10) [m/s].
    normal_load : str
        N_i of (P10): "weight", m_i g (the program), or "residual", the predictor's |r_y,i| (P9, the text).
    contraction_force : float
        Force on the connectors at activation 1 [N].
    wavelength : float
        Of the default travelling wave [m].
    ground_clearance : float
        Height of the lowest node at rest above the ground [m].
    snap : bool
        Whether nodes whose contact changed are set on the ground in the start configuration of the corrector.
    elastic_sign : float
        s of the module's equations: -1 as the program, +1 as mechanics wants it.
    rectified : bool
        Whether the default wave is max(0, sin) (the program) or sin (the paper's text).
    tolerance : float
        Newton stops after the update that follows a residual norm below this [N].
    max_iterations : int
        Newton stops there in any case, and the step is kept.

    Raises
    ------
    ValueError
        A value that is not finite, or out of its range.
    """

    length: float = 1.0
    k_spring: float = 13.0
    k_link: float = 1e4
    mass: float = 1e-8
    connector_mass: float = 1e-11
    gravity: float = 9.8
    mu_forward: float = 0.03
    mu_backward: float = 0.20
    velocity_threshold: float = 1e-6
    normal_load: Literal["weight", "residual"] = "weight"
    contraction_force: float = 10.0
    wavelength: float = 1.0
    ground_clearance: float = 0.02
    snap: bool = True
    elastic_sign: float = -1.0
    rectified: bool = True
    tolerance: float = 1e-6
    max_iterations: int = 100

    def __post_init__(self) -> None:
        for name in ("length", "k_spring", "k_link", "mass", "connector_mass", "wavelength", "tolerance"):
            arguments.number(name, getattr(self, name), gt=0.0, largest=LARGEST)
        for name in ("gravity", "mu_forward", "mu_backward", "velocity_threshold", "ground_clearance"):
            arguments.number(name, getattr(self, name), ge=0.0, largest=LARGEST)
        arguments.number("contraction_force", self.contraction_force, largest=LARGEST)
        arguments.whole("max_iterations", self.max_iterations)
        for name in ("snap", "rectified"):
            arguments.flag(name, getattr(self, name))
        if not 0 < self.connector_mass < self.mass:
            raise ValueError(
                f"connector_mass: got {self.connector_mass!r} kg, must lie between 0 and mass ({self.mass!r} kg)"
            )
        arguments.choice("normal_load", self.normal_load, ("weight", "residual"))
        if arguments.number("elastic_sign", self.elastic_sign) not in (-1.0, 1.0):
            raise ValueError(f"elastic_sign: got {self.elastic_sign!r}, must be -1 (the program) or +1 (mechanics)")

    def ground_height(self, net: Net) -> float:
        """Return the height of the ground under a worm [m]."""
        return float(net.rest[:, 1].min()) - self.ground_clearance
