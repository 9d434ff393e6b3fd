"""Closed forms of crawling and swimming, and the corresponding values in runs. Both are dimensionless.

The crawlers are the chains of `scenes.studies.validate.chain`: N feet carry equal loads, and n = N - 1 muscles between
them prescribe their motion relative to each other. The coefficient of friction is mu_f for motion towards the head and
mu_b for motion towards the tail, and q = mu_f/(mu_f + mu_b). The body then moves at the velocity V, which is minus the
quantile of level q of the feet's relative velocities. At any time k = floor(N q) feet slip back, and the foot with the
next larger velocity sticks. Distances are per cycle of the gait.

(Y1) All muscles move in unison, and d is the stroke of the whole body. The relative velocities are equally spaced. The
     foot that sticks is therefore foot k + 1, counted from the rear while the body lengthens and from the front while
     it shortens. The distance is

         d (1 - 2 k/(N - 1)),   for N -> infinity d (mu_b - mu_f)/(mu_b + mu_f)

(Y2) Two feet with m soft muscles in series between them. A muscle has the energy E = (k l0/2)(1 - l/l_cmd)^2. The force
     F = mu_f m g/2 extends a muscle to the length l_cmd + F l_cmd^2/(k l0), or compresses it to
     l_cmd - F l_cmd^2/(k l0). While the chain lengthens, the muscles are compressed, and the front foot moves until
     l_cmd = L1. While the chain shortens, the muscles are extended, and the rear foot moves until l_cmd = L2. The
     distance is

         m max(0, (L1 - L2) - F (L1^2 + L2^2)/(k l0))

(Y3) A sine wave. Muscle i has the length l0 + a sin(i phi - w t). The feet's relative velocities are N samples of
     a w/(2 sin(phi/2)) cos(...). The samples are evenly spaced in phase if N phi/(2 pi) is an integer that has no
     common factor with N. For phi = 2 pi/N, sample k + 1 in ascending order, averaged while the phase changes by the
     spacing of the samples, gives the distance

         N a cos(pi (k + 1/2)/N)/cos(pi/(2 N)),   for N -> infinity N a cos(pi q), which is V = A c cos(pi q)

     The distance is the same for both directions of the wave. A is the amplitude of the strain, and c is the speed of
     the wave in the material.
(Y4) No foot slips back (k = 0). The distance is 2 n a in unison (phi = 0). The distance is n a with phi = 2 pi/n,
     because the first and the last foot then move alike, and n phases remain in (Y3).
(Y5) Equal friction, mu_f = mu_b, an odd N, and a wave with w(t + T/2) = -w(t). The median of the velocities has the
     same symmetry, so that the distance is 0 for every phi.
(Y6) A pulse runs along a chain that is otherwise at rest, and shortens the chain by delta. If fewer than half of the
     feet move at once, the other feet stick. Each foot moves by delta, in the direction of a pulse of contraction, or
     against the direction of a pulse of extension. This is true even if mu_f = mu_b.
(Y7) Two feet with the loads p_rear and p_front. The distance is d if mu_f/mu_b < p_rear/p_front < mu_b/mu_f. Otherwise
     the lighter foot moves to and fro, and the distance is 0.
(Y8) A steady wave, which runs through the material at the speed c_m. The stretch is lam(X - c_m t), with the value
     lam_a where the body sticks to the ground. The velocity is v = c (1 - lam/lam_a), where c = c_m lam_a is the speed
     of the wave over the ground. The mean of v is c_m (lam_a - 1).
(Y9) A medium that resists the motion of every joint equally. The sum of the forces is zero, so that the mean position
     of the joints does not move.
(Y10) A medium that resists the motion of a segment in proportion to 1 + B cos(k X - w t + phi). The strain is
     A cos(k X - w t), with an integer number of waves on N segments of length l0. The middle of a segment moves at
     V - A w (l0/2) cot(k l0/2) cos(k X - w t). Because the sum of the forces is zero,

         V = (A B/2) c cos(phi) (k l0/2) cot(k l0/2),   for N -> infinity (A B/2) c cos(phi)

(Y11) Any gait. The distance is the integral of V over a cycle, for the muscle lengths that the gait prescribes.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from scenes.models.sections import gait_from
from scenes.studies.validate.chain import Chain, Crawl


def of_stroke(crawl: Crawl) -> float:
    """Return the distance divided by n a, the stroke of all muscles; for (Y1), (Y2), (Y4), (Y5), (Y7) and (Y11)."""
    return crawl.travel / (crawl.chain.muscles * crawl.chain.swing)


def of_wave(crawl: Crawl) -> float:
    """Return the distance divided by N a, which is V/(A c) in (Y3)."""
    return crawl.travel / (crawl.chain.feet * crawl.chain.swing)


def of_pulse(crawl: Crawl) -> float:
    """Return the distance divided by the length change of one muscle, for (Y6)."""
    return crawl.travel / crawl.chain.swing


def breathing(chain: Chain) -> float:
    """Return (Y1) divided by the stroke; negative if friction is lower towards the tail."""
    slipping = min(chain.slipping_back, chain.feet - 1 - chain.slipping_back)
    return float(np.copysign(1.0 - 2.0 * slipping / (chain.feet - 1), 0.5 - chain.level))


def breathing_continuum(chain: Chain) -> float:
    """Return (Y1) divided by the stroke, for N -> infinity."""
    return 1.0 - 2.0 * chain.level


def elastic(chain: Chain) -> float:
    """Return (Y2) divided by the stroke m (L1 - L2)."""
    s, l0 = chain.settings, chain.l0
    longest, shortest = l0, l0 - chain.swing
    easy = min(s.friction.forward, s.friction.backward) * s.worm.mass_kg * s.run.gravity_m_s2 / 2.0
    k = float(np.asarray(s.worm.spring_N)[~chain.is_foot][0])
    lost = easy * (longest**2 + shortest**2) / (k * l0)
    return float(np.copysign(max(0.0, 1.0 - lost / (longest - shortest)), 0.5 - chain.level))


def sine(chain: Chain) -> float:
    """Return (Y3) divided by N a."""
    n = chain.feet
    return float(np.cos(np.pi * (chain.slipping_back + 0.5) / n) / np.cos(np.pi / (2 * n)))


def sine_continuum(chain: Chain) -> float:
    """Return (Y3) divided by N a, for N -> infinity, which is cos(pi q)."""
    return float(np.cos(np.pi * chain.level))


def two_loads(chain: Chain) -> float:
    """Return (Y7) divided by d.

    The loads change with the distance of the feet.

    Raises
    ------
    ValueError
        The ratio of the loads crosses a limit of (Y7) during the cycle.
    """
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
    """Return the rms deviation of the velocities midway between feet from (Y8), relative to the largest velocity."""
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
    """Return the largest displacement of the mean position of the joints [body lengths], for (Y9).

    The joints at both ends have half the weight of the other joints.
    """
    joints = crawl.result.joints
    mean = (joints[:, :-1] + joints[:, 1:]).mean(axis=1) / 2.0
    return float(np.abs(mean - mean[0]).max()) / float(crawl.chain.settings.worm.length_m)


def of_swimming(crawl: Crawl) -> float:
    """Return the mean velocity of the joints in the last period, divided by A c, for (Y10)."""
    s, joints = crawl.chain.settings, crawl.result.joints[:, :, 0]
    mean = (joints[:, :-1] + joints[:, 1:]).mean(axis=1) / 2.0
    period = crawl.chain.steps // s.run.record_every
    waves = s.gait.wavelength * s.worm.length_m  # wave speed times period
    return float((mean[-1] - mean[-1 - period]) / (s.gait.amplitude * waves))


def swimming(chain: Chain) -> float:
    """Return (Y10) divided by A c, where B cos(phi) is the gain of the medium times A."""
    s = chain.settings
    half = np.pi / (s.gait.wavelength * s.worm.segments)
    along = 1.0 if s.gait.direction == "direct" else -1.0
    return float(along * s.medium.gain * s.gait.amplitude / 2.0 * half / np.tan(half))


def of_quantiles(chain: Chain) -> float:
    """Return (Y11) divided by n a."""
    gait = gait_from(chain.settings.gait, chain.settings.run.dt_s)
    times = np.linspace(0.0, chain.settings.gait.period_s, 20_001)
    lengths = chain.l0 * (1.0 - gait.amplitude * gait.activations(times, chain.settings.worm.segments))
    places = np.cumsum(np.where(chain.is_foot, chain.l0, lengths), axis=1)[:, chain.is_foot]
    velocities = np.sort(np.diff(places - places.mean(axis=1, keepdims=True), axis=0), axis=1)
    return float(-velocities[:, chain.slipping_back].sum() / (chain.muscles * chain.swing))


def constant(value: float) -> Callable[[Chain], float]:
    """Return a formula that has the same value for every chain."""
    return lambda _: value
