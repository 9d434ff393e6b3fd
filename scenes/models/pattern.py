"""The gait that a scene's section describes."""

from __future__ import annotations

from typing import Literal

from control import gaits
from scenes.models.sections import Gait


def pattern(gait: Gait, dt: float, *, wavelength: float, amplitude: float = 1.0, **turning: float) -> gaits.Gait:
    """Return the gait of a section.

    Parameters
    ----------
    gait : Gait
    dt : float
        Time step, which a dirac pulse lasts [s].
    wavelength : float
        Of a travelling wave [body lengths].
    amplitude : float
        Contraction at activation 1.
    turning : float
        Further fields of every gait: bias, hinge, force.
    """
    if gait.kind == "travelling_wave":
        return gaits.TravellingWave(
            amplitude=amplitude,
            period=gait.period_s,
            wavelength=wavelength,
            direction=gait.direction,
            rectified=gait.rectified,
            **turning,
        )
    direction: Literal["direct", "retrograde"] = "retrograde" if gait.direction == "retrograde" else "direct"
    if gait.kind == "two_anchor":
        return gaits.TwoAnchor(
            amplitude=amplitude,
            period=gait.period_s,
            extension=gait.extension,
            anchors=gait.anchors,
            direction=direction,
            **turning,
        )
    return gaits.ContractionEngine_segmentdriven(
        amplitude=amplitude,
        T_wave=gait.period_s,
        T_contract=gait.contract_time_s,
        contractType=gait.pulse,
        alternating=gait.alternating,
        direction=direction,
        impulse=dt,
        **turning,
    )
