"""From the settings of a scene to the corrected planar worm, its gait and its run."""

from __future__ import annotations

import math
from dataclasses import fields

from control.gaits import GAITS
from planar import linkage
from planar.linkage.simulate import Gait
from scenes.models.base import Observer
from scenes.models.pattern import pattern
from scenes.models.planar.linkage_schema import LinkageSettings, Worm

KEYS = {
    "segments": "segments",
    "length": "length_m",
    "half_height": "half_height_m",
    "density": "density_kg_m3",
    "depth": "depth_m",
    "mass": "mass_kg",
    "apex_mass_fraction": "apex_mass_fraction",
    "k_spring": "spring_N",
    "k_torsion": "torsion_J",
    "cross0": "cross0",
    "k_apex": "apex_hinge_N_m_rad",
    "kelvin_voigt_time": "kelvin_voigt_time_s",
    "drag": "drag_N_s_m",
}
"""Each parameter of `Linkage` and its key in the section [worm]."""


def simulate(scene: LinkageSettings, observer: Observer) -> linkage.Run:
    """Run the worm of a scene.

    Raises
    ------
    ValueError
        The worm is refused, or its weight would flatten it (`LimitPointError`).
    """
    return linkage.simulate(
        worm_of(scene.worm),
        gait_of(scene),
        duration=scene.run.duration_s,
        dt=scene.run.dt_s,
        ground=scene.ground.kind,
        friction=linkage.Friction(scene.friction.forward, scene.friction.backward, scene.friction.static_ratio),
        friction_law=scene.friction.law,
        gravity=scene.ground.gravity_m_s2,
        slope=math.radians(scene.ground.slope_deg),
        velocity_threshold=scene.friction.velocity_threshold_m_s,
        observer=observer,
    )


def worm_of(worm: Worm) -> linkage.Linkage:
    """Return the worm that the section [worm] describes."""
    return linkage.Linkage(**{parameter: getattr(worm, key) for parameter, key in KEYS.items()})


def gait_of(scene: LinkageSettings) -> Gait:
    """Return the gait as the worm wants it: time [s] -> contraction of each segment, shape (N,)."""
    gait, segments = scene.gait, scene.worm.segments
    wave = pattern(gait, scene.run.dt_s, wavelength=gait.wavelength, amplitude=gait.amplitude)
    return lambda t: wave.amplitude * wave.activation(t, segments)


def lengthens(kind: str, **settings: bool) -> bool:
    """Return whether a gait of some settings, of which it has some, makes segments longer too."""
    gait = GAITS[kind]
    own = {field.name for field in fields(gait)}
    return gait(**{name: value for name, value in settings.items() if name in own}).lengthens
