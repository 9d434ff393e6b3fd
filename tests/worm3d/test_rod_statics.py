"""In the limit of many segments the worm is an extensible Kirchhoff rod: statics, with the observed order in 1/N.

EA = k_spring, EI in pitch = k_torsion l0, EI in yaw from the chambers, k_spring b^2, in series with the joints,
k_yaw l0, and GJ = k_twist l0. A joint stands for half a segment to either side; a segment that is held by both its
joints is therefore a clamp in its middle, half a segment before the first joint that bends. With length counted from
there everything converges at order 2, with the full length at order 1. In yaw the chambers of the clamped segment see
half of the moment of the first joint and move their share of the clamp to a quarter of a segment.
Statics are steps of implicit Euler so long that inertia does not count. Nothing weighs anything unless it says so.
"""

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from worm3d import Command, Held, Result, State, Status, Worm, simulate

STEP = 100.0
"""Pseudo time step of statics [s]."""
PLANES = {"pitch": 2, "yaw": 1}
"""The axis in which a rod along x is deflected: up, or to the left."""
SHARE = {"joints": 0.4, "chambers": 0.6}
"""Shares of joints and chambers in the compliance in yaw."""
OFFSET = {"pitch": 0.5, "yaw": 0.5 * SHARE["joints"] + 0.25 * SHARE["chambers"]}
"""Where the clamp is, in segments behind the first joint that bends."""


def rod(
    segments: int, l0: float, plane: str, EI: float = 1.0, EA: float = 1e4, GJ: float = 1.0, **changes: Any
) -> Worm:
    """Return a rod with EI in one plane, and twice or half as much in the other."""
    pitch, yaw = (EI, 2.0 * EI) if plane == "pitch" else (0.5 * EI, EI)
    values = {
        "segments": segments,
        "length": segments * l0,
        "mass": 0.1 * segments * l0,
        "joint_mass_fraction": 1.0,
        "chamber_offset": np.sqrt(yaw / SHARE["chambers"] / EA),
        "half_height": 0.4,
        "k_spring": EA,
        "k_torsion": pitch / l0,
        "k_yaw": yaw / SHARE["joints"] / l0,
        "k_twist": GJ / l0,
        "kelvin_voigt_time": 0.0,
        "actuator_lag": 0.0,
    }
    return Worm(**values | changes)


def clamped(segments: int, plane: str, **changes: Any) -> Worm:
    """Return a rod of the length 1 from its clamp to its tip."""
    return rod(segments, 1.0 / (segments - 1 + OFFSET[plane]), plane, **changes)


def clamp(segments: int) -> Held:
    """Hold segment 0 and all rolls."""
    return Held(np.arange(segments + 1)[:, None] < 2, roll=True)


def on_tip(worm: Worm, force: Sequence[float], steps: int = 1) -> Callable[[float], np.ndarray]:
    """Return a force on the head that rises over some steps."""
    forces = np.zeros((worm.segments + 1, 3))
    forces[-1] = force
    return lambda t: forces * min(1.0, t / (STEP * steps))


def statics(worm: Worm, steps: int = 3, **changes: Any) -> Result:
    arguments = {"state": State.straight(worm, position=(0.0, 0.0, 5.0)), "gravity": (0.0, 0.0, 0.0)} | changes
    result = simulate(worm, None, duration=steps * STEP, dt=STEP, integrator="implicit_euler", **arguments)
    assert result.status is Status.DONE, result.stop.sentence
    assert np.abs(result.joint_velocity[-1]).max() < 1e-9, "at rest"
    return result


def tip(result: Result, plane: str) -> np.ndarray:
    """Return where the head is, along and across, seen from the clamp."""
    worm, joints = result.worm, result.joints[-1]
    away = joints[-1] - joints[1]
    return np.array([away[0] + OFFSET[plane] * worm.l0, away[PLANES[plane]]])


def orders(errors: Sequence[float], doublings: Sequence[int]) -> np.ndarray:
    ratios = np.array([b / a for a, b in pairwise(doublings)])
    return np.log(np.array(errors[:-1]) / errors[1:]) / np.log(ratios)


def across(plane: str, value: float) -> np.ndarray:
    vector = np.zeros(3)
    vector[PLANES[plane]] = value
    return vector


@pytest.mark.parametrize("plane", PLANES)
def test_cantilever_under_a_small_load_at_its_tip(plane: str) -> None:
    """Euler and Bernoulli: w = F L^3/(3 EI), to the side of the force; the chain of hinges has its own closed form.

    A joint at the distance r l0 from the tip turns by F r l0^2/EI; in yaw only the joints' share does, and the chambers
    add the moment as it is shared between neighbours: a quarter, a half and a quarter, nothing at the clamp.
    """
    load, errors, raw, counts = 1e-4, [], [], (6, 12, 24, 48)
    for n in counts:
        worm = clamped(n, plane)
        found = tip(statics(worm, held=clamp(n), external_force=on_tip(worm, across(plane, load))), plane)[1]
        arms = np.arange(n - 1.0, 0.0, -1.0)
        padded = np.concatenate([[0.0], arms, [0.0]])
        turns = arms
        if plane == "yaw":
            shared = (padded[:-2] + 2 * arms + padded[2:]) / 4
            turns = SHARE["joints"] * arms + SHARE["chambers"] * shared
        assert_allclose(found, load * worm.l0**3 * (arms @ turns), rtol=1e-7)
        errors.append(abs(found / (load / 3) - 1))
        raw.append(abs(found / (load * (n * worm.l0) ** 3 / 3) - 1))
    assert_allclose(orders(errors, counts)[1:], 2.0, atol=0.15)
    assert_allclose(orders(raw, counts)[1:], 1.0, atol=0.15)
    assert errors[-1] < 2e-4


def elastica(tip_load: float, own: float, EA: float) -> np.ndarray:
    """Return where the tip of an extensible cantilever with EI = L = 1 is, along and across.

    Dead loads across: F at the tip and q per rest length. With the angle th from the clamp, V = F + q (L - s),

        x' = (1 + e) cos th, y' = (1 + e) sin th, e = V sin th/EA, EI th' = M, M' = -(1 + e) V cos th, M(L) = 0.
    """

    def slope(s: float, y: np.ndarray) -> list[float]:
        shear, (_, _, angle, moment) = tip_load + own * (1.0 - s), y
        stretch = 1.0 + shear * np.sin(angle) / EA
        return [stretch * np.cos(angle), stretch * np.sin(angle), moment, -stretch * shear * np.cos(angle)]

    def shoot(moment: float) -> np.ndarray:
        return solve_ivp(slope, (0.0, 1.0), [0.0, 0.0, 0.0, moment], rtol=1e-10, atol=1e-11).y[:, -1]

    moment = brentq(lambda m: shoot(m)[3], 0.0, 1.5 * (tip_load + own / 2), xtol=1e-12)
    return shoot(moment)[:2]


def test_the_elastica_is_that_of_the_tables() -> None:
    """F L^2/EI = 1, 5, 10: deflection and approach of the tip (Mattiasson 1981, table 1, by elliptic integrals)."""
    for load, down, back in ((1.0, 0.30172, 0.05643), (5.0, 0.71379, 0.38763), (10.0, 0.81061, 0.55500)):
        assert_allclose(elastica(load, 0.0, 1e12), [1.0 - back, down], rtol=0, atol=6e-6)


@pytest.mark.parametrize("EA", [1e4, 50.0])
@pytest.mark.parametrize("plane", PLANES)
def test_cantilever_under_a_large_load_is_the_elastica(plane: str, EA: float) -> None:
    """F L^2/EI = 5, stiff or 7 % stretched."""
    expected, errors, counts = elastica(5.0, 0.0, EA), [], (12, 24, 48)
    for n in counts:
        worm = clamped(n, plane, EA=EA)
        force = on_tip(worm, across(plane, 5.0), steps=5)
        found = tip(statics(worm, 9, held=clamp(n), external_force=force), plane)
        errors.append(np.abs(found - expected).max())
    assert_allclose(orders(errors, counts), 2.0, atol=0.2)
    assert errors[-1] < 6e-4


@pytest.mark.parametrize("plane", PLANES)
def test_cantilever_under_its_own_weight(plane: str) -> None:
    """w = q L^4/(8 EI) while small, and the heavy elastica at q L^3/EI = 8; gravity points down, or to the right."""
    for weight, expected in ((1e-3, np.array([1.0, 1e-3 / 8])), (8.0, elastica(0.0, 8.0, 100.0))):
        errors, counts = [], (12, 24, 48)
        for n in counts:
            worm = clamped(n, plane, EA=100.0)
            found = tip(statics(worm, 6, held=clamp(n), gravity=across(plane, -weight / 0.1)), plane)
            errors.append(abs(-found[1] / expected[1] - 1))
        assert_allclose(orders(errors, counts), 2.0, atol=0.2)
        assert errors[-1] < 1e-3


@pytest.mark.parametrize("force", [3.0, -3.0])
def test_axial_load_stretches_by_its_share_of_the_stiffness(force: float) -> None:
    """u = F L/EA, exactly and evenly: (P7) is linear in the length."""
    worm = rod(5, 0.2, "pitch", EA=20.0)
    held = Held(np.arange(6)[:, None] == 0, roll=True)
    result = statics(worm, held=held, external_force=on_tip(worm, (force, 0.0, 0.0)))
    assert_allclose(np.diff(result.joints[-1], axis=0), np.tile([0.2 * (1 + force / 20), 0, 0], (5, 1)), atol=1e-13)


def test_hanging_worm_stretches_under_its_own_weight() -> None:
    """u = m g L/(2 EA), exactly also for the chain: the mass below the middle of each segment hangs on it."""
    worm = Worm(segments=5, joint_mass_fraction=1.0, k_spring=20.0)
    joints = np.zeros((6, 3))
    joints[:, 2] = 5.0 - 0.2 * np.arange(6)
    held = Held(np.arange(6)[:, None] == 0, roll=True)
    result = statics(worm, 20, state=State(joints=joints), held=held, gravity=(0.0, 0.0, -9.81))
    assert_allclose(joints[-1, 2] - result.joints[-1, -1, 2], 0.1 * 9.81 / (2 * 20.0), rtol=1e-12)


def test_twist_spreads_evenly_and_stores_the_energy_of_a_rod() -> None:
    """Ends turned by Phi against each other: E = GJ Phi^2/(2 L'), L' = (N - 1) l0 from middle to middle of the ends.

    Before, all of the twist sits in the last joint, with the energy GJ Phi^2/(2 l0).
    """
    n, angle, GJ = 8, 1.2, 0.7
    worm = rod(n, 0.1, "pitch", GJ=GJ, joint_mass_fraction=0.5)
    directors = np.tile([0.0, 1.0, 0.0], (n, 1))
    directors[-1] = [0.0, np.cos(angle), np.sin(angle)]
    ends = np.isin(np.arange(n), (0, n - 1))
    state = State.straight(worm, position=(0.0, 0.0, 5.0)).with_changes(directors=directors)
    result = statics(worm, 20, state=state, held=Held(roll=ends))
    turned = np.arctan2(result.directors[-1][:, 2], result.directors[-1][:, 1])
    assert_allclose(turned, angle * np.arange(n) / (n - 1), rtol=0, atol=1e-10)
    stored = GJ * angle**2 / 2 * (1 / (0.1 * (n - 1)) - 1 / 0.1)
    assert_allclose(result.energy.elastic.sum(), stored, rtol=1e-10)


@pytest.mark.parametrize("GJ", [1.0, 0.1])
def test_curved_rod_under_a_load_out_of_its_plane_bends_and_twists(GJ: float) -> None:
    """A quarter of a ring of radius R, clamped at one end, with a small load F across its plane at the other:

        w = F R^3 (pi/(4 EI) + (3 pi/4 - 2)/GJ)

    by Castigliano's theorem with M = F R sin(a), T = F R (1 - cos(a)) at the angle a from the load (Timoshenko,
    Strength of Materials II; Young, Roark's Formulas, table 9.4). The rod is bent in yaw by its hinges.
    """
    load, radius, errors, counts = 1e-4, 2 / np.pi, [], (6, 12, 24, 48)
    expected = load * radius**3 * (np.pi / 4 + (3 * np.pi / 4 - 2) / GJ)
    for n in counts:
        turn = np.pi / 2 / (n - 0.5)
        worm = rod(n, radius * turn, "pitch", GJ=GJ, EA=1e5)
        ways = turn * np.arange(n)
        edges = worm.l0 * np.column_stack([np.cos(ways), np.sin(ways), np.zeros(n)])
        state = State(joints=np.vstack([[[0.0, 0.0, 5.0]], np.cumsum(edges, axis=0) + 5.0 * np.eye(3)[2]]))
        held = Held(np.arange(n + 1)[:, None] < 2, roll=np.arange(n) == 0)
        command = Command(np.zeros((n, 2)), hinge=turn)
        result = statics(
            worm,
            state=state,
            held=held,
            external_force=on_tip(worm, (0.0, 0.0, load)),
            actuation=lambda t, command=command: command,
        )
        errors.append(abs((result.joints[-1, -1, 2] - 5.0) / expected - 1))
    assert_allclose(orders(errors, counts)[1:], 2.0, atol=0.15)
    assert errors[-1] < 5e-4
