"""`worm3d play`: values change while the run goes on, and the worm is pulled, steered, recorded and saved."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import worm3d
from control.gaits import TravellingWave
from scenes.language.errors import SceneError
from scenes.models.control.play import ControlPlay
from scenes.models.loading import load_scene
from scenes.models.worm.build import gravity_of
from scenes.models.worm.play import Going
from scenes.records.store import load
from scenes.running import playing
from scenes.running.playing import Player, changed, control, sliders, slope_of
from scenes.running.runner import simulate
from worm3d.running.run import Observer, Run

Message = Mapping[str, Any]


class Page:
    """A page that sends messages when the run has come to certain times [s], and keeps what it sees."""

    def __init__(self, player: Player, script: Iterable[tuple[float, Message]]) -> None:
        self.player, self.script, self.held = player, list(script), False
        self.seen: list[tuple[float, np.ndarray]] = []
        self.run: Run | None = None
        self.goes_on: Callable[[], bool] = lambda: True

    def follow(self, run: Run) -> Observer:
        def look(run: Run) -> bool:
            now = run.time(run.done)
            self.run = run
            self.seen.append((now, run.recorded_now().joints[0].copy()))
            answers = []
            while self.script and self.script[0][0] <= now + 1e-9:
                answers.append(self.player.answer(run, self.script.pop(0)[1]))
            return all(answers)

        return Observer(look, 1)

    def play(self, legs: int) -> None:
        for _ in range(legs):
            self.player.leg(self)  # type: ignore[arg-type]


def played(scene: str, script: Iterable[tuple[float, Message]], legs: int = 2, *overrides: str) -> Page:
    page = Page(Player(load_scene(scene, overrides)), script)
    page.play(legs)
    return page


def joints_at(page: Page, time: float) -> list[np.ndarray]:
    return [joints for t, joints in page.seen if abs(t - time) < 1e-9]


@pytest.fixture(autouse=True)
def short_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(playing, "LEG", 0.5)


def set_to(key: str, value: Any) -> Message:
    return {"do": "set", "key": key, "value": value}


def test_parts_of_a_run_are_the_run_bit_for_bit() -> None:
    page = played("flat", [], 3)
    whole = worm3d.simulate(
        worm3d.Worm(), worm3d.Plane(), worm3d.Friction(), TravellingWave(period=2.0, amplitude=0.2), duration=1.5
    )
    assert_array_equal(page.seen[-1][1], whole.joints[-1])


def test_a_gait_goes_on_with_its_phase_when_its_period_changes() -> None:
    """The commands are functions of the phase only: the same at the change, and then at the new rate."""
    first, second = TravellingWave(period=2.0), TravellingWave(period=0.7)
    worm, t = worm3d.Worm(), 3.3
    before = Going(first)
    after = before.followed_by(second, t)
    old, new = before.bind(worm), after.bind(worm)
    assert_allclose(new(t).contraction, old(t).contraction, atol=1e-12)
    assert_allclose(new(t + 0.07).contraction, old(t + 0.2).contraction, atol=1e-12)
    again = after.followed_by(first, 5.0).bind(worm)
    assert_allclose(again(5.0).contraction, new(5.0).contraction, atol=1e-12)


def test_a_gait_with_senses_goes_on_with_its_phase_too() -> None:
    class Sensing(SimpleNamespace):
        bind = lambda self, worm: SimpleNamespace(step=lambda t, measurement: t / self.period)  # noqa: E731

    after = Going(Sensing(period=2.0)).followed_by(Sensing(period=0.7), 3.3)
    assert after.bind(worm3d.Worm()).step(3.3, None) == pytest.approx(3.3 / 2.0)  # type: ignore[union-attr, arg-type]


def test_a_record_has_the_phase_of_its_own_time(tmp_path: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is a part of the run that nobody records, whose first steps do not belong to the record."""
    monkeypatch.chdir(tmp_path)
    played("path_line", [(0.3, {"do": "record"}), (0.7, {"do": "record"})], 2)
    (folder,) = (tmp_path / "runs").iterdir()
    whole = simulate(load_scene("path_line", ["run.duration_s=0.7", "run.record_every=1"]))
    assert whole["waves"][-1] > whole["waves"][30] > 0.0
    assert_allclose(load(folder / "result.nc")["waves"], whole["waves"][30:], atol=1e-12)


def test_a_mass_changes_while_the_worm_moves() -> None:
    page = played("flat", [(0.3, set_to("worm.mass_kg", 0.15))], 4)
    assert page.player.scene.settings.worm.mass_kg == 0.15
    before, after = joints_at(page, 0.3)
    assert_array_equal(before, after)
    assert page.run is not None
    loads = page.run.recorded_now()
    total = loads.normal_load.sum() + loads.joint_load.sum()
    assert_allclose(total, 0.15 * 9.81, rtol=0.1, err_msg="it moves, so that loads and weight differ a little")


def test_the_worm_turns_with_the_slope_about_the_origin() -> None:
    page = played("flat", [(0.4, set_to("world.slope_deg", 6.0))], 3, "start.position_m=[0.7,0.2]")
    before, after = joints_at(page, 0.4)
    angle = np.radians(6.0)
    x, y, z = before.T
    turned = np.array([np.cos(angle) * x - np.sin(angle) * z, y, np.sin(angle) * x + np.cos(angle) * z]).T
    assert_allclose(after, turned, atol=1e-12)
    assert page.seen[-1][0] > 0.8
    height = page.seen[-1][1] @ [-np.sin(angle), 0.0, np.cos(angle)]
    assert (height > 0.0).all(), "it still lies on the ground"


def test_the_worm_is_not_turned_if_a_value_of_the_same_moment_is_refused() -> None:
    page = played("flat", [(0.4, set_to("world.slope_deg", 6.0)), (0.4, set_to("worm.mass_kg", 50.0))], 2)
    before, after = joints_at(page, 0.4)
    assert page.player.state()["says"].endswith("; the value before is kept")
    assert slope_of(page.player.scene).magnitude() == 0.0
    assert_array_equal(after, before)


def test_a_reset_counts_also_if_the_slope_changes_after_it() -> None:
    page = played("flat", [(0.4, {"do": "reset"}), (0.4, set_to("world.slope_deg", 6.0))], 2)
    assert [t for t, _ in page.seen].count(0.0) == 2
    assert slope_of(page.player.scene).magnitude() == pytest.approx(np.radians(6.0))


def test_a_reference_that_the_controller_refuses_is_not_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    play = Player(load_scene("path_line")).played
    assert isinstance(play, ControlPlay)

    def refuse(reference: Any) -> None:
        raise ValueError("no way is left")

    monkeypatch.setattr(play.driver.controller, "lead", refuse)
    with pytest.raises(ValueError, match="no way is left"):
        play.follow(load_scene("path_line", ["reference.speed_m_s=0.02"]).settings, 0.0)
    assert play.wanted(0.0) == load_scene("path_line").settings.reference.speed_m_s
    with pytest.raises(ValueError, match="no way is left"):
        play.steer(1.0, 0.0, 0.3)
    assert play.state() == ""


def test_a_value_that_the_worm_cannot_have_is_not_taken() -> None:
    page = played("flat", [(0.2, set_to("worm.mass_kg", 50.0)), (0.4, set_to("friction.forward", -1.0))], 3)
    assert page.player.scene.settings.worm.mass_kg == 0.1
    assert page.seen[-1][0] >= 0.7
    assert page.player.state()["says"].startswith("friction.forward: got -1.0: ")
    page = played("flat", [(0.2, set_to("worm.mass_kg", 50.0))], 2)
    assert "make the worm lighter than" in page.player.state()["says"]
    assert page.player.state()["says"].endswith("; the value before is kept")


@pytest.mark.parametrize(
    "message",
    [
        {},
        {"do": 7},
        {"do": "leg"},
        {"do": "set"},
        {"do": "set", "key": "run.duration_s", "value": 1.0},
        {"do": "set", "key": "gait.kind", "value": "os:system"},
        {"do": "set", "key": "friction.forward", "value": "much"},
        {"do": "set", "key": "friction.forward", "value": float("nan")},
        {"do": "set", "key": "friction.forward", "value": [1]},
        {"do": "grab", "value": [0, 0]},
        {"do": "grab", "value": ["a", 0, 0]},
        {"do": "pull", "value": [float("inf"), 0, 0]},
        {"do": "steer", "value": None},
        {"do": "steer", "value": {"left": 1}},
        {"do": "set", "key": "friction.forward", "value": {}},
        {"do": "set", "key": "friction.forward", "value": 10**400},
        {"do": "set", "key": "gait.kind", "value": {}},
    ],
)
def test_other_messages_change_nothing(message: Message) -> None:
    page = played("flat", [(0.1, message)], 1)
    assert page.seen[-1][0] == pytest.approx(0.5)
    assert page.player.scene.settings == load_scene("flat").settings


def test_a_spring_pulls_the_worm_and_lets_go() -> None:
    """Its force is the stiffness times its length, up to a limit, on the joints beside the place."""
    weight, place = 0.1 * 9.81, [0.25, 0.0, 0.1]
    far = [(0.1, {"do": "grab", "value": place}), (0.1, {"do": "pull", "value": [0.25, 0.3, 0.1]})]
    page = played("flat", far, 1)
    assert page.run is not None
    at, pull = page.player._spring(page.run)
    i, share = page.player._grip or (0, 0.0)
    velocity = page.run.plant.arrays["joint_velocity"][:3, i : i + 2] @ [1.0 - share, share]
    damping = min(2.0 * np.sqrt(playing.STIFFNESS * weight * 0.1), playing.DAMPED * 0.1 / 6 / 0.01)
    wanted = playing.STIFFNESS * weight * (page.player._pointer - at) - damping * velocity
    assert_allclose(pull, wanted * min(1.0, playing.STRONGEST * weight / np.linalg.norm(wanted)), rtol=1e-12)
    joints = page.seen[-1][1]
    assert_allclose(at, (1.0 - share) * joints[i] + share * joints[i + 1], atol=1e-12)
    assert (i, share) == (1, pytest.approx(0.5, abs=0.3)), "0.25 m from the tail"
    values = page.player.values(page.run, page.run.recorded_now())
    assert_allclose(values["push"], [*at, *page.player._pointer, np.linalg.norm(pull)])
    sideways = page.seen[-1][1][:, 1]
    assert sideways[1:3].max() > 0.02, "it is pulled to the left"
    page.script = [(0.6, {"do": "let_go"})]
    page.play(1)
    assert_array_equal(page.player.values(page.run, page.run.recorded_now())["push"], 0.0)


def test_arrow_keys_steer_a_gait_by_its_own_keys() -> None:
    keys = [(0.1, {"do": "steer", "value": [1, 0]}), (0.2, {"do": "steer", "value": [0, 5]})]
    gait = played("flat", keys, 3).player.scene.settings.gait
    assert (gait.hinge_deg, gait.period_s) == (5.0, pytest.approx(2.0 / 1.1, rel=1e-5))


@pytest.mark.parametrize("left", [1, -1])
def test_the_left_key_turns_a_gait_to_the_left(left: int) -> None:
    keys = [(0.1 * k, {"do": "steer", "value": [left, 0]}) for k in (1, 2, 3)]
    chord = np.subtract(*played("flat", keys, 8).seen[-1][1][[-1, 0]])
    assert left * np.arctan2(chord[1], chord[0]) > 0.05


@pytest.mark.parametrize("left", [1.0, -1.0])
def test_the_left_key_leads_a_controller_to_the_left_of_the_present_heading(left: float) -> None:
    play = Player(load_scene("path_line")).played
    assert isinstance(play, ControlPlay)
    for times in (1, 2):
        assert play.steer(left, 0.0, 0.3) == {}
        reference = play.driver.controller.reference
        assert reference.path is None
        assert reference.heading(0.0) == pytest.approx(0.3 + left * times * np.radians(10.0))
    play.steer(0.0, 0.0, 0.3)
    assert play.driver.controller.reference.path is not None, "Esc: back to the path"


def test_another_gait_takes_over_with_its_own_defaults() -> None:
    page = played("flat", [(0.2, set_to("gait.kind", "inchworm"))], 2)
    gait = page.player.scene.settings.gait
    assert (gait.kind, gait.period_s) == ("inchworm", 2.0)


def test_the_page_gets_the_controls_of_another_gait(monkeypatch: pytest.MonkeyPatch) -> None:
    begun: list[Any] = []

    class View:
        url, waits = "", False
        __init__ = show = surround = tell = close = lambda self, *_, **__: None
        begin = lambda self, controls: begun.append([each["key"] for each in controls["keys"]])  # noqa: E731
        heard = lambda self, timeout: []  # noqa: E731

    monkeypatch.setattr("worm3d.running.live.LiveView", View)
    player = Player(load_scene("flat"))
    with worm3d.Live(speed=1e6, began=lambda url: None) as live:
        live.player = player
        for key, value in (("friction.forward", 0.05), ("gait.kind", "inchworm"), ("friction.forward", 0.06)):
            player.leg(live)
            assert player._run is not None
            player.answer(player._run, set_to(key, value))
        player.leg(live)
    assert begun[-1] == [*sliders(player.scene)]
    assert begun[0] != begun[-1]
    assert len(begun) == 2


def test_reset_begins_anew_with_the_present_values() -> None:
    page = played("flat", [(0.3, set_to("friction.forward", 0.05)), (0.4, {"do": "reset"})], 3)
    times = [t for t, _ in page.seen]
    assert times.count(0.0) == 2
    assert_array_equal(joints_at(page, 0.0)[1], joints_at(page, 0.0)[0])
    assert page.player.scene.settings.friction.forward == 0.05


def test_a_scene_is_saved_and_a_part_recorded(tmp_path: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    script = [(0.1, set_to("friction.forward", 0.05)), (0.2, {"do": "save"}), (0.3, {"do": "record"})]
    page = played("flat", [*script, (0.7, {"do": "record"})], 4)
    (saved,) = tmp_path.glob("flat-*.toml")
    assert load_scene(saved).settings == page.player.scene.settings
    assert load_scene(saved).settings.friction.forward == 0.05
    (folder,) = (tmp_path / "runs").iterdir()
    record = load(folder / "result.nc")
    assert record.status == "done"
    assert_allclose(record["time"][[0, -1]], [0.3, 0.7], atol=1e-9)
    assert {path.name for path in folder.iterdir()} >= {"result.nc", "summary.json", "viewer.html", "overview.png"}
    assert page.player.state()["says"] == f"recorded: runs/{folder.name}; 'worm3d view runs/{folder.name}' shows it"


def test_sliders_are_the_keys_of_the_scene_within_their_bounds() -> None:
    scene = load_scene("path_line")
    assert next(iter(sliders(scene))) == "reference.speed_m_s"
    assert "reference.heading_deg" not in sliders(scene), "a line has none"
    scene = load_scene("flat")
    for key, (known, value) in sliders(scene).items():
        made = control(key, known, value)
        if "choices" in made:
            assert value in made["choices"]
            continue
        assert made["low"] <= value <= made["high"], key
        for end in ("low", "high"):
            if key not in ("gait.amplitude", "gait.waves"):
                assert changed(scene, key, made[end]) != scene or made[end] == value
    with pytest.raises(SceneError, match=r"'worm\.length_m': this scene has no such control"):
        changed(scene, "worm.length_m", 2.0)
    assert_array_equal(gravity_of(scene.settings), [0.0, 0.0, -9.81])


@pytest.mark.slow
def test_a_worm_that_was_pulled_off_its_path_comes_back_and_keeps_another_speed() -> None:
    """With the controller of the scene, which goes on over all parts of the run."""
    grab = [(20.0, {"do": "grab", "value": [2.0, 0.0, 0.05]}), (20.0, {"do": "pull", "value": [2.0, 0.6, 0.05]})]
    script = [*grab, (22.0, {"do": "let_go"}), (22.0, set_to("reference.speed_m_s", 0.1))]
    page = played("path_line", script, 180)
    time, middle = np.array([t for t, _ in page.seen]), np.array([joints.mean(axis=0) for _, joints in page.seen])
    aside = np.interp([19.0, 22.0, 85.0], time, middle[:, 1])
    assert abs(aside[0]) < 0.02
    assert abs(aside[1]) > 0.1, "pulled off its path"
    assert abs(aside[2]) < 0.03, "back on its path"
    ahead = np.interp([85.0, 75.0], time, middle[:, 0])
    assert_allclose((ahead[0] - ahead[1]) / 10.0, 0.1, rtol=0.1)
    assert len(page.player.played.driver.controller.decisions) < 300  # type: ignore[attr-defined]


def test_what_cannot_be_played_is_told(worm3d: Any) -> None:
    ended = worm3d("play", "planar_published", "--no-open")
    assert ended.code == 2
    assert ended.complaints == [
        "planar_published: the model 'planar_published' cannot be played; 'worm3d run' animates it"
    ]


def test_a_run_that_diverges_goes_back_to_the_start_and_waits() -> None:
    page = played("flat", [(0.2, set_to("gait.hinge_deg", 170.0))], 6)
    assert page.held
    assert page.player.state()["says"].endswith("; back at the start, with the same values")
    assert [t for t, _ in page.seen].count(0.0) > 1


def test_values_that_cannot_begin_a_run_go_back_to_those_of_the_scene() -> None:
    page = played("turn_planned", [(0.1, set_to("gait.force_N", 1e6))], 5)
    assert page.player.scene.settings.gait.force_N < 10.0
    assert page.player.state()["says"].endswith("; back at the start, with the values of the scene")
    assert page.seen[-1][0] > 0.4


def test_a_worm_without_a_map_begins_anew_with_the_controller_of_the_scene() -> None:
    page = played("path_s_curve_slope", [(0.1, set_to("worm.mass_kg", 0.4)), (0.2, {"do": "reset"})], 4)
    assert page.player.scene.settings.worm.mass_kg == 0.4
    assert "the controller of the scene without changes is kept" in page.player.state()["says"]
    assert page.seen[-1][0] > 0.4
