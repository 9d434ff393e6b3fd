"""Comparisons of simulated animals with measurements. `scenes.studies.validate.robots` explains the method."""

from __future__ import annotations

import math

from scenes.studies.validate.comparison import Comparison, Source, chapter, friction, pipe, speed, within
from scenes.studies.validate.measures import Changes, Exponent, Figure, Ratio

QUILLIN_1999 = Source("Quillin, J. Exp. Biol. 202 (1999) 661, abstract", "R", "animal")
QUILLIN = Source("Quillin 1999 and 2000, regressions as quoted in a student's table", "R2", "animal")
GREANEY = Source(
    "Greaney et al., J. Neurosci. 2026, 12 larvae, 10th to 90th percentile, as tabulated by others", "R2", "animal"
)
LIU = Source("Liu et al., eLife 83328 (2023), as quoted by others", "R2", "animal")
HECKSCHER = Source("Heckscher et al. 2012, as quoted in eLife 11031", "R2", "animal")

BURROWS = (0.00395, 0.0045)
"""Further radii of the earthworm's burrow, for which the model's number is computed too [m]."""
ASYMMETRIES = (("friction.forward=0.03",), ("friction.forward=0.3",))
STRAINS = (("gait.amplitude=0.1",), ("gait.amplitude=0.3",))
GRAMS = (0.1, 1.0, 8.0)
"""Masses of the simulated earthworms [g]. The measured range is 0.012 to 8.5 g."""


def in_burrow_over_free(radius: float) -> Ratio:
    """Return the ratio of the earthworm's stride in a pipe with a given radius [m] to its stride on the ground."""
    return Ratio(Figure("stride_BL", "earthworm", pipe(radius)), Figure("stride_BL", "earthworm"))


L3 = (
    "worm.length_m=4e-3",
    "worm.half_height_m=0.3e-3",
    "worm.chamber_offset_m=0.13e-3",
    "worm.mass_kg=2.3e-6",
    "worm.spring_N=1.1e-3",
    "worm.torsion_J=1e-7",
    "worm.yaw_J=1e-7",
    "worm.twist_J=1e-7",
    "gait.period_s=0.667",
    "gait.contract_time_s=0.27",
    "gait.amplitude=0.3",
    "run.duration_s=6.67",
    "run.dt_s=0.005",
)
"""Changes for a larva of the third instar: 4 mm long, 1.5 waves a second, a contraction of 30 %. Its shape and the
pressure in its body are the same as in the first instar."""


def earthworm(grams: float) -> Changes:
    """Return the changes that scale the earthworm of 1 g to another mass m by published power laws.

    The shape and the pressure in the body do not depend on the mass. The length is proportional to m^0.34, and the
    frequency to m^-0.07. At the same pressure, the strength of the springs is proportional to the cross-section of the
    body, and the strength of the joints to the volume of the body.
    """
    size, beat = grams**0.34, grams**-0.07
    scaled = {
        "worm.mass_kg": 1e-3 * grams,
        "worm.length_m": 0.102 * size,
        "worm.half_height_m": 0.0028 * size,
        "worm.chamber_offset_m": 0.001 * size,
        "worm.spring_N": 0.12 * size**2,
        "worm.torsion_J": 1e-4 * size**3,
        "worm.yaw_J": 1e-4 * size**3,
        "worm.twist_J": 1e-4 * size**3,
        "gait.period_s": 4.0 / beat,
        "run.duration_s": 32.0 / beat,
        "run.dt_s": 0.02 / beat,
    }
    return tuple(f"{key}={value:.6g}" for key, value in scaled.items())


ANIMAL_COMPARISONS = (
    Comparison(
        "Earthworm of 1 g: stride",
        Figure("stride_BL", "earthworm"),
        0.15,
        (0.1, 0.3),
        QUILLIN,
        "The stride is nearly in proportion to the assumed strain, 0.2 (0.1 to 0.3). The band contains the strides "
        "that are plausible for all worms.",
        unit="BL",
        unknown=(*STRAINS, *ASYMMETRIES),
    ),
    Comparison(
        "Earthworm of 1 g: speed",
        Figure("speed_BL_s", "earthworm"),
        0.037,
        (0.02, 0.06),
        QUILLIN,
        "The model is given the published frequency, 0.25 Hz. The speed is the stride above times this frequency. The "
        "band contains the preferred speeds of earthworms.",
        standing="input",
        unit="BL/s",
        unknown=(*STRAINS, *ASYMMETRIES),
    ),
    Comparison(
        "Earthworm: exponent of the speed over the mass",
        Exponent({grams: speed("earthworm", *earthworm(grams)) for grams in GRAMS}),
        0.33,
        (0.23, 0.43),
        QUILLIN_1999,
        "Masses of 0.1, 1 and 8 g, with the same strain. The length and the frequency are scaled with their published "
        "exponents, 0.34 and -0.07. The exponent of the model's speed is therefore the sum, 0.27.",
        standing="input",
        unknown=(*STRAINS, *ASYMMETRIES),
    ),
    Comparison(
        "Earthworm: exponent of the stride over the mass",
        Exponent({grams: Figure("stride_m", "earthworm", earthworm(grams)) for grams in GRAMS}),
        0.41,
        (0.31, 0.51),
        QUILLIN_1999,
        "As above. At the same strain, the model's stride is proportional to the length, which has the exponent 0.34.",
        standing="input",
        unknown=(*STRAINS, *ASYMMETRIES),
    ),
    Comparison(
        "Earthworm of 1 g: ratio of strides, burrow to ground",
        in_burrow_over_free(0.0042),
        0.04 / 0.15,
        within(2.0, 0.04 / 0.15),
        QUILLIN,
        "The model's burrow is an open pipe, which is 10 % (4 to 18 %) wider than the worm. The model's worm moves in "
        "the pipe as on the ground. Animals that burrow push earth away, and make other movements.",
        others=tuple(map(in_burrow_over_free, BURROWS)),
        trend=True,
    ),
    Comparison(
        "Larva, first instar: speed",
        speed("larva"),
        31.8e-6,
        (23.5e-6, 48.6e-6),
        GREANEY,
        "The contracted segments of the model's worm are thick and carry the worm. A larva lifts its contracted "
        "segments. Assumed: friction 0.1 (0.03 to 0.3) forward, 0.5 backward.",
        unit="m/s",
        unknown=ASYMMETRIES,
    ),
    Comparison(
        "Larva, first instar: stride",
        Figure("stride_m", "larva"),
        153e-6,
        (140e-6, 179e-6),
        GREANEY,
        "As above.",
        unit="m",
        unknown=ASYMMETRIES,
    ),
    Comparison(
        "Larva, third instar: speed",
        speed("larva", *L3),
        1.0e-3,
        (0.35e-3, 1.23e-3),
        LIU,
        "The model makes 1.5 waves a second with a contraction of 30 %. The published number, about 1 mm/s, is by "
        "Hughes and Thomas (2007), as quoted by others.",
        unit="m/s",
        unknown=ASYMMETRIES,
    ),
    Comparison(
        "Larva, first instar: speed with equal friction in all directions",
        speed("larva", *friction(0.3)),
        None,
        (0.0, math.inf),
        HECKSCHER,
        "A larva lifts the three segments where the wave is, and would therefore get forward on any ground. The "
        "model's worm goes the other way, because its contracted segments hold the ground.",
        unit="m/s",
        trend=True,
    ),
)

rows = chapter(ANIMAL_COMPARISONS)
"""Function that runs the comparisons and yields their rows one by one. With `quick`, the spreads are left out."""
