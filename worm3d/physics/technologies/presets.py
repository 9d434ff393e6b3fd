"""Numbers of each actuator technology, with sources. Each technology is a subclass of `Technology`.

The source "estimate" means that no published number was found. The source of a "computed" number names its inputs.
Published times are times to 90 % of a step; time constants are computed from these times.
"""

from __future__ import annotations

import types
from dataclasses import dataclass, field, fields
from math import log, pi, radians, sin, tan
from typing import Any, get_type_hints

from worm3d.physics.pneumatic import Pneumatic
from worm3d.physics.technologies.law import Technology
from worm3d.values.parameters import documented

ROOM_PRESSURE: float = Pneumatic.room
"""Pressure of the room [Pa]."""

DYNALLOY = "Dynalloy, technical characteristics of Flexinol, F1140"
METALS = "Metals 3 (2013) 123"
NIZAMANI = "Nizamani et al., Development of Faster SMA Actuators (2017): 0.15 mm wire, 0.41 A"
PNAS = "table of actuators in PNAS (highwire 398536)"
STACK = "Frontiers stack DEA, PMC8050934, abstract"
PALAM = "Biomimetics 9 (2024) 447"
FILOGNA = "Filogna et al., Soft Robotics 10 (2023) 454"
ROBOTIS = "maker's manual of the MX-64T"
SES = "Riddle et al., Bioinspir. Biomim. 20 (2025) 066001, and its program"
ESTIMATE = "estimate"

Row = tuple[float | bool, str]
"""A number or a flag, and its source."""


def _lag(seconds: float, hysteresis: float = 0.0) -> float:
    """Return the time constant with which the active share, through the band of (T2), reaches 90 % in a time [s]."""
    return seconds / log(10.0 * (1.0 + hysteresis))


def compressed_air(gauge: float) -> tuple[float, float]:
    """Return the energy stored in compressed air [J/m^3] and the efficiency of filling from a supply at its pressure.

    `gauge` is the gauge pressure [Pa]. A volume V that is open to the room contains air at the room's pressure p_0. To
    fill V to the pressure p, air with the pressure p - p_0 in V is added. It comes from a supply that has compressed
    this air at the temperature of the room, (A5). The stored energy and the energy drawn from the supply are

        stored  V (p ln(p/p_0) - p + p_0),   drawn  V (p - p_0) ln(p/p_0)

    A chamber that then expands by dV draws p ln(p/p_0) dV more from the supply, for the work (p - p_0) dV. The
    parameter `efficiency` of the technology includes this loss. It is at most (1 - p_0/p)/ln(p/p_0), which is 0.80 at
    60 kPa and 0.54 at 300 kPa.

    The law (T4) makes both energies proportional to the drive. With p constant, the energy drawn is indeed proportional
    to the pressure reached. The stored energy is smaller than in proportion, by up to 0.23 (60 kPa) or 0.19 (300 kPa)
    of the stored energy at full pressure. For a pressure below the room's, a vacuum pump draws (p_0 - p) ln(p_0/p),
    which at a difference of 60 kPa is 1.9 times as much.
    """
    p = gauge + ROOM_PRESSURE
    kept, drawn = p * (log(p / ROOM_PRESSURE) - 1.0) + ROOM_PRESSURE, (p - ROOM_PRESSURE) * log(p / ROOM_PRESSURE)
    return kept, kept / drawn


def _air(gauge: float) -> dict[str, Row]:
    charge, charging = compressed_air(gauge)
    source = f"computed: availability of air at {gauge / 1e3:g} kPa, (A5)"
    return {
        "charge": (charge, source),
        "charging": (charging, f"{source}, of which a supply draws (p - p_0) ln(p/p_0)"),
    }


def bending(thickness: float, length: float, stress: float) -> tuple[float, float]:
    """Return the lever of bending strips, and their blocking stress [Pa].

    The faces of a cantilever strain by +e and -e, so that the curvature is 2 e/thickness and the tip moves by
    e length^2/thickness. The blocking force is 3 E I/length^3 times this displacement, which is
    e E b thickness^2/(4 length) for the width b. Strips that fill a chamber end to end therefore have the stroke
    e lever, with lever = length/thickness, and the force (e E/4) area/lever. `stress` is the stress e E of the faces.
    """
    return length / thickness, stress / 4.0


def _round(diameter: float) -> float:
    """Return the cross-section of a wire or coil from its diameter [m^2]."""
    return pi * diameter**2 / 4.0


def _braid(gauge: float, angle_deg: float) -> float:
    """Return the blocking stress of a braided muscle on its cross-section, which is 0.67 of the ideal stress [Pa]."""
    a = radians(angle_deg)
    return 0.67 * gauge * (3.0 / tan(a) ** 2 - 1.0 / sin(a) ** 2)


ALLOY_BAND = 0.94
ALLOY: dict[str, Row] = {
    "hysteresis": (ALLOY_BAND, "computed: 72 C up, 38 C down (IMECE2002-296496) of 70 K from room to hot"),
    "hot": (70.0, f"{DYNALLOY}: 20 to 90 C"),
}
BRAID_PRESSURE, BELLOWS_PRESSURE, FIELD_PRESSURE = 300e3, 60e3, 266e3
STRIP_LEVER, STRIP_STRESS = bending(thickness=0.2e-3, length=8e-3, stress=3e6)
FIELD = "computed: eps0 eps_r (V/z)^2, eps_r 3, 3 kV on 30 um (Pelrine 1998)"

TECHNOLOGIES: dict[str, type[Technology]] = {}
"""Class of each technology by name, as in `worm3d.ACTUATORS`."""


def _preset(name: str, what: str, **rows: Row) -> type[Technology]:
    """Return the class of a technology with the numbers and sources in `rows`; other numbers have their defaults."""
    known, hints = {each.name: each for each in fields(Technology)}, get_type_hints(Technology)

    def body(namespace: dict[str, Any]) -> None:
        namespace |= {key: field(default=value, metadata=known[key].metadata) for key, (value, _) in rows.items()}
        namespace["__annotations__"] = {key: hints[key] for key in rows}
        namespace["__module__"], namespace["__doc__"] = __name__, f"{what}."
        namespace["sources"] = types.MappingProxyType({key: source for key, (_, source) in rows.items()})

    title = "".join(word.capitalize() for word in name.split("_"))
    made = types.new_class(title, (Technology,), {"name": name}, body)
    TECHNOLOGIES[name] = documented(dataclass(frozen=True, eq=False, kw_only=True)(made))
    return TECHNOLOGIES[name]


SmaWire = _preset(
    "sma_wire",
    "Wires of a shape memory alloy, one along each chamber, heated by a current",
    **ALLOY,
    room=(0.02, f"{ESTIMATE}: wires need air around them"),
    strain=(0.04, f"{METALS}: less than 5 %"),
    stress=(172e6, f"{DYNALLOY}: pull of a million cycles"),
    droop=(0.0, f"{DYNALLOY}: the pull is given for the whole stroke"),
    series=(9.0, f"{ESTIMATE}: 40 GPa x strain / stress"),
    gauge=(_round(0.15e-3), "the wire of 0.15 mm whose times these are"),
    rise=(_lag(1.0, ALLOY_BAND), NIZAMANI),
    fall=(_lag(1.7, ALLOY_BAND), f"{ESTIMATE}: 1.7 s in still air"),
    charge=(534e6, f"computed: 70 K and the latent heat of {DYNALLOY}"),
    leak=(1.0 / _lag(1.7, ALLOY_BAND), "computed: it cools as it falls"),
)
SmaCoil = _preset(
    "sma_coil",
    "Coils of a shape memory alloy, one along each chamber, heated by a current",
    **ALLOY,
    room=(0.05, ESTIMATE),
    strain=(0.5, "Materials 11 (2018) 2324: above 100 % of the closed length, half of the open one"),
    stress=(1e6, f"{ESTIMATE}: 3 N of a coil of 2 mm"),
    gauge=(_round(2e-3), f"{ESTIMATE}: the times are those of this coil of 2 mm"),
    rise=(_lag(0.75, ALLOY_BAND), f"{ESTIMATE}: 0.5 to 1 s"),
    fall=(_lag(3.5, ALLOY_BAND), f"{ESTIMATE}: 2 to 5 s"),
    charge=(50e6, f"{ESTIMATE}: 9 % of the coil's cylinder is wire ({DYNALLOY})"),
    leak=(1.0 / _lag(3.5, ALLOY_BAND), "computed: it cools as it falls"),
)
DeaStack = _preset(
    "dea_stack",
    "Stacks of dielectric elastomer that a high voltage squeezes along the chamber",
    strain=(0.033, STACK),
    stress=(FIELD_PRESSURE, FIELD),
    push=(1.0, f"{ESTIMATE}: a solid body"),
    delay=(0.021, STACK),
    rise=(_lag(0.005), f"computed: 660 %/s of 3.3 % ({STACK})"),
    fall=(_lag(0.005), f"{ESTIMATE}: as it rises"),
    charge=(FIELD_PRESSURE / 2.0, FIELD),
    leak=(0.2, f"{ESTIMATE}: 39 uA held ({STACK}) at 3 kV"),
    charging=(0.5, "computed: charged through a resistor from a constant voltage"),
    efficiency=(0.9, f"{PNAS}: largest of acrylic"),
)
DeaFilm = _preset(
    "dea_film",
    "Films of acrylic dielectric elastomer that pull less while a high voltage widens them",
    strain=(0.3, f"{ESTIMATE}: 0.1 to 1 in use; {PNAS}: 2.15 at most"),
    stress=(0.3e6, f"{ESTIMATE}: {PNAS}: 2.4 MPa at most"),
    rise=(_lag(0.35), f"{ESTIMATE}: acrylic creeps"),
    fall=(_lag(0.35), f"{ESTIMATE}: acrylic creeps"),
    charge=(0.15e6, "computed: half of the stress"),
    leak=(0.2, ESTIMATE),
    charging=(0.5, "computed: charged through a resistor from a constant voltage"),
    efficiency=(0.9, f"{PNAS}: largest of acrylic"),
    room=(0.05, f"{ESTIMATE}: films need frames"),
)
Ipmc = _preset(
    "ipmc",
    "Ionic polymer-metal composites, bending strips whose levers shorten the chamber",
    strain=(0.005, f"{ESTIMATE}: of the faces; 0.033 at best"),
    stress=(STRIP_STRESS, f"computed: a bending beam; {ESTIMATE}: 3 MPa in its faces"),
    lever=(STRIP_LEVER, f"computed: a bending beam; {ESTIMATE}: strips of 0.2 mm that bend over 8 mm"),
    push=(1.0, "they bend both ways"),
    both_ways=(True, "they bend both ways"),
    rise=(_lag(2.5), f"{ESTIMATE}: 1 to 5 s"),
    fall=(_lag(2.5), f"{ESTIMATE}: 1 to 5 s"),
    charge=(
        STRIP_STRESS * 0.005 / 2.0 / 0.02,
        f"{ESTIMATE}: half of stress x strain at an efficiency of 2 %",
    ),
    room=(0.002, f"{ESTIMATE}: strips of 0.2 mm among as many levers"),
)
Mckibben = _preset(
    "mckibben",
    "Braided pneumatic muscles along the chamber",
    strain=(0.25, "softroboticstoolkit: typical"),
    stress=(_braid(BRAID_PRESSURE, 30.0), f"computed: 300 kPa, braid at 30 degrees, x 0.67 ({PALAM})"),
    scales=(True, f"the force grows with the pressure ({PALAM})"),
    rise=(_lag(0.2), f"{ESTIMATE}: 0.1 to 0.3 s"),
    fall=(_lag(0.35), f"{ESTIMATE}: 0.2 to 0.5 s"),
    hysteresis=(0.1, f"{ESTIMATE}: friction of the braid"),
    **_air(BRAID_PRESSURE),
    efficiency=(0.5, f"{ESTIMATE}: 0.2 to 0.5"),
)
BellowsPneumatic = _preset(
    "bellows_pneumatic",
    "Bellows that air pushes and a vacuum pulls; the energy of both is counted as that of the pressure",
    strain=(0.4, f"{FILOGNA}: 40 to 50 %"),
    stress=(BELLOWS_PRESSURE, f"{ESTIMATE}: 20 to 100 kPa"),
    push=(1.0, "they push and pull"),
    both_ways=(True, "they push and pull"),
    rise=(_lag(0.2), f"{ESTIMATE}: 0.1 to 0.3 s"),
    fall=(_lag(0.35), f"{ESTIMATE}: 0.2 to 0.5 s"),
    **_air(BELLOWS_PRESSURE),
    efficiency=(0.3, f"{ESTIMATE}: 0.1 to 0.3"),
)
Hydraulic = _preset(
    "hydraulic",
    "Bellows filled with a liquid by a pump of limited flow",
    strain=(0.4, f"{FILOGNA}: 40 to 50 %"),
    stress=(0.5e6, f"{ESTIMATE}: 0.1 to 4 MPa"),
    droop=(0.0, "the pressure does not depend on the stroke"),
    series=(20.0, f"{ESTIMATE}: walls that give by a 20th of the stroke"),
    push=(1.0, "they push and pull"),
    both_ways=(True, "they push and pull"),
    rise=(0.05, ESTIMATE),
    fall=(0.05, ESTIMATE),
    rate=(2.0, f"{ESTIMATE}: the stroke in 0.1 to 1 s"),
    efficiency=(0.55, f"{ESTIMATE}: 0.4 to 0.7"),
)
Magnetic = _preset(
    "magnetic",
    "Magnetic elastomers in a field from outside",
    strain=(0.2, f"{ESTIMATE}: 0.05 to 0.3"),
    stress=(10e3, f"{ESTIMATE}: 1 to 50 kPa, falling as 1/d^3 to 1/d^4 with the magnet's distance"),
    push=(1.0, f"{ESTIMATE}: a solid body"),
    both_ways=(True, "the field may turn"),
    rise=(_lag(0.1), "between 30 Hz (go.nature.com/3i1mxbQ) and 0.228 s (SL-sMRE)"),
    fall=(_lag(0.1), "between 30 Hz (go.nature.com/3i1mxbQ) and 0.228 s (SL-sMRE)"),
)
Magnetic.uncounted = "what the coils or magnets draw that make the field; it is the work of the field alone"
ServoCable = _preset(
    "servo_cable",
    "Servo motors that wind up cables",
    strain=(0.35, f"{SES}: 0.96 to 0.62 m of hoop"),
    stress=(31.0 / (0.0402 * 0.0611), f"computed: 31 N ({SES}) over the face of a servo ({ROBOTIS})"),
    droop=(0.0, "the torque does not depend on the angle"),
    series=(10.0, f"{ESTIMATE}: cables that give by a tenth of the stroke"),
    rise=(0.02, ESTIMATE),
    fall=(0.02, ESTIMATE),
    rate=(1.0, f"{SES}: 1 s up, 1 s down"),
    efficiency=(0.4, f"{ESTIMATE}: 0.3 to 0.6"),
    idle=(0.6, f"computed: 0.1 A at 12 V ({ROBOTIS}), a servo for both chambers of a segment"),
    stall=(0.01, f"computed: 49 W at 6 N m ({ROBOTIS}), a spool of 16 mm"),
    heat_capacity=(2.0, f"{ESTIMATE}: 126 g ({ROBOTIS}) of 0.5 J/g/K for 31 N"),
    cooling=(1700.0, f"computed: a fifth of the stall torque ({ROBOTIS}) warms it by 55 K"),
    hottest=(55.0, f"{ESTIMATE}: it switches off at 80 C"),
    room=(0.5, f"{ESTIMATE}: servos fill much of a segment"),
)
Muscle = _preset(
    "muscle",
    "Muscle, for comparison",
    strain=(0.4, PNAS),
    stress=(0.35e6, PNAS),
    scales=(True, "the force grows with the activation"),
    rise=(_lag(0.1), f"{ESTIMATE}: 0.05 to 0.2 s"),
    fall=(_lag(0.2), f"{ESTIMATE}: 0.05 to 0.2 s"),
    efficiency=(0.35, PNAS),
    room=(0.5, f"{ESTIMATE}: most of an animal's wall"),
)
