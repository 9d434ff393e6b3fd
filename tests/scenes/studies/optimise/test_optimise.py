"""The search for gaits: unknowns, goals, the search and its log, and the command."""

from __future__ import annotations

import json
import math
import threading
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import worm3d as w
from control.gaits import Periodic
from scenes.language.errors import SceneError
from scenes.models.loading import load_scene
from scenes.models.worm.build import gait_of
from scenes.studies.optimise import front, goals
from scenes.studies.optimise import search as searches
from scenes.studies.optimise.card import CONDITIONS, HALF, PERIOD, WEAK, Card, Left, fragment
from scenes.studies.optimise.goals import BROKEN, FAILED, GOALS, Guarded, goal_of, limit_of
from scenes.studies.optimise.optimising import trials_of
from scenes.studies.optimise.search import Best, Found, Log, search
from scenes.studies.optimise.trials import GROUNDS, SURE_WAVES, UNREACHED, WAVES, Score, Trials
from scenes.studies.optimise.unknowns import PHASE_UNIT, Choice, Space, free_of
from scenes.studies.optimise.workers import Asked, require_worker, scores_by
from scenes.sweep.engine import chosen
from worm3d.measures import Measure

SPACE = Space(6, 0.2, 2.0)


def test_a_simple_gait_is_a_wave_with_the_same_shape_everywhere() -> None:
    simple = np.array([0.6, 0.5, 0.5])
    gait = SPACE.choice(SPACE.spread(simple)).gait
    wave = Periodic(amplitude=0.2, period=2.0, waves=-2.0 + 0.6 * 5.0, duty=0.5, sharpness=12.0 * 0.25)
    times = np.linspace(0.0, 4.0, 57)
    assert_allclose(gait.activations(times, 6), wave.activations(times, 6), atol=1e-12)


def test_the_right_side_of_a_simple_turn_is_weak_or_half_a_period_late() -> None:
    space, times = replace(SPACE, turns=True), np.linspace(0.0, 2.0, 50)
    late = space.choice(space.spread(np.array([0.6, 0.5, 0.5, 0.25]))).gait.activations(times, 6)
    full = space.choice(space.spread(np.array([0.6, 0.5, 0.5, 1.0]))).gait
    assert_allclose(late[..., 0], full.activations(times, 6)[..., 0], atol=1e-12)
    assert_allclose(late[..., 1], 0.5 * full.activations(times + 1.0, 6)[..., 1], atol=1e-12)


@pytest.mark.parametrize("turns", [False, True])
def test_any_coordinates_within_the_bounds_are_a_gait(turns: bool) -> None:
    space = replace(SPACE, turns=turns, free=(free_of("worm.spring_N=5:50"),))
    rng = np.random.default_rng(3)
    for _ in range(20):
        at = space.inside(rng.normal(size=len(space.neighbourly), scale=3.0))
        found = space.choice(at)
        assert found.gait.activations(np.array([0.3]), 6).shape == ((1, 6, 2) if turns else (1, 6))
    moved = np.array(at)
    moved[0] += 1.0 / PHASE_UNIT  # a whole period
    assert_allclose(np.ravel(space.choice(moved).gait.phase), np.ravel(found.gait.phase), atol=1e-12)


def test_free_keys_are_linear_or_logarithmic() -> None:
    assert free_of("a.b=1:3").value(0.5) == 2.0
    assert free_of("a.b=1:100").value(0.5) == pytest.approx(10.0)
    for text in ("a.b", "a.b=1", "a.b=3:1", "a.b=1:x", "=1:2", "a.b=1:inf"):
        with pytest.raises(SceneError, match=r"--over: got .*, must be a key and its range, such as"):
            free_of(text)


def test_a_free_key_can_have_whole_numbers_or_a_value_of_each_segment() -> None:
    whole = replace(free_of("worm.segments=4:6"), whole=True)
    assert [whole.value(x) for x in (0.0, 0.32, 0.34, 0.66, 0.68, 1.0)] == [4, 4, 5, 5, 6, 6]
    space = replace(SPACE, free=(whole, free_of("worm.spring_N=5:11:each")))
    at = space.spread(np.array([0.6, 0.5, 0.5, 0.0, 0.0]))
    at[-6:] = (np.arange(6) + 0.5) / 6.0  # proportional to the place on the body
    choice = space.choice(at)
    assert choice.changes[0] == "worm.segments=4"
    assert_allclose(json.loads(choice.changes[1].partition("=")[2]), 5.0 + 6.0 * (np.arange(4) + 0.5) / 4.0)
    simple = replace(SPACE, segments=4)
    other = simple.choice(simple.spread(np.array([0.6, 0.5, 0.5]))).gait
    times = np.linspace(0.0, 2.0, 31)
    assert_allclose(choice.gait.activations(times, 4), other.activations(times, 4), atol=1e-12)


def test_the_first_steps_of_a_search_are_alike_in_neighbours_and_of_the_variance_1() -> None:
    space = replace(SPACE, turns=True, free=(free_of("worm.spring_N=5:11:each"), free_of("worm.mass_kg=1:2")))
    covariance = space.neighbourly @ space.neighbourly.T
    assert_allclose(np.diag(covariance), 1.0)
    assert covariance[0, 2] == pytest.approx(math.exp(-0.5))  # phases of the first two segments on the left
    assert covariance[0, 1] == covariance[0, 12] == covariance[-1, -2] == 0.0
    assert covariance[-2, -3] == pytest.approx(math.exp(-0.5))


def test_a_goal_that_hangs_or_raises_has_a_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(goals, "TIME_LIMIT", 0.2)

    def forever(result: object) -> float:
        while True:
            pass

    def wrong(result: object) -> float:
        raise KeyError("lost")

    before = threading.active_count()
    run = w.simulate(w.Worm(), w.Plane(), actuation=Periodic(), duration=0.1)
    for function, words in (
        (forever, "own took longer than 0.2 s"),
        (wrong, "own raised KeyError: 'lost'"),
        (lambda result: math.nan, "own returned nan, must return a finite number"),
        (lambda result: None, "own returned None, must return a finite number"),
    ):
        value, why = Guarded("own", own=Measure("odd_m", "odd", function))(run)
        assert (value, why) == (None, words)
    time.sleep(0.1)
    assert threading.active_count() == before  # the endless loop was ended
    assert Guarded("own", own=Measure("odd_m", "odd", lambda result: 2))(run) == (2.0, "")


@pytest.mark.slow
def test_workers_compute_the_same_scores() -> None:
    asked = Asked("flat", "speed", ("worm.mass_kg=0.12",), (), ("worm.spring_N=20:30",), "segments")
    trials = trials_of(*asked)
    choices = [trials.space.choice(trials.space.spread(np.array([0.6, 0.5, 0.5, x]))) for x in (0.2, 0.9)]
    with scores_by(chosen(workers=1), asked) as of:
        assert of(choices) == trials.scores(choices)


def test_a_scheduler_needs_workers_with_one_thread_each() -> None:
    def wait(count: int, timeout: float) -> None:
        raise TimeoutError

    with pytest.raises(SceneError, match="has had no worker for 600 s; 'dask worker ADDRESS"):
        require_worker(SimpleNamespace(wait_for_workers=wait))  # type: ignore[arg-type]
    many = SimpleNamespace(wait_for_workers=lambda count, timeout: None, nthreads=lambda: {"tcp://127.0.0.1:2": 4})
    with pytest.raises(SceneError, match="has 4 threads, must have 1"):
        require_worker(many)  # type: ignore[arg-type]


def test_limits_and_goals_are_explained() -> None:
    limit = limit_of("roll_max_deg <= 5")
    assert (limit.measure, limit.greatest, limit.bound) == ("roll_max_deg", True, 5.0)
    for text, words in (
        ("roll_max_deg<5", "must be a measure and a bound"),
        ("roll_max_deg<=x", "must be a measure and a bound"),
        ("roll_deg<=5", "no measure 'roll_deg'; did you mean"),
    ):
        with pytest.raises(SceneError, match=words):
            limit_of(text)
    with pytest.raises(SceneError, match=r"got 'sped', must be one of robust, speed.*; did you mean 'speed'"):
        goal_of("sped")
    assert [each.bound for each in goal_of("speed", ["roll_max_deg<=5"]).limits] == [5.0]
    assert len(goal_of("speed", ["speed_bl_s>=0.05"]).limits) == 2


def test_values_are_those_of_single_runs_and_limits_rank_the_others() -> None:
    trials = Trials("flat", (), goal_of("speed", ["speed_bl_s>=0.04"]))
    gaits = [Periodic(amplitude=0.2, period=2.0, waves=waves) for waves in (1.0, 0.5, 2.0)]
    gaits.append(Periodic(amplitude=0.2, period=2.0, direction="direct"))
    scores = trials.scores([Choice(gait) for gait in gaits])
    for gait, score in zip(gaits, scores, strict=True):
        runs = [
            w.simulate(trials.base.worm, w.Plane(), w.Friction(), actuation=gait, duration=2.0 * waves)
            for waves in (WAVES, SURE_WAVES)
        ]
        values = [run.summary()["speed_bl_s"] for run in runs]
        assert min(abs(score.value - value) for value in values) < 1e-12
        assert score.cost == -score.value if score.value >= 0.04 else score.cost > BROKEN
    slow = [score for score in scores if score.value < 0.04]
    assert len(slow) >= 2
    by_cost = sorted(slow, key=lambda each: each.cost)
    assert by_cost == sorted(slow, key=lambda each: -each.value)


def test_the_robust_value_is_the_worst_ratio_to_the_own_gait() -> None:
    trials = Trials("flat", (), goal_of("robust"))
    own = trials.base.actuation
    (score,) = trials.scores([Choice(Periodic(amplitude=0.2, period=2.0, waves=1.0))])
    assert score.value == pytest.approx(1.0, abs=0.1)  # this wave is the gait of the scene, of fewer waves
    ratios = []
    gait = Periodic(amplitude=0.2, period=2.0, waves=0.5)
    for ground in GROUNDS:
        run, plain = (
            w.simulate(trials.base.worm, w.Plane(), ground.of(w.Friction()), actuation=each, duration=12.0)
            for each in (gait, own)
        )
        ratios.append(run.summary()["speed_bl_s"] / plain.summary()["speed_bl_s"])
    (score,) = trials.scores([Choice(gait)])
    assert score.value == pytest.approx(min(ratios), rel=0.05)


def test_a_ground_where_the_own_gait_has_no_value_counts_too() -> None:
    goal = replace(goal_of("robust"), measure=Measure("own_m", "own", lambda result: result.own), limits=())
    trials = Trials("flat", (), goal)
    trials.__dict__["own"] = (0.1, math.nan, 0.1)
    runs = [SimpleNamespace(status=w.Status.DONE, own=value) for value in (0.1, -0.05, 0.1)]
    assert trials._score(runs).value == pytest.approx(-0.05 / (UNREACHED * 0.1))  # type: ignore[arg-type]


def test_a_run_that_cannot_begin_or_end_is_a_failed_candidate_only() -> None:
    free = [free_of("worm.mass_kg=0.1:1000")]
    trials = Trials("flat", (), goal_of("speed"), free)
    fine, heavy = (Choice(Periodic(amplitude=0.2), (f"worm.mass_kg={mass}",)) for mass in (0.1, 900.0))
    scores = trials.scores([heavy, fine])
    assert scores[0].cost == FAILED
    assert math.isnan(scores[0].value)
    assert scores[1].value > 0.03


def test_amplitude_and_period_can_be_free_and_other_keys_of_the_gait_cannot() -> None:
    trials = Trials("flat", (), goal_of("speed"), [free_of("gait.amplitude=0.1:0.4")])
    small, large = (trials.scores([Choice(Periodic(), (f"gait.amplitude={a}",))])[0].value for a in (0.1, 0.3))
    assert large > 2.0 * small > 0.0
    with pytest.raises(SceneError, match=r"--over: got 'gait.wavelength', must be gait.amplitude or gait.period_s"):
        Trials("flat", (), goal_of("speed"), [free_of("gait.wavelength=0.5:2")])


def quadratic(choices: list[Choice]) -> list[Score]:
    """Costs with a single minimum: duties of 0.3, and weights of 0.6."""
    costs = [
        float(np.sum((np.asarray(c.gait.duty) - 0.3) ** 2) + np.sum((np.asarray(c.gait.weight) - 0.6) ** 2))
        for c in choices
    ]
    return [Score(cost, -cost) for cost in costs]


def found(path: Path, of=quadratic, budget: int = 900, seed: int = 1, tell=lambda runs, best: True) -> Found:
    return search(SPACE, of, seed, budget, Log(path, {"seed": seed}), tell, simple=False)


@pytest.fixture(scope="module")
def _cma() -> None:
    pytest.importorskip("cma")


@pytest.mark.usefixtures("_cma")
def test_the_search_finds_a_minimum_that_no_simple_gait_has(tmp_path: Path) -> None:
    first = found(tmp_path / "log")
    assert first.simple.score.cost >= 6 * 0.4**2  # a simple gait has the weight 1
    assert first.best.score.cost < 0.05 * first.simple.score.cost
    assert len(first.costs) <= 900
    assert first.costs.min() == first.best.score.cost


@pytest.mark.usefixtures("_cma")
def test_a_search_from_a_gait_keeps_it_until_there_is_a_better_one() -> None:
    start = SPACE.spread(np.array([0.6, 0.25, 0.5]))
    (score,) = quadratic([SPACE.choice(start)])
    began = search(SPACE, quadratic, 1, 1, Log(None, {}), lambda runs, best: True, simple=False, start=start)
    assert began.best.score == score
    more = search(SPACE, quadratic, 1, 600, Log(None, {}), lambda runs, best: True, simple=False, start=start)
    assert more.costs[0] == score.cost
    assert more.best.score.cost < 0.2 * score.cost


@pytest.mark.usefixtures("_cma")
def test_a_front_has_a_gait_for_each_speed_none_worse_than_a_faster_one(
    worm3d, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(front, "SIMPLE_RUNS", 28)
    given = ("optimise", "flat", "--goal", "cost", "--front", "0.03,0.045,9", "--budget", 42, "--out", "front")
    ended = worm3d(*given)
    assert ended.code == 0, ended.err
    rows = [line.split("|")[1:-1] for line in (tmp_path / "front" / "front.md").read_text().splitlines() if "|" in line]
    fast, slow = ([float(cell) for cell in row[:3]] for row in rows[2:])  # no gait reaches 9 BL/s
    assert (fast[0], slow[0]) == (0.045, 0.03)
    assert fast[1] > 0.044
    assert slow[1] > 0.029
    assert slow[2] <= 1.02 * fast[2]
    assert {path.name for path in (tmp_path / "front").glob("[a-z]*")} == {
        *("front.md", "front.png", "gait_0.03.toml", "gait_0.045.toml")
    }
    ended = worm3d(*given[:5], "fast", "--out", "other")
    assert ended.code == 2
    assert "--front: got 'fast', must be minimum speeds in body lengths/s, such as 0.03,0.06,0.1" in ended.err


@pytest.mark.usefixtures("_cma")
def test_a_stopped_search_goes_on_bit_for_bit(tmp_path: Path) -> None:
    whole, counted = found(tmp_path / "whole", budget=500), [0]

    def stops(runs: int, best: Score) -> bool:
        return runs < 300

    assert found(tmp_path / "log", budget=500, tell=stops).why == "it was stopped"
    kept = (tmp_path / "log").read_text().splitlines()
    (tmp_path / "log").write_text("\n".join(kept[:-3]) + "\n")  # as if a generation had been lost in part

    def counting(choices: list[Choice]) -> list[Score]:
        counted[0] += len(choices)
        return quadratic(choices)

    again = found(tmp_path / "log", counting, budget=500)
    assert_array_equal(again.costs, whole.costs)
    assert_array_equal(again.best.at, whole.best.at)
    assert counted[0] == len(whole.costs) - (len(kept) - 1) + searches.POPULATION
    assert (tmp_path / "log").read_text() == (tmp_path / "whole").read_text()
    with pytest.raises(SceneError, match="belongs to a search with other settings"):
        Log(tmp_path / "log", {"seed": 2})


@pytest.mark.usefixtures("_cma")
def test_a_search_without_progress_stops(tmp_path: Path) -> None:
    flat = found(tmp_path / "log", lambda choices: [Score(1.0, -1.0) for _ in choices], budget=2000)
    starts = 1 + searches.STARTS
    assert 0 <= len(flat.costs) - searches.SIMPLE_RUNS - starts * searches.PATIENCE < starts * searches.POPULATION


def test_the_verdicts_follow_their_rules() -> None:
    trials = Trials("flat", (), goal_of("speed"))
    best = Best(trials.space.spread(np.array([0.6, 0.5, 0.5])), Score(-0.06, 0.06))
    card = Card(trials, [Found(0, best, best, np.array([-0.06]), "it was stopped")])

    def sentences(**changed: Left) -> str:
        rows = [changed.get(each.name, Left(each.name, 0.1, 1.0, 0.1, 0.0, 1.0)) for each in CONDITIONS]
        return " ".join(card.verdict_sentences(rows))

    assert sentences().startswith("none of the rules")
    assert "**glides**" in sentences(**{PERIOD: Left(PERIOD, 0.08, 0.8, 0.1, 0.0, 1.0)})
    assert "**needs anisotropy**" in sentences(**{WEAK: Left(WEAK, 0.05, 0.5, 0.1, 0.0, 1.0)})
    assert "**slides back" in sentences(**{HALF: Left(HALF, -0.01, -0.1, 0.1, 0.0, 1.0)})
    assert "**tips**" in sentences(**{HALF: Left(HALF, 0.1, 1.0, 0.1, 30.0, 1.0)})
    assert "**tips**" in sentences(**{HALF: Left(HALF, math.nan, math.nan, 0.1, math.nan, math.nan)})


def test_a_gait_file_gives_the_same_gait_and_mistakes_are_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    gait = SPACE.choice(np.random.default_rng(5).random(SPACE.spread(np.ones(3)).size)).gait
    (tmp_path / "gait.toml").write_text(fragment(gait, "a gait", ["worm.mass_kg=1"]))
    read = gait_of(load_scene("flat", ["gait=gait.toml"]).settings)
    for name in ("amplitude", "period", "phase", "duty", "sharpness", "weight"):
        assert_array_equal(getattr(read, name), getattr(gait, name))
    (tmp_path / "own").mkdir()
    (tmp_path / "own" / "scene.toml").write_text('model = "worm"\ngait = "near.toml"\n')
    (tmp_path / "own" / "near.toml").write_text(fragment(gait, "a gait", []))
    assert_array_equal(gait_of(load_scene("own/scene.toml").settings).duty, gait.duty)
    slow = gait_of(load_scene("flat", ["gait.wavelength=3", "gait=gait.toml", "gait.period_s=4"]).settings)
    assert slow.period == 4.0
    assert_array_equal(slow.duty, gait.duty)
    near = gait_of(load_scene("own/scene.toml", ["gait.amplitude=0.1"]).settings)
    assert near.amplitude == 0.1
    with pytest.raises(SceneError, match=r"gait: .*lost.toml.*no such file"):
        load_scene("flat", ["gait=lost.toml"])
    (tmp_path / "wrong.toml").write_text("[worm]\nsegments = 4\n")
    with pytest.raises(SceneError, match=r"gait: the file 'wrong.toml' has no section \[gait\]"):
        load_scene("flat", ["gait=wrong.toml"])


@pytest.mark.slow
@pytest.mark.usefixtures("_cma")
def test_the_command_writes_a_gait_that_runs_and_a_card(worm3d, tmp_path: Path) -> None:
    given = ("optimise", "flat", "--goal", "speed", "--budget", 28, "--searches", 1, "--free", "waves", "--out", "best")
    ended = worm3d(*given)
    assert ended.code == 0, ended.err
    assert {path.name for path in (tmp_path / "best").iterdir()} >= {"card.md", "card.html", "gait.toml", "gait.png"}
    card = (tmp_path / "best" / "card.md").read_text()
    for words in ("best simple gait", PERIOD, "confirmed", "Where the work goes"):
        assert words in card
    assert "data:image/png;base64," in (tmp_path / "best" / "card.html").read_text()
    scores = [json.loads(line) for line in (tmp_path / "best" / ".worm3d-search-0.jsonl").read_text().split("\n")[1:-1]]
    best = max(float(value) for _, value, _ in scores)
    more = worm3d(*given[:5], 42, *given[6:])  # goes on in a folder with results
    assert more.code == 0, more.err
    assert (tmp_path / "best" / ".worm3d-search-0.jsonl").read_text().count("\n") == 43
    ran = worm3d("run", "flat", "-o", "gait=best/gait.toml", "-o", "run.duration_s=12", "--out", "again")
    assert ran.code == 0
    summary = json.loads((tmp_path / "again" / "summary.json").read_text())
    assert summary["speed_bl_s"] == pytest.approx(best, rel=0.03)


@pytest.mark.usefixtures("_cma")
def test_two_searches_in_python_give_the_better_gait_and_its_card() -> None:
    card = w.optimise("flat", "speed", budget=28, free="waves")
    values = [each.best.score.value for each in card.found]
    assert len(values) == 2
    assert card.best.best.score.value == max(values)
    rows = card.measure()
    assert rows[0].kept == 1.0
    assert rows[0].value == pytest.approx(2.0 * max(values), rel=0.03)  # two seconds a wave
    assert card.confirmed is not None
    assert card.confirmed.error_estimate is not None


@pytest.mark.parametrize(
    ("given", "complaint"),
    [
        (("path_line",), "must be a scene of the model 'worm', with a gait; is of 'worm_control'"),
        (("flat", "--goal", "climb", "--free", "legs"), "free: got 'legs', must be one of segments, waves"),
        (("flat", "--goal", "no_module:measure"), "--goal: "),
        (("flat", "--over", "worm.colour=1:2"), "worm.colour"),
        (("flat", "--front", "0.05", "--workers", 2), "--front: got --free, --searches, --workers or --scheduler too"),
    ],
)
@pytest.mark.usefixtures("_cma")
def test_wrong_options_are_sentences(worm3d, given: tuple[str, ...], complaint: str) -> None:
    ended = worm3d("optimise", *given, "--budget", 14)
    assert ended.code == 2
    assert complaint in ended.err
    assert "Traceback" not in ended.err


def test_goals_have_measures_with_values_in_a_plain_run() -> None:
    trials = Trials("slope_5", (), GOALS["climb"])
    run = w.simulate(
        **{name: getattr(trials.base, name) for name in ("worm", "world", "ground", "actuation")}, duration=8
    )
    for goal in GOALS.values():
        assert math.isfinite(goal.value(run))
    rise = (run.com[-1, 2] - run.com[400, 2]) / 4.0 / run.worm.length
    assert GOALS["climb"].value(run) == pytest.approx(rise, rel=1e-9)
