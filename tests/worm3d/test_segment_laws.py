"""Segment laws: kernels against finite differences and closed forms, the ledger, the domain, and files of laws."""

import json
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import learned_laws
import numpy as np
import pytest
from kernel_states import COUNT, Values, assert_close, differences, evaluated, some_segment
from numpy.testing import assert_allclose, assert_array_equal
from scipy.integrate import cumulative_trapezoid

import worm3d
from control.gaits import TravellingWave
from planar import linkage
from worm3d import Friction, Hydrostat, Jenkins, Learned, Plane, Pneumatic, Rhombus, State, Status, Worm, load, simulate
from worm3d.measures import reasons
from worm3d.physics.actuators import FirstOrder
from worm3d.physics.hysteresis import Hysteresis
from worm3d.physics.kernels import actuator, segment
from worm3d.results.pictures import frames_of
from worm3d.running.plant import kernels
from worm3d.solver import guard
from worm3d.viewer import pieces

CONTENT = learned_laws.law()
WEIGHTS = CONTENT["energy"]["weights"]


@pytest.fixture(scope="module")
def law(tmp_path_factory: pytest.TempPathFactory) -> Learned:
    return Learned(str(learned_laws.written(tmp_path_factory.mktemp("laws"), CONTENT)))


def some_states(kind: type[worm3d.SegmentLaw], content: dict[str, Any] = CONTENT, seed: int = 0) -> Values:
    """Return segments in general position with the inputs of a law, of a worm like the default worm."""
    scales = [content["scales"][name] for name in learned_laws.SCALES]
    own = {
        "energy": content["energy"]["weights"],
        "radius": content["radius"]["weights"],
        "bending": content["bending_Nm"],
        "scales": scales,
        "rest_height": [0.05],
    }
    values = some_segment(seed)
    for name, size in actuator.chambers(FirstOrder, Hysteresis, kind).sizes.items():
        if name not in values:
            given = own.get(name.removeprefix(segment.SEGMENT_LAW_PREFIX), [0.0] * size)
            values[name] = np.tile(np.array(given, dtype=float)[:, None], COUNT)
    return values


def run(kind: type[worm3d.SegmentLaw], name: str, values: Values) -> np.ndarray:
    """Return the outputs of a kernel of a segment for inputs by name, shape (rows, COUNT)."""
    of_actuator = name in ("segment_gradient", "segment_hessian")
    layout = actuator.chambers(FirstOrder, Hysteresis, kind) if of_actuator else segment.layout(kind)
    return evaluated(kernels(segment_law=kind)[name], layout, {each: values[each] for each in layout.sizes})


KINDS = pytest.mark.parametrize("kind", [Learned, Hydrostat])


@KINDS
def test_gradient_and_hessian_are_derivatives(kind: type[worm3d.SegmentLaw]) -> None:
    """As `test_kernel_derivatives.test_segment_gradient_and_hessian`, whose explanation also holds here."""
    foreseen = some_states(kind)
    values = foreseen | {"f_ahead": foreseen["f"]}
    x0 = run(kind, "segment_shape", values)[8:]

    def potential(q: np.ndarray) -> np.ndarray:
        x = run(kind, "segment_shape", values | {"q": q})[8:]
        return run(kind, "segment_gradient", values | {"q": q})[:1] + np.sum(values["f"] * x, axis=0)

    def gradient(q: np.ndarray) -> np.ndarray:
        x = run(kind, "segment_shape", values | {"q": q})[8:]
        f = values["f"] + np.tile(values["K"][:8], (3, 1)) * (x - x0)
        return run(kind, "segment_gradient", values | {"q": q, "f": f})[1:]

    out = run(kind, "segment_hessian", values)
    assert_close(out[None, 1:9], differences(potential, values["q"], 1e-4), 1e-8)
    hessian = out[9:].reshape(8, 8, COUNT)
    assert_close(hessian, differences(gradient, values["q"], 1e-4), 1e-8)
    assert_array_equal(hessian, hessian.transpose(1, 0, 2))


@KINDS
def test_points_move_with_the_coordinates_and_with_the_command(kind: type[worm3d.SegmentLaw]) -> None:
    values = some_states(kind, seed=2)

    def points(changed: str, at: np.ndarray) -> np.ndarray:
        return run(kind, "segment_shape", values | {changed: at})[8:]

    of_q = differences(partial(points, "q"), values["q"], 1e-4)
    found = run(kind, "segment_jacobian", values).reshape(8, 3, 8, COUNT)
    assert_allclose(found, of_q.reshape(3, 8, 8, COUNT).transpose(1, 0, 2, 3), rtol=0, atol=1e-10)
    moved = np.einsum("mnk,nk->mk", of_q, values["dq"])
    assert_allclose(run(kind, "segment_motion", values), moved, rtol=0, atol=1e-11)
    of_command = differences(partial(points, "commanded"), values["commanded"], 1e-4)
    by_command = np.einsum("mnk,nk->mk", of_command, values["commanded"] - values["commanded_n"])
    assert_allclose(run(kind, "segment_ledger", values)[8:], moved + by_command, rtol=0, atol=1e-10)
    assert (np.abs(by_command).max() > 1e-4) == (kind is Learned)


def chambers_of(values: Values) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return length and bend of the segments, and the lengths of the chambers (2, COUNT)."""
    length, bend = np.linalg.norm(values["q"][5:] - values["q"][:3], axis=0), values["q"][4]
    return length, bend, length + np.array([[-1.0], [1.0]]) * values["offset"] * bend


NO_DAMPERS = {"tau": np.zeros((1, COUNT)), "roll_damping": np.zeros((1, COUNT)), "force": np.zeros((2, COUNT))}


def test_energy_and_radius_are_those_of_the_file() -> None:
    values = some_states(Learned, seed=3) | NO_DAMPERS
    same = {"l0": learned_laws.L0, "k": learned_laws.K, "offset": learned_laws.B}
    values |= {name: np.full((1, COUNT), value) for name, value in same.items()}
    length, bend, lengths = chambers_of(values)
    contraction = 1.0 - values["commanded"] / learned_laws.L0
    energy, radius = learned_laws.evaluated(CONTENT, lengths.ravel(), contraction.ravel())
    m = learned_laws.bending_stiffness(CONTENT, length, contraction.mean(axis=0))
    expected = energy.reshape(2, COUNT).sum(axis=0) + m * bend**2 / 2.0
    assert_allclose(run(Learned, "segment_gradient", values)[0], expected, rtol=1e-12)
    points = run(Learned, "segment_shape", values)[8:].reshape(3, 8, COUNT)
    middle = (values["q"][:3] + values["q"][5:]) / 2.0
    away = np.linalg.norm(points - middle[:, None], axis=0)[:6]  # all apexes of a chamber lie on a circle
    assert_allclose(away, np.repeat(radius.reshape(2, COUNT), 3, axis=0), rtol=1e-12)


def test_without_a_network_the_spring_is_that_of_the_rhombus() -> None:
    values = some_states(Learned, learned_laws.without_network(CONTENT), seed=4) | {"k_apex": np.zeros((1, COUNT))}
    found, expected = (run(kind, "segment_gradient", values) for kind in (Learned, Rhombus))
    assert_allclose(found[0], expected[0], rtol=1e-14)


def test_the_hydrostat_is_a_cylinder_of_constant_volume() -> None:
    worm = Worm(segment=Hydrostat(), half_height=np.linspace(0.04, 0.06, 6))
    length = worm.l0 * np.linspace(0.4, 1.6, 50) * np.ones((6, 1))
    height, outward = worm.segment.outlines(worm, length, np.zeros((6, 50)))
    volume = np.pi * height**2 * length
    assert_allclose(volume, np.pi * worm.half_height[:, None] ** 2 * worm.l0 * np.ones((1, 50)), rtol=1e-15)
    assert_allclose(outward, worm.chamber_offset + height, rtol=1e-15)


WAVE = TravellingWave(amplitude=0.25)
GROUND = Friction(0.1, 0.5, 0.4)


def crawl(segment_law: worm3d.SegmentLaw, dt: float = 0.01, mass: float = 0.1, **changes: Any) -> worm3d.Result:
    """Return a crawl on a plane, which must reach its end."""
    given: dict[str, Any] = {"actuation": WAVE, "duration": 4.0, "dt": dt} | changes
    result = simulate(Worm(segment=segment_law, mass=mass), Plane(), GROUND, **given)
    assert result.status is Status.DONE, result.stop.sentence
    return result


def test_a_hydrostat_crawls_with_constant_volume_and_a_closed_ledger() -> None:
    result = crawl(Hydrostat())
    assert result.distance > 0.2
    assert result.energy.balance_error < 1e-12
    apexes = result.apexes
    height = np.linalg.norm(apexes[:, :, 1::3] - apexes[:, :, 0::3], axis=3) / 2.0
    volume = np.pi * height**2 * result.chamber_length
    assert_allclose(volume, np.pi * 0.05**2 / 6.0, rtol=1e-13)


@pytest.mark.parametrize("integrator", ["bdf2", "implicit_euler"])
def test_the_command_does_work_on_the_points_that_it_moves(law: Learned, integrator: str) -> None:
    """Unless this work is booked, it is numerical loss: -7 to -8 % of the work of this worm, at any time step."""
    coarse, fine = (crawl(law, dt, mass=0.4, integrator=integrator).energy for dt in (0.01, 0.005))
    assert coarse.balance_error < 1e-12
    most = {"bdf2": 0.01, "implicit_euler": 0.03}[integrator]
    shares = [each.numerical_loss.sum() / each.work_contract.sum() for each in (coarse, fine)]
    assert 0.0 < shares[1] < 0.8 * shares[0] < most


def test_the_distance_converges_with_the_time_step(law: Learned) -> None:
    far = [crawl(law, dt).distance for dt in (0.02, 0.01, 0.005, 0.0025)]
    assert abs(far[3] - far[2]) < 0.01 * far[3]
    assert abs(far[3] - far[2]) < 0.7 * abs(far[1] - far[0])


def test_turning_and_slopes_close_the_ledger(law: Learned) -> None:
    wave = TravellingWave(amplitude=0.2, bias=0.4, hinge=0.3)
    for world in (Plane(0.1, 0.7), None):
        result = simulate(Worm(segment=law), world, GROUND, actuation=wave, duration=2.0)
        assert result.status is Status.DONE
        assert result.energy.balance_error < 1e-12


def test_a_law_without_network_or_radius_is_a_worm_with_other_apexes(law: Learned, tmp_path: Path) -> None:
    """In the air and without apex masses, the law without network is the default worm."""
    content = learned_laws.without_network(CONTENT)
    bare = Learned(str(learned_laws.written(tmp_path, content)))
    more = {"actuation": TravellingWave(amplitude=0.2, bias=0.3), "duration": 1.0, "gravity": (0, 0, 0)}
    light = {"joint_mass_fraction": 1.0, "outward_apexes": True, "stroke": (0.0, 0.45)}
    found, expected = (simulate(Worm(segment=each, **light), None, **more) for each in (bare, Rhombus()))
    assert_allclose(found.joints, expected.joints, rtol=0, atol=1e-9)
    assert np.ptp(found.bend) > 0.05


def test_a_run_stops_outside_the_domain(law: Learned) -> None:
    worm = Worm(segment=law, stroke=(-0.1, 0.6))
    result = simulate(worm, Plane(), GROUND, actuation=TravellingWave(amplitude=0.58), duration=2.0)
    assert result.status is Status.OUTSIDE
    assert result.status.diverged
    assert "chamber of segment" in result.stop.sentence
    assert "must be from" in result.stop.sentence
    pull = np.zeros((7, 3))
    pull[0, 0], pull[-1, 0] = -20.0, 20.0
    result = simulate(Worm(segment=law), None, external_force=lambda t: pull, duration=2.0, gravity=(0, 0, 0))
    assert result.status is Status.OUTSIDE
    assert "chamber of segment" in result.stop.sentence


HEIGHTS = (1.2, 1.15, 1.0)
"""Greatest lengths at the contractions 0, 0.225 and 0.45, over the rest length."""


def with_region(content: dict[str, Any]) -> dict[str, Any]:
    """Return a law whose greatest length falls with the contraction, first slowly and then quickly."""
    region = {"shortest_m": [0.5 * learned_laws.L0] * 3, "longest_m": [h * learned_laws.L0 for h in HEIGHTS]}
    return {**content, "domain": {**content["domain"], **region}}


def pulled(segment_law: worm3d.SegmentLaw, contraction: float) -> worm3d.Result:
    """Return a run in the air with all chambers contracted and a pull that grows."""
    pull = np.zeros((7, 3))
    pull[0, 0], pull[-1, 0] = -30.0, 30.0
    worm = Worm(segment=segment_law, stroke=(0.0, learned_laws.MOST))
    command = worm3d.Command(np.full((6, 2), contraction))
    start = State.straight(worm, None, contraction=contraction)
    more = {"external_force": lambda t: t * pull, "duration": 2.0, "gravity": (0, 0, 0)}
    return simulate(worm, None, state=start, actuation=lambda t: command, **more)


def test_the_greatest_length_depends_on_the_contraction(law: Learned, tmp_path: Path) -> None:
    """The bounds are linear in the contraction; the contraction 0.3 is at a third between the last two bounds."""
    region = Learned(str(learned_laws.written(tmp_path, with_region(CONTENT))))
    most = learned_laws.L0 * (1.15 - 0.15 / 3.0)
    found, free = pulled(region, 0.3), pulled(law, 0.3)
    assert found.status is Status.OUTSIDE
    assert 0.99 * most < found.chamber_length.max() < most
    steps = len(found.time)
    assert free.chamber_length[steps].max() > most
    assert_array_equal(found.joints, free.joints[:steps])
    assert "a chamber left the domain of the segment law" in found.stop.sentence
    sentence = found.stop.sentence
    assert f"to {most:.4g} m where its free length is {0.7 * learned_laws.L0:.4g} m" in sentence
    assert pulled(region, 0.1).chamber_length.max() > most


def test_a_start_has_lengths_of_the_domain_at_its_contraction(tmp_path: Path) -> None:
    """At 1.1 rest lengths, a worm may have the contraction 0.225, and not 0.45."""
    worm = Worm(segment=Learned(str(learned_laws.written(tmp_path, with_region(CONTENT)))))
    joints = State.straight(worm, None).joints * [1.1, 1.0, 1.0]
    for contraction in (0.225, 0.45):
        state = State(joints=joints, contraction=np.full((6, 2), contraction))
        if contraction == 0.225:
            assert simulate(worm, None, state=state, duration=0.01, gravity=(0, 0, 0)).status is Status.DONE
            continue
        sentence = (
            r"state: the left chamber of segment 0 is 0.1833 m long, must lie between .* and 0.1667 m at its contr"
        )
        with pytest.raises(worm3d.StateError, match=sentence):
            simulate(worm, None, state=state, duration=0.01, gravity=(0, 0, 0))


def test_a_law_that_cannot_bear_the_worm_is_refused() -> None:
    """The mesh bears hardly any weight at its greatest length. The sentence says how light the worm must be."""
    mesh, plane, sentence = (
        Learned("mesh_segment.json"),
        Plane(),
        r"pressed flat: .*, or its chambers more contracted at",
    )
    with pytest.raises(worm3d.LimitPointError, match=sentence) as error:
        simulate(Worm(segment=mesh, mass=1.0), plane, duration=0.01)
    lightest = float(str(error.value).split("lighter than ")[1].split(" kg")[0])
    with pytest.raises(worm3d.LimitPointError):
        simulate(Worm(segment=mesh, mass=1.01 * lightest), plane, duration=0.01)
    assert simulate(Worm(segment=mesh, mass=0.94 * lightest), plane, duration=0.01).status is Status.DONE
    worm = Worm(segment=mesh, mass=1.0)
    state = State.straight(worm, plane, contraction=0.05)
    assert simulate(worm, plane, state=state, duration=0.01).status is Status.DONE


def test_both_guards_interpolate_between_the_bounds(tmp_path: Path) -> None:
    path = learned_laws.written(tmp_path, with_region(CONTENT))
    own, worm = linkage.Learned.read(path), Worm(segment=Learned(str(path)))
    rng, l0 = np.random.default_rng(0), learned_laws.L0
    region = np.array([[1.0 - learned_laws.MOST], [1.0]] + [[0.5]] * 3 + [[h] for h in HEIGHTS]) * l0
    for a in (0.0, 0.225, learned_laws.MOST, *rng.uniform(0.0, learned_laws.MOST, 50)):
        low, high = guard._bounds(region, 0, l0 * (1.0 - a))
        wanted = l0 * np.interp(a, [0.0, 0.225, 0.45], HEIGHTS)
        assert_allclose((low, high), (0.5 * l0, wanted), rtol=1e-14)
        assert_allclose(np.ravel(worm.segment.possible(worm, np.full((6, 1), a)))[::6], (low, high), rtol=1e-9)
        for length, inside in ((high * (1.0 - 1e-6), True), (high * (1.0 + 1e-6), False), (0.499 * l0, False)):
            assert own.contains(np.array([length]), np.array([a])) is inside


MEMBERS = [
    {"energy": [1.1 * w for w in WEIGHTS], "radius": CONTENT["radius"]["weights"], "bending_Nm": [0.5] * 6},
    {"energy": [0.9 * w for w in WEIGHTS], "radius": [1.01 * w for w in CONTENT["radius"]["weights"]]},
]


@pytest.fixture(scope="module")
def ensemble(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return learned_laws.written(tmp_path_factory.mktemp("laws"), {**CONTENT, "ensemble": MEMBERS})


def test_a_member_is_the_law_with_its_weights(ensemble: Path) -> None:
    for k, each in enumerate([None, *MEMBERS]):
        found, planar = Learned(str(ensemble), member=k), linkage.Learned.read(ensemble, k)
        wanted = CONTENT["energy"]["weights"] if each is None else each["energy"]
        assert_array_equal(found.values(Worm(segment=found))["energy"][:, 0], wanted)
        assert_array_equal(planar.energy, wanted)
        assert_array_equal(planar.radius, found.law.radius)
        bending = CONTENT["bending_Nm"] if each is None else each.get("bending_Nm", CONTENT["bending_Nm"])
        assert_array_equal(found.law.bending, bending)
    for read in (lambda k: Learned(str(ensemble), member=k), lambda k: linkage.Learned.read(ensemble, k)):
        with pytest.raises(ValueError, match=r"member: got 3, must be .* 2"):
            read(3)
    with pytest.raises(ValueError, match=r"member: got 1, must be from 0 to 0: the file has no further laws"):
        Learned(content=json.dumps(CONTENT), member=1)


def test_the_members_move_apart_without_a_new_kernel(ensemble: Path) -> None:
    assert Learned.inputs() == dict(Learned.further_inputs)
    far = [crawl(Learned(str(ensemble), member=k), duration=2.0).distance for k in range(3)]
    assert np.ptp(far) > 1e-3 * far[0]
    assert_allclose(far[0], crawl(Learned(content=json.dumps(CONTENT)), duration=2.0).distance, rtol=0, atol=0)


def test_the_summary_has_the_spread_of_the_ensemble(ensemble: Path) -> None:
    """The forces are central differences of energies that this test evaluates from the file."""
    result = crawl(Learned(str(ensemble), member=1), duration=1.0)
    length, contraction, h = result.chamber_length, result.contraction, 1e-6
    forces, radii = [], []
    for each in ({}, *MEMBERS):
        own = {
            name: {**CONTENT[name], "weights": each.get(name, CONTENT[name]["weights"])}
            for name in ("energy", "radius")
        }
        of = lambda at, own=own: learned_laws.evaluated({**CONTENT, **own}, at.ravel(), contraction.ravel())  # noqa: E731
        forces.append((of(length + h)[0] - of(length - h)[0]) / h)
        radii.append(of(length)[1])
    force = np.sqrt(np.mean(np.std(forces, axis=0) ** 2))
    summary = result.summary()
    assert force > 1e-3
    assert_allclose(summary["law_spread_N"], force, rtol=1e-5)
    assert_allclose(summary["law_spread_share"], force / np.sqrt(np.mean(np.mean(forces, axis=0) ** 2)), rtol=1e-5)
    assert_allclose(summary["law_spread_m"], np.sqrt(np.mean(np.std(radii, axis=0) ** 2)), rtol=1e-9)
    for bare in (Rhombus(), Learned(content=json.dumps(CONTENT))):
        run = simulate(Worm(segment=bare), None, duration=0.1, gravity=(0, 0, 0))
        assert run.summary()["law_spread_N"] is None
        assert "has no ensemble of laws" in run.reasons()["law_spread_N"]


@pytest.mark.parametrize("contraction", [0.0, 0.3])
def test_a_worm_that_is_wider_than_at_rest_starts(law: Learned, contraction: float) -> None:
    worm = Worm(segment=law)
    start = State.straight(worm, Plane(), contraction=contraction)
    result = simulate(worm, Plane(), GROUND, state=start, duration=0.2)
    assert result.status is Status.DONE
    assert result.settling is not None


def test_a_worm_with_wide_plates_starts_on_them(tmp_path: Path) -> None:
    """The plates are wider than the worm is tall, so that both plates carry load after settling."""
    wide = Learned(str(learned_laws.written(tmp_path, CONTENT | {"plate_radius_m": 0.058})))
    worm = Worm(segment=wide)
    start = State.straight(worm, Plane())
    assert (start.joints[:, 2] > 0.058 - 1e-12).all()
    result = simulate(worm, Plane(), GROUND, duration=0.2)
    assert result.status is Status.DONE
    assert (result.end_load[-1] > 0.0).all()


def test_the_commands_of_a_start_are_those_of_its_points(law: Learned) -> None:
    """The first recorded points have the radius that belongs to the contraction at the start."""
    worm = Worm(segment=law)
    start = State.straight(worm, None, contraction=0.3)
    result = simulate(worm, None, state=start, duration=0.1, gravity=(0, 0, 0))
    apexes, joints = result.apexes[0], result.joints[0]
    away = np.linalg.norm(apexes - ((joints[:-1] + joints[1:]) / 2.0)[:, None], axis=2)
    _, radius = learned_laws.evaluated(CONTENT, np.full(1, worm.l0), np.full(1, 0.3))
    assert_allclose(away, radius[0], rtol=1e-12)


def test_a_result_stands_alone_and_goes_on(law: Learned, tmp_path: Path) -> None:
    own = tmp_path / "laws"
    own.mkdir()
    path = learned_laws.written(own)
    worm = Worm(segment=Learned(str(path)))
    whole = simulate(worm, Plane(), GROUND, actuation=WAVE, duration=1.0)
    half = simulate(worm, Plane(), GROUND, actuation=WAVE, duration=0.5)
    half.save(tmp_path / "half.nc")
    path.unlink()
    loaded = worm3d.load(tmp_path / "half.nc")
    assert loaded.worm.segment == worm.segment
    rest = simulate(loaded.worm, Plane(), GROUND, actuation=WAVE, duration=0.5, state=loaded.state)
    assert_array_equal(rest.joints[-1], whole.joints[-1])
    assert_allclose(loaded.worm.segment.law.energy, CONTENT["energy"]["weights"])


def test_chambers_without_links_are_drawn_with_their_outline(law: Learned) -> None:
    for segment_law, layers in ((law, {"chambers", "faces"}), (Rhombus(), {"links", "chambers", "faces"})):
        result = crawl(segment_law, duration=0.5)
        frames = frames_of(result)
        drawn = pieces.worm(frames, pieces.Scales.of(frames))
        assert {each.path.partition("/")[0] for each in drawn} == layers


def test_sizes_of_the_worm_follow_from_the_law(law: Learned) -> None:
    worm = Worm(segment=law, segments=5)
    assert_allclose(worm.length, 5 * learned_laws.L0)
    assert (worm.chamber_offset, worm.stroke) == (learned_laws.B, (0.0, learned_laws.MOST))
    assert_allclose(np.hypot(worm.half_height, worm.chamber_offset), law.law.rest_radius, rtol=1e-15)
    assert_allclose(worm.k_spring, learned_laws.K)
    assert replace(worm, mass=0.2).segment is law
    assert replace(Worm(), segment=law).half_height[0] == worm.half_height[0]
    for name, value in (("half_height", 0.06), ("k_spring", 20.0), ("length", 1.5), ("chamber_offset", 0.02)):
        with pytest.raises(ValueError, match=rf"{name}: got .*, must be .* as in the segment law, or be left out"):
            Worm(segment=law, **{name: value})


def test_parts_that_act_on_links_are_refused(law: Learned) -> None:
    for segment_law in (law, Hydrostat()):
        with pytest.raises(ValueError, match=r"got Pneumatic, which acts on the links of a rhombus, must be"):
            Worm(segment=segment_law, actuator=Pneumatic())


def lengthening(content: dict[str, Any]) -> dict[str, Any]:
    """Return a law whose input lengthens the segment: without an input, the contraction is the greatest one."""
    return {**content, "input": {**content["input"], "counted_down_from": 5.0}}


@pytest.mark.parametrize(("free", "scale"), [(0.0, 1.0), (learned_laws.MOST, 0.85)])
def test_joints_rub_with_a_share_of_the_force_without_input(free: float, scale: float, tmp_path: Path) -> None:
    """Two ways of a segment: P from the file, y by quadrature, and the sliders one by one."""
    content = lengthening(CONTENT) if free else CONTENT
    own = Jenkins(moment=0.01, load_ratio=0.4, give=1e-4, spread=2.0)
    segment_law = Learned(str(learned_laws.written(tmp_path, content)))
    worm = Worm(segment=segment_law, segments=1, kelvin_voigt_time=0.0, hysteresis=own)
    at = scale * np.linspace(0.65, 1.1, 20_001) * worm.l0

    def energy(length: np.ndarray) -> np.ndarray:
        return learned_laws.evaluated(content, length, np.full_like(length, free))[0]

    pull = (energy(at + 1e-6) - energy(at - 1e-6)) / 2e-6
    rest = worm.l0 * (1.0 - free)
    w0 = learned_laws.evaluated(content, np.array([rest]), np.array([free]))[1][0]
    slope = own.moment / np.sqrt(w0**2 + rest**2 / 4.0 - at**2 / 4.0) + own.load_ratio * np.abs(pull)
    y = cumulative_trapezoid(slope, at, initial=0.0)
    length = scale * worm.l0 * np.concatenate([np.linspace(0.9, 1.08, 60), np.linspace(1.08, 0.67, 90)])
    e, gives, shares, lost = np.zeros(4), own.give * own.spread ** np.array([-1.0, -1.0 / 3.0, 1.0 / 3.0, 1.0]), [], []
    for moved in np.diff(np.interp(length, at, y), prepend=np.interp(length[0], at, y)):
        wanted = e + moved / gives
        e = np.clip(wanted, -1.0, 1.0)
        shares.append(e.mean())
        lost.append(np.mean(gives * np.abs(wanted - e)))
    expected = 2.0 * (np.interp(length, at, pull) + np.array(shares) * np.interp(length, at, slope))
    found = worm3d.stretch_segment(worm, length, np.arange(150.0))
    assert_allclose(found.force, expected, rtol=0, atol=1e-4 * np.abs(expected).max())
    assert (min(shares), max(shares)) == (-1.0, 1.0)
    assert found.hysteresis_loss.min() >= 0.0
    assert_allclose(found.hysteresis_loss.sum(), 2.0 * np.sum(lost), rtol=1e-5)
    stored = 2.0 * (energy(length[-1:]) - energy(length[:1]))[0] + np.mean(gives * e**2)
    assert_allclose(found.elastic.sum(), stored, rtol=1e-9)


@pytest.mark.slow
def test_a_worm_with_joints_that_rub_closes_the_ledger(law: Learned) -> None:
    worm = Worm(segment=law, hysteresis=Jenkins(moment=0.002, load_ratio=0.3))
    wave = TravellingWave(amplitude=0.3, bias=0.3)
    result = simulate(worm, Plane(), GROUND, actuation=wave, duration=2.0)
    assert result.status is Status.DONE
    assert result.energy.balance_error < 1e-12
    assert result.energy.hysteresis_loss.min() >= 0.0
    assert result.energy.hysteresis_loss.sum() > 0.05 * result.energy.work_contract.sum() > 0.0


def test_the_force_of_a_stretched_segment_is_the_slope_of_the_energy(law: Learned) -> None:
    worm = Worm(segment=law, segments=1, kelvin_voigt_time=0.0)
    length = np.linspace(0.7, 1.15, 40) * worm.l0
    found = worm3d.stretch_segment(worm, length, np.linspace(0.0, 1.0, 40))

    def energy(at: np.ndarray) -> np.ndarray:
        return 2.0 * learned_laws.evaluated(CONTENT, at, np.zeros_like(at))[0]

    h = 1e-5
    assert_allclose(found.force, (energy(length + h) - energy(length - h)) / (2.0 * h), rtol=0, atol=1e-6)
    assert_allclose(np.cumsum(found.elastic), energy(length) - energy(length[:1]), rtol=0, atol=1e-13)
    with pytest.raises(ValueError, match=r"must be above 0.0833333 and below 0.2 m, the domain of the segment law"):
        worm3d.stretch_segment(worm, [0.15, 0.3], [0.0, 1.0])
    with pytest.raises(
        ValueError, match=r"above 0.143333 and below 0.17 m, the domain .* without an input, 0; stay with"
    ):
        worm3d.stretch_segment(Worm(segment=Learned("barrel.json")), [0.16, 0.125], [0.0, 1.0])


def test_factors_scale_the_forces_of_chambers_and_the_moment_of_a_bend() -> None:
    content = json.dumps({**CONTENT, "ensemble": MEMBERS})
    for member in (0, 1):
        plain, firm = (
            Learned(content=content, member=member),
            Learned(content=content, member=member, stiffness_factor=1.4),
        )
        length = np.linspace(0.75, 1.1, 9)
        of = [
            worm3d.stretch_segment(Worm(segment=each, segments=1), length * learned_laws.L0, 1.0 + np.arange(9.0))
            for each in (plain, firm)
        ]
        assert_allclose(of[1].elastic, 1.4 * of[0].elastic, rtol=1e-12, atol=1e-15)
        bent = Learned(content=content, member=member, bending_factor=0.7)
        assert_allclose(bent.law.bending, 0.7 * plain.law.bending, rtol=1e-14)
        assert_array_equal(bent.law.energy, plain.law.energy)
        forces = [each.ensemble(length * learned_laws.L0, np.zeros(9))[0] for each in (plain, firm)]
        assert_allclose(forces[1], 1.4 * forces[0], rtol=1e-12)
    with pytest.raises(ValueError, match="stiffness_factor: got 0"):
        Learned(content=content, stiffness_factor=0.0)


def changed(path: str, value: Any) -> Callable[[dict[str, Any]], Any]:
    """Return a function that sets the value at a path of keys in the content of a file."""

    def change(content: dict[str, Any]) -> None:
        *inner, last = path.split(".")
        for key in inner:
            content = content[key]
        content[last] = value

    return change


WRONG = {
    "kind": ("other", r"kind: got 'other', must be 'worm3d segment law'; this is a file of something else"),
    "version": (2, r"version: got 2, must be 1; make the file again"),
    "rest_length_m": (98.0, r"rest_length_m: got 98.0, must be between 0 and 10 m: lengths are in metres"),
    "rest_radius_m": (0.09, r"rest_radius_m: got 0.09, must be the radius of the network at rest, 0.058"),
    "stiffness_N": (float("nan"), r"stiffness_N: got nan, must be between 0 and inf"),
    "energy.weights": (WEIGHTS[1:], r"energy.weights: got 66 numbers, must be 67 for the sizes \[2, 6, 6, 1\]"),
    "radius.weights": ([float("nan")] * 25, r"radius.weights: number 0 is nan, must be finite; the fit has failed"),
    "energy.sizes": ([2, 8, 1], r"energy.sizes: got \[2, 8, 1\], must be \[2, 6, 6, 1\]"),
    "bending_Nm": ([0.1], r"bending_Nm: got 1 numbers, must be 6: 1, x, y, x\^2, x y, y\^2"),
    "input.unit": ("kPa", r"input.unit: got 'kPa', must be 'Pa' for pressure; convert the table"),
    "input.name": ("water", r"input.name: got 'water', must be one of 'pressure', 'cable'"),
    "input.value": ([0, 1, 3, 2, 5, 6], r"input.value: number 3 is 2 after 3, must ascend; leave out states in which"),
    "input.contraction": ([], r"input.value: got 6 numbers, must be 0, as many as contractions"),
    "scales.x_half": (0.0, r"scales.x_half: got 0.0, must be between 0 and inf"),
    "domain.length_m": ([0.2, 0.3], r"domain.length_m: got 0.2 to 0.3, must be in metres and include the rest length"),
    "domain.contraction": ([0.0, 1.5], r"domain.contraction: got 0 to 1.5, must be from 0 to a number below 1"),
    "domain.shortest_m": ([0.1, 0.1], r"domain.longest_m: is missing; the file has 'length_m'"),
    "domain.longest_m": ([0.2, 0.2], r"domain.shortest_m: is missing"),
    "ensemble": ([{"energy": WEIGHTS}], r"ensemble\[0\].radius: is missing"),
    "chamber_offset_m": (0.057, r"radius: falls to 0.05\d+ m in the domain, must stay above chamber_offset_m"),
}


@pytest.mark.parametrize("path", WRONG)
def test_a_wrong_value_in_a_file_is_named(path: str, tmp_path: Path) -> None:
    value, sentence = WRONG[path]
    content = json.loads(json.dumps(CONTENT))
    changed(path, value)(content)
    with pytest.raises(ValueError, match=rf"segment law 'barrel.json': {sentence}"):
        Learned(str(learned_laws.written(tmp_path, content)))


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "the file is empty; make it with 'worm3d law'"),
        ("length_m, force_N", "is no JSON, Expecting value: line 1"),
        ("[1, 2]", "the file: got list, must be an object with keys"),
        ('{"kinds": 1}', "kind: is missing; the file has 'kinds'"),
    ],
)
def test_a_file_that_is_no_law_is_refused(text: str, sentence: str, tmp_path: Path) -> None:
    path = tmp_path / "barrel.json"
    path.write_text(text)
    with pytest.raises(ValueError, match=f"segment law 'barrel.json': {sentence}"):
        Learned(str(path))


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"segment law 'none.json': there is no such file in"):
        Learned(str(tmp_path / "none.json"))


@pytest.mark.parametrize("kind", ["learned", "hydrostat"])
def test_the_planar_linkage_moves_as_the_flat_worm(kind: str, tmp_path: Path) -> None:
    """Both programs evaluate the law by formulas of their own. The agreement is to rounding."""
    place, path = (np.arange(4) + 0.5) / 4.0, str(learned_laws.written(tmp_path, CONTENT))
    sizes = {"segments": 4, "mass": 0.07, "k_torsion": 10.0, "k_apex": 0.0}
    sizes |= {} if kind == "learned" else {"length": 0.64, "half_height": 0.05}

    def contraction(t: float) -> np.ndarray:
        begun = min(1.0, 2.0 * t)
        return 0.1 * begun**2 * (3.0 - 2.0 * begun) * (1.0 - np.cos(2.0 * np.pi * (place + t)))

    flat = Worm.planar(**sizes, segment=Learned(path) if kind == "learned" else Hydrostat())
    command = lambda t: worm3d.Command(np.column_stack([contraction(t)] * 2))  # noqa: E731
    ground = Friction(0.03, 0.20, lateral=0.7, static_ratio=1.2)
    found = simulate(flat, Plane(), ground, command, duration=1.0, dt=0.01, integrator="implicit_euler")
    oracle = linkage.Linkage(**sizes, segment=path if kind == "learned" else kind)
    wanted = linkage.simulate(oracle, contraction, duration=1.0, dt=0.01)
    assert_allclose(found.joints[..., [0, 2]], wanted.joints, rtol=0, atol=1e-12)
    assert_allclose(found.energy.work_contract.sum(), wanted.ledger.work_contract.sum(), rtol=1e-9)
    assert wanted.distance > 0.02


def test_a_contraction_is_a_pressure_by_the_table_of_the_law() -> None:
    """The table of the file is the straight line 4 kPa a; a kink in the table is met exactly."""
    kinked = {**CONTENT["input"], "contraction": [0.0, 0.1, 0.45], "value": [0.0, 1000.0, 1700.0]}
    for table, contraction, pressure in (
        (CONTENT["input"], [[0.0, 0.1], [0.33, 0.45]], [[0.0, 400.0], [1320.0, 1800.0]]),
        (kinked, [0.05, 0.1, 0.275], [500.0, 1000.0, 1350.0]),
    ):
        segment = Learned("barrel.json", content=json.dumps({**CONTENT, "input": table}))
        assert_allclose(segment.input_of(contraction), pressure, rtol=1e-14)
        assert_allclose(segment.contraction_of(pressure), contraction, rtol=1e-14, atol=1e-16)
    for refused, sentence in (
        (lambda: segment.input_of([0.1, 0.46]), r"contraction: got 0.46, must be from 0 to 0.45 as in the table"),
        (lambda: segment.contraction_of(-5.0), r"pressure: got -5 Pa, must be from 0 to 1700 Pa as in the table"),
        (lambda: segment.contraction_of(np.nan), r"pressure: got nan Pa"),
        (lambda: segment.contraction_of(5.0, "cable"), r"'learned' has no cable; command its pressure"),
        (lambda: Rhombus().input_of(0.1), r"segment: the law 'rhombus' has no pressure; command the contraction"),
    ):
        with pytest.raises(ValueError, match=sentence):
            refused()


@pytest.mark.parametrize(("name", "unit"), [("pressure", "Pa"), ("cable", "N")])
def test_a_run_tells_the_inputs_of_its_chambers(name: str, unit: str, tmp_path: Path) -> None:
    table = {**CONTENT["input"], "name": name, "unit": unit}
    worm = Worm(segments=3, segment=Learned("barrel.json", content=json.dumps({**CONTENT, "input": table})))
    run = simulate(worm, Plane(), actuation=TravellingWave(amplitude=0.2, bias=0.3), duration=0.3)
    (found,) = (each for each in run.variables() if each.name == name)
    assert (found.units, found.dims) == (unit, ("time", "segment", "chamber"))
    assert_allclose(found.values, 4e3 * run.contraction, rtol=1e-12)
    assert found.values.max() > 100.0
    summary = run.summary()
    assert summary[f"peak_{name}_{unit}"] == found.values.max()
    assert [summary[each] for each in ("peak_pressure_Pa", "peak_cable_N") if name not in each] == [None]
    run.save(tmp_path / "run.nc")
    assert_array_equal(load(tmp_path / "run.nc").chamber_input, found.values)


def test_a_run_of_rhombi_has_no_inputs() -> None:
    run = simulate(Worm(), Plane(), duration=0.05)
    assert not {"pressure", "cable"} & {each.name for each in run.variables()}
    assert reasons(run)["peak_pressure_Pa"] == "the segment law has no pressure"
    with pytest.raises(ValueError, match="the law 'rhombus' has no pressure"):
        np.max(run.chamber_input)
