"""A pneumatic actuator: compressed air in each chamber, filled and emptied through a valve.

The air fills the chamber's rhombus (E2) with links a and half-height h, over the width w, and a dead volume V_d:

    V(l) = w l h(l) + V_d,   h = sqrt(a^2 - l^2/4)                                                     (A1)

Pressure increases V. It therefore shortens a chamber while l > sqrt(2) a, like a fluidic muscle, and makes it taller.
The air is an ideal gas at room temperature. Its mass is m and its pressure p. The flow through the valve, between the
chamber and a regulator that holds the commanded pressure, is proportional to the drop of pressure:

    p V = m R T,   dm/dt = C (p_cmd - p)                                                                (A2)

(A chamber of constant length fills with the time constant V/(R T C).) In a step, with m_hat and span of the integrator,

    p = (m_hat + span C p_cmd)/(V/(R T) + span C)                                                       (A3)

which depends only on the length. The force on the chamber, (p - p_0) dV/dl, is minus the derivative of

    Psi(l) = - (m_hat + span C p_cmd) R T ln(V + span C R T) + p_0 V                                    (A4)

Energy. The air stores the work that it could do until its pressure is p_0 (the room's), at constant temperature,

    X(m, V) = m R T (ln(p/p_0) - 1) + p_0 V,   dX = R T ln(p/p_0) dm - (p - p_0) dV                     (A5)

Air comes from the supply if p_cmd > p_0, and goes to the vacuum if p_cmd < p_0. In the opposite direction, the valve
exchanges air with the room. From a source at the pressure p_s, a mass dm brings in the energy R T ln(p_s/p_0) dm >= 0,
of which the valve loses R T ln(p_s/p) dm >= 0. (This energy is the availability, or exergy, of a gas at the temperature
of the surroundings: A. Bejan, Advanced Engineering Thermodynamics, chapter 3.)

With implicit Euler, the loss of every step is at least 0. With BDF2, the flow over a step differs from the flow that
the pressure at the end drives. The loss of a step may then be negative by the error of the integrator, some millionths
of the work at time steps of 20 ms.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from worm3d.physics.actuators import Actuator, Response
from worm3d.physics.part import Numbers, Symbol, Symbols
from worm3d.values.parameters import documented, parameter


@documented
@dataclass(frozen=True, eq=False, kw_only=True)
class Pneumatic(Actuator, name="pneumatic"):
    """Chambers that are filled with air through a valve. A commanded contraction is converted into a pressure.

    The commanded gauge pressure is `gain` times the commanded contraction, within the limits of the supply. The springs
    of the chambers keep their rest lengths. At rest and without load, small contractions equal the commands if
    gain = k/(2 |dV/dl|). States: pressure (absolute) and mass of the air of each chamber.

    Raises
    ------
    ValueError
        A value that is not finite or out of range, or a vacuum below the pressure of the room.
    """

    states: ClassVar[Mapping[str, str]] = {"pressure": "Pa", "air": "kg"}
    drives_hinges: ClassVar[bool] = False
    has_source: ClassVar[bool] = True
    needs_links: ClassVar[bool] = True

    width: Numbers = parameter(0.04, "width w of the air in a chamber", "m", gt=0, each="segment")
    dead_volume: Numbers = parameter(
        1e-5, "volume V_d of the air between valve and chamber", "m^3", ge=0, each="segment"
    )
    gain: Numbers = parameter(
        2e3, "commanded gauge pressure over the commanded contraction", "Pa", gt=0, each="segment"
    )
    supply: Numbers = parameter(2e3, "gauge pressure of the supply", "Pa", ge=0, each="segment")
    vacuum: Numbers = parameter(0.0, "gauge pressure of the vacuum, 0: none", "Pa", le=0, each="segment")
    conductance: Numbers = parameter(
        5e-6, "mass flow C through the valve over its drop of pressure", "kg/(s Pa)", gt=0, each="segment"
    )
    room: float = parameter(101325.0, "pressure p_0 of the room", "Pa", gt=0)
    temperature: float = parameter(293.15, "temperature T of the air", "K", gt=0)
    gas_constant: float = parameter(287.05, "specific gas constant R of the air", "J/(kg K)", gt=0)

    def __post_init__(self) -> None:
        super().__post_init__()
        lowest = float(np.min(self.vacuum))
        if lowest <= -self.room:
            raise ValueError(f"vacuum: got {lowest:g} Pa, must be above -{self.room:g} Pa, minus the room's pressure")

    @classmethod
    def respond(cls, s: Symbols) -> Response:
        """Return (A3) to (A5)."""
        import casadi as ca  # parameters do not need casadi

        RT, volume, volume_n = s["gas_constant"] * s["temperature"], _volume(s, "length"), _volume(s, "length_n")
        command = ca.fmin(ca.fmax(s["command"], s["vacuum"] / s["gain"]), s["supply"] / s["gain"])
        target, valve = s["room"] + s["gain"] * command, s["span"] * s["conductance"]
        filled = s["air_hat"] + valve * target
        pressure = filled / (volume / RT + valve)
        air = pressure * volume / RT
        # The volume in the logarithm is relative to the volume at the start, since a constant of some kJ would hide the
        # energy of the springs.
        grown = volume - volume_n
        potential = -filled * RT * ca.log1p(grown / (volume_n + valve * RT)) + s["room"] * grown
        flow = air - s["air_n"]
        source_in = ca.if_else(target > s["room"], s["room"] + s["supply"], s["room"])
        source_out = ca.if_else(target < s["room"], s["room"] + s["vacuum"], s["room"])
        source = ca.if_else(flow > 0.0, source_in, source_out)
        return Response(
            command=command,
            given=(pressure - s["room"]) / s["gain"],
            force=s["force_command"],
            spring=0.0,
            potential=potential,
            states={"pressure": pressure, "air": air},
            work=RT * ca.log(source / s["room"]) * flow,
            stored=_available(air, pressure, s) - _available(s["air_n"], s["pressure_n"], s),
            lost=RT * ca.log(source / pressure) * flow,
        )

    @classmethod
    def at_rest(cls, s: Symbols) -> Symbols:
        """Return the commanded pressure, and the mass of air in the chamber at this pressure."""
        pressure = s["room"] + s["gain"] * s["command"]
        return {"pressure": pressure, "air": pressure * _volume(s, "length") / (s["gas_constant"] * s["temperature"])}


def _volume(s: Symbols, length: str) -> Symbol:
    """Return the volume of the air in a chamber of the length s[length], (A1) [m^3]."""
    from worm3d.physics.elements import half_height

    return s["width"] * s[length] * half_height(s["link"], s[length]) + s["dead_volume"]


def _available(air: Symbol, pressure: Symbol, s: Symbols) -> Symbol:
    """Return X of (A5) [J]."""
    import casadi as ca

    RT = s["gas_constant"] * s["temperature"]
    return air * RT * (ca.log(pressure / s["room"]) - 1.0 + s["room"] / pressure)
