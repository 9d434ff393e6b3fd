"""A map for a worm that has not been identified: the map of the default worm, corrected by a few runs.

A map gives the motion of the worm per wave. The motion depends only on dimensionless ratios. For a worm of N segments,
length L, mass m, on friction mu, with gravity g,

    (d, omega, c) = F(A, f sqrt(L/g), s;  N, a/L, h/L, mu_b/mu_f, mu_l/mu_f, k L/(mu m g), J/(mu m g L) ...)        (N1)

d and c are distance and drift per wave in body lengths, and omega is the turn per wave. They depend on the amplitude A,
the frequency f and the steering s of the gait, and on the following properties of the worm: half of the distance
between its feet a, the height h, the coefficients of friction backward and sideways over the coefficient forward, and
the stiffness of springs (k) and of torsion, yaw and twist (J) relative to friction. Size and mass have no other
influence.

The only assumption of the correction is that F is smooth. It is (I5) in `control.identification.surrogate`, with
`DESIGN.runs` runs, which take some seconds in total. A single factor for the speed and a single factor for the turn
would not suffice. For example, if springs and joints are half as stiff, the default worm covers 14 % less distance, but
with hinge angles of 0.02, 0.06 and 0.12 rad the turn is -1, 30 and 83 % of the turn of the default worm. It follows
s^2/(s + z), where z grows with friction over stiffness.

This table has the rms errors in % of the rms of the quantity, over 132 waves that steer by hinges. The three numbers
for friction are the factors of the forward, the backward and the sideways coefficient.

    worm                    default's map           corrected by 48 runs      its own map, 120 runs
                            distance turn drift     distance turn drift       distance turn drift
    half as stiff              14     72   137         1.0    6.5    8           0.6   3.0   4
    half the springs only       9     57   129         1.1    4.9   10           0.9   2.6   6
    4 segments                 23     45    47         1.8    6.6   18           1.5   4.3  11
    8 segments                  9     34    72         1.5    1.8   15           1.0   0.9  12
    friction 1.3, 0.7, 0.7     10      3    29         1.5    1.1    6           1.1   0.7   5
    friction 0.7, 1.3, 1.3      7      2    25         1.2    1.3   11           0.9   0.9  10

The lags are taken from the default worm. The corrected map is checked by further runs (`identify.check_parameters`). If
its errors exceed `MAX_MAP_ERRORS`, the worm is too different, and the user has to identify it.
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
"""The 48 most informative of all combinations of amplitude, frequency and steering."""
MAX_MAP_ERRORS = MappingProxyType({"distance": 8.0, "turn": 20.0})
"""Largest allowed rms errors of a corrected map in the runs that check it [% of the rms of the quantity]. The worms of
the table above that were tested with a controller have errors of up to 2.7 for the distance and 12 for the turn. The
limits are larger by a margin; it was not measured at which error control fails."""
IDENTIFY_ADVICE = (
    "identify it once by 'worm3d study identify SCENE' with the same options -o (a minute or two), or take the "
    "default worm's map by -o controller.map=default"
)


def nearby(worm: worm3d.Worm, ground: worm3d.Friction, mechanism: Mechanism, wave: Schedule) -> Identified:
    """Return the maps of a worm on level ground for a wave, with at least the corrected map of the given mechanism.

    A new map is stored in the user's cache.

    Raises
    ------
    SceneError
        If the worm tips over, or is too different from the default worm.
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
