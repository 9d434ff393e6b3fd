"""Rules that detect faults from measurements of a worm in the last waves.

*Chambers.* The gain of a chamber is the amplitude of the strain at the wave's frequency over the amplitude of the
command. On the default worm gains are 0.7 to 0.95, and the gains of one body lie within a quarter of each other, on
slopes, in pipes and in turns. A stuck chamber has less than a third of the others' gain, due to the pull of the
neighbours. A load reduces the gain of small waves more than the gain of large waves: the gains of a worm of 0.4 kg are
0.33 at an amplitude of 0.15, 0.5 at 0.2, 0.7 at 0.27. The identified map gives the reduced progress of such a wave.

*Tipping.* A load on a chamber changes the gain. A worm that lies on one side rests on the chambers of that side. The
mean gains of left and right are equal to 4 % while the worm stands on both sides (slopes of 5 degrees, friction 30 %
off). On a tipped worm the mean gains differ by 4.5 to 18 % of their sum (37 worms tipped by pushes and slopes; the
heights of the centre of mass, by 1 to 6 mm, and the innovations are less informative). Chambers that are weak from the
start differ as much, so that gains are divided by the usual gains of the waves before. A push to the side changes the
gains too, but bends the body.

*Speed, turn and place* of the centre of mass, averaged over each wave, are compared with the reference and the map.

A fault has to appear in two waves in a row, or over three waves, and is therefore reported within three waves.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from math import inf, nan

import numpy as np

from control.estimation.estimate import SIGNIFICANT_EXCESS
from control.sensing.sensors import SIDE_NAMES
from control.tracking.preview import AWAY
from worm3d.values.arrays import FloatArray

DISOBEYS = 0.55
"""Gain of a chamber, as a share of the median gain, below which the chamber does not obey; the limit is lower in small
waves, in proportion to `Wave.expected`. Neighbours of dead chambers, and pushed worms, have at least 0.6 in two waves
in a row. Half of the limit would miss stuck chambers. A worm of 0.4 kg that turns in small waves has gains of 0.43."""
WEAK = 0.4
"""Ratio of the median gain to the expected gain at the wave's amplitude below which all chambers are too weak."""
LEANS = 0.045
"""Least difference of the gains of left and right, over their sum, of a worm that lies on one side. Half of this limit
would report slopes and sharp turns; twice this limit would miss half of the tipped worms."""
SURE_TO_LEAN = 4.0
"""Least distance of this difference from 0, in standard errors."""
BENT = 0.02
"""Least mean strain of a left minus a right chamber in a body that a push has bent, which spoils the gains."""
SLOW, SLOW_AT_LIMIT, FAST = 0.75, 0.9, 1.3
"""Shares of the wanted speed: too slow, too slow although the wave is as fast as possible, too fast."""
CREEPS = 0.1
"""Share of the greatest speed of the map below which a slow worm is not reported."""
UNREACHABLE_SPEED_SHARE = 1.02
"""Share of the greatest speed of the map beyond which a speed cannot be reached."""
TURNS = 1.1
"""Share of the greatest turn rate at a speed beyond which a turn cannot be reached."""
ASTRAY = 0.5
"""Least standard deviation of a lost heading [rad]."""
ANY_WAY = np.pi / np.sqrt(3.0)
"""Standard deviation of a heading that is completely unknown [rad]."""
PUSH_VELOCITY_CHANGE = 0.016
"""Velocity change, beyond the change that the wave makes, of a worm that is pushed [body lengths/s]."""
NEARLY = 0.003
"""Standard error of the mean position of a wave beyond which this change is unknown [body lengths]."""
CRABS = 0.22
"""Least angle between motion and measured heading, not explained by a slope, of a wrong heading [rad]."""
TRESPASS = 0.03
"""Distance inside an obstacle or outside a corridor beyond which a trespass is reported [body lengths]."""
MAX_PATH_ANGLE = 0.3
"""Angle to the path below which a worm that has turned round follows the path again, and no longer leaves it [rad]."""
LEFT_PATH = 0.15
"""Limit of the distance from the path, or from the detour around obstacles, minus the least distance of the last waves
[body lengths]. In the benchmark (seed 40) the value is 0.05 at a corner of 90 degrees, and 0.12 after a push."""
CHAMBER_ADVICE = "look at its supply, its valve and its strain sensor; segment 0 is the tail"
"""Advice on a chamber."""


@dataclass(frozen=True)
class Fault:
    """Something that keeps a worm from following the reference."""

    time: float
    """Time when the fault was found [s]."""
    kind: str
    """Name of the fault, including the chamber if any; each name is reported once a run."""
    what: str
    """Description, a sentence."""
    advice: str
    """Advice, a sentence."""


@dataclass(frozen=True, eq=False)
class Wave:
    """Summary of one wave of a worm of N segments."""

    end: float
    """End of the wave [s]."""
    gain: FloatArray
    """Gain of each chamber [left, right], shape (N, 2); NaN where unknown."""
    gain_error: FloatArray
    """Standard errors of the gains, shape (N, 2)."""
    bend: float
    """Greatest mean strain of a left minus a right chamber; NaN if unknown."""
    place: FloatArray | None
    """Mean of the centre of mass [m], shape (2,); None without samples."""
    place_time: float
    """Mean instant of the samples of `place` [s]."""
    place_error: float
    """Standard error of `place` [m]."""
    at_limit: bool
    """Whether amplitude and frequency are as great as possible."""
    made: float
    """Speed of the wave on the map, at the end of the wave [m/s]."""
    least_asked: float
    """Least wanted speed in the wave, limited to the speed at which the path can be followed on the map [m/s]."""
    most_asked: float
    """Greatest wanted speed in the wave [m/s]."""
    reach: float
    """Greatest speed of the map [m/s]."""
    ahead: float | None = None
    """Azimuth of the path at the worm; without a path the worm's heading, if known [rad]."""
    turn: float = 0.0
    """Turn rate of the path at the worm [rad/s]."""
    sharpest: float = inf
    """Greatest turn rate of the map [rad/s]."""
    aside: float | None = None
    """Distance from the path [body lengths]."""
    trespass: float = -inf
    """Distance of the worm into an obstacle or out of the corridor [body lengths]."""
    away: float = 0.0
    """Angle between the known heading and the path [rad]."""
    heading_error: float = 0.0
    """Standard deviation of the estimated heading [rad]."""
    back: bool = False
    """Whether the worm can and should go backwards; speeds are then counted backwards."""
    numb: bool = False
    """Whether the worm has strain sensors but no sample of them was used."""
    usual_gain: FloatArray | None = None
    """Gain of each chamber relative to a healthy chamber, as known in the waves before, shape (N, 2)."""
    pushed: bool = False
    """Whether samples of the position showed that something other than the wave moves the worm."""
    turning: float = 0.0
    """Estimated turn rate that the wave makes, at the end of the wave [rad/s]."""
    length: float = 1.0
    """Length of the body [m]."""
    jumped: bool = False
    """Whether the sensor of the heading jumped and the estimator accepted the jump."""
    crab: float = 0.0
    """Significant angle between motion and heading, beyond the angle that a slope explains [rad]."""
    expected: float = 1.0
    """Expected gain of this wave over the expected gain of the wave of greatest amplitude, from the distances of both
    waves on the map."""


def faults(waves: Sequence[Wave]) -> Iterator[Fault]:
    """Yield the faults that the last wave and the waves before show."""
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
    """Return the difference of the mean gains of left and right over their sum, positive to the left, and the error.

    Gains are divided by the usual gains, so that weak chambers do not count as a lean. Segments with a chamber that
    does not obey are left out: this chamber alone would make a difference of 8 % for six segments.
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
        advice = "set it upright; no wave does that. Ask for gentler turns, or for less of a slope across"
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
            what = f"the {SIDE_NAMES[side]} chamber of segment {segment} moves by {share:.0f} % of what the others do"
            yield Fault(last[-1].end, f"chamber {segment} {SIDE_NAMES[side]}", what, CHAMBER_ADVICE)


def _unreachable(waves: Sequence[Wave]) -> Iterator[Fault]:
    wave = waves[-1]
    if wave.most_asked > UNREACHABLE_SPEED_SHARE * wave.reach:
        what = f"{wave.most_asked:.3g} m/s are asked for, by the identified map this worm's wave makes {wave.reach:.3g}"
        yield Fault(wave.end, "unreachable speed", what, "ask for less speed")
    if wave.least_asked < 0.0:
        what = f"{wave.least_asked:.3g} m/s are asked for; by the identified map no wave of this worm goes backwards"
        advice = "ask for speeds of 0 or more, and turn where it is to go back; bristles let it go forward only"
        yield Fault(wave.end, "unreachable speed", what, advice)


def _too_sharp(waves: Sequence[Wave]) -> Iterator[Fault]:
    if len(waves) > 1 and all(abs(wave.turn) > TURNS * wave.sharpest for wave in waves[-2:]):
        turn, most = np.rad2deg([abs(waves[-1].turn), waves[-1].sharpest])
        what = f"the path turns by {turn:.3g} deg/s, by the identified map this worm turns by {most:.3g}"
        yield Fault(waves[-1].end, "unreachable turn", what, "ask for less speed, or for wider turns")


def _speed(waves: Sequence[Wave]) -> Iterator[Fault]:
    if len(waves) <= 4:  # the first wave swells
        return
    last = waves[-4:]  # the first and the last of these are three waves apart
    if any(wave.back != last[-1].back or wave.away >= AWAY for wave in last):
        return
    way, error = _way(last)
    least, most = min(wave.least_asked for wave in last), max(wave.most_asked for wave in last)
    slow = SLOW_AT_LIMIT if all(wave.at_limit for wave in last[1:]) else SLOW
    if least > CREEPS * last[-1].reach and way + 3.0 * error < slow * least:
        what = f"the worm makes {way:.3g} m/s over three waves, {least:.3g} are asked for"
        yield Fault(last[-1].end, "too slow", what, "ask for less speed; look at ground, slope, load and chambers")
    made = max(wave.made for wave in last)
    if abs(way) - 3.0 * error > FAST * max(most, made, 0.25 * last[-1].reach):
        what = f"the worm is carried along at {abs(way):.3g} m/s, {most:.3g} are asked for"
        yield Fault(last[-1].end, "too fast", what, "hold it: it slides, or something moves it")


def _way(waves: Sequence[Wave]) -> tuple[float, float]:
    """Return the speed along the path [m/s], negative in the wrong direction, and the error; NaN if unknown."""
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
        yield Fault(waves[-1].end, "off the path", what, "look at ground and slope, and whether it stands upright")


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
        yield Fault(waves[-1].end, "lost heading", what, "look at the sensors of place and heading, or give it one")


def _pushed(waves: Sequence[Wave]) -> Iterator[Fault]:
    lately = waves[1:][-3:]  # the first wave swells
    if (
        any(wave.pushed for wave in lately)
        and not any(wave.jumped for wave in lately)
        and _unexplained(lately) > PUSH_VELOCITY_CHANGE
    ):
        what = "the centre of mass moves otherwise than the wave makes it: the worm is pushed, or the sensor drifts"
        advice = "look at what touches the worm, at the ground, and at the sensor of the centre of mass"
        yield Fault(waves[-1].end, "push or drift", what, advice)


def _unexplained(waves: Sequence[Wave]) -> float:
    """Return the change of the velocity over three waves that the waves do not make [body lengths/s].

    The waves make the speeds of the map and the estimated turn rates. The result is 0 if the change is unknown.
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
    return float(np.hypot(*(after - expected))) / waves[-1].length


def _beside_heading(waves: Sequence[Wave]) -> Iterator[Fault]:
    wave = waves[-1]
    advice = "look at the sensor of the heading, and whether the ground slopes across the way"
    if wave.jumped:
        yield Fault(wave.end, "heading off", "the sensor of the heading has jumped: the worm did not turn so", advice)
    elif len(waves) > 1 and min(wave.crab, waves[-2].crab) > CRABS:
        what = f"the worm goes at least {np.rad2deg(wave.crab):.0f} degrees beside its measured heading"
        yield Fault(wave.end, "heading off", what, advice)


def _facing_away(waves: Sequence[Wave]) -> Iterator[Fault]:
    wave = waves[-1]
    if wave.away >= AWAY and wave.made > 0.0:
        what = f"the worm faces {np.rad2deg(wave.away):.0f} degrees away from its path, and turns round first"
        yield Fault(wave.end, "facing away", what, "begin with a worm that looks along its path")


def _trespassing(waves: Sequence[Wave]) -> Iterator[Fault]:
    wave = waves[-1]
    if wave.trespass > TRESPASS:
        what = f"the worm is {wave.trespass:.2g} body lengths inside an obstacle or outside its corridor"
        yield Fault(wave.end, "out of bounds", what, "leave it more room, and way to turn in, or ask for less speed")
