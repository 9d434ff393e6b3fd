"""Robots and animals: what was measured beside what their scenes give, as bands, and whether trends have their sign.

Sizes, masses and gaits are those of the sources. What the sources do not tell is assumed once, in the scene, and named
in the row; `unknown` lists other values of it, over which the row says how far the model's number spreads. Nothing is
chosen so that a row comes out right.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from scenes.validate.measures import Changes, Exponent, Figure, Measure, Ratio, StoppedError
from scenes.validate.rows import Row

CMMWORM = "Horchler et al., Soft Robotics 2 (2015) 135, abstract"
KANDHARI = "Kandhari et al., An Analysis of Peristaltic Locomotion (2019), abstract"
RIDDLE = "Riddle et al., Bioinspiration & Biomimetics 20 (2025) 066001, a simulation, as quoted in talks on it"
BRAID = "Active Braid Crawler, its authors' table"
QUILLIN_1999 = "Quillin, J. Exp. Biol. 202 (1999) 661, abstract"
QUILLIN = "Quillin 1999 and 2000, regressions as quoted in a student's table"
GREANEY = "Greaney et al., J. Neurosci. 2026, 12 larvae, 10th to 90th percentile, as tabulated by others"
LIU = "Liu et al., eLife 83328 (2023), as quoted by others"
HECKSCHER = "Heckscher et al. 2012, as quoted in eLife 11031"

ABOVE_1, BELOW_1 = (1.0, math.inf), (-math.inf, 1.0)
"""Bands of trends of which only the sign was published."""


def friction(mu: float) -> Changes:
    """Return the changes of a scene that make its friction the same in all directions."""
    return tuple(f"friction.{way}={mu}" for way in ("forward", "backward", "lateral"))


def within(factor: float, published: float) -> tuple[float, float]:
    """Return the band from the published number over a factor to the factor times the number."""
    return published / factor, published * factor


@dataclass(frozen=True)
class Comparison:
    """A measure beside what was published; the fields that `Row` has mean the same."""

    name: str
    measure: Measure
    published: float | None
    band: tuple[float, float]
    source: str
    trust: str
    note: str
    unit: str = "1"
    unknown: Sequence[Changes] = ()
    """Changes of the scene to other values of what the source does not tell."""
    others: Sequence[Measure] = ()
    """The measure with other values of it, where these belong to only some of its runs."""
    trend: bool = False
    """Whether the number is a ratio that says by its side of 1 how something changes."""

    def row(self, *, quick: bool) -> Row:
        """Return the row; with `quick` without the spread."""
        note, model, others = self.note, math.nan, []
        try:
            model = self.measure()
            others = [] if quick else [*(_found(self.measure, c) for c in self.unknown), *map(_found, self.others)]
        except StoppedError as error:
            note = f"the model gives nothing: {error}. {note}"
        found = [other for other in others if other is not None]
        if len(found) < len(others):
            note += f" With {len(others) - len(found)} of {len(others)} other values the run does not come to its end."
        return Row(
            name=self.name,
            model=model,
            published=self.published,
            tolerance=self.band,
            source=self.source,
            note=note,
            trust=self.trust,
            unit=self.unit,
            scene=self.measure.scene,
            spread=(min(model, *found), max(model, *found)) if found else None,
            sign_agrees=self._sign_agrees(model),
        )

    def _sign_agrees(self, model: float) -> bool | None:
        if not self.trend or math.isnan(model):
            return None
        rises = self.published > 1.0 if self.published is not None else self.band == ABOVE_1
        return (model > 1.0) == rises


def _found(measure: Measure, changes: Changes = ()) -> float | None:
    """Return the number of a measure, None if a run does not come to its end."""
    try:
        return measure(changes)
    except StoppedError:
        return None


def rows(quick: bool) -> Iterator[Row]:
    """Yield the rows of robots and animals, each as soon as it is known; with `quick` without spreads."""
    for comparison in COMPARISONS:
        yield comparison.row(quick=quick)


def _speed(scene: str, *changes: str) -> Figure:
    return Figure("speed_m_s", scene, changes)


SOFT_TO_STIFF = tuple((f"worm.spring_N={k}",) for k in (50.0, 200.0, 1000.0, 5000.0))
GROUNDS = tuple(friction(mu) for mu in (0.2, 0.8))
THREE_MOVE = ("gait.moving=0.5", "gait.held=0.3333333333333333")
"""Three of six segments move at a time, as in the waveform 3x1."""

PIPES = (0.0725, 0.0775)
"""Other radii of the braid crawler's pipe [m]."""
BURROWS = (0.00395, 0.0045)
"""Other radii of the earthworm's burrow [m]."""
ASYMMETRIES = (("friction.forward=0.03",), ("friction.forward=0.3",))
STRAINS = (("gait.amplitude=0.1",), ("gait.amplitude=0.3",))
GRAMS = (0.1, 1.0, 8.0)
"""Masses of earthworms, in the range of the measured ones, 0.012 to 8.5 g [g]."""


def pipe(radius: float, *changes: str) -> Changes:
    """Return the changes of a scene that put its worm into a pipe, with further ones; the radius is in m."""
    return ("world.kind=pipe", f"world.radius_m={radius}", *changes)


def in_pipe_over_free(radius: float) -> Ratio:
    """Return the speed of the braid crawler in a level pipe over that on the ground."""
    return Ratio(_speed("braid_crawler", *pipe(radius)), _speed("braid_crawler"))


def up_over_level(radius: float) -> Ratio:
    """Return the speed of the braid crawler in a vertical pipe over that in a level one."""
    level, up = pipe(radius), pipe(radius, "world.tilt_deg=90")
    return Ratio(_speed("braid_crawler", *up), _speed("braid_crawler", *level))


def in_burrow_over_free(radius: float) -> Ratio:
    """Return the stride of the earthworm in a pipe over that on the ground."""
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
"""Larva of the third instar: 4 mm, 1.5 waves a second, contraction 30 %; shape and pressure as of the first."""


def earthworm(grams: float) -> Changes:
    """Return the changes that make the earthworm of 1 g one of another mass, by the published powers of the mass.

    Length m^0.34 at the same shape, frequency m^-0.07; the pressure in the body is the same, so that springs grow with
    the cross-section and joints with the volume.
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


COMPARISONS = (
    Comparison(
        "CMMWorm: speed on plywood",
        _speed("cmmworm"),
        4.3e-3,
        within(2.0, 4.3e-3),
        CMMWORM,
        "R",
        "Assumed: friction 0.4 (0.2 to 0.8), springs of 100 N (50 to 5000), and the successor's gait.",
        unit="m/s",
        unknown=(*SOFT_TO_STIFF, *GROUNDS, THREE_MOVE),
    ),
    Comparison(
        "CMMWorm: speed, friction 0.8 over 0.2",
        Ratio(_speed("cmmworm", *friction(0.8)), _speed("cmmworm", *friction(0.2))),
        None,
        ABOVE_1,
        CMMWORM,
        "R",
        "Faster where friction is larger. In the model that holds of stiff worms; soft ones are held back by friction.",
        unknown=SOFT_TO_STIFF,
        trend=True,
    ),
    Comparison(
        "CMMWorm: speed, 3 over 2 moving segments",
        Ratio(_speed("cmmworm", *THREE_MOVE), _speed("cmmworm")),
        None,
        ABOVE_1,
        KANDHARI,
        "R",
        "Speed is largest with as many moving segments as possible.",
        unknown=(*SOFT_TO_STIFF, *GROUNDS),
        trend=True,
    ),
    Comparison(
        "CMMWorm: cost of transport, 3 over 2 moving segments",
        Ratio(Figure("cost_of_transport", "cmmworm", THREE_MOVE), Figure("cost_of_transport", "cmmworm")),
        None,
        ABOVE_1,
        KANDHARI,
        "R",
        "The cost of transport is least with few moving segments; there it is the power that holds segments in shape.",
        unknown=(*SOFT_TO_STIFF, *GROUNDS),
        trend=True,
    ),
    Comparison(
        "CMMWorm-SES: speed on the ground",
        _speed("cmmworm_ses"),
        0.0385,
        (0.029, 0.048),
        RIDDLE,
        "R2",
        "Another simulation, no measurement: 29 to 48 mm/s over friction of 0.1 to 0.9.",
        unit="m/s",
        unknown=(*SOFT_TO_STIFF, friction(0.1), friction(0.9)),
    ),
    Comparison(
        "CMMWorm-SES: speed, friction 0.9 over 0.1, stiff mesh",
        Ratio(
            _speed("cmmworm_ses", "worm.spring_N=1000", *friction(0.9)),
            _speed("cmmworm_ses", "worm.spring_N=1000", *friction(0.1)),
        ),
        None,
        ABOVE_1,
        RIDDLE,
        "R2",
        "There a stiff mesh is faster on more friction. Stiff here: springs of 1000 N.",
        trend=True,
    ),
    Comparison(
        "CMMWorm-SES: speed, friction 0.9 over 0.1, soft mesh",
        Ratio(_speed("cmmworm_ses", *friction(0.9)), _speed("cmmworm_ses", *friction(0.1))),
        None,
        BELOW_1,
        RIDDLE,
        "R2",
        "There a soft mesh is slower on more friction. Soft here: springs of 26 N, by the measured work.",
        trend=True,
    ),
    Comparison(
        "Active Braid Crawler: speed in a level pipe over free",
        in_pipe_over_free(0.075),
        72 / 22,
        within(2.0, 72 / 22),
        BRAID,
        "R",
        "On the ground the robot loses 70 % of what it gains in a pipe to slip. The model's worm, whose sections keep "
        "their lengths whatever they meet, slips little.",
        unknown=(*GROUNDS, ("worm.spring_N=300.0",), ("worm.spring_N=3000.0",)),
        others=tuple(map(in_pipe_over_free, PIPES)),
        trend=True,
    ),
    Comparison(
        "Active Braid Crawler: speed in a vertical pipe over level",
        up_over_level(0.075),
        27 / 72,
        within(2.0, 27 / 72),
        BRAID,
        "R",
        "The model's cranks lift the robot without slowing down or giving way, in a pipe of 145 to 152 mm; in one of "
        "155 mm, in which a section alone has no hold at times, it slides down.",
        unknown=(*GROUNDS, ("worm.spring_N=3000.0",)),
        others=tuple(map(up_over_level, PIPES)),
        trend=True,
    ),
    Comparison(
        "Earthworm of 1 g: stride",
        Figure("stride_BL", "earthworm"),
        0.15,
        (0.1, 0.3),
        QUILLIN,
        "R2",
        "The stride is nearly in proportion to the assumed strain, 0.2 (0.1 to 0.3). Band: plausible for all worms.",
        unit="BL",
        unknown=(*STRAINS, *ASYMMETRIES),
    ),
    Comparison(
        "Earthworm of 1 g: speed",
        Figure("speed_BL_s", "earthworm"),
        0.037,
        (0.02, 0.06),
        QUILLIN,
        "R2",
        "Stride times the published frequency, 0.25 Hz, which the model does not predict. Band: preferred speeds.",
        unit="BL/s",
        unknown=(*STRAINS, *ASYMMETRIES),
    ),
    Comparison(
        "Earthworm: exponent of the speed over the mass",
        Exponent({grams: _speed("earthworm", *earthworm(grams)) for grams in GRAMS}),
        0.33,
        (0.23, 0.43),
        QUILLIN_1999,
        "R",
        "0.1, 1 and 8 g; length and frequency by their published exponents, 0.34 and -0.07, the same strain.",
        unknown=(*STRAINS, *ASYMMETRIES),
    ),
    Comparison(
        "Earthworm: exponent of the stride over the mass",
        Exponent({grams: Figure("stride_m", "earthworm", earthworm(grams)) for grams in GRAMS}),
        0.41,
        (0.31, 0.51),
        QUILLIN_1999,
        "R",
        "As above. At the same strain the model's stride grows as the length.",
        unknown=(*STRAINS, *ASYMMETRIES),
    ),
    Comparison(
        "Earthworm of 1 g: stride in a burrow over free",
        in_burrow_over_free(0.0042),
        0.04 / 0.15,
        within(2.0, 0.04 / 0.15),
        QUILLIN,
        "R2",
        "The model's burrow is an open pipe, 10 % wider than the worm (4 to 18 %), in which it moves as on the ground; "
        "animals that burrow push earth away, and make other movements.",
        others=tuple(map(in_burrow_over_free, BURROWS)),
        trend=True,
    ),
    Comparison(
        "Larva, first instar: speed",
        _speed("larva"),
        31.8e-6,
        (23.5e-6, 48.6e-6),
        GREANEY,
        "R2",
        "Contracted segments are thick and carry the model's worm; a larva lifts them. Assumed: friction 0.1 forward, "
        "0.5 backward (forward 0.03 to 0.3).",
        unit="m/s",
        unknown=ASYMMETRIES,
    ),
    Comparison(
        "Larva, first instar: stride",
        Figure("stride_m", "larva"),
        153e-6,
        (140e-6, 179e-6),
        GREANEY,
        "R2",
        "As above.",
        unit="m",
        unknown=ASYMMETRIES,
    ),
    Comparison(
        "Larva, third instar: speed",
        _speed("larva", *L3),
        1.0e-3,
        (0.35e-3, 1.23e-3),
        LIU,
        "R2",
        "At 1.5 waves a second and a contraction of 30 %; about 1 mm/s (Hughes and Thomas 2007, quoted).",
        unit="m/s",
        unknown=ASYMMETRIES,
    ),
    Comparison(
        "Larva, first instar: speed with equal friction in all directions",
        _speed("larva", *friction(0.3)),
        None,
        (0.0, math.inf),
        HECKSCHER,
        "R2",
        "Three segments are off the ground where the wave is, so a larva would get forward on any ground. The model's "
        "worm goes the other way: its contracted segments hold the ground.",
        unit="m/s",
    ),
)
