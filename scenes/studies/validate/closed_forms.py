"""Comparison of closed forms of crawling and swimming with `worm3d.simulate`.

`CASES` is the table of the cases. Each case consists of a scene, a formula (`scenes.studies.validate.formulas`) and a
tolerance.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from scenes.language.errors import SceneError
from scenes.studies.validate.chain import Chain, Crawl
from scenes.studies.validate.formulas import (
    breathing,
    breathing_continuum,
    constant,
    drift_in_medium,
    elastic,
    of_pulse,
    of_quantiles,
    of_stroke,
    of_swimming,
    of_wave,
    off_the_steady_wave,
    sine,
    sine_continuum,
    swimming,
    two_loads,
)
from scenes.studies.validate.rows import Row
from worm3d.values.arrays import BoolArray

LEAST = 0.0101
"""Ratio of the smallest to the largest coefficient of friction. With a ratio below
`worm3d.physics.friction.SMALLEST_COEFFICIENT` the smallest coefficient would not set the breakaway displacement."""

DIRECT, RETROGRADE = "gait.direction=direct", "gait.direction=retrograde"
"""Overrides for waves from the tail to the head, and from the head to the tail."""


@dataclass(frozen=True)
class Case:
    """A closed form and the run that it is compared with. The two compared values are dimensionless.

    Parameters
    ----------
    name : str
    scene : str
        Name of a scene in the folder of this module, without ".toml".
    formula : callable
        Function that returns the value of the closed form for a `Chain`.
    overrides : tuple of str
        Overrides of the scene, as in `worm3d run -o`.
    measure : callable
        Function that returns the value of a run, a `Crawl`.
    tolerance : float
        The same as in `Row`.
    source, note : str
        The same as in `Row`.
    """

    name: str
    scene: str
    formula: Callable[[Chain], float]
    overrides: tuple[str, ...] = ()
    measure: Callable[[Crawl], float] = of_stroke
    tolerance: float = 1e-6
    source: str = "derived and checked in this project"
    note: str = ""

    def row(self) -> Row:
        """Run the scene and return the row with the values of the run and of the closed form.

        If the run fails, its value is NaN and the note is the error.
        """
        chain = Chain.of(self.scene, self.overrides)
        try:
            crawl = Crawl.of(chain)
        except (ValueError, SceneError) as error:
            return self._row(np.nan, self.formula(chain), str(error))
        loads = (f"loads of the feet within a fraction {crawl.unevenness:.1g} of their mean",) if chain.feet else ()
        return self._row(self.measure(crawl), self.formula(chain), "; ".join(filter(None, (self.note, *loads))))

    def _row(self, model: float, closed_form: float, note: str) -> Row:
        file = f"scenes/studies/validate/{self.scene}.toml"
        command = " ".join((file, *(f"-o {each}" for each in self.overrides)))
        scene = command if len(command) < 160 else f"{file}, varied"
        return Row(self.name, model, closed_form, self.tolerance, self.source, note, scene=scene)


def is_muscle(feet: int, muscles_each: int = 1) -> BoolArray:
    """Return which segments of a chain are muscles, shape (segments,).

    There are `muscles_each` muscles between consecutive feet.
    """
    return np.arange(feet + (feet - 1) * muscles_each) % (muscles_each + 1) > 0


def body(feet: int, *, tall: float = 0.016, low: float = 0.002) -> tuple[str, ...]:
    """Return the overrides for the body of a chain of `feet` feet, with one muscle between consecutive feet.

    Each segment has a length of 0.02 m and a mass of 0.01 kg. `tall` and `low` are the
    half-heights of the feet and of the muscles [m]. The friction is set separately, by `friction`.
    """
    n = 2 * feet - 1
    return (
        f"worm.segments={n}",
        f"worm.length_m={0.02 * n!r}",
        f"worm.mass_kg={0.01 * n!r}",
        f"worm.half_height_m={np.where(is_muscle(feet), low, tall).tolist()}",
        f"actuator.least={np.where(is_muscle(feet), -0.5, 0.0).tolist()}",
        f"actuator.greatest={np.where(is_muscle(feet), 0.9, 0.0).tolist()}",
    )


def friction(forward: float, backward: float, feet: int, muscles_each: int = 1) -> tuple[str, ...]:
    """Return the overrides for the coefficients of friction.

    The smallest coefficient of a worm determines how far the springs of its contacts stretch before the contacts
    slide. To make the springs stiff, the muscles, which do not touch the ground, get a small lateral coefficient.
    """
    larger = max(forward, backward)
    lateral = np.where(is_muscle(feet, muscles_each), LEAST * larger, larger).tolist()
    return f"friction.forward={forward!r}", f"friction.backward={backward!r}", f"friction.lateral={lateral}"


def phase_step(step: float, feet: int) -> str:
    """Return the override that sets the phase difference between neighbouring muscles to `step` [rad]."""
    return f"gait.wavelength={2.0 * np.pi / step * 2.0 / (2 * feet - 1)!r}"


WIDE = {"tall": 0.012, "low": 0.005}
"""Half-heights for `body` if the muscles not only shorten but also lengthen, by up to a tenth [m]."""

# Overrides for muscles whose phases do not form a wave.
PHASES_WITHOUT_ORDER = (
    "gait.kind=periodic",
    "gait.wavelength=1.0",
    "gait.waves=0",
    "gait.phase=[0, 0.13, 0, 0.71, 0, 0.36, 0, 0.92, 0, 0.55, 0, 0.28, 0, 0.81, 0, 0.44, 0]",
    "gait.duty=0.4",
)

GIDONI = "Gidoni, Noselli, DeSimone 2014"

CASES = [
    Case("Breathing, N = 7, q = 2/9", "breathing", breathing),
    Case("Breathing, N = 11, q = 10/33", "breathing", breathing, (*body(11), *friction(0.1, 0.23, 11))),
    Case("Breathing, N = 7, lower friction backwards", "breathing", breathing, friction(0.35, 0.1, 7)),
    Case(
        "Breathing, N = 100, compared with a continuum",
        "breathing",
        breathing_continuum,
        (*body(100), *friction(0.1, 0.33, 100)),
        tolerance=1e-3,
        source=f"{GIDONI} (breathing crawler); derived here",
    ),
    *(
        Case(
            f"Elastic crawler, k = {k} N, friction {forward} / {backward}",
            "elastic_crawler",
            elastic,
            (f"worm.spring_N={[1e7, k, k, k, k, 1e7]}", *friction(forward, backward, 2, 4)),
            source="derived here for the spring of a chamber; a linear spring would give d - 2 mu_f N/k",
        )
        for k, forward, backward in ((2.0, 0.1, 0.35), (1.0, 0.3, 0.5), (1.0, 0.4, 0.15))
    ),
    Case(
        "Elastic crawler, too soft for its stroke",
        "elastic_crawler",
        elastic,
        (f"worm.spring_N={[1e7, *[1.0] * 4, 1e7]}", *friction(0.3, 0.5, 2, 4), "gait.amplitude=0.1"),
        note="neither foot ever slides",
    ),
    *(
        Case(
            f"Two contacts, payload {payload} kg of 0.06 kg",
            "two_contacts",
            two_loads,
            (f"worm.payload_kg={payload}",),
            source="Noselli, DeSimone 2014, reduced model; derived here",
        )
        for payload in (0.01, 0.035)
    ),
    *(
        Case(
            f"Sine wave, N = 50, compared with a continuum, {override.removeprefix('gait.direction=')}",
            "sine_wave",
            sine_continuum,
            (override,),
            of_wave,
            1e-3,
            note="required: 1 % at N >= 400 and 0.1 % at N = 4000; 50 feet are sufficient, because N q = 10.5",
        )
        for override in (DIRECT, RETROGRADE)
    ),
    Case("Sine wave, N = 50, exact closed form", "sine_wave", sine, (), of_wave, 3e-5),
    Case("Sine wave, N = 50, q = 0.37", "sine_wave", sine, friction(0.2, 0.2 * 0.63 / 0.37, 50), of_wave, 3e-5),
    Case(
        "Steady wave, deviation from v = c (1 - lam/lam_a)", "sine_wave", constant(0.0), (), off_the_steady_wave, 0.02
    ),
    *(
        Case(
            f"Sines in unison, n = {n}, no foot slips back",
            "phase_steps",
            constant(2.0),
            (*body(n + 1, **WIDE), *friction(0.1, 1.0, n + 1), phase_step(1e-7, n + 1)),
            tolerance=3e-5,
        )
        for n in (3, 8)
    ),
    *(
        Case(
            f"Sines with phase steps of 2 pi/{n}, no foot slips back",
            "phase_steps",
            constant(1.0),
            (*body(n + 1, **WIDE), *friction(0.1, 1.0, n + 1), phase_step(2.0 * np.pi / n, n + 1)),
            tolerance=3e-5,
        )
        for n in (3, 4, 5, 8)
    ),
    *(
        Case(
            f"Velocity law, irregular phases, q = {forward / (forward + backward):.3g}",
            "phase_steps",
            of_quantiles,
            (*PHASES_WITHOUT_ORDER, *friction(forward, backward, 9)),
            tolerance=1e-3,
            source=f"{GIDONI} (the quantile law); derived here",
        )
        for forward, backward in ((0.1, 0.3), (0.1, 0.18))
    ),
    *(
        Case(
            f"Sines with phase steps of {step} rad, n = {n}, equal friction",
            "phase_steps",
            constant(0.0),
            (*body(n + 1, **WIDE), phase_step(step, n + 1), *friction(0.2, 0.2, n + 1)),
        )
        for n, step in ((4, 0.7), (6, 1.0), (8, 2.0))
    ),
    Case("Pulse of contraction, motion with the pulse", "pulse", constant(1.0), (), of_pulse, 1e-5),
    Case("Pulse of contraction from the head", "pulse", constant(-1.0), (RETROGRADE,), of_pulse, 1e-5),
    Case("Pulse of two muscles", "pulse", constant(2.0), ("gait.contract_time_s=400.0",), of_pulse, 1e-5),
    Case(
        "Pulse of extension, motion against the pulse",
        "pulse",
        constant(-1.0),
        ("gait.contract_time_s=1100.0",),
        of_pulse,
        1e-5,
    ),
    Case("Medium with equal resistance at all joints", "viscous_medium", constant(0.0), (), drift_in_medium, 1e-12),
    *(
        Case(
            f"Medium whose resistance depends on the strain, {what}",
            "medium_wave",
            swimming,
            overrides,
            of_swimming,
            source="derived here; the control of friction is that of Tanaka, Ito, Nakagaki, Kobayashi 2012",
        )
        for what, overrides in (
            ("phi = 0", ()),
            ("phi = pi", ("medium.gain=-5.0",)),
            ("phi = -0.81", ("medium.gain=3.0", "medium.rate_gain_s=5.0")),
            ("wave from the head", (RETROGRADE,)),
        )
    ),
]
"""All comparisons with closed forms of crawling."""


def rows(quick: bool) -> Iterator[Row]:
    """Run the cases and yield their rows (see `scenes.studies.validate.rows.Chapter`).

    `quick` has no effect, because all cases are quick.
    """
    return (case.row() for case in CASES)
