"""Scene of the paper's program; every default is the program's own constant."""

from __future__ import annotations

from typing import Literal

from planar.published import Parameters, bytes_per_step
from scenes.language.checks import Check, Found, kind_checks
from scenes.language.schema import Section, Sign, quantity, setting
from scenes.models.checks import GAIT_CHECKS, RUN_CHECKS, memory_check
from scenes.models.sections import WAVE, Gait, Settings

PROGRAM = Parameters()


class Worm(Section):
    """The mass points and springs."""

    segments: int = quantity(6, ge=1, le=200, title="number of segments", aka=("n", "n_segments"))
    length_m: float = quantity(PROGRAM.length, unit="m", gt=0, le=100, title="length at rest")
    spring_N: float = quantity(PROGRAM.k_spring, unit="N", gt=0, title="stiffness k of a segment's spring, (P7)")
    link_N: float = quantity(PROGRAM.k_link, unit="N", gt=0, title="stiffness k of each link of a rhombus, (P7)")
    mass_kg: float = quantity(PROGRAM.mass, unit="kg", gt=0, title="mass of the whole worm")
    connector_mass_kg: float = quantity(
        PROGRAM.connector_mass, unit="kg", gt=0, title="the part of it that the connectors share"
    )


class Friction(Section):
    """Friction along the ground, (P10), with the normal load m g."""

    forward: float = quantity(
        PROGRAM.mu_forward, ge=0, title="coefficient for motion towards the head", aka=("mu_forward",)
    )
    backward: float = quantity(
        PROGRAM.mu_backward, ge=0, title="coefficient for motion towards the tail", aka=("mu_backward",)
    )
    gravity_m_s2: float = quantity(PROGRAM.gravity, unit="m/s^2", ge=0, title="g, in the normal load only")
    velocity_threshold_m_s: float = quantity(
        PROGRAM.velocity_threshold, unit="m/s", ge=0, title="no friction below this speed"
    )


class PublishedGait(Gait):
    """The contraction, as a force on the connectors."""

    direction: Literal["direct", "retrograde", "standing"] = setting(
        "direct", title="direct runs tail to head, retrograde head to tail; standing: travelling_wave only"
    )
    wavelength_m: float = quantity(
        PROGRAM.wavelength,
        unit="m",
        gt=0,
        only=WAVE,
        title="length of the wave",
        aka=("lambda_m", "wave_length_m"),
    )
    rectified: bool = setting(PROGRAM.rectified, only=WAVE, title="whether segments contract, never lengthen")
    force_N: float = quantity(
        PROGRAM.contraction_force, unit="N", ge=0, title="force on a connector at activation 1", aka=("amplitude_N",)
    )


class Ground(Section):
    """The ground that the connectors may touch."""

    clearance_m: float = quantity(
        PROGRAM.ground_clearance, unit="m", ge=0, title="height of the lowest connector at rest above the ground"
    )


class Solver(Section):
    """Newton's iteration, (P2)."""

    tolerance_N: float = quantity(PROGRAM.tolerance, unit="N", gt=0, title="norm of the residual to reach")
    max_iterations: int = quantity(
        PROGRAM.max_iterations, ge=1, le=10_000, title="the step is kept after so many, converged or not"
    )
    elastic_sign: Sign = setting(
        int(PROGRAM.elastic_sign), title="sign of the elastic force: -1 as the program, 1 as mechanics wants it"
    )


class PublishedScene(Settings):
    """A whole scene."""

    model: Literal["planar_published"] = setting(title="which simulation the scene is for")
    worm: Worm = Worm()
    friction: Friction = Friction()
    gait: PublishedGait = PublishedGait()
    ground: Ground = Ground()
    solver: Solver = Solver()


def _connectors_lighter_than_worm(connector_mass_kg: float, mass_kg: float) -> Found:
    if connector_mass_kg < mass_kg:
        return None
    return {
        "worm.connector_mass_kg": f"got {connector_mass_kg} kg: must be below worm.mass_kg ({mass_kg} kg), "
        "of which it is a part",
        "worm.mass_kg": f"got {mass_kg} kg: must be above worm.connector_mass_kg ({connector_mass_kg} kg), "
        "which is a part of it",
    }


CHECKS = (
    *RUN_CHECKS,
    *GAIT_CHECKS,
    *kind_checks(PublishedGait),
    memory_check(bytes_per_step),
    Check(("worm.connector_mass_kg", "worm.mass_kg"), _connectors_lighter_than_worm),
)
