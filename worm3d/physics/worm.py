"""The worm: body, actuators, joint friction, medium and loads."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from worm3d.physics.actuators import Actuator, FirstOrder
from worm3d.physics.body import MOST_SEGMENTS, Body
from worm3d.physics.hysteresis import Hysteresis
from worm3d.physics.load import HEAD, Load
from worm3d.physics.media import Medium
from worm3d.physics.part import Numbers
from worm3d.physics.segment_laws.law import SegmentLaw
from worm3d.physics.segment_laws.shapes import Rhombus
from worm3d.values import arguments
from worm3d.values.arrays import FloatArray
from worm3d.values.parameters import documented, parameter
from worm3d.values.spelling import spelled

SAME_SIZE = 1e-9
"""Largest difference of a given size from the size in a segment law, as a fraction. Sizes in scenes have up to 12
digits; sizes that differ by more are another segment."""


@documented
@dataclass(frozen=True, eq=False, kw_only=True)
class Worm(Body):
    """A chain of N segments with left and right chambers. Frozen and validated, with read-only arrays.

    Without arguments, this is the default worm of the project. Segment 0 and joint 0 are at the tail. Some segment laws
    determine sizes of the worm. A size that has the default value then follows from the segment law.

    Raises
    ------
    ValueError
        A value that is not finite or out of range, or an array of the wrong shape.
    """

    actuator: Actuator = field(default_factory=FirstOrder)
    """Actuator of the chambers."""
    hinge_actuator: Actuator = field(default_factory=FirstOrder)
    """Actuator of the hinges."""
    hysteresis: Hysteresis = field(default_factory=Hysteresis)
    """Friction in the joints of the chambers. `Hysteresis()` means no friction."""
    medium: Medium = field(default_factory=Medium)
    """Medium, which determines how `drag` depends on the shape. With `Medium()` it does not depend on the shape."""
    load: Load | tuple[Load, ...] = field(default_factory=Load)
    """Loads that the worm carries or drags, one or several. `Load()` means no load."""
    segment: SegmentLaw = field(default_factory=Rhombus)
    """Segment law: energy and outline of a segment as functions of length, bend and command."""
    flat: bool = parameter(False, "whether the worm stays in its plane: y, roll and bend are held (`planar`)")

    @classmethod
    @spelled
    def planar(
        cls,
        *,
        segments: int = 6,
        length: float = 1.0,
        half_height: Numbers | None = None,
        density: float = 10.0,
        depth: float = 0.1,
        mass: float | None = None,
        payload: float = 0.0,
        apex_mass_fraction: float = 0.5,
        k_spring: Numbers = 13.0,
        k_torsion: Numbers = 1e4,
        cross0: Numbers = 0.0,
        k_apex: Numbers = 0.12,
        kelvin_voigt_time: float = 0.05,
        drag: float = 0.0,
        segment: SegmentLaw | None = None,
    ) -> Worm:
        """Return the planar special case, with the parameters of `planar.linkage.Linkage`.

        Left and right chambers coincide (b = 0) and share mass, stiffness and contact. The worm stays in the plane
        y = const. and has no roll and bend. It has no outward apexes, no end faces and no actuator lag.

        Parameters
        ----------
        half_height : float or ndarray, shape (N,), optional
            Rest half-height of the chambers [m]. The default follows from the segment law; otherwise it is sqrt(3)/4
            l0, as in the paper.
        density, depth : float
            If `mass` is not given, the mass is density [kg/m^3] x rest area of the rhombi [m^2] x depth [m].
        apex_mass_fraction : float
            Share of the mass that is on the apexes.
        k_apex : float or ndarray, shape (N,)
            Stiffness of each of the two apex hinges of a rhombus [N m/rad]. Other segments have no apex hinges.
        segment : SegmentLaw, optional
            The default is `Rhombus`. Sizes that a law determines may be left out.
        """
        segments = arguments.whole("segments", segments, le=MOST_SEGMENTS)
        for name, value in (("length", length), ("density", density), ("depth", depth)):
            arguments.number(name, value, gt=0.0)
        apex_mass_fraction = arguments.number("apex_mass_fraction", apex_mass_fraction, ge=0.0, le=1.0)
        law = Rhombus() if segment is None else segment
        arguments.instance("segment", law, SegmentLaw, "a worm3d.SegmentLaw such as worm3d.Hydrostat()")
        implied = law.implied(segments, flat=True)
        l0 = implied.get("length", length) / segments
        h0 = implied.get("half_height", np.sqrt(3.0) / 4.0 * l0) if half_height is None else half_height
        area = float(l0 * np.sum(arguments.array("half_height", h0, (segments,), fill=True)))
        return cls(
            segments=segments,
            length=length,
            mass=density * area * depth if mass is None else mass,
            payload=payload,
            joint_mass_fraction=1.0 - apex_mass_fraction,
            chamber_offset=0.0,
            half_height=h0,
            k_spring=k_spring,
            k_torsion=k_torsion,
            k_yaw=0.0,
            k_twist=0.0,
            cross0=cross0,
            k_apex=k_apex,
            kelvin_voigt_time=kelvin_voigt_time,
            drag=drag,
            actuator_lag=0.0,
            stroke=law.suited().get("stroke", (-100.0, 0.999)),
            outward_apexes=False,
            end_faces=False,
            segment=law,
            flat=True,
        )

    def __post_init__(self) -> None:
        arguments.instance("segment", self.segment, SegmentLaw, "a worm3d.SegmentLaw such as worm3d.Hydrostat()")
        self._follow_segment_law()
        super().__post_init__()
        n = self.segments
        self.segment.require_size("segment", n)
        self._require_links()
        for name, count in (("actuator", n), ("hinge_actuator", n - 1)):
            given = getattr(self, name)
            arguments.instance(name, given, Actuator, "a worm3d.Actuator such as worm3d.FirstOrder()")
            given.require_size(name, count)
        arguments.instance("hysteresis", self.hysteresis, Hysteresis, "a worm3d.Hysteresis such as worm3d.Jenkins()")
        self.hysteresis.require_size("hysteresis", n)
        arguments.instance("medium", self.medium, Medium, "a worm3d.Medium such as worm3d.StrainDrag()")
        self.medium.require_size("medium", n)
        given = self.load if isinstance(self.load, tuple | list) else (self.load,)
        for each in given:
            arguments.instance("load", each, Load, "a worm3d.Load such as worm3d.Tether(), or some in a tuple")
            if not HEAD <= each.at <= n:
                raise ValueError(f"load.joint: got {each.at}, must be from 0, the tail, to {n}, or {HEAD} for the head")
        if isinstance(self.load, list):
            object.__setattr__(self, "load", tuple(self.load))
        if self.drag == 0.0 and type(self.medium) is not Medium:
            raise ValueError(f"drag: got {self.drag!r} N s/m, must be above 0 with a medium, which multiplies it")
        if not self.hinge_actuator.drives_hinges:
            wrong = type(self.hinge_actuator).__name__
            raise ValueError(f"hinge_actuator: got {wrong}, which acts on chambers alone; use it as the actuator")
        if self.flat and self.chamber_offset != 0.0:
            raise ValueError(f"chamber_offset: got {self.chamber_offset!r}, must be 0 in a worm that is flat")

    def _follow_segment_law(self) -> None:
        """Set the values that follow from the segment law; raise ValueError for given values that differ."""
        defaults = {each.name: each.default for each in fields(self)}
        segments = arguments.whole("segments", self.segments, le=MOST_SEGMENTS)
        implied = self.segment.implied(segments, flat=self.flat)
        for name, value in {**implied, **self.segment.suited()}.items():
            given = getattr(self, name)
            if _all_close(given, defaults[name], 0.0):
                object.__setattr__(self, name, value)
            elif name in implied and not _all_close(given, value, SAME_SIZE):
                raise ValueError(
                    f"{name}: got {arguments.shown(given)}, must be {value:.9g} as in the segment law, or be left out"
                )

    def _require_links(self) -> None:
        """Raise ValueError if a part needs links, but the chambers have none."""
        if self.segment.has_links:
            return
        for name in ("actuator", "hysteresis"):
            part = getattr(self, name)
            if part.needs_links:
                law = type(self.segment).__name__
                raise ValueError(
                    f"{name}: got {type(part).__name__}, which acts on the links of a rhombus, must be another one "
                    f"with the segment law {law}, whose chambers have no links"
                )

    @property
    def loads(self) -> tuple[Load, ...]:
        """All loads of the worm except `Load()`, which means no load."""
        given = self.load if isinstance(self.load, tuple) else (self.load,)
        return tuple(each for each in given if type(each) is not Load)

    @property
    def load_mass(self) -> FloatArray:
        """Mass that loads add to each joint, shape (N+1,) [kg]; not included in the worm's mass."""
        mass = np.zeros(self.segments + 1)
        for each in self.loads:
            mass[each.at] += each.mass_carried
        return mass


def _all_close(given: Any, wanted: Any, share: float) -> bool:
    """Return whether all given numbers are the wanted ones, up to a share. Other values than numbers are not."""
    try:
        return bool(np.allclose(np.asarray(given, dtype=float), wanted, rtol=share, atol=0.0))
    except (TypeError, ValueError):
        return False
