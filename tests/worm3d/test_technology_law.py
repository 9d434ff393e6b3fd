"""The law of technologies, (T1) to (T5), in a step of random actuators, against its equations written out in numpy."""

from typing import Any

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

from worm3d.physics.actuator_names import Technology
from worm3d.physics.actuators import RESPONSE_INPUTS
from worm3d.values.parameters import parameters_of

COUNT = 4000
SPANS = {
    "strain": (0.05, 0.6),
    "stress": (1e4, 1e6),
    "lever": (0.5, 3.0),
    "area": (1e-5, 1e-4),
    "series": (1.0, 30.0),
    "droop": (0.0, 1.0),
    "push": (0.0, 1.0),
    "delay": (0.02, 0.1),
    "rise": (0.01, 0.3),
    "fall": (0.01, 0.3),
    "rate": (0.5, 20.0),
    "hysteresis": (0.0, 1.0),
    "charge": (0.0, 1e6),
    "leak": (0.0, 20.0),
    "charging": (0.3, 1.0),
    "efficiency": (0.1, 1.0),
    "stall": (0.0, 0.1),
    "idle": (0.0, 1.0),
    "hot": (0.0, 70.0),
    "heat_capacity": (0.01, 1.0),
    "cooling": (0.05, 1.0),
    "hottest": (60.0, 150.0),
    "l0": (0.1, 0.3),
    "dt": (0.002, 0.02),
    "command": (-0.6, 0.9),
    "command_n": (-0.6, 0.9),
}
SUBSTEPS = 400
"""Number of steps of the midpoint rule, whose error is below (2/400)^2/12 of a share of the drive."""

Values = dict[str, np.ndarray]


def play(p: Values, before: np.ndarray, drive: np.ndarray) -> np.ndarray:
    """Return the active share behind a drive, (T2)."""
    w = p["hysteresis"]
    return np.clip(np.clip(before, (1.0 + w) * drive - w, (1.0 + w) * drive), -p["both_ways"], 1.0)


def some_step() -> Values:
    """Return the parameters, the states at the start, and the commands and lengths of a step, each (COUNT,)."""
    rng = np.random.default_rng(11)
    p = {name: np.zeros(COUNT) for name in (*RESPONSE_INPUTS, *parameters_of(Technology))}
    p |= {name: rng.uniform(*span, COUNT) for name, span in SPANS.items()}
    kind = np.arange(COUNT) % 3
    p |= {"scales": 1.0 * (kind == 1), "both_ways": 1.0 * (kind == 2), "lengthens": 1.0 * rng.integers(0, 2, COUNT)}
    p["hysteresis"] = np.where((kind == 2) | (rng.random(COUNT) < 0.3), 0.0, p["hysteresis"])
    for name in ("cooling", "hottest", "heat_capacity"):
        p[name] = np.where(rng.random(COUNT) < 0.3, np.inf, p[name])
    p["rate"] = np.where(rng.random(COUNT) < 0.7, np.inf, p["rate"])
    p["droop"] = np.where(rng.random(COUNT) < 0.2, 1.0, p["droop"])
    p["series"] = np.where(rng.random(COUNT) < 0.3, 1.0, p["series"])
    drive = rng.uniform(-p["both_ways"], 1.0)
    p |= {"drive_n": drive, "active_n": play(p, rng.uniform(0.0, 1.0, COUNT), drive)}
    p |= {"asked_n": rng.uniform(-p["both_ways"], 1.0), "warmth_n": p["hot"] * abs(drive) + rng.uniform(0, 80, COUNT)}
    for name in ("length", "length_n"):
        p[name] = p["l0"] * rng.uniform(0.5, 1.5, COUNT)
    return p


def answers(p: Values, method: str = "respond") -> Values:
    """Return what the law says, and the slope of its potential in the length, each (COUNT,)."""
    s: Any = {name: ca.SX.sym(name) for name in p}
    said = getattr(Technology, method)(s)
    if method == "respond":
        slope = ca.gradient(said.potential, s["length"])
        named = {"work": said.work, "stored": said.stored, "lost": said.lost, "slope": slope, "given": said.given}
        said = named | {"command_given": said.command, **said.states}
    found = ca.Function("law", list(s.values()), [ca.SX(each) for each in said.values()]).map(COUNT)
    out = found(*(values[None] for values in p.values()))
    return {name: np.asarray(row).ravel() for name, row in zip(said, out, strict=True)}


@pytest.fixture(scope="module")
def p() -> Values:
    return some_step()


@pytest.fixture(scope="module")
def said(p: Values) -> Values:
    return answers(p)


def sense(p: Values) -> np.ndarray:
    return np.where(p["lengthens"] > 0.0, -1.0, 1.0)


def stroke(p: Values) -> np.ndarray:
    return np.minimum(p["strain"] * p["lever"], 0.9)


def share(p: Values, command: str) -> np.ndarray:
    return np.clip(sense(p) * p[command] / stroke(p), -p["both_ways"], 1.0)


def pull(p: Values, active: np.ndarray, length: np.ndarray) -> np.ndarray:
    """Return the force in the actuator's own sense, (T3) [N]."""
    x = sense(p) * (1.0 - length / p["l0"]) / stroke(p)
    scales = p["scales"] > 0.0
    q, most = np.where(scales, 1.0, active), np.where(scales, active, 1.0)
    f = np.minimum(p["series"] * (q - x), most * (1.0 - p["droop"] * np.maximum(x, 0.0)))
    return p["stress"] * p["area"] / p["lever"] * np.maximum(f, -p["push"])


def driven(p: Values) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return asked, the drive without its limit of speed, and its integral over the step, by small steps of (T1)."""
    asked, h = p["asked_n"].copy(), p["dt"] / SUBSTEPS
    first, last = share(p, "command_n"), share(p, "command")
    for k in range(SUBSTEPS):  # the midpoint rule, implicit
        command = first + (last - first) * (k + 0.5) / SUBSTEPS
        asked += h / p["delay"] / (1.0 + h / (2.0 * p["delay"])) * (command - asked)
    most = np.clip(10.0 * (1.0 - p["warmth_n"] / p["hottest"]), 0.0, 1.0)
    wanted, w = np.clip((asked + p["asked_n"]) / 2.0, -most, most), p["hysteresis"]
    target = np.where(wanted > p["active_n"], (wanted + w) / (1.0 + w), wanted / (1.0 + w))
    assert_allclose(play(p, p["active_n"], target), wanted, atol=1e-12)
    lag = np.where(abs(target) > abs(p["drive_n"]), p["rise"], p["fall"])
    drive, integral = p["drive_n"].copy(), np.zeros(COUNT)
    for _ in range(SUBSTEPS):
        before = drive
        drive = drive + h / lag / (1.0 + h / (2.0 * lag)) * (target - drive)
        integral += h * (abs(before) + abs(drive)) / 2.0
    return asked, drive, integral


def test_drive_and_active_share(p: Values, said: Values) -> None:
    """(T1) and (T2); a drive that is limited moves by what its rate allows."""
    asked, free, _ = driven(p)
    most = p["rate"] * p["dt"]
    assert_allclose(said["asked"], asked, atol=2e-6)
    assert_allclose(said["drive"], p["drive_n"] + np.clip(free - p["drive_n"], -most, most), atol=5e-6)
    assert (abs(free - p["drive_n"]) > most).mean() > 0.05
    assert_allclose(said["active"], play(p, p["active_n"], said["drive"]), atol=1e-12)
    assert_allclose(said["given"], sense(p) * stroke(p) * said["active"], atol=1e-12)
    assert_allclose(said["command_given"], sense(p) * stroke(p) * share(p, "command"), atol=1e-12)


def test_pull_and_potential(p: Values, said: Values) -> None:
    """(T3): what contracts is positive, and lengthening the chamber costs its potential what it pulls."""
    force = sense(p) * pull(p, said["active"], p["length"])
    largest = p["stress"] * p["area"] / p["lever"]
    assert_allclose(said["pull"] / largest, force / largest, atol=1e-8)
    assert_allclose(said["slope"] / largest, force / largest, atol=1e-8)


def test_what_is_drawn_kept_and_lost(p: Values, said: Values) -> None:
    """(T4): the drive's work is what the chamber is given and its spring keeps; none of it comes back."""
    before, after = pull(p, p["active_n"], p["length_n"]), pull(p, said["active"], p["length"])
    given = (before + after) / 2.0 * sense(p) * (p["length_n"] - p["length"])
    largest = p["stress"] * p["area"] / p["lever"]
    stiffness = p["series"] * largest / (stroke(p) * p["l0"])
    sprung = np.where(p["scales"] > 0.0, 0.0, (after**2 - before**2) / (2.0 * stiffness))
    full, (_, free, integral) = p["charge"] * p["area"] * p["l0"], driven(p)
    limited = abs(free - p["drive_n"]) > p["rate"] * p["dt"]
    mean = np.where(limited, p["dt"] * (abs(said["drive"]) + abs(p["drive_n"])) / 2.0, integral)
    charged, leaked = full * (abs(said["drive"]) - abs(p["drive_n"])), p["leak"] * full * mean
    power, work = charged + leaked, given + sprung
    holding = p["stall"] * p["lever"] / largest * p["dt"] * (before**2 + after**2) / 2.0
    drawn = np.maximum(power, 0.0) / p["charging"] + np.maximum(work, 0.0) / p["efficiency"] + holding
    wasted = np.maximum(power, 0.0) * (1.0 / p["charging"] - 1.0) + np.maximum(work, 0.0) * (
        1.0 / p["efficiency"] - 1.0
    )
    wasted += np.maximum(-power, 0.0) + np.maximum(-work, 0.0)
    idle = p["idle"] * p["dt"]
    drawn, wasted = drawn + idle, wasted + idle
    scale = largest * p["l0"] * 0.1 + full + drawn
    one_sign = said["drive"] * p["drive_n"] >= 0.0
    assert one_sign.mean() > 0.9
    for name, value in (("work", drawn), ("stored", charged + sprung), ("lost", leaked + wasted + holding)):
        assert_allclose((said[name] / scale)[one_sign], (value / scale)[one_sign], atol=5e-6, err_msg=name)
    balance = said["work"] - said["stored"] - said["lost"]  # what the chamber is given, to rounding
    assert_allclose(balance / scale, given / scale, atol=1e-11)
    assert (said["work"] >= -1e-12 * scale).all()
    assert (said["lost"] >= -1e-12 * scale).all()
    assert min((work > 0.0).mean(), (work < 0.0).mean(), (power > 0.0).mean(), (power < 0.0).mean()) > 0.1


def test_warmth(p: Values, said: Values) -> None:
    """(T5), with the losses of the step, but for those of idling, spread over it."""
    left, capacity = p["warmth_n"] - p["hot"] * abs(p["drive_n"]), p["heat_capacity"] * p["stress"] * p["area"]
    h, lost = p["dt"] / SUBSTEPS, said["lost"] / p["dt"] - p["idle"]
    heated = lost / capacity * p["dt"]
    for _ in range(SUBSTEPS):
        left = (left * (1.0 - h / (2.0 * p["cooling"])) + h * lost / capacity) / (1.0 + h / (2.0 * p["cooling"]))
    found = said["warmth"] - p["hot"] * abs(said["drive"])
    assert (abs(found - left) <= 0.01 * heated + 1e-3).all()


def test_rest_is_rest(p: Values) -> None:
    """A constant command leaves the states that it has led to, and draws what leaks, what holds and what idles."""
    p = p | {"command_n": p["command"], "length_n": p["length"], "hottest": np.full(COUNT, np.inf)}
    p["heat_capacity"] = np.full(COUNT, np.inf)
    rest = answers(p, "at_rest")
    p |= {f"{name}_n": values for name, values in rest.items()}
    after = answers(p)
    for name, values in rest.items():
        assert_allclose(after[name], values, rtol=1e-9, atol=1e-9, err_msg=name)
    leaks = p["leak"] * p["charge"] * p["area"] * p["l0"] * abs(rest["drive"]) * p["dt"]
    holds = p["stall"] * p["lever"] ** 2 / (p["stress"] * p["area"]) * rest["pull"] ** 2 * p["dt"]
    assert_allclose(after["work"], leaks / p["charging"] + holds + p["idle"] * p["dt"], rtol=1e-6, atol=1e-12)
    assert_allclose(after["stored"], 0.0, atol=1e-12)
