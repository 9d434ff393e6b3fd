"""Closed forms of crawling and swimming, and the matching results of runs; both are numbers without unit.

N feet carry equal loads, n = N - 1 muscles between them prescribe their motion relative to each other
(`chain` beside this file), friction is mu_f against motion towards the head and mu_b against motion towards the tail,
and q = mu_f/(mu_f + mu_b). The body then moves at V = -(quantile at the level q of the feet's relative velocities): k =
floor(N q) feet slip back, and the next foot holds. Ways are per cycle of the gait.

(Y1) In unison, with the stroke d of the whole body. The relative velocities are equally spaced. The foot that holds is
     therefore the (k+1)-th foot, from the rear while the body lengthens, from the front while it shortens. The way is

         d (1 - 2 k/(N - 1)),   for N -> infinity d (mu_b - mu_f)/(mu_b + mu_f)

(Y2) Two feet and m soft muscles in series between them, E = (k l0/2)(1 - l/l_cmd)^2 each. The force F = mu_f m g/2
     pulls a muscle to the length l_cmd + F l_cmd^2/(k l0), or presses a muscle to l_cmd - F l_cmd^2/(k l0). The front
     foot moves while the chain lengthens, pressed, to L1. The rear foot moves while the chain shortens, pulled, to L2.
     The way is

         m max(0, (L1 - L2) - F (L1^2 + L2^2)/(k l0))

(Y3) A sine wave. Muscle i has the length l0 + a sin(i phi - w t). The feet's relative velocities are N samples
     a w/(2 sin(phi/2)) cos(...), evenly spaced in phase if N phi/(2 pi) is a whole number without a common factor
     with N. The (k+1)-th smallest sample, averaged over the drift of the phase by one sample, gives for phi = 2 pi/N

         N a cos(pi (k + 1/2)/N)/cos(pi/(2 N)),   for N -> infinity N a cos(pi q), which is V = A c cos(pi q)

     for both directions of the wave; A is the amplitude of the strain, c the speed of the wave in the material.
(Y4) No foot slips back (k = 0): the way is 2 n a in unison (phi = 0); the way is n a with phi = 2 pi/n, where the first
     and the last foot move alike and n phases remain in (Y3).
(Y5) mu_f = mu_b and N odd, w(t + T/2) = -w(t): the median is odd as well, and the way is 0 for every phi.
(Y6) A pulse runs along a chain at rest, and shortens the chain by delta. While fewer than half of the feet move at
     once, the other feet hold. Each foot moves by delta, in the direction of a pulse of contraction and against the
     direction of a pulse of extension, even if mu_f = mu_b.
(Y7) Two feet with the loads p: the way is d while mu_f/mu_b < p_rear/p_front < mu_b/mu_f. Otherwise the way is 0: the
     lighter foot moves to and fro.
(Y8) A steady wave, which runs at c_m in the material. lam(X - c_m t) is the stretch, and the holding part has the
     stretch lam_a: v = c (1 - lam/lam_a) with the speed c = c_m lam_a of the wave over the ground, on average
     c_m (lam_a - 1).
(Y9) A medium that resists every joint alike: the net force is zero, so that the mean joint is exactly at rest.
(Y10) A medium that resists a segment in proportion to 1 + B cos(k X - w t + phi). The strain is A cos(k X - w t), with
     a whole number of waves on N segments of the length l0. The middle of a segment moves at
     V - A w (l0/2) cot(k l0/2) cos(k X - w t), the forces add up to 0, and

         V = (A B/2) c cos(phi) (k l0/2) cot(k l0/2),   for N -> infinity (A B/2) c cos(phi)

(Y11) Any gait: the integral of V over a cycle, for the muscle lengths that the gait prescribes.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from scenes.models.sections import gait_from
from scenes.studies.validate.chain import Chain, Crawl


def of_stroke(crawl: Crawl) -> float:
    """Return the way over the stroke of all muscles together, n a: (Y1), (Y2), (Y4), (Y5), (Y7), (Y11)."""
    return crawl.travel / (crawl.chain.muscles * crawl.chain.swing)


def of_wave(crawl: Crawl) -> float:
    """Return the way over N a, (Y3): V/(A c)."""
    return crawl.travel / (crawl.chain.feet * crawl.chain.swing)


def of_pulse(crawl: Crawl) -> float:
    """Return the way over the length change of one muscle, (Y6)."""
    return crawl.travel / crawl.chain.swing


def breathing(chain: Chain) -> float:
    """Return (Y1) over the stroke; negative if backwards is the easy direction."""
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
    """Return (Y7) over d; the loads depend on the distance of the feet and must stay on one side of the limits."""
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
    """Return the largest displacement of the mean joint (the ends count half), in body lengths (Y9)."""
    joints = crawl.result.joints
    mean = (joints[:, :-1] + joints[:, 1:]).mean(axis=1) / 2.0
    return float(np.abs(mean - mean[0]).max()) / float(crawl.chain.settings.worm.length_m)


def of_swimming(crawl: Crawl) -> float:
    """Return the velocity of the mean joint in the last period over A c, (Y10)."""
    s, joints = crawl.chain.settings, crawl.result.joints[:, :, 0]
    mean = (joints[:, :-1] + joints[:, 1:]).mean(axis=1) / 2.0
    period = crawl.chain.steps // s.run.record_every
    waves = s.gait.wavelength * s.worm.length_m  # wave speed times period
    return float((mean[-1] - mean[-1 - period]) / (s.gait.amplitude * waves))


def swimming(chain: Chain) -> float:
    """Return (Y10) over A c: B cos(phi) is the gain times A."""
    s = chain.settings
    half = np.pi / (s.gait.wavelength * s.worm.segments)
    along = 1.0 if s.gait.direction == "direct" else -1.0
    return float(along * s.medium.gain * s.gait.amplitude / 2.0 * half / np.tan(half))


def of_quantiles(chain: Chain) -> float:
    """Return (Y11) over n a."""
    gait = gait_from(chain.settings.gait, chain.settings.run.dt_s)
    times = np.linspace(0.0, chain.settings.gait.period_s, 20_001)
    lengths = chain.l0 * (1.0 - gait.amplitude * gait.activations(times, chain.settings.worm.segments))
    places = np.cumsum(np.where(chain.is_foot, chain.l0, lengths), axis=1)[:, chain.is_foot]
    velocities = np.sort(np.diff(places - places.mean(axis=1, keepdims=True), axis=0), axis=1)
    return float(-velocities[:, chain.slipping_back].sum() / (chain.muscles * chain.swing))


def constant(value: float) -> Callable[[Chain], float]:
    """Return a closed form with a constant value."""
    return lambda _: value
