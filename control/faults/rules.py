"""Rules that detect faults from summaries of the last waves of a worm.

*Chambers.* The gain of a chamber is the amplitude of its strain at the frequency of the wave, divided by the amplitude
of its command. On the default worm, gains are 0.7 to 0.95, and the gains of one body differ by less than a quarter,
also on slopes, in pipes and in turns. A stuck chamber has less than a third of the others' gain (the neighbours pull
it). A load reduces the gain of small waves more than the gain of large waves: a worm of 0.4 kg has gains of 0.33 at an
amplitude of 0.15, 0.5 at 0.2, and 0.7 at 0.27. The identified map gives the reduced progress of such a wave.

*Tipping.* A load on a chamber changes its gain. If a worm lies on one side, the chambers of that side carry the load.
In a worm that stands on both sides, the mean gains of left and right differ by less than 4 % (on slopes of up to 5
degrees, and with 30 % more or less friction). In 37 worms tipped by pushes and slopes, they differed by 4.5 to 18 % of
their sum. The height of the centre of mass, which changes by 1 to 6 mm, and the innovations are less informative.
Chambers that are weak from the start differ as much. Therefore gains are divided by the usual gains, which are known
from earlier waves. A push to the side changes the gains too, but it also bends the body.

*Speed, turn and place* of the centre of mass, averaged over each wave, are compared with the reference and the map.

Most rules need a fault to appear in two waves in a row, or over three waves. A fault is therefore reported within three
waves.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from math import inf, nan

import numpy as np

from control.estimation.estimate import SIGNIFICANT_EXCESS
from control.gaits.reflexes import GRAVITY
from control.sensing.sensors import SIDE_NAMES
from control.tracking.preview import AWAY
from worm3d.values.arrays import FloatArray

DISOBEYS = 0.55
"""Gain of a chamber, as a share of the median gain, below which the chamber counts as faulty. In small waves the limit
is lower, in proportion to `Wave.expected`. Neighbours of dead chambers, and pushed worms, have at least 0.6 in two
waves in a row. With half of this limit, stuck chambers would not be detected. A worm of 0.4 kg that turns in small
waves has gains of 0.43."""
WEAK = 0.4
"""Median gain, as a share of the gain expected at the amplitude of the wave, below which all chambers are too weak."""
LEANS = 0.045
"""Difference between the mean gains of left and right, divided by their sum, above which the worm lies on one side.
With half of this limit, worms on slopes and in sharp turns would be reported. With twice this limit, half of the tipped
worms would not be detected."""
SURE_TO_LEAN = 4.0
"""The worm counts as tipped only if this difference is more than this number of standard errors from 0."""
BENT = 0.02
"""Difference between the mean strains of left and right in a segment above which a push has bent the body. The gains
are then not used."""
SLOW, SLOW_AT_LIMIT, FAST = 0.75, 0.9, 1.3
"""Limits of the speed, as shares of the requested speed: `SLOW` for too slow, `SLOW_AT_LIMIT` for too slow at the
largest and fastest wave, `FAST` for too fast."""
CREEPS = 0.1
"""Requested speed below which a slow worm is not reported, as a share of the greatest speed of the map."""
UNREACHABLE_SPEED_SHARE = 1.02
"""Requested speed above which the speed counts as unreachable, as a share of the greatest speed of the map."""
TURNS = 1.1
"""Turn rate of the path above which the turn counts as unreachable, as a share of the greatest turn rate at the
speed."""
ASTRAY = 0.5
"""Standard deviation of the heading above which the heading counts as lost [rad]."""
ANY_WAY = np.pi / np.sqrt(3.0)
"""Standard deviation of a heading that is completely unknown (uniformly distributed) [rad]."""
PUSH_VELOCITY_CHANGE = 0.016
"""Change of velocity that the wave does not explain, above which a push is reported [body lengths/s]."""
DOWNHILL_DRIVE = 0.1
"""Velocity change per wave that gravity may cause on a worm that crawls downhill, as a share of the change in free
motion down the slope. Friction prevents most of the free motion. With half of this value, a worm that turns on a slope
of 1.4 degrees counts as pushed. With twice this value, a drift of the sensor on level ground is still detected."""
NEARLY = 0.003
"""Standard error of the mean position in a wave above which the change of velocity is considered unknown [body
lengths]."""
CRABS = 0.22
"""Angle between motion and measured heading, minus the angle that a slope explains, above which the heading counts as
wrong [rad]."""
TRESPASS = 0.03
"""Distance inside an obstacle or outside a corridor above which this is reported [body lengths]."""
MAX_PATH_ANGLE = 0.3
"""Angle to the path below which a worm that has turned round follows its path again [rad]."""
LEFT_PATH = 0.15
"""Increase of the distance from the path, over the smallest distance in the last waves, above which the worm has left
its path [body lengths]. The path may be the detour around obstacles. In the benchmark (seed 40) the increase is 0.05 at
a corner of 90 degrees, and 0.12 after a push."""
CHAMBER_ADVICE = "look at its supply, its valve and its strain sensor; segment 0 is the tail"
"""Advice to the user if a chamber is faulty."""


@dataclass(frozen=True)
class Fault:
    """A fault that prevents the worm from following the reference."""

    time: float
    """Time of detection [s]."""
    kind: str
    """Name of the fault, which includes the chamber if there is one. Each name is reported once per run."""
    what: str
    """Description of the fault as a sentence."""
    advice: str
    """Advice to the user as a sentence."""


@dataclass(frozen=True, eq=False)
class Wave:
    """Summary of one wave of a worm of N segments."""

    end: float
    """End of the wave [s]."""
    gain: FloatArray
    """Gain of each chamber, shape (N, 2) for [left, right]. NaN where unknown."""
    gain_error: FloatArray
    """Standard errors of the gains, shape (N, 2)."""
    bend: float
    """Greatest difference between the mean strains of left and right in a segment. NaN if unknown."""
    place: FloatArray | None
    """Mean position of the centre of mass in the wave [m], shape (2,). None without samples."""
    place_time: float
    """Mean instant of the samples of `place` [s]."""
    place_error: float
    """Standard error of `place` [m]."""
    at_limit: bool
    """Whether amplitude and frequency are at their upper limits."""
    made: float
    """Speed of the commanded wave according to the map, at the end of the wave [m/s]."""
    least_asked: float
    """Smallest requested speed during the wave [m/s]. Requested speeds are limited to the worm's greatest speed on the
    path according to the map."""
    most_asked: float
    """Greatest requested speed during the wave [m/s]."""
    reach: float
    """Greatest speed of the map [m/s]."""
    ahead: float | None = None
    """Azimuth of the path at the worm [rad]. Without a path, the heading of the worm, or None if the heading is
    unknown."""
    turn: float = 0.0
    """Turn rate of the path at the worm [rad/s]."""
    sharpest: float = inf
    """Greatest turn rate of the map [rad/s]."""
    aside: float | None = None
    """Distance from the path [body lengths]."""
    trespass: float = -inf
    """Distance of the worm into an obstacle or out of the corridor [body lengths]. Negative if the worm is clear of
    both."""
    away: float = 0.0
    """Angle between heading and path [rad]. 0 if the heading is unknown."""
    heading_error: float = 0.0
    """Standard deviation of the estimated heading [rad]."""
    back: bool = False
    """Whether the reference requests backward motion, and the worm can go backwards. All speeds are then counted
    backwards."""
    numb: bool = False
    """Whether the worm has strain sensors, but none of their samples was used."""
    usual_gain: FloatArray | None = None
    """Gain of each chamber relative to a healthy chamber, averaged over earlier waves, shape (N, 2)."""
    pushed: bool = False
    """Whether samples of the position showed a motion that the wave does not explain."""
    turning: float = 0.0
    """Estimated turn rate caused by the wave, at the end of the wave [rad/s]."""
    length: float = 1.0
    """Length of the body [m]."""
    jumped: bool = False
    """Whether the heading sensor jumped, and the estimator accepted the jump."""
    descent: float = 0.0
    """Estimated downward slope in the direction of motion, minus one standard error, and at least 0."""
    crab: float = 0.0
    """Angle between motion and heading, minus the angle that a slope explains and minus its uncertainty [rad]."""
    expected: float = 1.0
    """Expected gain of this wave, divided by the expected gain of the wave of greatest amplitude. It follows from the
    distances that both waves cover according to the map."""


def faults(waves: Sequence[Wave]) -> Iterator[Fault]:
    """Yield the faults that the last wave shows, together with the waves before it."""
    for rule in (
        _unreachable,
        _too_sharp,
        _tipped,
        _chambers,
        _speed,
        _off_path,
        _blind,
        _numb,
        _astray,
        _pushed,
        _beside_heading,
        _facing_away,
        _trespassing,
    ):
        yield from rule(waves)


def _lean(wave: Wave) -> tuple[float, float]:
    """Return the lean of the worm and its standard error.

    The lean is the difference between the mean gains of left and right, divided by their sum. It is positive if the
    left side has the larger gain. Gains are divided by the usual gains, so that weak chambers do not count as a lean.
    Segments with a faulty chamber are left out. Otherwise this chamber would cause a lean of 8 % in a worm of six
    segments.
    """
    usual = 1.0 if wave.usual_gain is None else np.maximum(wave.usual_gain, WEAK)
    gain, errors = wave.gain / usual, wave.gain_error / usual
    both = np.isfinite(gain).all(axis=1)
    for each in (gain, wave.gain):
        if both.any():
            both &= (each > DISOBEYS * np.nanmedian(each)).all(axis=1)
    if not both.any():
        return 0.0, inf
    left, right = gain[both].mean(axis=0)
    error = float(np.sqrt((errors[both] ** 2).sum())) / both.sum()
    return float((left - right) / (left + right)), error / float(left + right)


def _tipped(waves: Sequence[Wave]) -> Iterator[Fault]:
    leans = [_lean(wave) for wave in waves[1:][-2:]]  # the usual gains are unknown in the first wave
    one_side = len({np.sign(lean) for lean, _ in leans}) == 1
    sure = all(abs(lean) > max(LEANS, SURE_TO_LEAN * error) for lean, error in leans)
    if len(leans) == 2 and one_side and sure and all(wave.bend < BENT for wave in waves[-2:]):
        what = (
            f"the worm leans on its {SIDE_NAMES[leans[-1][0] < 0.0]} side, or lies on it: the chambers there carry it"
        )
        advice = "set the worm upright, which no wave can do; ask for gentler turns, or for less slope across the way"
        yield Fault(waves[-1].end, "tipped", what, advice)


def _chambers(waves: Sequence[Wave]) -> Iterator[Fault]:
    last = waves[-2:]
    if len(last) < 2 or any(np.isfinite(wave.gain).sum() < 3 for wave in last):
        return
    medians = [np.nanmedian(wave.gain) for wave in last]
    surely = [(wave.gain + SIGNIFICANT_EXCESS * wave.gain_error) for wave in last]
    most = [float(np.nanmedian(gain)) for gain in surely]
    if all(gain < WEAK * wave.expected for gain, wave in zip(most, last, strict=True)):
        what = f"the chambers move by {100 * most[-1]:.0f} % of what they are told"
        yield Fault(last[-1].end, "chambers", what, "look at the pressure supply")
    if min(medians) <= 0.0:  # strains that stay the same
        return
    least = [DISOBEYS * wave.expected * median for wave, median in zip(last, medians, strict=True)]
    for segment, side in product(range(len(surely[0])), (0, 1)):
        if all(gain[segment, side] < limit for gain, limit in zip(surely, least, strict=True)):  # false if any is NaN
            share = 100 * last[-1].gain[segment, side] / medians[-1]
            what = f"the {SIDE_NAMES[side]} chamber of segment {segment} moves by {share:.0f} % of the others' motion"
            yield Fault(last[-1].end, f"chamber {segment} {SIDE_NAMES[side]}", what, CHAMBER_ADVICE)


def _unreachable(waves: Sequence[Wave]) -> Iterator[Fault]:
    wave = waves[-1]
    if wave.most_asked > UNREACHABLE_SPEED_SHARE * wave.reach:
        what = f"{wave.most_asked:.3g} m/s are asked for, but by the identified map this worm makes {wave.reach:.3g}"
        yield Fault(wave.end, "unreachable speed", what, "ask for less speed")
    if wave.least_asked < 0.0:
        what = f"{wave.least_asked:.3g} m/s are asked for; by the identified map no wave of this worm goes backwards"
        advice = "ask for speeds of 0 or more, and let the worm turn round to go back; bristles let it go forward only"
        yield Fault(wave.end, "unreachable speed", what, advice)


def _too_sharp(waves: Sequence[Wave]) -> Iterator[Fault]:
    if len(waves) > 1 and all(abs(wave.turn) > TURNS * wave.sharpest for wave in waves[-2:]):
        turn, most = np.rad2deg([abs(waves[-1].turn), waves[-1].sharpest])
        what = f"the path turns by {turn:.3g} deg/s, but by the identified map this worm turns by {most:.3g} deg/s"
        yield Fault(waves[-1].end, "unreachable turn", what, "ask for less speed, or for wider turns")


def _speed(waves: Sequence[Wave]) -> Iterator[Fault]:
    if len(waves) <= 4:  # the amplitude still grows in the first wave
        return
    last = waves[-4:]  # the first and the last of these are three waves apart
    if any(wave.back != last[-1].back or wave.away >= AWAY for wave in last):
        return
    way, error = _way(last)
    least, most = min(wave.least_asked for wave in last), max(wave.most_asked for wave in last)
    slow = SLOW_AT_LIMIT if all(wave.at_limit for wave in last[1:]) else SLOW
    if least > CREEPS * last[-1].reach and way + 3.0 * error < slow * least:
        what = f"the worm makes {way:.3g} m/s over three waves, but {least:.3g} m/s are asked for"
        yield Fault(last[-1].end, "too slow", what, "ask for less speed; look at ground, slope, load and chambers")
    made = max(wave.made for wave in last)
    if abs(way) - 3.0 * error > FAST * max(most, made, 0.25 * last[-1].reach):
        what = f"the worm is carried along at {abs(way):.3g} m/s, but {most:.3g} m/s are asked for"
        yield Fault(last[-1].end, "too fast", what, "hold the worm: it slides, or something moves it")


def _way(waves: Sequence[Wave]) -> tuple[float, float]:
    """Return the speed along the path over the last waves and its standard error [m/s].

    The speed is negative in the wrong direction. Both are NaN if the speed is unknown.
    """
    places = [wave.place for wave in waves if wave.place is not None]
    if len(places) < len(waves):
        return nan, nan
    ways, last = np.diff(places, axis=0), waves[-1]
    time = last.place_time - waves[0].place_time
    made = float(np.hypot(*ways.T).sum()) / time
    if last.ahead is not None:
        back = (places[-1] - places[0]) @ [np.cos(last.ahead), np.sin(last.ahead)] < 0.0
        made = -made if back != last.back else made
    return made, float(np.linalg.norm([wave.place_error for wave in waves])) / time


def _off_path(waves: Sequence[Wave]) -> Iterator[Fault]:
    turned = max((k for k, wave in enumerate(waves) if wave.away >= AWAY), default=-1)
    follows = next(
        (k for k in range(turned + 1, len(waves)) if turned < 0 or waves[k].away < MAX_PATH_ANGLE), len(waves)
    )
    known = [wave.aside for wave in waves[follows:] if wave.aside is not None]
    if len(known) > 1 and waves[-1].aside is not None and known[-1] > max(min(known) + LEFT_PATH, known[-2]):
        what = f"the worm is {known[-1]:.2g} body lengths beside its path, and goes farther from it"
        yield Fault(waves[-1].end, "off the path", what, "look at ground, slope, and whether the worm stands upright")


def _blind(waves: Sequence[Wave]) -> Iterator[Fault]:
    if len(waves) >= 3 and all(wave.place is None for wave in waves[-3:]):
        advice = "look at the sensor, its delay and its clock, and at the measurements that were refused"
        yield Fault(waves[-1].end, "no place", "no sample of the centre of mass was used for three waves", advice)


def _numb(waves: Sequence[Wave]) -> Iterator[Fault]:
    if len(waves) >= 2 and all(wave.numb for wave in waves[-2:]):
        what = "no strain of a chamber was used for two waves: a chamber that does not obey would not be found"
        yield Fault(waves[-1].end, "no strains", what, "look at the strain sensors, and at the measurements refused")


def _astray(waves: Sequence[Wave]) -> Iterator[Fault]:
    error = min((wave.heading_error if wave.made > 0.0 else 0.0 for wave in waves[-3:]), default=0.0)
    if len(waves) >= 3 and error > ASTRAY:
        what = f"the heading is known to {np.rad2deg(min(error, ANY_WAY)):.0f} degrees at best for three waves"
        yield Fault(waves[-1].end, "lost heading", what, "look at the sensors of place and heading, or add a sensor")


def _pushed(waves: Sequence[Wave]) -> Iterator[Fault]:
    lately = waves[1:][-3:]  # the amplitude still grows in the first wave
    if (
        any(wave.pushed for wave in lately)
        and not any(wave.jumped for wave in lately)
        and _unexplained(lately) > PUSH_VELOCITY_CHANGE
    ):
        what = "the wave does not explain the motion of the centre of mass: the worm is pushed, or the sensor drifts"
        advice = "look at what touches the worm, at the ground, and at the sensor of the centre of mass"
        yield Fault(waves[-1].end, "push or drift", what, advice)


def _unexplained(waves: Sequence[Wave]) -> float:
    """Return the change of the velocity over three waves that the waves do not explain [body lengths/s].

    The waves explain the speeds of the map and the estimated turn rates. If the ground falls ahead, gravity explains a
    change of `DOWNHILL_DRIVE` times the free motion down the slope. The result is 0 if the change is unknown.
    """
    places = [wave.place for wave in waves if wave.place is not None]
    if len(places) < 3 or not all(np.isfinite(wave.made) and wave.place_error < NEARLY * wave.length for wave in waves):
        return 0.0
    times, made = (np.array([getattr(wave, name) for wave in waves]) for name in ("place_time", "made"))
    before, after = np.diff(places, axis=0) / np.diff(times)[:, None]
    speed = float(np.hypot(*before))
    turned = float(np.interp(times, [wave.end for wave in waves], [wave.turning for wave in waves]).mean())
    angle, quicker = turned * (times[2] - times[0]) / 2.0, float(made[1:].mean() - made[:-1].mean())
    expected = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]) @ before
    expected = expected * (1.0 + quicker / speed) if speed > 0.0 else expected
    downhill = DOWNHILL_DRIVE * GRAVITY * max(wave.descent for wave in waves) * float(times[2] - times[1])
    return max(float(np.hypot(*(after - expected))) - downhill, 0.0) / waves[-1].length


def _beside_heading(waves: Sequence[Wave]) -> Iterator[Fault]:
    wave = waves[-1]
    advice = "look at the sensor of the heading, and whether the ground slopes across the way"
    if wave.jumped:
        yield Fault(wave.end, "heading off", "the sensor of the heading jumped, but the worm did not turn", advice)
    elif len(waves) > 1 and min(wave.crab, waves[-2].crab) > CRABS:
        what = f"the worm goes at least {np.rad2deg(wave.crab):.0f} degrees beside its measured heading"
        yield Fault(wave.end, "heading off", what, advice)


def _facing_away(waves: Sequence[Wave]) -> Iterator[Fault]:
    wave = waves[-1]
    if wave.away >= AWAY and wave.made > 0.0:
        what = f"the worm faces {np.rad2deg(wave.away):.0f} degrees away from its path, and turns round first"
        yield Fault(wave.end, "facing away", what, "start with the worm facing along its path")


def _trespassing(waves: Sequence[Wave]) -> Iterator[Fault]:
    wave = waves[-1]
    if wave.trespass > TRESPASS:
        what = f"the worm is {wave.trespass:.2g} body lengths inside an obstacle or outside its corridor"
        yield Fault(wave.end, "out of bounds", what, "leave the worm more room, also for turns, or ask for less speed")
