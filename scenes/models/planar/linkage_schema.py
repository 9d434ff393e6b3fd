"""Sections of a scene of the corrected planar worm; every default is that of the model itself."""

from __future__ import annotations

from dataclasses import fields
from inspect import signature
from typing import Any, Literal

from control import gaits
from planar import linkage
from scenes.language.schema import Cross, Each, NonNegative, Positive, Section, quantity, setting
from scenes.models.sections import WAVE, Gait, Settings

_WORM: dict[str, Any] = {field.name: field.default for field in fields(linkage.Linkage)}
_FRICTION: dict[str, Any] = {field.name: field.default for field in fields(linkage.Friction)}
_RUN: dict[str, Any] = {name: given.default for name, given in signature(linkage.simulate).parameters.items()}
_WAVE = gaits.TravellingWave()


class Worm(Section):
    """The chain of rhombic linkages."""

    segments: int = quantity(_WORM["segments"], ge=1, le=200, title="number of segments", aka=("n", "n_segments"))
    length_m: float = quantity(_WORM["length"], unit="m", gt=0, le=100, title="length at rest")
    half_height_m: Each[Positive] | None = quantity(
        unit="m",
        each="segment",
        left_out="sqrt(3)/4 of a segment's length, as in the paper",
        title="rest half-height of a rhombus",
        aka=("h0_m",),
    )
    density_kg_m3: float = quantity(_WORM["density"], unit="kg/m^3", gt=0, title="mass per rest area and depth")
    depth_m: float = quantity(_WORM["depth"], unit="m", gt=0, title="depth across the plane, for the mass")
    mass_kg: float | None = quantity(
        unit="kg", gt=0, left_out="density x rest area x depth", title="mass of the whole worm"
    )
    apex_mass_fraction: float = quantity(
        _WORM["apex_mass_fraction"], ge=0, le=1, title="share of the mass on the apexes; the rest is on the joints"
    )
    spring_N: Each[Positive] = quantity(
        _WORM["k_spring"], unit="N", each="segment", title="stiffness k of a segment's spring, (P7)", aka=("k_spring",)
    )
    torsion_J: Each[NonNegative] = quantity(
        _WORM["k_torsion"],
        unit="J",
        each="joint",
        title="torsional stiffness between neighbouring segments, (P6)",
        aka=("k_torsion",),
    )
    cross0: Each[Cross] = quantity(_WORM["cross0"], each="joint", title="rest value of the cross product in (P6)")
    apex_hinge_N_m_rad: Each[NonNegative] = quantity(
        _WORM["k_apex"],
        unit="N m/rad",
        each="segment",
        title="stiffness of each apex hinge of a rhombus, on its angle",
        aka=("k_apex",),
    )
    kelvin_voigt_time_s: float = quantity(
        _WORM["kelvin_voigt_time"], unit="s", ge=0, title="damping of every strain over its stiffness"
    )
    drag_N_s_m: float = quantity(
        _WORM["drag"], unit="N s/m", ge=0, title="viscous medium, (P8): force over speed of the worm"
    )


class Friction(Section):
    """Directional Coulomb friction along the ground."""

    forward: float = quantity(
        _FRICTION["forward"], ge=0, title="kinetic coefficient against motion towards the head", aka=("mu_forward",)
    )
    backward: float = quantity(
        _FRICTION["backward"], ge=0, title="kinetic coefficient against motion towards the tail", aka=("mu_backward",)
    )
    static_ratio: float = quantity(_FRICTION["static_ratio"], ge=1, title="static over kinetic coefficient, anchored")
    law: Literal["anchored", "threshold"] = setting(
        _RUN["friction_law"], title="in contact: set-valued with anchors, or the paper's (P10) for comparison"
    )
    velocity_threshold_m_s: float = quantity(
        _RUN["velocity_threshold"], unit="m/s", ge=0, title="(P10): no friction below this speed (threshold, clamped)"
    )


class Ground(Section):
    """The ground under the worm, and gravity."""

    kind: Literal["contact", "clamped"] = setting(
        _RUN["ground"], title="contact: the apexes touch it; clamped: the joints' heights are held, loads by (P9)"
    )
    slope_deg: float = quantity(_RUN["slope"], unit="deg", gt=-90, lt=90, title="angle, rising towards the head")
    gravity_m_s2: float = quantity(_RUN["gravity"], unit="m/s^2", ge=0, title="g")


class LinkageGait(Gait):
    """The commanded contraction: rest lengths are l0 (1 - amplitude x activation)."""

    wavelength: float = quantity(
        _WAVE.wavelength,
        unit="body lengths",
        gt=0,
        only=WAVE,
        title="length of the wave",
        aka=("wavelength_m", "lambda", "wave_length"),
    )
    amplitude: float = quantity(
        _WAVE.amplitude, ge=0, lt=1, title="contraction at activation 1", aka=("contraction", "stroke")
    )


class LinkageSettings(Settings):
    """What one run of the worm needs."""

    worm: Worm = Worm()
    friction: Friction = Friction()
    gait: LinkageGait = LinkageGait()
    ground: Ground = Ground()


class LinkageScene(LinkageSettings):
    """A whole scene."""

    model: Literal["planar_linkage"] = setting(title="which simulation the scene is for")
