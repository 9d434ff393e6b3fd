"""Closed forms of crawling against `worm3d.simulate`: a table of cases, each a scene, a formula and a tolerance.

N feet carry equal loads, n = N - 1 muscles between them prescribe their motion relative to each other
(`scenes.validate.chain`), friction is mu_f against motion towards the head and mu_b against motion towards the tail,
and q = mu_f/(mu_f + mu_b). The body then moves at V = -(quantile at the level q of the feet's relative velocities): k =
floor(N q) feet slip back, and the next one holds. Ways are per cycle of the gait.

(Y1) In unison, with the stroke d of the whole body. The relative velocities are equally spaced, so that the foot which
     holds is the (k+1)-th from the rear while the body lengthens, from the front while it shortens, and the way is

         d (1 - 2 k/(N - 1)),   for N -> infinity d (mu_b - mu_f)/(mu_b + mu_f)

(Y2) Two feet and m soft muscles in series between them, E = (k l0/2)(1 - l/l_cmd)^2 each. Pulled by F = mu_f m g/2 a
     muscle has the length l_cmd + F l_cmd^2/(k l0), pressed by it l_cmd - F l_cmd^2/(k l0). The front foot moves on
     while the chain lengthens, pressed, to L1, the rear one while it shortens, pulled, to L2, and the way is

         m max(0, (L1 - L2) - F (L1^2 + L2^2)/(k l0))

(Y3) A sine wave. The muscle i has the length l0 + a sin(i phi - w t), and the feet's relative velocities are N samples
     a w/(2 sin(phi/2)) cos(...), evenly spaced in phase if N phi/(2 pi) is a whole number that has no factor in common
     with N. The (k+1)-th smallest, averaged over the drift of the phase by one sample, gives for phi = 2 pi/N

         N a cos(pi (k + 1/2)/N)/cos(pi/(2 N)),   for N -> infinity N a cos(pi q), which is V = A c cos(pi q)

     whichever way the wave runs; A is the amplitude of the strain, c the speed of the wave in the material.
(Y4) No foot slips back (k = 0): in unison (phi = 0) 2 n a; with phi = 2 pi/n, where the first and the last foot move
     alike and n phases remain in (Y3), n a.
(Y5) mu_f = mu_b and N odd, w(t + T/2) = -w(t): the median is odd as well, and the way 0 for every phi.
(Y6) A pulse runs along a chain at rest, and takes the length delta from it. While fewer than half of the feet move at
     once, the others hold: each foot moves by delta with a pulse of contraction, against one of extension, even if
     mu_f = mu_b.
(Y7) Two feet with the loads p: d while mu_f/mu_b < p_rear/p_front < mu_b/mu_f, else 0: the lighter foot goes to and
     fro.
(Y8) A steady wave. In the material it runs at c_m, lam(X - c_m t) is the stretch, and what holds has the stretch lam_a:
     v = c (1 - lam/lam_a) with the speed c = c_m lam_a of the wave over the ground, on average c_m (lam_a - 1).
(Y9) A medium that resists every joint alike: no net force, so that their mean rests, exactly.
(Y10) A medium that resists a segment in proportion to 1 + B cos(k X - w t + phi), its strain A cos(k X - w t), a whole
     number of waves on N segments of the length l0: the middle of a segment moves at V - A w (l0/2) cot(k l0/2)
     cos(k X - w t), the forces add up to 0, and

         V = (A B/2) c cos(phi) (k l0/2) cot(k l0/2),   for N -> infinity (A B/2) c cos(phi)
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from scenes.validate.chain import Chain, Crawl
from scenes.validate.rows import Row
from worm3d.values.arrays import BoolArray

SECTION = "derived and checked in this project"

LONGEST_COMMAND = 160
"""Number of characters of a scene and its overrides that a report shows."""

LEAST = 0.0101
"""Least coefficient over the largest. One below `worm3d.physics.friction.SMALLEST_COEFFICIENT` would not count."""

DIRECT, RETROGRADE = "gait.direction=direct", "gait.direction=retrograde"


@dataclass(frozen=True)
class Case:
    """A closed form and the run that it is compared with; both are numbers without unit.

    Parameters
    ----------
    name : str
    scene : str
        Name of a scene in this folder.
    formula : callable
        Chain -> closed form.
    measure : callable
        Crawl -> what the run gives.
    tolerance : float
        As of `Row`.
    overrides : tuple of str
        As of `worm3d run -o`.
    source, note : str
        As of `Row`.
    """

    name: str
    scene: str
    formula: Callable[[Chain], float]
    measure: Callable[[Crawl], float]
    tolerance: float
    overrides: tuple[str, ...] = ()
    source: str = SECTION
    note: str = ""

    def row(self) -> Row:
        """Run the scene and return what it gave beside the closed form; of a run that fails the note says why."""
        chain = Chain.of(self.scene, self.overrides)
        try:
            crawl = Crawl.of(chain)
        except ValueError as error:
            return self._row(np.nan, self.formula(chain), str(error))
        loads = (f"loads of the feet within {crawl.unevenness:.1g} of their mean",) if chain.feet else ()
        return self._row(self.measure(crawl), self.formula(chain), "; ".join(filter(None, (self.note, *loads))))

    def _row(self, model: float, closed_form: float, note: str) -> Row:
        command = " ".join((f"scenes/validate/{self.scene}.toml", *(f"-o {each}" for each in self.overrides)))
        return Row(
            name=self.name,
            model=model,
            published=closed_form,
            tolerance=self.tolerance,
            source=self.source,
            note=note,
            scene=command if len(command) < LONGEST_COMMAND else f"scenes/validate/{self.scene}.toml, varied",
        )


def of_stroke(crawl: Crawl) -> float:
    """Return the way over the stroke of all muscles together, (Y1), (Y2), (Y7)."""
    return crawl.travel / (crawl.chain.muscles * crawl.chain.swing)


def of_wave(crawl: Crawl) -> float:
    """Return the way over N a, (Y3): V/(A c)."""
    return crawl.travel / (crawl.chain.feet * crawl.chain.swing)


def of_swings(crawl: Crawl) -> float:
    """Return the way over n a, (Y4), (Y5)."""
    return crawl.travel / (crawl.chain.muscles * crawl.chain.swing)


def of_pulse(crawl: Crawl) -> float:
    """Return the way over the length that one muscle takes, (Y6)."""
    return crawl.travel / crawl.chain.swing


def breathing(chain: Chain) -> float:
    """Return (Y1) over the stroke; backwards if that is the easy way."""
    slipping = min(chain.slipping_back, chain.feet - 1 - chain.slipping_back)
    return float(np.copysign(1.0 - 2.0 * slipping / (chain.feet - 1), 0.5 - chain.level))


def breathing_continuum(chain: Chain) -> float:
    """Return (Y1) over the stroke for N -> infinity."""
    return 1.0 - 2.0 * chain.level


def elastic(chain: Chain) -> float:
    """Return (Y2) over the stroke m (L1 - L2)."""
    s, l0 = chain.settings, chain.l0
    longest, shortest = l0, l0 - chain.swing
    easy = min(s.friction.forward, s.friction.backward) * s.worm.mass_kg * s.run.gravity_m_s2 / 2.0
    k = float(np.asarray(s.worm.spring_N)[~chain.is_foot][0])
    lost = easy * (longest**2 + shortest**2) / (k * l0)
    return float(np.copysign(max(0.0, 1.0 - lost / (longest - shortest)), 0.5 - chain.level))


def sine(chain: Chain) -> float:
    """Return (Y3) over N a."""
    n = chain.feet
    return float(np.cos(np.pi * (chain.slipping_back + 0.5) / n) / np.cos(np.pi / (2 * n)))


def sine_continuum(chain: Chain) -> float:
    """Return (Y3) over N a for N -> infinity, cos(pi q)."""
    return float(np.cos(np.pi * chain.level))


def two_loads(chain: Chain) -> float:
    """Return (Y7) over d; the loads change with the distance of the feet and must stay on one side of the limits."""
    s, l0 = chain.settings, chain.l0
    free, payload = s.worm.mass_kg - s.worm.payload_kg, s.worm.payload_kg
    distance = l0 + chain.muscles * np.array([l0, l0 - chain.swing])
    moved = payload * l0 / (2.0 * distance)
    ratio = (free / 2.0 - moved) / (free / 2.0 + payload + moved)
    limit = min(s.friction.forward / s.friction.backward, s.friction.backward / s.friction.forward)
    if ratio.min() > limit:
        return float(np.copysign(1.0, 0.5 - chain.level))
    if ratio.max() < limit:
        return 0.0
    raise ValueError(f"two_loads: the ratio of loads, {ratio.min():.3g} to {ratio.max():.3g}, passes {limit:.3g}")


def off_the_steady_wave(crawl: Crawl) -> float:
    """Return the rms deviation of the velocities between feet from (Y8), over the largest velocity."""
    chain, steps = crawl.chain, crawl.chain.steps
    s = chain.settings
    places, dt = crawl.places[-1 - steps :], s.run.dt_s
    gaps = np.diff(places, axis=1) / (2.0 * chain.l0)
    stretch = (gaps[1:] + gaps[:-1]) / 2.0
    velocity = np.diff(places, axis=0) / dt
    towards_head = 1.0 if s.gait.direction == "direct" else -1.0
    in_material = towards_head * chain.feet * 2.0 * chain.l0 / s.gait.period_s
    anchored = 1.0 + towards_head * s.gait.amplitude / 2.0 * np.cos(np.pi * chain.level)
    law = in_material * anchored * (1.0 - stretch / anchored)
    off = (velocity[:, 1:] + velocity[:, :-1]) / 2.0 - law
    return float(np.sqrt(np.mean(off**2)) / np.abs(velocity).max())


def drift_in_medium(crawl: Crawl) -> float:
    """Return the largest displacement of the mean joint, where the ends count half, in body lengths (Y9)."""
    joints = crawl.result.joints
    mean = (joints[:, :-1] + joints[:, 1:]).mean(axis=1) / 2.0
    return float(np.abs(mean - mean[0]).max()) / float(crawl.chain.settings.worm.length_m)


def of_swimming(crawl: Crawl) -> float:
    """Return the velocity of the mean joint in the last period over A c, (Y10)."""
    s, joints = crawl.chain.settings, crawl.result.joints[:, :, 0]
    mean = (joints[:, :-1] + joints[:, 1:]).mean(axis=1) / 2.0
    period = crawl.chain.steps // s.run.record_every
    waves = s.gait.wavelength * s.worm.length_m  # its speed times the period
    return float((mean[-1] - mean[-1 - period]) / (s.gait.amplitude * waves))


def swimming(chain: Chain) -> float:
    """Return (Y10) over A c: B cos(phi) is the gain times A."""
    s = chain.settings
    half = np.pi / (s.gait.wavelength * s.worm.segments)
    along = 1.0 if s.gait.direction == "direct" else -1.0
    return float(along * s.medium.gain * s.gait.amplitude / 2.0 * half / np.tan(half))


def constant(value: float) -> Callable[[Chain], float]:
    """Return a closed form that is a number."""
    return lambda _: value


def is_muscle(feet: int, muscles_each: int = 1) -> BoolArray:
    """Return which segments of a chain are muscles, with so many of them between two feet."""
    return np.arange(feet + (feet - 1) * muscles_each) % (muscles_each + 1) > 0


def body(feet: int, *, tall: float = 0.016, low: float = 0.002) -> tuple[str, ...]:
    """Return the overrides that make a chain of so many feet with a muscle between two of them, but for its friction.

    Segments are 0.02 m long and of 0.01 kg; `tall` and `low` are the half-heights of feet and muscles [m].
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
    """Return the overrides of the coefficients.

    The least of all coefficients sets how far anchors give way. That of muscles, which touch nothing, makes them stiff.
    """
    larger = max(forward, backward)
    lateral = np.where(is_muscle(feet, muscles_each), LEAST * larger, larger).tolist()
    return f"friction.forward={forward!r}", f"friction.backward={backward!r}", f"friction.lateral={lateral}"


def phase_step(step: float, feet: int) -> str:
    """Return the override that sets the step of phase between neighbouring muscles [rad]."""
    return f"gait.wavelength={2.0 * np.pi / step * 2.0 / (2 * feet - 1)!r}"


IN_UNISON = 1e-7
"""Step of phase that stands for none [rad]."""

WIDE = {"tall": 0.012, "low": 0.005}
"""Half-heights of chains whose muscles lengthen too, by a tenth [m]."""

BREATHING = [
    Case("Breathing, N = 7, q = 2/9", "breathing", breathing, of_stroke, 1e-6),
    Case(
        "Breathing, N = 11, q = 10/33", "breathing", breathing, of_stroke, 1e-6, (*body(11), *friction(0.1, 0.23, 11))
    ),
    Case("Breathing, N = 7, easy backwards", "breathing", breathing, of_stroke, 1e-6, friction(0.35, 0.1, 7)),
    Case(
        "Breathing, N = 100 for a continuum",
        "breathing",
        breathing_continuum,
        of_stroke,
        1e-3,
        (*body(100), *friction(0.1, 0.33, 100)),
        source="Gidoni, Noselli, DeSimone 2014 (breathing crawler); derived here",
    ),
]

ELASTIC = [
    Case(
        f"Elastic crawler, k = {k} N, friction {forward} / {backward}",
        "elastic_crawler",
        elastic,
        of_stroke,
        1e-6,
        (f"worm.spring_N={[1e7, k, k, k, k, 1e7]}", *friction(forward, backward, 2, 4)),
        source="derived here for the spring of a chamber; a linear one gives d - 2 mu_f N/k",
    )
    for k, forward, backward in ((2.0, 0.1, 0.35), (1.0, 0.3, 0.5), (1.0, 0.4, 0.15))
] + [
    Case(
        "Elastic crawler, too soft for its stroke",
        "elastic_crawler",
        elastic,
        of_stroke,
        1e-6,
        (f"worm.spring_N={[1e7, *[1.0] * 4, 1e7]}", *friction(0.3, 0.5, 2, 4), "gait.amplitude=0.1"),
        note="neither foot ever slides",
    )
]

LOADS = [
    Case(
        f"Two contacts, payload {payload} kg of 0.06 kg",
        "two_contacts",
        two_loads,
        of_stroke,
        1e-6,
        (f"worm.payload_kg={payload}",),
        source="Noselli, DeSimone 2014, reduced model; derived here",
    )
    for payload in (0.01, 0.035)
]

SINE = [
    Case(
        f"Sine wave, N = 50 for a continuum, {override.removeprefix('gait.direction=')}",
        "sine_wave",
        sine_continuum,
        of_wave,
        1e-3,
        (override,),
        note="asked for are 1 % at N >= 400 and 0.1 % at N = 4000; N q = 10.5 makes fifty feet do",
    )
    for override in (DIRECT, RETROGRADE)
] + [
    Case("Sine wave, N = 50 exactly", "sine_wave", sine, of_wave, 3e-5),
    Case("Sine wave, N = 50, q = 0.37", "sine_wave", sine, of_wave, 3e-5, friction(0.2, 0.2 * 0.63 / 0.37, 50)),
    Case("Steady wave, deviation from v = c (1 - lam/lam_a)", "sine_wave", constant(0.0), off_the_steady_wave, 0.02),
]

STEPS = [
    Case(
        f"Sines in unison, n = {n}, no back-slip",
        "phase_steps",
        constant(2.0),
        of_swings,
        3e-5,
        (*body(n + 1, **WIDE), *friction(0.1, 1.0, n + 1), phase_step(IN_UNISON, n + 1)),
    )
    for n in (3, 8)
] + [
    Case(
        f"Sines in steps of 2 pi/{n}, no back-slip",
        "phase_steps",
        constant(1.0),
        of_swings,
        3e-5,
        (*body(n + 1, **WIDE), *friction(0.1, 1.0, n + 1), phase_step(2.0 * np.pi / n, n + 1)),
    )
    for n in (3, 4, 5, 8)
]

ISOTROPIC = [
    Case(
        f"Sines in steps of {step} rad, n = {n}, equal friction",
        "phase_steps",
        constant(0.0),
        of_swings,
        1e-6,
        (*body(n + 1, **WIDE), phase_step(step, n + 1), *friction(0.2, 0.2, n + 1)),
    )
    for n, step in ((4, 0.7), (6, 1.0), (8, 2.0))
]

PULSES = [
    Case("Pulse of contraction, with it", "pulse", constant(1.0), of_pulse, 1e-5),
    Case("Pulse of contraction from the head", "pulse", constant(-1.0), of_pulse, 1e-5, (RETROGRADE,)),
    Case("Pulse of two muscles", "pulse", constant(2.0), of_pulse, 1e-5, ("gait.contract_time_s=400.0",)),
    Case("Pulse of extension, against it", "pulse", constant(-1.0), of_pulse, 1e-5, ("gait.contract_time_s=1100.0",)),
]

MEDIUM = [
    Case("Medium that resists every joint alike", "viscous_medium", constant(0.0), drift_in_medium, 1e-12),
    *(
        Case(
            f"Medium that follows the strain, {what}",
            "medium_wave",
            swimming,
            of_swimming,
            1e-6,
            overrides,
            source="derived here; Tanaka, Ito, Nakagaki, Kobayashi 2012 control friction so",
        )
        for what, overrides in (
            ("phi = 0", ()),
            ("phi = pi", ("medium.gain=-5.0",)),
            ("phi = -0.81", ("medium.gain=3.0", "medium.rate_gain_s=5.0")),
            ("the wave from the head", (RETROGRADE,)),
        )
    ),
]

CASES = [*BREATHING, *ELASTIC, *LOADS, *SINE, *STEPS, *ISOTROPIC, *PULSES, *MEDIUM]
"""All closed forms of the report."""


def rows(quick: bool) -> Iterator[Row]:
    """Run the cases; see `scenes.validate.rows.Chapter`. All are quick."""
    return (case.row() for case in CASES)
