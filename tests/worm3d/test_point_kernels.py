"""Kernels of a contact point: law, derivatives and regimes, against differences and against the equations."""

import numpy as np
import pytest
from kernel_states import (
    AT_REST,
    COUNT,
    across,
    assert_close,
    difference,
    differences,
    on_sphere,
    presets,
    run,
    some_point,
    with_pull_of_the_law,
)
from numpy.testing import assert_allclose

from worm3d.physics.kernels import point
from worm3d.physics.kernels import regime as regime_kernels
from worm3d.physics.kernels.point import LEDGER_TERMS
from worm3d.solver.evaluate import LOAD_ROW, PHI, STIFFNESS
from worm3d.solver.regimes import (
    EXCESS,
    NEXT,
    PREDICTED_FRICTION,
    RECENT,
    STALE,
    STATIC_EXCESS,
    SWING,
    TOUCHING_DEPTH,
    Y,
)


@pytest.mark.parametrize("inside", [False, True])
@pytest.mark.parametrize("coupled", [False, True])
def test_point_force_and_its_derivative_on_a_curved_world(coupled: bool, inside: bool) -> None:
    """The world is a ball or a hollow one, whose distance is |x - c| - R: normal and curvature turn with x.

    With a regime K is the derivative where what Newton foresaw is what the law says.
    """
    values = some_point(coupled, inside)
    own = run("point_yielding", point.POINT_LAYOUT, values | AT_REST)
    held = np.where(own[Y] < 0.0, point.STICKING_BACK, point.STICKING_FORWARD)
    held = np.where(own[EXCESS] > 0.0, point.SLIDING, held)
    values["regime"] = np.where(values["regime"] == point.STICKING_FORWARD, held, values["regime"])
    values = with_pull_of_the_law(values)

    def at(x: np.ndarray) -> np.ndarray:
        return run("point_stiffness", point.POINT_LAYOUT, values | {"x": x} | on_sphere(x, inside))

    out, h = at(values["x"]), 1e-6
    assert_allclose(
        run("point_force", point.POINT_LAYOUT, values | on_sphere(values["x"], inside)), out[:5], rtol=1e-14
    )
    K = out[STIFFNESS:].reshape(3, 3, COUNT)
    pushed = (out[LOAD_ROW] >= 0.0) | (
        not coupled
    )  # friction of what would pull is left out of K: it were a pushing spring
    assert pushed.sum() > COUNT - 5
    assert_close(K[..., pushed], differences(lambda x: at(x)[:3], values["x"], h)[..., pushed], 1e-6)
    if not coupled:
        assert_close(out[None, :3], differences(lambda x: at(x)[PHI : PHI + 1], values["x"], h), 1e-6)
    assert (np.abs(K - K.transpose(1, 0, 2)).max() > 1.0) == coupled
    yielding = run("point_yielding", point.POINT_LAYOUT, values | AT_REST)
    free, touching = values["regime"][0] == point.FREE, (out[LOAD_ROW] > 0.0)
    touching, sliding, ahead = free & touching, yielding[EXCESS] > 0.0, yielding[Y] > 0.0
    for kind in (touching & sliding & ahead, touching & sliding & ~ahead, touching & ~sliding, free & ~touching):
        assert kind.sum() >= 3, "every branch is among the states"


def test_a_regime_that_the_law_confirms_changes_nothing() -> None:
    """Newton's regimes OPEN, SLIDING and sticking give force, derivative, potential and load of the law itself."""
    values = with_pull_of_the_law(some_point(coupled=True, inside=False) | {"regime": np.full((1, COUNT), point.FREE)})
    law, yielding = (
        run("point_stiffness", point.POINT_LAYOUT, values),
        run("point_yielding", point.POINT_LAYOUT, values | AT_REST),
    )
    sticking = np.where(yielding[Y] < 0.0, point.STICKING_BACK, point.STICKING_FORWARD)
    held = np.where(yielding[EXCESS] > 0.0, point.SLIDING, sticking)
    regime = np.where(yielding[TOUCHING_DEPTH] > 0.0, held, point.OPEN)
    assert len(set(regime)) == 4
    assert_allclose(
        run("point_stiffness", point.POINT_LAYOUT, values | {"regime": regime[None]}), law, rtol=1e-12, atol=1e-12
    )
    wrong = run(
        "point_stiffness", point.POINT_LAYOUT, values | {"regime": np.where(regime == point.OPEN, 2.0, 1.0)[None]}
    )
    assert (np.abs(wrong - law).max(axis=0) > 1e-6).all(), "and one that it denies does"


def test_where_points_stay_open_nothing_of_contact_counts() -> None:
    """The kernels of mass and weight alone agree with the whole ones, and `near` names all that could change."""
    values = some_point(coupled=True, inside=False) | {"regime": np.full((1, COUNT), point.OPEN)}
    for kind in ("force", "stiffness"):
        free, whole = (run(f"point_{name}{kind}", point.POINT_LAYOUT, values) for name in ("free_", ""))
        assert_allclose(free, whole, rtol=1e-14, atol=1e-14)
    values["regime"][0, ::3] = point.SLIDING
    ahead, whole, free = (
        run(f"point_{name}", point.POINT_LAYOUT, values) for name in ("ahead", "stiffness", "free_stiffness")
    )
    assert_allclose(ahead[:STIFFNESS], whole[:STIFFNESS], rtol=1e-14, atol=1e-14)
    np.testing.assert_array_equal(ahead[STIFFNESS:], free[STIFFNESS:])
    near = run("point_near", point.POINT_LAYOUT, values)[0]
    stale = run("point_yielding", point.POINT_LAYOUT, values)[STALE]
    assert not stale[near == 0.0].any()
    assert (near == 0.0).sum() > COUNT / 10
    assert (near == 1.0)[::3].all()
    assert (stale != 0.0)[near == 1.0].any()


def test_looking_ahead_is_looking_from_there() -> None:
    """Displacement, excess and penetration at X + `first` are those seen at that place (of a plane: exactly)."""
    values = some_point(coupled=True, inside=False)
    there = values["x"] + values["first"]
    closer = values["distance"] + np.sum(values["normal"] * values["first"], axis=0)
    ahead = run("point_yielding", point.POINT_LAYOUT, values)
    seen = run("point_yielding", point.POINT_LAYOUT, values | AT_REST | {"x": there, "distance": closer})
    assert_allclose(ahead[: TOUCHING_DEPTH + 1], seen[: TOUCHING_DEPTH + 1], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("error", [0.0, 0.003])
def test_regimes_change_where_the_law_denies_them(error: float) -> None:
    """Each regime of each state, by the rules in words; what is denied by less than the error stays."""
    kinds = (point.OPEN, point.SLIDING, point.STICKING_FORWARD, point.STICKING_BACK)
    seen = set()
    for regime in kinds:
        more = {"regime": np.full((1, COUNT), regime), "error": np.full((1, COUNT), error)}
        v = some_point(coupled=True, inside=False, seed=9) | more
        v["distance"] = np.random.default_rng(3).uniform(-0.02, 0.01, (1, COUNT))
        out, now = run("point_yielding", point.POINT_LAYOUT, v), run("point_yielding", point.POINT_LAYOUT, v | AT_REST)
        f = out[PREDICTED_FRICTION : PREDICTED_FRICTION + 2] / np.array(
            [np.where(out[PREDICTED_FRICTION] > 0.0, v["mu"][0], v["mu"][1]), v["mu"][2]]
        )
        inside = np.sum(f**2, axis=0) < regime_kernels.STICK_SHARE * v["limit_ratio"][0] ** 2
        mu_n, mu = (np.where(way[Y] > 0.0, v["mu"][0], v["mu"][1]) for way in (now, out))
        back = mu_n**2 * now[Y] * out[Y] + v["mu"][2] ** 2 * now[Y + 1] * out[Y + 1] <= 0.0
        for k in range(COUNT):
            side = point.STICKING_FORWARD if out[Y, k] >= 0.0 else point.STICKING_BACK
            if regime == point.OPEN:
                slides = out[EXCESS, k] > error and not back[k]
                expected = (point.SLIDING if slides else side) if out[TOUCHING_DEPTH, k] > error else point.OPEN
            elif out[TOUCHING_DEPTH, k] < -error:
                expected = point.OPEN
            elif regime == point.SLIDING:
                expected = side if out[EXCESS, k] < -error or inside[k] else point.SLIDING
            elif regime != side and abs(out[Y, k]) > error and mu[k] > 0.0:
                expected = side
            else:
                expected = point.SLIDING if out[EXCESS, k] > error else regime
            assert out[NEXT, k] == expected, (k, regime, side)
            changed = expected != regime or (regime == point.SLIDING and out[SWING, k] > regime_kernels.MAX_SWING)
            assert out[STALE, k] == changed
            seen.add((regime, expected))
    assert len(seen) > 10, seen


def displaced(y: np.ndarray, regime: float, error: float, **more: np.ndarray) -> dict[str, np.ndarray]:
    """Return pressed points at a displacement y from s*, shape (2, COUNT), in units in which 1 is the yield surface.

    y is given in the gauge of hard contacts, H mu y over c_0 r.
    """
    v = some_point(coupled=True, inside=False, seed=17) | AT_REST
    v |= {"regime": np.full((1, COUNT), regime), "error": np.full((1, COUNT), error)} | more
    v["hardness"] = np.random.default_rng(18).uniform(1.0, 2.0, (3, COUNT))
    v["distance"] = -np.abs(v["distance"]) - 0.01
    e = v["mu"] * v["hardness"]
    y = y * (v["limit_ratio"] * v["r"])[0] / np.array([np.where(y[0] > 0.0, e[0], e[1]), e[2]])
    s = v["centre"] + y
    return v | {"anchor": v["x"] - s[0] * v["tangent"][:3] - s[1] * v["tangent"][3:]}


def test_what_is_as_good_as_at_its_static_limit_breaks_away() -> None:
    """(C6): within a billionth of the limit in the gauge eta, and not before, in any direction."""
    angle = np.linspace(-3.0, 3.0, COUNT)
    for share in (0.5, 1.0 - 2e-9, 1.0 - 0.5e-9, 1.0, 1.5):
        v = displaced(share * np.array([np.cos(angle), np.sin(angle)]), point.STICKING_FORWARD, 0.0)
        out, limit = run("point_yielding", point.POINT_LAYOUT, v), (v["limit_ratio"] * v["r"])[0]
        assert ((out[STATIC_EXCESS] > 0.0) == (share > 1.0 - 1e-9)).all()
        assert_allclose(out[STATIC_EXCESS], (share - 1.0) * limit, rtol=1e-6, atol=2e-9 * limit.max())


def test_the_last_change_of_a_contact_is_its_step_in_its_gauge_and_the_error() -> None:
    angle = np.linspace(-3.0, 3.0, COUNT)
    v = displaced(0.7 * np.array([np.cos(angle), np.sin(angle)]), point.STICKING_FORWARD, 2e-4)
    v["first"] = np.random.default_rng(19).uniform(-1e-4, 1e-4, (3, COUNT))
    out, e = run("point_yielding", point.POINT_LAYOUT, v), v["mu"] * v["hardness"]
    dy = np.array([np.sum(way * v["first"], axis=0) for way in (v["tangent"][:3], v["tangent"][3:])])
    moved = np.hypot(np.where(out[Y] > 0.0, e[0], e[1]) * dy[0], e[2] * dy[1])
    assert_allclose(out[RECENT], moved + e.max(axis=0) * 2e-4, rtol=1e-9)


@pytest.mark.parametrize("regime", [point.STICKING_FORWARD, point.STICKING_BACK])
def test_a_stuck_contact_slides_far_beyond_its_limit_whatever_the_error(regime: float) -> None:
    """Up to there it sticks as long as the error may be to blame."""
    angle = np.linspace(-3.0, 3.0, COUNT)
    for share in (0.9, 2.9, 3.1):
        v = displaced(share * np.array([np.cos(angle), np.sin(angle)]), regime, 1.0, breaks=np.full((1, COUNT), 9.0))
        found = run("point_yielding", point.POINT_LAYOUT, v)[NEXT]
        assert (found == (point.SLIDING if share > 3.0 else regime)).all()


def test_a_stuck_contact_takes_the_other_side_once_it_is_there_by_more_than_rounding() -> None:
    """Coefficients forward and backward differ: that of the side counts, from a ten millionth of the limit on."""
    regimes = point.STICKING_FORWARD, point.STICKING_BACK
    for regime, other, way in ((*regimes, -1.0), (*regimes[::-1], 1.0)):
        for share, turns in ((-0.5, False), (0.5e-7, False), (2e-7, True), (0.5, True)):
            y = np.array([np.full(COUNT, way * share), np.full(COUNT, 0.1)])
            v = displaced(y, regime, 0.0)
            assert (run("point_yielding", point.POINT_LAYOUT, v)[NEXT] == (other if turns else regime)).all()
            v["mu"][1], v["hardness"][1] = v["mu"][0], v["hardness"][0]
            assert (run("point_yielding", point.POINT_LAYOUT, v)[NEXT] != other).all(), "both sides are alike"


def test_a_contact_is_expected_to_go_on_as_in_its_last_steps() -> None:
    """Each regime of each state, by the rules in words: what lifts, breaks away, turns or lands by its trend."""
    seen = set()
    for regime in (point.OPEN, point.SLIDING, point.STICKING_FORWARD, point.STICKING_BACK):
        v = some_point(coupled=True, inside=False, seed=5) | {"regime": np.full((1, COUNT), regime)}
        v["load_m"] = np.where(np.arange(COUNT) % 5 == 0, 0.0, 2.2 * v["load_m"])
        v["distance"] = np.random.default_rng(6).uniform(-0.02, 0.02, (1, COUNT))
        out, along = run("point_expected", point.POINT_LAYOUT, v), v["tangent"].reshape(2, 3, COUNT)
        y = np.einsum("idk,dk->ik", along, v["x"] + v["first"] - v["anchor"]) - v["centre"]
        trend = 2.0 * v["pull"] - v["pull_m"]
        mu, mu_of_trend = (np.vstack([np.where(x[0] > 0.0, *v["mu"][:2]), v["mu"][2]]) for x in (y, trend))
        rho, share = np.hypot(*(mu * y)), np.hypot(*(trend / mu_of_trend))
        touching = -v["distance"][0] - v["carried"][0] - np.sum(v["normal"] * v["first"], axis=0)
        for k in range(COUNT):
            c_0, known, pull, load, expected = (
                v["limit_ratio"][0, k],
                v["load_m"][0, k] > 0.0,
                v["pull"][:, k],
                None,
                regime,
            )
            against = c_0 * mu[:, k] ** 2 * y[:, k] / max(rho[k], c_0 * v["r"][0, k])
            if regime == point.OPEN and touching[k] > 0.0:
                expected, pull, load = point.SLIDING, against, v["stiff"][0, k] * v["error"][0, k]
            elif regime >= point.STICKING_FORWARD and known and share[k] > c_0:
                expected, pull = point.SLIDING, trend[:, k] * c_0 / share[k]
            elif regime == point.SLIDING and rho[k] > c_0 * v["r"][0, k] and y[:, k] @ pull < 0.0:
                pull = against
            if regime != point.OPEN and known and 2.0 * v["load_n"][0, k] < v["load_m"][0, k]:
                expected = point.OPEN
            assert_allclose(out[:2, k], pull, rtol=1e-9, atol=1e-12)
            assert out[2, k] == pytest.approx(v["load_n"][0, k] if load is None else load)
            assert out[3, k] == expected, (k, regime)
            seen.add((regime, expected))
    assert len(seen) == 10, seen


def test_newtons_own_friction_is_that_of_its_linear_equation() -> None:
    """(C5) against (C3): m f = c_0 M^2 y, made linear in f and y, holds for f' and y + dy; f' is inside the set."""
    v = some_point(coupled=True, inside=False, seed=8) | {"regime": np.full((1, COUNT), point.SLIDING)}
    out, now = run("point_yielding", point.POINT_LAYOUT, v), run("point_yielding", point.POINT_LAYOUT, v | AT_REST)
    y, dy, f, c_0 = now[Y : Y + 2], out[Y : Y + 2] - now[Y : Y + 2], v["pull"], v["limit_ratio"][0]
    mu = np.array([np.where(y[0] > 0.0, v["mu"][0], v["mu"][1]), v["mu"][2]])
    limit = c_0 / (1.0 / v["yield_gauge"][0] + v["gauge_damping"][0] / v["dt"][0])

    def m(at: np.ndarray) -> np.ndarray:
        return np.maximum(limit, np.hypot(*(mu * at)))

    h = 1e-6
    slope = (m(y + h * dy) - m(y - h * dy)) / (2.0 * h)  # of m along dy
    expected = (c_0 * mu**2 * (y + dy) - f * slope) / m(y)
    of = np.array([np.where(expected[0] > 0.0, v["mu"][0], v["mu"][1]), v["mu"][2]])
    size = np.hypot(*(expected / of))
    sliding = m(y) > limit
    assert 5 < sliding.sum() < COUNT - 5
    assert 5 < (size > c_0).sum() < COUNT - 5
    assert_allclose(
        out[PREDICTED_FRICTION : PREDICTED_FRICTION + 2], expected * np.minimum(1.0, c_0 / size), rtol=1e-7, atol=1e-9
    )
    assert_allclose(out[SWING], np.sum((mu * dy) ** 2, axis=0) / m(y) ** 2, rtol=1e-12)
    force = run("point_force", point.POINT_LAYOUT, with_pull_of_the_law(v))[:3]
    without = run("point_force", point.POINT_LAYOUT, v | {"hold": np.zeros((1, COUNT))})[:3]
    load = run("point_force", point.POINT_LAYOUT, v)[LOAD_ROW]
    own = with_pull_of_the_law(v)["pull"]
    friction = v["hold"][0] * load * (own[0] * v["tangent"][:3] + own[1] * v["tangent"][3:])
    assert_allclose(force - without, friction, rtol=0, atol=1e-12)


def test_point_force_is_that_of_the_equations() -> None:
    """(C1), (C2) and (C3) with (C4): the force of the anchor's spring and damper, both capped together by the load."""
    v = some_point(coupled=True, inside=False, seed=6) | {"regime": np.full((1, COUNT), point.FREE)}
    g, n, k, c, dt = v["distance"][0], v["normal"], v["stiffness"][0], v["damping"][0], v["dt"][0]
    load = np.maximum(0.0, k * -g + c / dt * (-g - v["depth_n"][0]))
    along, left = v["tangent"][:3], v["tangent"][3:]
    s = np.array([np.sum(t * (v["x"] - v["anchor"]), axis=0) for t in (along, left)])
    per_rho, per_rate = 1 / v["yield_gauge"][0], v["gauge_damping"][0] / dt
    y = s - per_rate * v["slide_n"] / (per_rho + per_rate)
    mu = np.array([np.where(y[0] > 0.0, v["mu"][0], v["mu"][1]), v["mu"][2]])
    elastic = per_rho * s + per_rate * (s - v["slide_n"])  # spring and damper in the gauge
    gauge = np.sqrt(np.sum((mu * elastic) ** 2, axis=0))
    share = np.minimum(1.0, v["limit_ratio"][0] / gauge)
    force = v["hold"][0] * load * share * mu**2 * elastic
    expected = v["inertia"] * (v["x"] - v["x_hat"]) - v["weight"] - load * n + force[0] * along + force[1] * left
    out = run("point_force", point.POINT_LAYOUT, v)
    assert_allclose(out[LOAD_ROW], load, rtol=1e-12)
    assert_allclose(out[:3], expected, rtol=0, atol=1e-12)
    friction = np.sqrt(np.sum((force / (mu * np.where(load > 0, v["hold"][0] * load, 1.0))) ** 2, axis=0))
    assert (friction <= v["limit_ratio"][0] * (1 + 1e-12)).all(), "inside the set"
    assert ((share < 1.0) & (load > 0.0)).sum() > 3


def test_tangents_are_the_segment_projected_and_its_left() -> None:
    """Orthonormal, in the tangent plane, along the segment; where that stands upright, along its upward normal."""
    v = some_point(coupled=True, inside=False, seed=11)
    upright = np.arange(COUNT) % 4 == 0
    v["segment_tangent"] = np.where(upright, v["normal"], v["segment_tangent"])
    v["segment_director"] = across(v["segment_tangent"], np.random.default_rng(3))
    out = run("point_start", point.POINT_LAYOUT, v)[:8]
    along, left = out[:3], out[3:6]
    pointing = np.where(upright, np.cross(v["segment_tangent"], v["segment_director"], axis=0), v["segment_tangent"])
    for a, b, expected in ((along, along, 1.0), (left, left, 1.0), (along, left, 0.0), (along, v["normal"], 0.0)):
        assert_allclose(np.sum(a * b, axis=0), expected, rtol=0, atol=1e-12)
    assert_allclose(np.cross(v["normal"], along, axis=0), left, rtol=0, atol=1e-12)
    assert (np.sum(along * pointing, axis=0) > 0.0).all(), "towards the head"
    assert_allclose(np.sum(left * pointing, axis=0), 0.0, rtol=0, atol=1e-12)
    away = v["x"] - v["anchor"]
    assert_allclose(out[6:], [np.sum(along * away, axis=0), np.sum(left * away, axis=0)], rtol=0, atol=1e-13)


def test_start_of_a_step_is_that_of_the_equations() -> None:
    """Presets of contact, friction and inertia; a point that approaches sinks in by -v.n dt less its gap."""
    v = some_point(coupled=True, inside=False, seed=12)
    v["stiffness"][0, :4] = 0.0
    out, layout = run("point_start", point.POINT_LAYOUT, v), point.POINT_LAYOUT
    found = {name: out[layout.first(name) - layout.first("tangent") :][: layout.sizes[name]] for name in layout.sizes}
    v |= {"slide_n": found["slide_n"], "depth_n": np.maximum(0.0, -v["distance"])}
    speed = difference(v, found["x_hat"], v["past"])
    closing = -np.sum(v["velocity"][:3] * v["normal"], axis=0)
    strikes = (closing > 0.0) & (v["stiffness"][0] > 0.0)
    assert 5 < strikes.sum() < COUNT - 5
    expected = presets(v) | {
        "inertia": v["mass"] / v["span"] ** 2,
        "depth_n": v["depth_n"],
        "distance_n": v["distance"],
        "hold": v["grip"],
        "load": v["load_n"],
        "deep": np.where(strikes, closing * v["dt"] - np.maximum(0.0, v["distance"]), 0.0),
    }
    for name, value in expected.items():
        assert_allclose(found[name], value, rtol=1e-13, atol=1e-16, err_msg=name)
    assert_allclose(difference(v, speed, v["velocity"]), 0.0, rtol=0, atol=1e-9)  # no acceleration


def test_an_anchor_on_its_yield_surface_stays_but_for_more_than_rounding() -> None:
    """(C4): beyond the surface by half of the tolerance of 1e-9 it does not slip, by twice as much it does."""
    v = some_point(coupled=True, inside=False, seed=13) | {"regime": np.full((1, COUNT), point.FREE)}
    v["distance"] = -np.abs(v["distance"]) - 0.01
    direction = np.random.default_rng(14).standard_normal((2, COUNT))
    mu = np.array([np.where(direction[0] > 0.0, *v["mu"][:2]), v["mu"][2]])
    surface = direction * v["limit_ratio"] * v["r"] / np.hypot(*(mu * direction))
    for excess, slips in ((0.5e-9, False), (2e-9, True)):
        s = v["centre"] + surface * (1.0 + excess)
        v["anchor"] = v["x"] - s[0] * v["tangent"][:3] - s[1] * v["tangent"][3:]
        slipped = run("point_after", point.POINT_LAYOUT, v)[point.AFTER.first("slipped")]
        assert ((slipped > 0.0) == slips).all()


def test_friction_loses_the_gauge_of_the_slip_times_the_limit() -> None:
    """(C2) and (C4): load, limit and rho of what the anchor slips, whatever the hardness; nothing where it holds."""
    v = some_point(coupled=True, inside=False, seed=6) | {"regime": np.full((1, COUNT), point.FREE)}
    v["hardness"] = np.random.default_rng(7).uniform(0.5, 1.0, v["hardness"].shape)
    out, first, load = (
        run("point_after", point.POINT_LAYOUT, v),
        point.AFTER.first,
        run("point_force", point.POINT_LAYOUT, v)[LOAD_ROW],
    )
    moved = out[first("anchor") : first("anchor") + 3] - v["anchor"]
    slip = np.array([np.sum(way * moved, axis=0) for way in (v["tangent"][:3], v["tangent"][3:])])
    mu = np.array([np.where(slip[0] > 0.0, v["mu"][0], v["mu"][1]), v["mu"][2]])
    touched = v["load_n"][0] > 0.0
    loss = out[first("terms") + LEDGER_TERMS.index("friction_loss")]
    expected = v["hold"][0] * load * v["limit_ratio"][0] * np.hypot(*(mu * slip))
    assert_allclose(loss[touched], expected[touched], rtol=1e-9, atol=1e-14)
    assert_allclose(out[first("slipped"), touched], np.hypot(*slip)[touched], rtol=1e-9, atol=1e-14)
    assert 3 < (loss[touched] > 1e-9).sum() < touched.sum()


def after(values: dict[str, np.ndarray]) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Return the outputs of `point.after` by name, and the terms of contact and friction in its ledger, less inertia's.

    Inertia's terms are those of a point that touches nothing.
    """
    out, first = run("point_after", point.POINT_LAYOUT, values), point.AFTER.first
    found = {name: out[first(name) : first(name) + size].squeeze() for name, size in point.AFTER.sizes.items()}
    of_inertia = run("point_free_after", point.POINT_LAYOUT, values)[: len(LEDGER_TERMS)]
    return found, dict(zip(LEDGER_TERMS, found["terms"] - of_inertia, strict=True))


def pressed(seed: int) -> dict[str, np.ndarray]:
    """Return points of which some are pressed into the world, with their own load as that of the end of the step."""
    v = some_point(coupled=True, inside=False, seed=seed) | {"regime": np.full((1, COUNT), point.FREE)}
    v["load_n"] = run("point_force", point.POINT_LAYOUT, v)[LOAD_ROW][None]
    assert 5 < (v["load_n"] > 0.0).sum() < COUNT - 5
    return v


def test_the_stored_terms_of_a_contact_are_the_change_of_what_its_springs_hold() -> None:
    """Penetration: k d^2/2, d = max(0, -g). Anchor: from the energy before to the energy that the next step finds.

    `load_change` is what the load alone changes of the energy: all of it where the spring keeps its length.
    """
    v = pressed(21)
    (found, terms), touches = after(v), v["load_n"][0] > 0.0
    depth = np.maximum(0.0, -v["distance"])
    risen = (0.5 * v["stiffness"] * (depth**2 - v["depth_n"] ** 2))[0]
    assert_allclose(terms["penetration"], risen, rtol=1e-9, atol=1e-15)
    assert risen.min() < -1e-4 < 1e-4 < risen.max()
    gained = found["stored"] - v["stored_n"][0]
    assert_allclose(terms["anchor"][touches], gained[touches], rtol=1e-9, atol=1e-15)
    limit = (v["limit_ratio"] * v["r"])[0]
    still = v | {"past": np.tile(v["x"], (2, 1)), "slide_n": np.vstack([0.1 * limit, 0.1 * limit])}
    still |= {"anchor": v["x"] - 0.1 * limit * (v["tangent"][:3] + v["tangent"][3:]), "centre": np.zeros((2, COUNT))}
    found, terms = after(still)
    assert_allclose(terms["load_change"][touches], (found["stored"] - v["stored_n"][0])[touches], rtol=1e-9)
    energy = v["hold"] * v["load_n"] * np.sum(v["mu"][[0, 2]] ** 2, axis=0) * (0.1 * limit) ** 2
    assert_allclose(found["stored"][touches], (energy / (2.0 * v["yield_gauge"]))[0, touches], rtol=1e-9)


def test_what_the_world_does_in_a_step_is_stored_or_lost() -> None:
    """The terms of contact and friction together are the work of their force over the motion to first order.

    `load_change` is no work, and `work_friction_p13` is the work over the whole motion.
    """
    v = pressed(22)
    _, terms = after(v)
    names = ("penetration", "anchor", "viscous_loss", "friction_loss", "impact", "numerical_loss")
    spent = sum(terms[name] for name in names) - terms["load_change"]
    load, normal = v["load_n"], v["normal"]
    force = run("point_free_force", point.POINT_LAYOUT, v)[:3] - run("point_force", point.POINT_LAYOUT, v)[:3]
    assert_allclose(spent, -np.sum(force * v["first"], axis=0), rtol=0, atol=1e-12)
    friction, moved = force - load * normal, v["x"] - v["past"][:3]
    assert_allclose(terms["work_friction_p13"], np.sum(friction * moved, axis=0), rtol=0, atol=1e-12)
    assert (np.abs(terms["work_friction_p13"]) > 1e-4).sum() > 5


def test_the_damper_beside_an_anchor_loses_its_force_over_the_way_of_the_spring() -> None:
    """D/dt m^2 (s - s_n)^2 per unit of the capacity where the contact sticks; the spring itself loses nothing."""
    v = pressed(25)
    v["mu"][1], v["anchor"] = v["mu"][0], v["x"] - 1e-4 * v["tangent"][:3] - 1e-4 * v["tangent"][3:]
    v["past"][:3] = v["x"] - 3e-4 * v["tangent"][:3] + 2e-4 * v["tangent"][3:]
    away = v["past"][:3] - v["anchor"]
    v["slide_n"] = np.array([np.sum(way * away, axis=0) for way in (v["tangent"][:3], v["tangent"][3:])])
    found, terms = after(v | presets(v))
    stretch = v["mu"][[0, 2]] * np.array([[3e-4], [-2e-4]])
    lost = (v["hold"] * v["load_n"] * v["gauge_damping"] / v["dt"])[0] * np.sum(stretch**2, axis=0)
    holds = (v["load_n"][0] > 0.0) & (found["slipped"] == 0.0)
    assert holds.sum() > 5
    assert_allclose(terms["viscous_loss"][holds], lost[holds], rtol=1e-9)


def test_an_impact_takes_what_the_load_does_over_the_mean_motion_and_a_damper_what_it_does_over_the_way() -> None:
    """Where a point lands the force works over the mean of both velocities; elsewhere the damper over the distance."""
    v = pressed(23)
    (found, terms), lands, load = after(v), v["lands"][0] > 0, v["load_n"][0]
    mean, moved = 0.5 * v["dt"] * (found["velocity"] + v["velocity"][:3]), v["x"] - v["past"][:3]
    force = run("point_free_force", point.POINT_LAYOUT, v)[:3] - run("point_force", point.POINT_LAYOUT, v)[:3]
    friction = force - load * v["normal"]
    of_landing = -np.sum(force * mean, axis=0) + np.sum(friction * moved, axis=0) - terms["penetration"]
    spring = v["stiffness"][0] * np.maximum(0.0, -v["distance"][0])
    of_damper = (load - spring) * (v["distance_n"] - v["distance"])[0]
    assert_allclose(terms["impact"], np.where(lands, of_landing, of_damper), rtol=1e-9, atol=1e-13)
    assert ((load > 0.0) & lands).sum() > 3
    assert ((load > 0.0) & ~lands).sum() > 3


@pytest.mark.parametrize("way", [(0, 0), (1, 0), (-1, 0), (0, 1), (0, -1), (1, 1)])
def test_an_anchor_follows_a_contact_that_slips_along_or_aside_and_holds_one_that_does_not(
    way: tuple[int, int],
) -> None:
    """(C4): what is left of the displacement points as before, on the yield surface; a contact that slips is not stuck.

    A displacement along one tangent alone slips along that one alone.
    """
    v = pressed(24)
    v |= {
        name: np.zeros((size, COUNT)) for name, size in (("slide_n", 2), ("centre", 2), ("depth_n", 1), ("carried", 1))
    }
    v |= {"tangent": np.repeat(np.eye(3)[:2].reshape(6, 1), COUNT, axis=1), "anchor": np.zeros((3, COUNT))}
    away = 0.1 * np.repeat([[way[0]], [way[1]], [0.0]], COUNT, axis=1)
    v |= {"x": away, "distance": np.full((1, COUNT), -0.03), "load_n": np.ones((1, COUNT))}
    found, _ = after(v)
    slips = way != (0, 0)
    assert (found["stuck"] == (not slips)).all()
    assert ((found["slipped"] > 0.0) == slips).all()
    left = away - found["anchor"]
    assert_allclose(left[2], 0.0)
    assert_allclose(left[0] * way[1], left[1] * way[0])
    gauge = np.hypot(np.where(left[0] > 0.0, v["mu"][0], v["mu"][1]) * left[0], v["mu"][2] * left[1])
    assert_allclose(gauge, slips * (v["limit_ratio"] * v["r"])[0], rtol=1e-9)
    assert (np.sum(left * away, axis=0) > 0.0).all() == slips
    apart, _ = after(v | {"load_n": np.zeros((1, COUNT))})
    assert (apart["stuck"] == 1.0).all(), "the anchor of what touches nothing lies under the point"
    assert_allclose(apart["anchor"], away)
    assert (apart["stored"] == 0.0).all()
