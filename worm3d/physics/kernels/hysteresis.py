"""The step of joint friction, (H2) to (H4), generated from the coordinate and the sliders of a `Hysteresis`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import casadi as ca

from worm3d.physics.expressions import EXPRESSION_ADVICE, answer, scalar
from worm3d.physics.hysteresis import HYSTERESIS_PREFIX, Hysteresis
from worm3d.values.parameters import parameters_of


class Slid(NamedTuple):
    """Response of the friction in the joints of a chamber in a step."""

    potential: ca.SX
    """Potential Psi of (H2) [J]."""
    states: Mapping[str, ca.SX]
    """States at the end of the step, (H3), by name."""
    stored: ca.SX
    """Change of the energy in the springs of the elements [J]."""
    lost: ca.SX
    """Loss of the sliders, (H4) [J]."""


Joints = Callable[[ca.SX], Mapping[str, ca.SX]]
"""Function from the length of a chamber [m] to the results of `SegmentLaw.joints`."""


def slide(kind: type[Hysteresis], known: Mapping[str, ca.SX], joints: Joints, acts: ca.SX) -> Slid:
    """Return the response of a chamber's joint friction in a step. `acts` is 1, or 0 if there is no friction now.

    Raises
    ------
    ValueError
        The coordinate or the sliders of the class are not valid.
    """
    if not kind.elements:
        return Slid(ca.SX(0.0), {}, ca.SX(0.0), ca.SX(0.0))
    own = {name: known[HYSTERESIS_PREFIX + name] for name in parameters_of(kind)}
    own |= {name: known[name] for name in kind.known if name in known}
    now, past = ({**own, "length": each, **joints(each)} for each in (known["length"], known["length_n"]))
    moved = _coordinate(kind, now) - _coordinate(kind, past)
    potential, stored, lost, states = ca.SX(0.0), ca.SX(0.0), ca.SX(0.0), {}
    for name, (share, give) in zip(kind.states, _sliders(kind, own), strict=True):
        before = known[f"{HYSTERESIS_PREFIX}{name}_n"]
        d = give * before + moved
        e = ca.fmin(ca.fmax(d / give, -1.0), 1.0)
        spring = share * give / 2.0
        potential += acts * (share * e * d - spring * e**2)  # this form also has the correct slope at |d| = r
        stored += acts * spring * (e**2 - before**2)
        lost += acts * share * ca.fmax(ca.fabs(d) - give, 0.0)
        states[HYSTERESIS_PREFIX + name] = acts * e
    return Slid(potential, states, stored, lost)


def _coordinate(kind: type[Hysteresis], known: Mapping[str, ca.SX]) -> ca.SX:
    return scalar(f"{kind.__name__}.coordinate", answer(kind, "coordinate", known))


def _sliders(kind: type[Hysteresis], known: Mapping[str, ca.SX]) -> list[tuple[ca.SX, ca.SX]]:
    given = answer(kind, "sliders", known)
    name = f"{kind.__name__}.sliders"
    try:
        pairs = [(share, give) for share, give in given]
    except (TypeError, ValueError) as error:
        raise ValueError(
            f"{name}: got {type(given).__name__}, must be pairs of share and give; each {EXPRESSION_ADVICE}"
        ) from error
    if len(pairs) != kind.elements:
        raise ValueError(
            f"{name}: got {len(pairs)} pairs of share and give, must be {kind.elements} as `elements` says"
        )
    return [(scalar(f"{name}, share", share), scalar(f"{name}, give", give)) for share, give in pairs]
