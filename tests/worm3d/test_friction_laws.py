"""Laws of friction as parts: viscous friction against closed forms, and a third law that is defined here alone."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from kernel_states import AT_REST, COUNT, assert_close, differences, on_sphere, run, some_point, with_pull_of_the_law
from numpy.testing import assert_allclose, assert_array_equal
from test_friction import BOTH, STIFF, G, all_slip, uniform

import worm3d
from control.gaits import TravellingWave
from worm3d import Coulomb, Friction, FrictionLaw, Plane, State, Status, Viscous, Worm
from worm3d.physics.friction_laws import LAWS, law_of
from worm3d.physics.kernels import point
from worm3d.results.files import plain, restored
from worm3d.solver.evaluate import LOAD_ROW, PHI, STIFFNESS
from worm3d.solver.regimes import EXCESS, PREDICTED_FRICTION, Y
from worm3d.values.parameters import parameter


@dataclass(frozen=True, eq=False)
class Sticky(FrictionLaw):  # without a name: the laws of this file are none that other tests find
    """Pads that adhere: they resist as if `adhesion` more pressed on them, wholly so from a load of `full` on."""

    adhesion: Any = parameter(0.1, meaning="load that adhesion is worth", unit="N", ge=0, each="segment")
    full: Any = parameter(0.01, meaning="load at which 0.7 of it acts", unit="N", gt=0, each="segment")

    @staticmethod
    def capacity(load: ca.SX, p: Any) -> ca.SX:
        return load + p["adhesion"] * load / ca.sqrt(load**2 + p["full"] ** 2)


@dataclass(frozen=True, eq=False)
class Thinning(FrictionLaw):
    """Adhesion and a resistance that grows less than in proportion to speed: both functions at once."""

    growth: Any = parameter(1.0, meaning="growth of friction at high speed", ge=0, each="segment")
    speed: Any = parameter(0.01, meaning="rate at which it levels off", unit="m/s", gt=0, each="segment")
    adhesion: Any = parameter(0.02, meaning="load that adhesion is worth", unit="N", ge=0, each="segment")

    @staticmethod
    def capacity(load: ca.SX, p: Any) -> ca.SX:
        return Sticky.capacity(load, {"adhesion": p["adhesion"], "full": p["adhesion"]})

    @staticmethod
    def excess(rate: ca.SX, p: Any) -> ca.SX:
        return p["growth"] * (rate - p["speed"] * ca.log1p(rate / p["speed"]))


LAWS_HERE = (Coulomb, Viscous, Sticky, Thinning)
LAW = pytest.mark.parametrize("law", LAWS_HERE, ids=lambda law: law.__name__)
B = 20.0
"""Viscosity [s/m]."""


def slide(mu: tuple[float, float, float], viscosity: Any, plane: Plane, velocity: Any, **more: Any) -> worm3d.Result:
    """Let a stiff worm that lies along x slide freely from a velocity; return the run."""
    worm, ground = Worm(**STIFF), Friction(*mu, static_ratio=1.0, law=Viscous(viscosity))
    start = worm3d.simulate(worm, plane, ground, duration=0.01).state
    start = start.with_changes(joint_velocity=np.tile(velocity, (7, 1)), time=0.0)
    return worm3d.simulate(worm, plane, ground, state=start, **{"duration": 0.5, "dt": 1e-3} | more)


@BOTH
@pytest.mark.parametrize(
    ("heading", "mu_x", "mu_l"),
    [(0.0, 0.5, 0.3), (np.pi, 0.2, 0.3), (np.pi / 2, 0.9, 0.3)],
    ids=["back", "forth", "side"],
)
def test_terminal_speed_on_a_slope(integrator: str, heading: float, mu_x: float, mu_l: float) -> None:
    """m g sin = mu N (1 + b mu v): v = (tan/mu - 1)/(b mu), in each direction with its own coefficient."""
    mu = mu_l if heading == np.pi / 2 else mu_x
    slope = np.arctan(1.4 * mu)
    plane = Plane(slope, heading)
    coefficients = (mu_x if heading == np.pi else 0.9, mu_x if heading == 0.0 else 0.9, mu_l)
    worm = Worm(**STIFF, end_faces=heading != np.pi / 2)
    ground = Friction(*coefficients, static_ratio=1.0, law=Viscous(B))
    result = worm3d.simulate(worm, plane, ground, duration=2.0, integrator=integrator, settle_first=False)
    assert result.status is Status.DONE
    speed = -result.com_velocity[-1] @ plane.axes[0]
    assert_allclose(speed, 0.4 / (B * mu), rtol=2e-3)


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_it_comes_to_rest_as_the_differential_equation_says(direction: float) -> None:
    """dv/dt = -mu g (1 + b mu v): v = (v0 + 1/(b mu)) exp(-mu^2 b g t) - 1/(b mu), then nothing moves."""
    mu, b = 0.2 if direction > 0.0 else 0.35, 8.0
    result = slide((0.2, 0.35, 0.9), b, Plane(), [direction * 0.4, 0.0, 0.0])
    law = np.maximum(0.0, (0.4 + 1.0 / (b * mu)) * np.exp(-(mu**2) * b * G * result.time) - 1.0 / (b * mu))
    moving = (law > 0.05) & (result.time > 0.02)
    assert moving.sum() > 20
    assert_allclose(direction * result.com_velocity[moving, 0], law[moving], rtol=0, atol=3e-3)
    assert_array_equal(all_slip(result)[-20:], 0.0)
    free = slide((0.2, 0.35, 0.9), 0.0, Plane(), [direction * 0.4, 0.0, 0.0])
    assert direction * free.distance > 1.1 * direction * result.distance


def test_oblique_sliding_follows_the_gradient_of_the_dissipation() -> None:
    """The force is -N (1 + b rho) grad rho at the velocity."""
    mu_f, mu_l = 0.1, 0.4
    result = slide((mu_f, 0.8, mu_l), 5.0, Plane(), [1.0, 1.0, 0.0], duration=0.05)
    change, v = (result.momentum[40] - result.momentum[10]) / 0.03, result.com_velocity[25]
    rho = np.hypot(mu_f * v[0], mu_l * v[1])
    law = -result.worm.mass * G * (1.0 + 5.0 * rho) * np.array([mu_f**2 * v[0], mu_l**2 * v[1]]) / rho
    assert_allclose(change[:2], law, rtol=1.5e-2)


@BOTH
def test_pulling_steadily_costs_what_the_law_says(integrator: str) -> None:
    """Held at a speed by its pull, the worm loses mu m g (1 + b mu v) a metre; the ledger says so, and it closes."""
    mu, v, worm = 0.2, 0.15, Worm(**STIFF)
    pull = mu * worm.mass * G * (1.0 + B * mu * v)
    ground = Friction(mu, 0.9, 0.9, static_ratio=1.0, law=Viscous(B))
    force = uniform(worm, np.array([pull, 0.0, 0.0]))
    result = worm3d.simulate(worm, Plane(), ground, duration=2.0, integrator=integrator, external_force=force)
    late, way = slice(160, None), result.com[-1, 0] - result.com[159, 0]
    assert_allclose(result.com_velocity[-1, 0], v, rtol=1e-3)
    assert_allclose(result.energy.friction_loss[late].sum() / way, pull, rtol=1e-3)
    assert result.energy.balance_error < 1e-11


@pytest.mark.parametrize("ratio", [1.0, 1.3])
def test_what_sticks_holds_as_by_coulombs_law(ratio: float) -> None:
    """Nothing slips below the static limit, whatever the viscosity; above it the worm moves."""
    worm = Worm(**STIFF)
    for factor, moves in ((0.97, False), (1.03, True)):
        force = uniform(worm, np.array([factor * ratio * 0.3 * worm.mass * G, 0.0, 0.0]))
        ground = Friction(0.3, 0.1, 0.2, static_ratio=ratio, law=Viscous(200.0))
        slip = all_slip(worm3d.simulate(worm, Plane(), ground, duration=1.0, external_force=force))
        assert (slip[-1] > 0.0) == moves


def test_each_segment_has_its_own_viscosity() -> None:
    """Gliding forward on one viscous segment alone, the worm feels mu^2 b v of that segment's load beside mu m g."""
    for segment in (0, 3):
        viscosity = np.zeros(6)
        viscosity[segment] = B
        result = slide((0.3, 0.9, 0.9), viscosity, Plane(), [0.5, 0.0, 0.0], duration=0.04, integrator="implicit_euler")
        felt, v = -np.diff(result.momentum[:, 0])[-1] / result.dt, result.com_velocity[-1, 0]
        carried = result.normal_load[-1, segment].sum() + result.joint_load[-1, segment]
        extra = 0.3**2 * B * v * carried
        assert extra > 0.03
        assert_allclose(felt, 0.3 * result.worm.mass * G + extra, rtol=5e-3)


def test_no_viscosity_is_coulombs_law() -> None:
    gait = TravellingWave(amplitude=0.3, bias=0.3)
    runs = [
        worm3d.simulate(Worm(), Plane(0.05), Friction(law=law), gait, duration=4.0)
        for law in (Coulomb(), Viscous(0.0), Viscous(1.0))
    ]
    assert_allclose(runs[1].com, runs[0].com, rtol=0, atol=1e-11)
    assert abs(runs[2].distance - runs[0].distance) > 1e-4


def test_adhesion_holds_a_worm_on_a_slope_beyond_the_friction_angle() -> None:
    """n contacts with the adhesion A each: tan = mu (1 + n A/(m g cos)); Coulomb's law slides there."""
    worm = Worm(**STIFF)
    touching = (worm3d.simulate(worm, Plane(), duration=0.01).normal_load[-1] > 0.0).sum() + 2  # end faces
    mu, law = 0.3, Sticky(adhesion=0.02, full=1e-4)

    def slides(factor: float, law: FrictionLaw) -> bool:
        slope = 0.0
        for _ in range(60):
            slope = np.arctan(factor * mu * (1.0 + touching * 0.02 / (worm.mass * G * np.cos(slope))))
        ground = Friction(mu, mu, mu, static_ratio=1.0, law=law)
        result = worm3d.simulate(worm, Plane(slope), ground, duration=1.0, settle_first=False)
        return bool(all_slip(result)[-1] > 1e-6)

    assert slides(0.8, Coulomb())
    assert not slides(0.97, law)
    assert slides(1.03, law)


@pytest.mark.parametrize("inside", [False, True])
@pytest.mark.parametrize("coupled", [False, True])
@LAW
def test_force_and_derivative_of_a_law(law: type[FrictionLaw], coupled: bool, inside: bool) -> None:
    """The stiffness is the derivative of the force, and the force at given loads that of the potential."""
    values = some_point(coupled, inside, seed=21)
    values["law"] = np.array([[20.0], [0.3], [0.5], [0.0]]) * values["law"]
    values = with_pull_of_the_law(values | {"regime": np.full((1, COUNT), point.FREE)}, law)

    def at(x: np.ndarray) -> np.ndarray:
        return run("point_stiffness", point.POINT_LAYOUT, values | {"x": x} | on_sphere(x, inside), law)

    out, h = at(values["x"]), 1e-6
    K = out[STIFFNESS:].reshape(3, 3, COUNT)
    pushed = (out[LOAD_ROW] >= 0.0) | (not coupled)
    assert_close(K[..., pushed], differences(lambda x: at(x)[:3], values["x"], h)[..., pushed], 1e-6)
    if not coupled:
        assert_close(out[None, :3], differences(lambda x: at(x)[PHI : PHI + 1], values["x"], h), 1e-6)
    look = run("point_yielding", point.POINT_LAYOUT, values | AT_REST, law)
    sliding = (look[EXCESS] > 0.0) & (out[LOAD_ROW] > 0.0)
    for kind in (sliding & (look[Y] > 0.0), sliding & (look[Y] < 0.0), ~sliding & (out[LOAD_ROW] > 0.0)):
        assert kind.sum() >= 3
    other = run("point_stiffness", point.POINT_LAYOUT, values)
    assert (law is Coulomb) == np.allclose(other, out)


@LAW
def test_the_force_is_that_of_the_equations(law: type[FrictionLaw]) -> None:
    """(C3) with C(N) and 1 + Psi', written out; Newton's own friction stays on its ellipse."""
    v = some_point(coupled=True, inside=False, seed=22) | {"regime": np.full((1, COUNT), point.FREE)}
    p, dt, c_0, r = v["law"], v["dt"][0], v["limit_ratio"][0], v["r"][0]
    out, look = (run(name, point.POINT_LAYOUT, v | AT_REST, law) for name in ("point_force", "point_yielding"))
    y, N = look[Y : Y + 2], out[LOAD_ROW]
    mu = np.array([np.where(y[0] > 0.0, *v["mu"][:2]), v["mu"][2]])
    rho = np.hypot(*(mu * y))
    slip = np.maximum(0.0, rho - c_0 * r)
    w = slip / dt
    strength, capacity = {
        Coulomb: (c_0, N),
        Viscous: (c_0 + p[0] * w, N),
        Sticky: (c_0, N + p[0] * N / np.hypot(N, p[1])),
        Thinning: (c_0 + p[0] * w / (p[1] + w), N + p[2] * N / np.hypot(N, p[2])),
    }[law]
    size = np.where(slip > 0.0, strength, rho / r)
    along = v["tangent"].reshape(2, 3, COUNT)
    without = run("point_force", point.POINT_LAYOUT, v | {"hold": np.zeros((1, COUNT))}, law)
    force = np.einsum("idk,dk->ik", along, out[:3] - without[:3])
    assert_allclose(force, v["hold"] * capacity * size * mu**2 * y / rho, rtol=1e-9, atol=1e-12)
    foreseen = run("point_yielding", point.POINT_LAYOUT, v, law)
    ahead = foreseen[PREDICTED_FRICTION : PREDICTED_FRICTION + 2]
    side = np.array([np.where(ahead[0] > 0.0, *v["mu"][:2]), v["mu"][2]])
    reached = foreseen[Y : Y + 2]
    rate = np.maximum(
        0.0, np.hypot(*(np.array([np.where(reached[0] > 0.0, *v["mu"][:2]), v["mu"][2]]) * reached)) - c_0 * r
    )
    most = {Viscous: c_0 + p[0] * rate / dt, Thinning: c_0 + p[0] * rate / dt / (p[1] + rate / dt)}.get(law, c_0)
    assert (np.hypot(*(ahead / side)) <= most * (1.0 + 1e-9)).all()


@pytest.mark.parametrize("seed", range(4))
def test_worms_crawl_by_any_law(seed: int) -> None:
    """Random coefficients, laws and gaits: every step converges, the ledger closes, friction only takes energy."""
    rng = np.random.default_rng(seed)
    law = (
        Viscous(10.0 ** rng.uniform(-1, 3, 6)),
        Sticky(10.0 ** rng.uniform(-3, -1), 0.02),
        Thinning(10.0 ** rng.uniform(-1, 1), 10.0 ** rng.uniform(-3, -1), 0.01),
        Viscous(10.0 ** rng.uniform(1, 4)),
    )[seed]
    ground = Friction(*rng.uniform(0.02, 0.5, 3), static_ratio=rng.uniform(1.0, 1.5), law=law)
    gait = TravellingWave(amplitude=rng.uniform(0.1, 0.3), bias=rng.uniform(-0.5, 0.5), period=rng.uniform(1.0, 3.0))
    result = worm3d.simulate(Worm(), Plane(rng.uniform(0.0, 0.1), rng.uniform(-3, 3)), ground, gait, duration=4.0)
    assert result.status is Status.DONE
    assert result.halved_steps == 0
    assert result.energy.balance_error < 1e-10
    assert result.energy.friction_loss.min() >= -1e-15
    assert result.newton_iterations.mean() < 8.0


def test_a_mirrored_worm_makes_the_mirrored_path_and_a_resumed_one_goes_on() -> None:
    ground = Friction(law={"name": "viscous", "viscosity": 50.0})
    left, right = (
        worm3d.simulate(Worm(), Plane(), ground, TravellingWave(amplitude=0.3, bias=sign * 0.4), duration=4.0)
        for sign in (1.0, -1.0)
    )
    assert_allclose(left.com * [1.0, -1.0, 1.0], right.com, rtol=0, atol=1e-11)
    gait = TravellingWave(amplitude=0.3, bias=0.4)
    half = worm3d.simulate(Worm(), Plane(), ground, gait, duration=2.0)
    rest = worm3d.simulate(Worm(), Plane(), ground, gait, duration=2.0, state=half.state)
    assert_array_equal(rest.joints[-1], left.joints[-1])


def test_laws_are_found_by_name_and_compared_by_value() -> None:
    class Third(Sticky, name="third"):
        pass

    try:
        assert LAWS.keys() >= {"coulomb", "viscous", "third"}
        assert Friction(law={"name": "third", "adhesion": 0.5}).law == Third(0.5) != Sticky(0.5)
    finally:
        del LAWS["third"]
    assert Friction().law == Coulomb()
    assert Friction(law="viscous").law == Viscous()
    assert law_of({"name": "viscous", "viscosity": 3}) == Viscous(np.full(1, 3.0)[0]) != Viscous(4.0)
    assert replace(Friction(law=Viscous(3.0)), forward=0.5).law == Viscous(3.0)
    with pytest.raises(ValueError, match="Other: Viscous has the name 'viscous' already, must be another one"):
        type("Other", (FrictionLaw,), {}, name="viscous")


def test_the_example_of_the_guide_is_a_law() -> None:
    text = (Path(worm3d.__file__).parents[1] / ".docs" / "guides" / "extend.md").read_text()
    code, found = text.split("```python")[1].split("```")[0], {}
    try:
        exec(code, found)
        assert found["ground"].law == law_of({"name": "sticky", "adhesion": 0.05})
        result = worm3d.simulate(Worm(), Plane(), found["ground"], TravellingWave(), duration=0.5)
        assert result.status is Status.DONE
    finally:
        LAWS.pop("sticky", None)


class Pushing(FrictionLaw):
    @staticmethod
    def excess(rate: ca.SX, p: Any) -> ca.SX:
        return 0.1 * rate


class Weightless(FrictionLaw):
    @staticmethod
    def capacity(load: ca.SX, p: Any) -> ca.SX:
        return load + 0.1


class Falling(FrictionLaw):
    @staticmethod
    def capacity(load: ca.SX, p: Any) -> ca.SX:
        return -load


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Friction(law="slimy"), "law: got 'slimy', must be one of 'coulomb', 'viscous'"),
        (lambda: Friction(law=3), "law: got 3, must be one of"),
        (lambda: Friction(law={"viscosity": 3}), "law: got None, must be one of"),
        (
            lambda: Friction(law={"name": "viscous", "sticky": 3}),
            "law: got 'sticky' for 'viscous', must be of viscosity",
        ),
        (lambda: Viscous(-1.0), "viscosity: got -1.0, must be finite and at least 0"),
        (lambda: Viscous(np.nan), "viscosity: got nan, must be finite"),
        (Pushing, "Pushing: the slope of excess at 0 is 0.1, must be 0"),
        (Weightless, "Weightless: the capacity at 0 is 0.1, must be 0"),
        (Falling, "Falling: the slope of capacity at 0 is -1, must be finite and at least 0"),
        (
            lambda: worm3d.simulate(Worm(), Plane(), Friction(law=Viscous([1.0, 2.0]))),
            "viscosity: got 2 values, must be a number or 6 of them",
        ),
        (
            lambda: worm3d.simulate(Worm.planar(mass=0.1), worm3d.ClampedGround(), Friction(law="viscous")),
            "ground: got the law 'viscous' on a ClampedGround, must be 'coulomb'",
        ),
    ],
)
def test_bad_laws_are_refused(make: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make()


@pytest.mark.parametrize(
    ("name", "function", "message"),
    [
        ("capacity", lambda N, p: N * (1 - N), r"the slope of capacity at 0.501 N is -0.00237, must be at least 0"),
        ("excess", lambda w, p: -(w**2), r"the second derivative of excess at 1e-06 m/s is -2, must be at least 0"),
        ("excess", lambda w, p: w**3 / (1 - 1e3 * w), r"the excess or a derivative of it at 0.001 m/s is inf, must be"),
        ("excess", lambda w, p: w**3 / (1 - 777 * w), r"the second derivative of excess at 0.00\d* m/s is -"),
        (
            "excess",
            lambda w, p: ca.exp(100 * w) - 1 - 100 * w,
            r"the excess or a derivative of it at .* is inf, must be",
        ),
        ("capacity", lambda N, p: None, "got NoneType, must be a scalar expression; take ca.if_else"),
        ("capacity", lambda N: N, "got TypeError: .*; must be a scalar expression"),
        ("capacity", lambda N, p: ca.vertcat(N, N), r"got an array of shape \(2, 1\), must be a scalar"),
        ("excess", lambda w, p: w**2 if w > 1 else 0.0, "got a decision of Python on an expression, .* ca.if_else"),
        ("excess", lambda w, p: w * p["speed"], "got KeyError: 'speed'; must be"),
    ],
)
def test_functions_that_are_no_law_are_refused(name: str, function: Any, message: str) -> None:
    own = type("Own", (FrictionLaw,), {name: staticmethod(function)})
    with pytest.raises(ValueError, match=f"Own.{name}: {message}"):
        own()


@pytest.mark.parametrize(
    ("name", "function"),
    [
        ("capacity", lambda N, p: 3.0 * ca.tanh(N / 3.0)),  # level beyond: its slope is 0 but for rounding
        ("capacity", lambda N, p: N + 0.02 * (1.0 - ca.exp(-N / 0.01))),
        ("excess", lambda w, p: w**1.5),
        ("excess", lambda w, p: ca.fmax(w - 0.1, 0.0) ** 2),
        ("excess", lambda w, p: 0.0),
    ],
)
def test_functions_that_are_a_law_are_taken(name: str, function: Any) -> None:
    type("Own", (FrictionLaw,), {name: staticmethod(function)})()


def test_the_start_of_a_run_settles_whatever_the_law() -> None:
    """On uneven ground a worm comes to rest by the friction of its run."""
    heights = 0.02 * np.sin(np.arange(60))[:, None] * np.ones((60, 20))
    bumps = worm3d.Heightfield(heights, spacing=0.05, origin=(-1.0, -0.5))
    result = worm3d.simulate(Worm(), bumps, Friction(0.6, 0.6, 0.6, law="viscous"), duration=0.05)
    assert result.status is Status.DONE
    assert isinstance(result.state, State)


def test_a_law_of_ones_own_is_not_read_as_coulombs() -> None:
    """A file has no functions: without its class, the law would be Coulomb's, without a word."""
    law = Sticky()
    assert plain(law, []) == {"unknown": "Sticky"}
    with pytest.raises(ValueError, match=r"its ground has a part of the class Sticky, .* give it, worm3d\.load"):
        restored("ground", plain(Friction(law=law), []), [])
    assert restored("ground", plain(Friction(law=Viscous(3.0)), []), []).law == Viscous(3.0)
    assert hash(Viscous(3.0)) == hash(Viscous(3.0))
