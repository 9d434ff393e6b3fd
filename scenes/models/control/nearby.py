"""A map for a worm that has not been identified: the map of the default worm, corrected by a few short runs.

A map gives the motion of a worm per wave: the distance d and the sideways drift c in body lengths, and the turn omega.
They depend only on dimensionless ratios. For a worm with N segments, length L and mass m, with the coefficients of
friction mu and gravity g,

    (d, omega, c) = F(A, f sqrt(L/g), s;  N, a/L, h/L, mu_b/mu_f, mu_l/mu_f, k L/(mu m g), J/(mu m g L) ...)        (N1)

Here A is the amplitude, f the frequency, s the steering, a the stance and h the height of the worm. mu_f, mu_b and mu_l
are the coefficients of friction forward, backward and sideways. k is the stiffness of the springs, and J represents the
stiffnesses of the joints in torsion, yaw and twist.

F is smooth. Therefore the map of the default worm can be corrected for a worm that is not very different, by (I5) of
`control.identification.surrogate`. This uses `DESIGN.runs` runs, which take a few seconds in total. A single factor for
the speed and another factor for the turn would not be sufficient. For example, if the springs and joints of the default
worm are half as stiff, the distance is 14 % less. The turn, however, is -1, 30 and 83 % of the turn of the default worm
with hinge angles of 0.02, 0.06 and 0.12 rad. The turn is approximately proportional to s^2/(s + z), where z increases
with the ratio of friction to stiffness.

The table shows rms errors of three maps for several worms, over 132 waves with steering by hinges, in % of the rms of
the quantity itself:

    worm                    map of default worm     corrected by 48 runs      own map from 120 runs
                            distance turn drift     distance turn drift       distance turn drift
    half as stiff              14     72   137         1.0    6.5    8           0.6   3.0   4
    half the springs only       9     57   129         1.1    4.9   10           0.9   2.6   6
    4 segments                 23     45    47         1.8    6.6   18           1.5   4.3  11
    8 segments                  9     34    72         1.5    1.8   15           1.0   0.9  12
    friction 1.3, 0.7, 0.7     10      3    29         1.5    1.1    6           1.1   0.7   5
    friction 0.7, 1.3, 1.3      7      2    25         1.2    1.3   11           0.9   0.9  10

The three numbers after "friction" are factors of mu_f, mu_b and mu_l. The lags of the
corrected map are those of the default worm. The corrected map is checked with additional runs
(`scenes.models.control.identify.check_parameters`). If an error exceeds `MAX_MAP_ERRORS`, the worm is too different
from the default worm. It is then refused, and has to be identified.
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
"""Design of the runs that correct the map: the 48 most informative of all combinations of amplitude, frequency and
steering in the design."""
MAX_MAP_ERRORS = MappingProxyType({"distance": 8.0, "turn": 20.0})
"""Maximum rms errors of a corrected map in additional runs [% of the rms of the quantity]. The worms of the table that
were tested with a controller have errors of up to 2.7 for the distance and 12 for the turn. The limits are larger by a
margin. They were not determined by experiments."""
IDENTIFY_ADVICE = (
    "identify it once by 'worm3d study identify SCENE' with the same options -o (takes a minute or two), or use the "
    "map of the default worm by -o controller.map=default"
)


def nearby(worm: worm3d.Worm, ground: worm3d.Friction, mechanism: Mechanism, wave: Schedule) -> Identified:
    """Return the map of a worm for one steering mechanism and one wave, on level ground.

    The map is stored in the user's cache. If the cache already contains the map, no runs are needed.

    Raises
    ------
    SceneError
        The worm tips over, or is too different from the default worm.
    """
    known = kept.load(worm, ground, wave, DESIGN)
    if known is not None and mechanism in known.maps:
        return known
    usual = kept.load(worm3d.Worm(), schedule=wave)
    assert usual is not None  # the map of the default worm is part of the package
    try:
        found = runs.map_of(runs.Subject(worm, ground, wave), DESIGN, mechanism, usual.maps[mechanism])
    except SceneError as error:
        raise SceneError(f"worm: {error}") from error
    for name, most in MAX_MAP_ERRORS.items():
        missed = found.checks[name].rms_percent
        if not missed <= most:
            raise SceneError(
                f"worm: it differs too much from the default worm: the error of the corrected map in the {name} per "
                f"wave is {missed:.0f} %, must be at most {most:g} %: {IDENTIFY_ADVICE}"
            )
    maps = {**(known.maps if known else {}), mechanism: found}
    lags = MappingProxyType({each: usual.lags[each] for each in maps})
    held = usual.held if worm.segments == len(usual.held) else ()
    strain = runs.strain_model(runs.Subject(worm, ground, wave), found)
    near = Identified(usual.schedule, MappingProxyType(maps), lags, held=held, strain=strain).on(worm, ground)
    kept.store(near, worm, ground, DESIGN)
    return near
