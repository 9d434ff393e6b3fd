"""Rival simulators do the task, each converges on its own, and the search finds the step where it has."""

import json
import math
import sys
from pathlib import Path

import numpy as np
import plant
import pytest
import rivals
from numpy.testing import assert_allclose
from rivals import RIVALS, Contender, NotConvergedError, Rival, Task, largest_step
from speed_measures import relative_error
from typer.testing import CliRunner

from scenes.language.errors import MissingPartError

NEEDS = {"mujoco": "mujoco", "pyelastica": "elastica"}
"""PyElastica compiles for a minute when it is new."""


@pytest.fixture(params=["mujoco", pytest.param("pyelastica", marks=pytest.mark.slow)])
def rival(request: pytest.FixtureRequest) -> Rival:
    package = NEEDS[request.param]
    pytest.importorskip(package, reason=f"{request.param} is not installed; it comes with the extra 'bench'")
    return rivals.load(request.param)


class Exact(Rival):
    """A rival whose distance error is dt and which takes 2 us a step."""

    name, cannot = "Exact 1.0", ("friction", "gravity")

    def settings(self, segments: int) -> str:
        return f"{segments} segments"

    def prepare(self, task: Task, duration: float, steps: int):
        return lambda: duration * (1.0 + duration / steps)

    def real_time_factor(self, task: Task, dt: float, duration: float) -> float:
        return dt / 2e-6


OWN = Contender("worm3d", "", 4, "bristles", 0.01, 0.0, 0.7, 1.0, 1e4, 5e3)


def test_measured_speeds_belong_together() -> None:
    found = Exact().measured(6, "isotropic", 10.0)
    assert (found.name, found.settings, found.segments, found.ground) == ("Exact 1.0", "6 segments", 6, "isotropic")
    assert 0.005 < found.dt_s <= 0.0115
    assert_allclose(found.distance, 10.0 * (1.0 + found.dt_s), rtol=1e-3)
    assert_allclose([found.us_per_step, found.real_time_factor], [2.0, found.dt_s / 2e-6])


@pytest.mark.parametrize(("order", "largest"), [(1, 0.01), (2, 0.1)])
def test_search_finds_the_largest_step_of_a_known_error(order: int, largest: float) -> None:
    step = largest_step(lambda dt: 1.0 + dt**order, coarsest=0.32, seconds=10.0)
    assert step.error <= 0.01
    assert step.reference_dt <= step.dt / 8.0
    assert largest / 2**0.25 <= step.dt <= largest * 1.15


def test_a_coarse_step_that_is_right_by_luck_does_not_count() -> None:
    def distance(dt: float) -> float:
        return 1.0 if dt > 0.3 else 1.0 + dt

    assert largest_step(distance, coarsest=0.32, seconds=10.0).dt < 0.012


def test_unstable_steps_are_passed_over() -> None:
    step = largest_step(lambda dt: np.nan if dt > 0.003 else 1.0, coarsest=0.02, seconds=10.0)
    assert_allclose(step.dt, 0.0025 * 2**0.25)


def test_search_gives_up_when_its_time_is_up() -> None:
    with pytest.raises(NotConvergedError, match=r"no step from 0\.02 s down to .* allow more time"):
        largest_step(lambda dt: 1.0 / dt, coarsest=0.02, seconds=1e-4)


def test_an_error_is_relative_to_the_reference_and_unknown_where_that_is_zero() -> None:
    assert_allclose(relative_error(-1.1, -1.0), 0.1)
    assert np.isnan(relative_error(1.0, 0.0))


def test_the_task_is_the_default_worm() -> None:
    task = Task.of(12)
    assert (task.worm.segments, task.worm.l0, task.friction.forward, task.friction.backward) == (
        12,
        1.0 / 12,
        0.03,
        0.2,
    )
    crest_at_tail = 0.5 - 1.0 / 12
    assert_allclose(task.contractions(np.array([crest_at_tail]))[0, [0, -1]], [0.2, 0.2 * np.cos(np.pi / 6)])


def test_yaw_is_the_chambers_in_series_with_the_joint() -> None:
    chambers = 13.0 * 0.03**2 * 6
    assert_allclose(Task.of(6).yaw, np.full(5, chambers * 0.5 / (chambers + 0.5)))


@pytest.mark.parametrize("name", list(RIVALS))
def test_a_missing_rival_says_how_to_get_it(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, NEEDS[name], None)
    monkeypatch.delitem(sys.modules, f"{name}_worm", raising=False)
    with pytest.raises(MissingPartError, match=rf"{name} cannot be imported .* extra 'bench': pip install .*"):
        rivals.load(name)


def test_a_rival_without_a_step_is_a_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plant, "ours", lambda segments, ground: OWN)
    own, lost = plant.beside(4, "bristles", [Exact()], 0.0)
    assert own is OWN
    assert str(lost).startswith("Exact 1.0 (4 segments), 4 segments: no step from 0.02 s")


def test_the_largest_step_is_that_up_to_which_all_hold() -> None:
    errors = {0.02: 0.009, 0.005: 0.001, 0.01: 0.002, 0.03: 0.02, 0.04: 0.001}
    assert plant.largest_that_holds(errors, 0.01) == (0.02, 0.009)
    with pytest.raises(NotConvergedError, match=r"an error of 0\.5 at dt = 0\.005 s, must be 0\.01 or less"):
        plant.largest_that_holds({0.005: 0.5, 0.01: 0.001}, 0.01)
    with pytest.raises(NotConvergedError, match="nan"):
        plant.largest_that_holds({0.005: math.nan}, 0.01)


def test_a_rivals_ratios_are_those_of_the_real_time_factors() -> None:
    found = plant.against(OWN, Contender("Exact 1.0", "", 4, "bristles", 0.01, math.nan, 0.7, 2.0, 5e3))
    assert (found.ratio, found.ratio_of_call) == (2.0, 1.0)
    _, rows = plant.table(plant.COLUMNS, [found])
    assert rows == [("bristles", "4", "Exact 1.0", "10", "", "0.700", "2.0", "5000.0", "2.0", "1.0")]


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plant, "DURATION", 0.1)
    monkeypatch.setattr(plant, "STEPS", (0.01,))
    monkeypatch.setattr(plant.largest_that_holds, "__defaults__", (1e9,))


def compare(*arguments: object):
    app = plant.typer.Typer()
    app.command()(plant.main)
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def test_the_comparison_prints_and_writes(short: None, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def load_one(name: str) -> Rival:
        if name == "pyelastica":
            raise MissingPartError("pyelastica cannot be imported")
        return Exact()

    monkeypatch.setattr(plant, "load", load_one)
    done = compare("--out", tmp_path / "out", "--segments", 4, "--ground", "isotropic")
    assert done.exit_code == 0, done.output
    study = json.loads((tmp_path / "out" / "rivals.json").read_text())
    own, exact = study["rivals"]
    assert own["name"].startswith("worm3d ")
    assert (own["ground"], exact["ground"]) == ("isotropic", "isotropic")
    assert_allclose(exact["ratio"], own["real_time_factor"] / exact["real_time_factor"])
    assert_allclose(1e6 * exact["dt_s"] / exact["us_per_step"], exact["real_time_factor"])
    for text in (done.output, (tmp_path / "out" / "rivals.md").read_text()):
        assert "Exact 1.0 cannot express: friction; gravity." in text
        assert "pyelastica cannot be imported" in text


@pytest.mark.parametrize(
    ("arguments", "code"), [((), 4), (("--rival", "mujoco"), 4), (("--rival", "toy"), 2), (("--ground", "toy"), 2)]
)
def test_rivals_that_are_not_there_end_it_before_anything_is_measured(
    arguments: tuple[str, ...], code: int, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    for name in RIVALS:
        monkeypatch.setitem(sys.modules, NEEDS[name], None)
        monkeypatch.delitem(sys.modules, f"{name}_worm", raising=False)
    done = compare("--out", tmp_path / "out", *arguments)
    assert done.exit_code == code
    expected = "toy" if code == 2 else "it comes with the extra 'bench': pip install"
    assert expected in done.output
    assert not (tmp_path / "out").exists()


def test_a_rival_says_what_it_is_and_what_it_cannot_express(rival: Rival) -> None:
    assert rival.name.lower().startswith(("mujoco 4", "pyelastica 1"))
    assert len(rival.cannot) >= 4
    assert rival.settings(3)


def test_a_rival_converges_with_its_step(rival: Rival) -> None:
    reference = rival.run(Task.of(3), 1.0, 2e-4)
    coarse, fine = (abs(rival.run(Task.of(3), 1.0, dt) - reference) for dt in (3.2e-3, 8e-4))
    assert 1e-3 < abs(reference) < 0.1
    assert fine < max(0.5 * coarse, 1e-4)
    assert fine < 5e-4


def test_a_rival_crawls_towards_its_head(rival: Rival) -> None:
    assert 0.3 < rival.run(Task.of(6), 10.0, 2.5e-3) < 0.6


def test_a_step_that_blows_up_is_not_a_distance(rival: Rival) -> None:
    distance = rival.run(Task.of(3), 1.0, 0.2)
    assert np.isnan(distance) or abs(distance - rival.run(Task.of(3), 1.0, 1e-3)) > 0.01


def test_speed_is_positive(rival: Rival) -> None:
    assert rival.real_time_factor(Task.of(3), 5e-3, 0.1) > 0.0


class TestMuJoCo:
    @pytest.fixture(autouse=True)
    def _needs_mujoco(self) -> None:
        pytest.importorskip("mujoco", reason="mujoco is not installed; it comes with the extra 'bench'")

    @staticmethod
    def model(segments: int, per_tree: int = 6):
        import mujoco
        from mujoco_model import mjcf

        return mujoco.MjModel.from_xml_string(mjcf(Task.of(segments), 2e-3, per_tree))

    @pytest.mark.parametrize("per_tree", [3, 20])
    def test_mass_is_the_worms_however_it_is_cut(self, per_tree: int) -> None:
        model = self.model(7, per_tree)
        assert_allclose(model.body_mass.sum(), 0.1)
        assert model.ntree == -(-7 // per_tree)

    def test_cut_into_trees_it_crawls_as_far(self) -> None:
        from mujoco_worm import MuJoCoWorm

        whole, cut = (MuJoCoWorm(n).run(Task.of(6), 4.0, 2e-3) for n in (6, 2))
        assert_allclose(cut, whole, rtol=0.02)

    def test_a_fully_contracted_foot_is_where_the_rhombus_has_its_apex(self) -> None:
        import mujoco

        worm, model = Task.of(6).worm, self.model(6)
        data = mujoco.MjData(model)
        short = 0.2 * worm.l0
        data.joint("length5").qpos = -short
        data.joint("foot5").qpos = -short * model.eq_data[-1, 1]
        mujoco.mj_kinematics(model, data)
        apex, far = data.geom("L5").xpos, data.body("far5").xpos
        height = np.sqrt(worm.link_length[5] ** 2 - (worm.l0 - short) ** 2 / 4.0)
        assert_allclose(apex[2] - 0.005, 0.05 - height, atol=1e-12)
        assert_allclose(far[0] - apex[0], (worm.l0 - short) / 2.0)

    @pytest.mark.parametrize("segments", [3, 6, 25])
    def test_at_rest_it_hardly_sinks_in(self, segments: int) -> None:
        import mujoco

        model = self.model(segments)
        data = mujoco.MjData(model)
        mujoco.mj_step(model, data, nstep=500)
        assert data.ncon == 2 * segments
        assert 0.5e-4 < -data.contact.dist.mean() * segments < 2e-4


class TestPyElastica:
    @pytest.fixture(autouse=True)
    def _needs_pyelastica(self) -> None:
        pytest.importorskip("elastica", reason="pyelastica is not installed; it comes with the extra 'bench'")

    def test_mass_and_stiffness_are_the_worms(self) -> None:
        from pyelastica_worm import _rod

        task = Task.of(4)
        rod = _rod(task)
        assert_allclose(rod.mass.sum(), 0.1)
        assert_allclose(np.einsum("iik->ik", rod.bend_matrix), 0.25 * np.array([task.yaw, task.pitch, task.twist]))
        assert_allclose(rod.radius, 0.05)

    def test_damping_is_an_implicit_step_of_the_relative_rates(self) -> None:
        from pyelastica_worm import _damp_joints, _damp_stretch

        rng = np.random.default_rng(1)
        n, mass, damping = 5, rng.uniform(0.5, 2.0, 6), rng.uniform(0.1, 3.0, 5)
        tangents = rng.normal(size=(3, n))
        tangents /= np.linalg.norm(tangents, axis=0)
        velocity = rng.normal(size=(3, n + 1))
        rates = np.zeros((n, 3, n + 1))
        for i in range(n):
            rates[i, :, i], rates[i, :, i + 1] = -tangents[:, i], tangents[:, i]
        expected = implicit(rates.reshape(n, -1), np.tile(mass, 3), damping, velocity.ravel())
        _damp_stretch(velocity, tangents, mass, damping)
        assert_allclose(velocity.ravel(), expected)

        omega, inertia = rng.normal(size=(3, n)), rng.uniform(0.5, 2.0, (3, n))
        joints = rng.uniform(0.1, 3.0, (3, n - 1))
        difference = np.diff(np.eye(n), axis=0)
        expected = [implicit(difference, inertia[a], joints[a], omega[a]) for a in range(3)]
        _damp_joints(omega, np.eye(3)[:, :, None] / inertia, joints)
        assert_allclose(omega, expected)


def implicit(rates: np.ndarray, mass: np.ndarray, damping: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """Solve (M + D^T C D) v' = M v."""
    return np.linalg.solve(np.diag(mass) + rates.T @ np.diag(damping) @ rates, mass * velocity)
