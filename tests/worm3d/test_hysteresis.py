"""Friction in the joints: closed forms of its loops, derivatives, the ledger, and worms that have it."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import casadi as ca
import numpy as np
import pytest
from kernel_states import COUNT, assert_close, differences, evaluated, some_segment
from numpy.testing import assert_allclose, assert_array_equal

import worm3d
from control.gaits import TravellingWave
from worm3d import (
    Command,
    FirstOrder,
    Hydrostat,
    Hysteresis,
    Jenkins,
    Plane,
    Pneumatic,
    Rhombus,
    SegmentLaw,
    Status,
    Worm,
)
from worm3d.physics.kernels import actuator
from worm3d.running.plant import kernels
from worm3d.values.parameters import parameter

LAWS = pytest.mark.parametrize("law", [Rhombus, Hydrostat])
FREE = {"moment": 0.02, "load_ratio": 0.5, "give": 2e-4, "spread": 3.0}


def coordinate(
    length: np.ndarray, l0: float, link: float, k: float, own: Mapping[str, float], k_apex: float = 0.0
) -> np.ndarray:
    """Return y of (H1) [J], written out: the hinge angle, and the energy of half of the springs with its sign."""
    angle, rest = (2.0 * np.arcsin(each / (2.0 * link)) for each in (length, l0))
    pulled = k * l0 / 4.0 * (1.0 - length / l0) ** 2 + k_apex / 2.0 * (angle - rest) ** 2
    return np.asarray(own["moment"] * angle + own["load_ratio"] * pulled * np.sign(length - l0))


class Sliders:
    """Four springs with sliders, moved along y in steps however small: the force is what they carry together."""

    def __init__(self, give: float, spread: float) -> None:
        self.gives = give * spread ** np.array([-1.0, -1.0 / 3.0, 1.0 / 3.0, 1.0])
        self.given, self.y, self.lost = np.zeros(4), 0.0, 0.0

    def move(self, y: float) -> float:
        """Move to y; return the force over the greatest."""
        wanted = self.given + y - self.y
        self.given, self.y = np.clip(wanted, -self.gives, self.gives), y
        self.lost += float(np.abs(wanted - self.given).mean())
        return float((self.given / self.gives).mean())

    @property
    def stored(self) -> float:
        return float((self.given**2 / (2.0 * self.gives)).mean())


def some_friction(seed: int, law: type[SegmentLaw]) -> dict[str, np.ndarray]:
    """Return segments in general position, with friction that sticks, slides and is about to."""
    rng, values = np.random.default_rng(seed), some_segment(seed)
    sizes = actuator.chambers(FirstOrder, Jenkins, law).sizes
    values |= {name: np.zeros((size, COUNT)) for name, size in sizes.items() if name not in values}
    if law is Hydrostat:
        values["segment_law_rest_height"] = rng.uniform(0.04, 0.06, (1, COUNT))
        link = np.hypot(values["segment_law_rest_height"] + values["offset"], values["l0"] / 2.0)
        values |= {"link": link, "k_apex": 0.0 * link}  # for `_without_kinks`; the kernel does not use them
    known = {"moment": (0.0, 0.1), "load_ratio": (0.0, 0.9), "give": (1e-3, 0.1), "spread": (1.0, 5.0)}
    for name, (low, high) in known.items():
        values[f"actuator_hysteresis_{name}"] = rng.uniform(low, high, (1, COUNT))
    for k in range(1, 5):
        values[f"actuator_hysteresis_{k}_n"] = rng.uniform(-1.0, 1.0, (2, COUNT))
    nothing = {"f": 0.0 * values["f"], "f_ahead": 0.0 * values["f"], "K": 0.0 * values["K"]}
    return values | nothing | {"actuator_haste": np.ones((1, COUNT)), "actuator_lag": np.ones((1, COUNT))}


@LAWS
@pytest.mark.parametrize("seed", range(3))
def test_gradient_and_hessian_of_a_segment_that_rubs(seed: int, law: type[SegmentLaw]) -> None:
    made, values = kernels(own=Jenkins, segment_law=law), some_friction(seed, law)
    layout = actuator.chambers(FirstOrder, Jenkins, law)

    def potential(q: np.ndarray) -> np.ndarray:
        return evaluated(made["segment_gradient"], layout, values | {"q": q})[:1]

    def gradient(q: np.ndarray) -> np.ndarray:
        return evaluated(made["segment_gradient"], layout, values | {"q": q})[1:]

    found = evaluated(made["segment_hessian"], layout, values)
    smooth = _without_kinks(values, 4e-5)
    assert smooth.sum() > COUNT / 2
    for of, at, h, relative in ((found[None, 1:9], potential, 1e-5, 1e-6), (found[9:], gradient, 1e-6, 1e-6)):
        expected = differences(at, values["q"], h)
        assert_close(of.reshape(expected.shape)[..., smooth], expected[..., smooth], relative)


def _without_kinks(values: Mapping[str, np.ndarray], near: float) -> np.ndarray:
    """Return where no slider is about to slide or stop, and no chamber at its rest length, within `near` [m]."""
    q, l0, k, link = values["q"], values["l0"], values["k"], values["link"]
    length = np.linalg.norm(q[5:8] - q[:3], axis=0) - np.array([1.0, -1.0])[:, None] * values["offset"] * q[4]
    own = {name: values[f"actuator_hysteresis_{name}"] for name in FREE}
    moved = [
        coordinate(at, l0, link, k, own, values["k_apex"])
        for at in (length, values["length_n"], length + near, length - near)
    ]  # type: ignore[arg-type]
    smooth: np.ndarray = (np.abs(length - l0) > near).all(axis=0)
    for j, place in enumerate((-1.0, -1.0 / 3.0, 1.0 / 3.0, 1.0)):
        give = own["give"] * own["spread"] ** place
        state = values[f"actuator_hysteresis_{j + 1}_n"]
        slides = [np.abs(give * state + y - moved[1]) > give for y in (moved[0], *moved[2:])]
        smooth &= ((slides[0] == slides[1]) & (slides[0] == slides[2])).all(axis=0)
    return smooth


def loop(cycles: np.ndarray, worm: Worm, dt: float = 0.01) -> worm3d.Result:
    """Command a floating, damped segment's contraction along a path; its chambers follow but for the friction."""
    return worm3d.simulate(
        worm,
        None,
        actuation=lambda t: Command([[cycles[min(round(t / dt), len(cycles) - 1)]] * 2]),
        duration=dt * (len(cycles) - 1),
        dt=dt,
        gravity=(0, 0, 0),
        integrator="implicit_euler",
    )


@LAWS
def test_states_and_loss_are_those_of_sliders_moved_by_hand(law: type[SegmentLaw]) -> None:
    """The way that the chambers went, taken again by springs and sliders written out: the same states and losses."""
    worm = Worm(segments=1, length=0.2, hysteresis=Jenkins(**FREE), actuator_lag=0.0, segment=law())
    run = loop(0.1 * np.sin(np.linspace(0.0, 15.0, 301)) * np.linspace(0.3, 1.0, 301), worm)
    link = np.hypot(0.05 + (0.03 if law is Hydrostat else 0.0), 0.1)  # (H5)
    y = coordinate(run.chamber_length[:, 0, 0], worm.l0, link, 13.0, FREE)
    by_hand = Sliders(FREE["give"], FREE["spread"])
    by_hand.y = y[0]
    for row in range(1, len(y)):
        by_hand.move(y[row])
        states = [run.actuator_states[f"hysteresis_{k}"][row, 0, 0] for k in range(1, 5)]
        assert_allclose(states, by_hand.given / by_hand.gives, rtol=0, atol=1e-10)
    assert_allclose(run.energy.hysteresis_loss.sum(), 2.0 * by_hand.lost, rtol=1e-9)
    assert by_hand.lost > 20.0 * by_hand.stored > 0.0
    assert run.energy.balance_error < 1e-12
    assert run.energy.hysteresis_loss.min() >= 0.0


def test_a_pull_below_the_friction_holds_and_one_above_moves_to_the_balance() -> None:
    """At rest |spring + pull| <= moment/h + ratio |spring|, with equality where the whole friction slides."""
    worm = Worm(
        segments=1, length=0.2, hysteresis=Jenkins(moment=0.02, load_ratio=0.5, give=1e-6), kelvin_voigt_time=0.3
    )
    capacity = 2.0 * 0.02 / 0.05  # of both chambers, at rest

    def pulled(newton: float) -> worm3d.Result:
        pull = np.array([[-newton, 0.0, 0.0], [newton, 0.0, 0.0]])
        return worm3d.simulate(worm, None, external_force=lambda t: pull * min(t, 1.0), duration=6.0, gravity=(0, 0, 0))

    held, moved = pulled(0.8 * capacity), pulled(3.0 * capacity)
    assert np.abs(held.chamber_length - worm.l0).max() < 2e-5
    length = moved.chamber_length[-1, 0, 0]
    spring = worm.k_spring[0] * (length / worm.l0 - 1.0)  # type: ignore[index]
    h = np.sqrt(worm.link_length[0] ** 2 - length**2 / 4.0)
    assert_allclose(3.0 * capacity, spring + 2.0 * 0.02 / h + 0.5 * spring, rtol=1e-7)
    for k in range(1, 5):
        assert_allclose(moved.actuator_states[f"hysteresis_{k}"][-1], 1.0, rtol=0, atol=1e-9)


def test_each_segment_has_friction_of_its_own() -> None:
    """The rear segment holds a pull that the front one, without friction, follows to its spring's balance."""
    worm = Worm(
        segments=2, length=0.4, hysteresis=Jenkins(moment=[0.05, 0.0], load_ratio=0.0, give=1e-6), kelvin_voigt_time=0.3
    )
    pull = np.array([[-1.0, 0.0, 0.0], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    run = worm3d.simulate(worm, None, external_force=lambda t: pull * min(t, 1.0), duration=6.0, gravity=(0, 0, 0))
    rear, front = run.chamber_length[-1] / worm.l0 - 1.0
    assert np.abs(rear).max() < 1e-4
    assert_allclose(front, 1.0 / 13.0, rtol=1e-6)


def test_the_loss_of_a_cycle_depends_on_the_way_alone() -> None:
    """A cycle from angle to angle and back loses 2 M (their difference) a chamber, however slow; dampers lose less."""
    viscous = []
    for period in (2.0, 200.0):
        own = Jenkins(moment=0.02, load_ratio=0.0, give=1e-9)
        worm = Worm(segments=1, length=0.2, actuator_lag=0.0, hysteresis=own, kelvin_voigt_time=0.02)
        run = loop(0.2 * np.sin(2.0 * np.pi * np.arange(801) / 400), worm, period / 400)
        angle = 2.0 * np.arcsin(run.chamber_length[401:, 0, 0] / (2.0 * worm.link_length[0]))
        assert_allclose(run.energy.hysteresis_loss[401:].sum(), 2.0 * 2.0 * 0.02 * np.ptp(angle), rtol=1e-4)
        viscous.append(run.energy.viscous_loss[401:].sum())
    assert viscous[1] < 0.02 * viscous[0]


def test_a_cycle_loses_what_masing_says() -> None:
    """Each element slides twice a cycle, by the way in y from turn to turn less the 2 r_k of its spring."""
    own = Jenkins(**FREE)
    worm = Worm(segments=1, length=0.2, actuator_lag=0.0, hysteresis=own)
    steps = 400
    run = loop(0.2 * np.sin(2.0 * np.pi * np.arange(3 * steps + 1) / steps), worm, 0.02)
    y = coordinate(run.chamber_length[2 * steps + 1 :, 0, 0], worm.l0, worm.link_length[0], 13.0, FREE)
    gives = FREE["give"] * FREE["spread"] ** np.array([-1.0, -1.0 / 3.0, 1.0 / 3.0, 1.0])
    expected = 2.0 * np.sum(2.0 * np.maximum(np.ptp(y) - 2.0 * gives, 0.0) / 4.0)
    assert_allclose(run.energy.hysteresis_loss[2 * steps + 1 :].sum(), expected, rtol=2e-3)


def crawl(own: Hysteresis | None = None, duration: float = 2.0, **more: Any) -> worm3d.Result:
    worm = Worm(**({} if own is None else {"hysteresis": own}), **more)
    return worm3d.simulate(worm, Plane(), actuation=TravellingWave(amplitude=0.2, bias=0.2), duration=duration)


@pytest.mark.parametrize("seed", range(5))
def test_any_friction_leads_to_a_result(seed: int) -> None:
    """From joints that give a lot to all but rigid ones, with hardly any friction and with as much as there may be."""
    rng = np.random.default_rng(seed)
    own = Jenkins(
        moment=np.exp(rng.uniform(np.log(1e-4), np.log(0.05), 6)),
        load_ratio=rng.uniform(0.0, 0.95, 6),
        give=np.exp(rng.uniform(np.log(1e-6), np.log(1e-3), 6)),
        spread=rng.uniform(1.0, 10.0),
    )
    drives: list[Any] = [FirstOrder(), Pneumatic()]
    run = crawl(own, 1.0, actuator=drives[seed % 2], k_apex=rng.uniform(0.0, 0.05))
    assert run.status is Status.DONE, run.stop.sentence
    assert run.energy.balance_error < 1e-11
    assert run.energy.hysteresis_loss.min() >= 0.0
    assert run.energy.hysteresis_loss.sum() > 0.0
    for k in range(1, 5):
        assert np.abs(run.actuator_states[f"hysteresis_{k}"]).max() <= 1.0


def test_without_friction_nothing_changes_and_nothing_is_recorded() -> None:
    plain, none = crawl(duration=0.5), crawl(Jenkins(moment=0.0, load_ratio=0.0), 0.5)
    assert plain.actuator_states == {}
    assert_array_equal(plain.energy.hysteresis_loss, 0.0)
    assert_allclose(none.joints, plain.joints, rtol=0, atol=1e-12)
    assert not any(name.startswith("hysteresis") for name in kernels())


def test_a_run_is_saved_gone_on_with_and_one_of_a_batch(tmp_path: Path) -> None:
    own = Jenkins(give=[1e-4, 2e-4, 1e-4, 1e-4, 1e-4, 3e-4])
    whole, begun = crawl(own, 1.0), crawl(own, 0.5)
    begun.save(tmp_path / "rubs.nc")
    again = worm3d.load(tmp_path / "rubs.nc")
    assert again.worm.hysteresis == own
    gait = TravellingWave(amplitude=0.2, bias=0.2)
    rest = worm3d.simulate(again.worm, Plane(), actuation=gait, duration=0.5, state=again.state)
    assert_array_equal(rest.joints, whole.joints[50:])
    for name, states in whole.actuator_states.items():
        assert_array_equal(rest.actuator_states[name], states[50:])
        assert_array_equal(again.actuator_states[name], begun.actuator_states[name])
    assert_array_equal(again.energy.hysteresis_loss, begun.energy.hysteresis_loss)
    batch = worm3d.simulate_batch([whole.worm, Worm()], Plane(), actuation=gait, duration=0.5, threads=2)
    assert_array_equal(batch[0].joints, begun.joints)


def test_a_mirrored_worm_rubs_mirrored() -> None:
    runs = [
        worm3d.simulate(
            Worm(hysteresis=Jenkins()), Plane(), actuation=TravellingWave(amplitude=0.2, bias=bias), duration=1.0
        )
        for bias in (0.3, -0.3)
    ]
    assert_allclose(runs[1].joints, runs[0].joints * [1.0, -1.0, 1.0], rtol=0, atol=1e-9)
    for name, states in runs[0].actuator_states.items():
        assert_allclose(runs[1].actuator_states[name], states[..., ::-1], rtol=0, atol=1e-7)


def test_a_turned_worm_rubs_turned() -> None:
    worm, gait, angle = Worm(hysteresis=Jenkins()), TravellingWave(amplitude=0.2, bias=0.3, hinge=0.2), 1.0
    starts = [worm3d.State.straight(worm, Plane(), azimuth=azimuth) for azimuth in (0.0, angle)]
    runs = [worm3d.simulate(worm, Plane(), actuation=gait, duration=1.0, state=start) for start in starts]
    turn = np.array([[np.cos(angle), np.sin(angle), 0.0], [-np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]])
    ways = [run.joints - run.joints[0, 0] for run in runs]
    assert_allclose(ways[1], ways[0] @ turn, rtol=0, atol=1e-8)
    for name, states in runs[0].actuator_states.items():
        assert_allclose(runs[1].actuator_states[name], states, rtol=0, atol=1e-6)


def test_crawling_converges_with_the_time_step() -> None:
    def reached(dt: float) -> float:
        gait = TravellingWave(amplitude=0.2)
        run = worm3d.simulate(Worm(hysteresis=Jenkins()), Plane(), actuation=gait, duration=2.0, dt=dt)
        return float(run.com[-1, 0])

    fine = reached(0.000625)
    assert_allclose([reached(dt) for dt in (0.02, 0.01, 0.0025)], fine, rtol=0.01)
    assert fine > 0.05


def test_joints_without_links_have_the_lever_of_a_rhombus_until_it_is_nearly_flat() -> None:
    """1/h up to 0.95 of twice the links, constant above."""
    length = ca.SX.sym("length")
    s = {
        name: ca.SX(value)
        for name, value in {"l0": 0.2, "offset": 0.03, "rest_height": 0.05, "k": 13.0, "tau": 0.0}.items()
    }
    angle = Hydrostat.joints(s, length)["angle"]
    found = ca.Function("angle", [length], [angle, ca.gradient(angle, length)])
    link = np.hypot(0.08, 0.1)
    at = np.linspace(0.02, 0.99, 50) * 1.9 * link
    assert_allclose(found(at)[0].full().ravel(), 2.0 * np.arcsin(at / (2.0 * link)), rtol=1e-14)
    assert_allclose(found(at)[1].full().ravel(), 1.0 / np.sqrt(link**2 - at**2 / 4.0), rtol=1e-13)
    end = 1.9 * link
    beyond = np.array([1.0 + 1e-12, 1.2, 5.0]) * end
    lever = np.sqrt(link**2 - end**2 / 4.0)
    assert_allclose(found(beyond)[1].full().ravel(), 1.0 / lever, rtol=1e-13)
    assert_allclose(found(beyond)[0].full().ravel(), 2.0 * np.arcsin(0.95) + (beyond - end) / lever, rtol=1e-13)


@dataclass(frozen=True, eq=False, kw_only=True)
class Own(Hysteresis):
    """Friction of a constant force."""

    elements: ClassVar[int] = 1
    newton: Any = parameter(0.3, meaning="friction along the chamber", unit="N", ge=0, each="segment")

    @classmethod
    def coordinate(cls, s: Mapping[str, Any]) -> Any:
        return s["newton"] * s["length"]

    @classmethod
    def sliders(cls, s: Mapping[str, Any]) -> Any:
        return [(1.0, 1e-5)]


@LAWS
def test_friction_of_ones_own_holds_what_it_says(law: type[SegmentLaw]) -> None:
    worm = Worm(segments=1, length=0.2, hysteresis=Own(newton=0.4), kelvin_voigt_time=0.15, segment=law())
    pull = np.array([[-2.0, 0.0, 0.0], [2.0, 0.0, 0.0]])
    run = worm3d.simulate(worm, None, external_force=lambda t: pull * min(t, 1.0), duration=6.0, gravity=(0, 0, 0))
    assert_allclose(run.chamber_length[-1] / worm.l0 - 1.0, (2.0 - 0.8) / 13.0, rtol=1e-7)


class _Few(Own):
    elements: ClassVar[int] = 2


class _Wrong(Own):
    @classmethod
    def sliders(cls, s: Mapping[str, Any]) -> Any:
        return 1.0


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: Worm(hysteresis=0.1), "hysteresis: got float, must be a worm3d.Hysteresis such as worm3d.Jenkins()"),
        (lambda: Worm(hysteresis=Jenkins(moment=np.ones(5))), "hysteresis.moment: got 5 values, must be a number or 6"),
        (lambda: Jenkins(load_ratio=1.0), "load_ratio: got 1.0, must be"),
        (lambda: Jenkins(give=0.0), "give: got 0.0, must be finite and above 0"),
        (lambda: crawl(_Few()), "_Few.sliders: got 1 pairs of share and give, must be 2 as `elements` says"),
        (lambda: crawl(_Wrong()), "_Wrong.sliders: got float, must be pairs of share and give"),
        (lambda: type("jenkins2", (Hysteresis,), {}, name="jenkins"), "Jenkins has the name 'jenkins' already"),
    ],
)
def test_what_is_wrong_is_said(make: Any, sentence: str) -> None:
    with pytest.raises(ValueError, match=re.escape(sentence)):
        make()


def test_a_scene_names_it() -> None:
    from scenes.language.errors import SceneError
    from scenes.models.loading import load_scene
    from scenes.models.worm.build import worm_of

    chosen = ["hysteresis.kind=jenkins", "hysteresis.moment_N_m=0.01", "hysteresis.give_J=3e-4"]
    assert worm_of(load_scene("flat", chosen).settings).hysteresis == Jenkins(moment=0.01, give=3e-4)
    assert worm_of(load_scene("flat").settings).hysteresis == Hysteresis()
    with pytest.raises(SceneError, match=r"hysteresis.moment_N_m: only for hysteresis.kind = 'jenkins'"):
        load_scene("flat", chosen[1:])
