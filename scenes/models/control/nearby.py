"""A map for a worm without an identified map: the map of the default worm, corrected by a few runs.

The motion per wave depends only on ratios. For a worm of N segments, length L, mass m, on friction mu, with gravity g,

    (d, omega, c) = F(A, f sqrt(L/g), s;  N, a/L, h/L, mu_b/mu_f, mu_l/mu_f, k L/(mu m g), J/(mu m g L) ...)        (N1)

Distance and drift per wave in body lengths, and turn per wave, depend on amplitude, frequency and steering; on the
stance a and the height h; on friction backward and sideways over friction forward; and on the stiffness of springs (k,
over L: a force), torsion, yaw and twist (J) over friction. Size and mass alone do not matter. F changes smoothly, and
the method needs nothing else: `control.identification.surrogate`, (I5), from `DESIGN.runs` runs, which take some
seconds in all. One factor each for speed and turn would not be enough: with springs and joints half as stiff, the
default worm covers 14 % less distance, but with hinges of 0.02, 0.06 and 0.12 rad the turn is only -1, 30 and 83 % of
the default turn: s^2/(s + z), with z growing as friction over stiffness.

rms errors, in % of the rms of the quantity itself, over 132 waves with hinges:

    worm                    default's map           corrected by 48 runs      its own map, 120 runs
                            distance turn drift     distance turn drift       distance turn drift
    half as stiff              14     72   137         1.0    6.5    8           0.6   3.0   4
    half the springs only       9     57   129         1.1    4.9   10           0.9   2.6   6
    4 segments                 23     45    47         1.8    6.6   18           1.5   4.3  11
    8 segments                  9     34    72         1.5    1.8   15           1.0   0.9  12
    friction 1.3, 0.7, 0.7     10      3    29         1.5    1.1    6           1.1   0.7   5
    friction 0.7, 1.3, 1.3      7      2    25         1.2    1.3   11           0.9   0.9  10

(friction: factors forward, backward, sideways). The lags are those of the default worm. A worm is near if the map's
error at the new runs of `identify.check_parameters` is at most `MAX_MAP_ERRORS`; a worm farther away is refused,
because it has to be identified.
"""

from __future__ import annotations

from types import MappingProxyType

import worm3d
from control.gaits.steering import Mechanism, Schedule
from control.identification import identified as kept
from control.identification.identified import Design, Identified
from scenes.language.errors import SceneError
from scenes.models.control import identify as runs

DESIGN = Design(runs=48)
"""The most informative runs, out of all combinations of a design."""
MAX_MAP_ERRORS = MappingProxyType({"distance": 8.0, "turn": 20.0})
"""Largest rms error at new runs [% of the rms of the quantity]. The worms above with closed-loop runs have errors of up
to 2.7 for the distance and 12 for the turn; the limits leave room, and are not a measured boundary."""
IDENTIFY_ADVICE = (
    "identify it once by 'worm3d study identify SCENE' with the same options -o (a minute or two), or take the "
    "default worm's map by -o controller.map=default"
)


def nearby(worm: worm3d.Worm, ground: worm3d.Friction, mechanism: Mechanism, wave: Schedule) -> Identified:
    """Return the map of one mechanism of a worm's wave on level ground, stored in the user's cache.

    Raises
    ------
    SceneError
        The worm tips, or is too different from the default worm.
    """
    known = kept.load(worm, ground, wave, DESIGN)
    if known is not None and mechanism in known.maps:
        return known
    usual = kept.load(worm3d.Worm(), schedule=wave)
    assert usual is not None  # the map is shipped
    try:
        found = runs.map_of(runs.Subject(worm, ground, wave), DESIGN, mechanism, usual.maps[mechanism])
    except SceneError as error:
        raise SceneError(f"worm: {error}") from error
    for name, most in MAX_MAP_ERRORS.items():
        missed = found.checks[name].rms_percent
        if not missed <= most:
            raise SceneError(
                f"worm: it crawls so differently from the default worm that the map corrected on the spot misses the "
                f"{name} a wave by {missed:.0f} %, must be at most {most:g} %: {IDENTIFY_ADVICE}"
            )
    maps = {**(known.maps if known else {}), mechanism: found}
    lags = MappingProxyType({each: usual.lags[each] for each in maps})
    held = usual.held if worm.segments == len(usual.held) else ()
    strain = runs.strain_model(runs.Subject(worm, ground, wave), found)
    near = Identified(usual.schedule, MappingProxyType(maps), lags, held=held, strain=strain).on(worm, ground)
    kept.store(near, worm, ground, DESIGN)
    return near
