import json
import math

import numpy as np
import pytest

from scenes.models.loading import load_scene
from scenes.studies.validate import animals, powered, report, robots
from scenes.studies.validate.animals import earthworm
from scenes.studies.validate.comparison import ABOVE_1, BELOW_1, Comparison, Source
from scenes.studies.validate.measures import (
    VALIDATION_FOLDER,
    Exponent,
    Figure,
    Ratio,
    StoppedError,
    figures,
    run_figures,
)
from scenes.studies.validate.rows import Row


@pytest.mark.parametrize(
    "name", sorted({c.measure.scene for c in (*robots.ROBOT_COMPARISONS, *animals.ANIMAL_COMPARISONS)})
)
def test_scenes_are_right_and_say_what_they_are(name):
    path = VALIDATION_FOLDER / f"{name}.toml"
    assert load_scene(path if path.exists() else name).settings.title
    assert not path.exists() or path.read_text().startswith("# ")
    assert not path.exists() or "Not published" in path.read_text()


def comparison(measure, published=None, band=(1.0, math.inf), kind="robot", **more):
    return Comparison("x", measure, published, band, Source("here", "C", kind), "A note.", **more)


class Fixed:
    """Measure that is known."""

    scene = "none"

    def __init__(self, value):
        self.value = value

    def __call__(self, changes=()):
        if changes == ("stops",):
            raise StoppedError("folded")
        return self.value + len(changes)


def test_row_with_spread():
    row = comparison(Fixed(2.0), unknown=(("a",), ("a", "b"), ("stops",)), others=(Fixed(0.5),)).row(quick=False)
    assert (row.model, row.spread, row.ok) == (2.0, (0.5, 4.0), True)
    assert row.note.endswith("With 1 of 4 other values the run does not come to its end.")
    assert comparison(Fixed(2.0), unknown=(("a",),)).row(quick=True).spread is None


def test_run_that_stops():
    class Stops(Fixed):
        def __call__(self, changes=()):
            raise StoppedError("folded")

    row = comparison(Stops(0.0), trend=True).row(quick=False)
    assert math.isnan(row.model)
    assert not row.ok
    assert row.sign_agrees is None
    assert row.note == "the model gives nothing: folded. A note."
    assert row.to_dict()["model"] is None


@pytest.mark.parametrize(
    ("model", "published", "band", "agrees"),
    [
        (1.1, None, ABOVE_1, True),
        (1.04, None, ABOVE_1, False),
        (0.9, None, ABOVE_1, False),
        (0.9, None, BELOW_1, True),
        (0.96, None, BELOW_1, False),
        (-0.9, None, BELOW_1, False),
        (1.1, 3.0, (1.5, 6.0), True),
        (0.9, 3.0, (1.5, 6.0), False),
        (0.9, 0.4, (0.2, 0.8), True),
        (0.99, 0.4, (0.2, 0.8), False),
    ],
)
def test_sign_of_a_trend(model, published, band, agrees):
    assert comparison(Fixed(model), published, band, trend=True).row(quick=True).sign_agrees is agrees


@pytest.mark.parametrize(
    ("others", "agreement", "sign"),
    [((0.4, 0.7), "agrees", True), ((-2.8, 0.7), "depends", False), ((0.3, 0.9), "depends", True)],
)
def test_a_spread_that_leaves_the_band_is_no_agreement(others, agreement, sign):
    row = comparison(Fixed(0.5), 0.4, (0.2, 0.8), trend=True, others=tuple(map(Fixed, others))).row(quick=False)
    assert (row.ok, row.agreement, row.sign_agrees) == (True, agreement, sign)
    assert (row.to_dict()["agreement"], row.to_dict()["counts"]) == (agreement, True)


def test_speeds_whose_sign_is_published_have_it_over_their_spread():
    told = {"band": (0.0, math.inf), "unit": "m/s", "trend": True}
    assert comparison(Fixed(1e-6), **told).row(quick=True).sign_agrees is True
    assert comparison(Fixed(1e-6), **told, others=(Fixed(-1e-7),)).row(quick=False).sign_agrees is False


def test_rows_that_were_fitted_or_follow_from_an_input_say_so():
    rows = [*robots.ROBOT_COMPARISONS, *animals.ANIMAL_COMPARISONS, *powered.POWERED_COMPARISONS]
    assert {c.name for c in rows if c.standing == "fitted"} == {c.name for c in rows if c.source == robots.LOAD_FRAME}
    assert {c.name for c in rows if c.source.kind == "other model"} == {
        c.name for c in rows if c.source in (robots.RIDDLE, robots.KANDHARI)
    }
    given = [c for c in rows if c.standing == "input"]
    assert {c.name.partition(":")[2] for c in given} == {
        " speed",
        " exponent of the speed over the mass",
        " exponent of the stride over the mass",
    }


@pytest.mark.parametrize(("what", "given"), [("speed", 0.34 - 0.07), ("stride", 0.34)])
def test_exponents_of_the_earthworm_are_those_that_it_was_given(what, given):
    row = next(c for c in animals.ANIMAL_COMPARISONS if c.name == f"Earthworm: exponent of the {what} over the mass")
    assert row.measure() == pytest.approx(given, abs=0.002)


def test_measures():
    assert Ratio(Fixed(6.0), Fixed(2.0))() == 3.0
    powers = {m: Fixed(2.0 * m**0.3) for m in (0.1, 1.0, 9.0)}
    assert Exponent(powers)() == pytest.approx(0.3)
    with pytest.raises(StoppedError, match="no exponent"):
        Exponent({1.0: Fixed(1.0), 2.0: Fixed(-1.0)})()
    with pytest.raises(StoppedError, match=r"worm\.mass_kg"):
        figures("cmmworm", ("worm.mass_kg=-1",))
    assert figures("load_frame", ())["work_lost_share"] == pytest.approx(0.91, abs=0.05)
    assert figures("mesh_segment", ())["work_lost_share"] == pytest.approx(0.91, abs=0.01)
    assert figures("mesh_segment", ())["peak_force_N"] == pytest.approx(16.0, rel=0.02)
    with pytest.raises(StoppedError, match="no cost_of_transport"):
        Figure("cost_of_transport", "cmmworm", ("gait.direction=direct",))()


def test_own_changes_win():
    own = Figure("speed_m_s", "cmmworm", ("worm.spring_N=200",))
    assert own(("worm.spring_N=400",)) == own()
    assert own(("friction.forward=0.2",)) != own()


def test_speed_scales_with_the_worm():
    """At the same strain and shape the model is kinematic: the stride in body lengths hardly knows the mass."""
    strides = [Figure("stride_BL", "earthworm", earthworm(grams))() for grams in (1.0, 8.0)]
    assert strides[1] == pytest.approx(strides[0], rel=0.02)
    assert earthworm(1.0)[:2] == ("worm.mass_kg=0.001", "worm.length_m=0.102")


def test_stride_is_towards_the_head_of_the_last_whole_periods():
    """The first half of the run, where the worm slips back, does not count; nor does the way across the body."""
    time = np.arange(0.0, 43.01, 1.0)
    along = np.where(time < 23.0, -time, 0.5 * (time - 23.0) - 23.0)
    record = RecordOf(time, along[:, None] * [0.0, 1.0, 0.0] + time[:, None] * [0.3, 0.0, 0.0])
    found = run_figures(record)
    assert found == pytest.approx({"stride_m": 0.5 * 4.0, "stride_BL": 1.0, "speed_m_s": 0.5, "speed_BL_s": 0.25})


class RecordOf(dict):
    """What `run_figures` reads of a record: a worm that lies along y, tail first."""

    scene = "[gait]\nperiod_s = 4.0\n[worm]\nlength_m = 2.0\n"

    def __init__(self, time, com):
        joints = np.tile([[0.0, 0.0, 0.0], [0.0, 2.0, 0.0]], (len(time), 1, 1))
        super().__init__(time=time, com=com, joints=joints)


def test_mirrored_wave_goes_backward():
    """The symmetric worm on isotropic ground goes as far back under the mirrored wave."""
    there, back = (Figure("stride_m", "cmmworm", (f"gait.direction={way}",))() for way in ("retrograde", "direct"))
    assert there > 0.02
    assert back == pytest.approx(-there, rel=1e-6)


def test_command(tmp_path, capsys, monkeypatch):
    some = [
        comparison(Fixed(2.0), trend=True),
        comparison(Fixed(0.5), 1.0, (0.8, 1.2), unknown=(("a",),)),
        comparison(Fixed(1.0), 1.0, (0.8, 1.2), kind="animal", unknown=(("a",),)),
        comparison(Fixed(1.0), 1.0, (0.8, 1.2), standing="fitted"),
    ]
    exact = [Row("y", 1.0 + 2e-7, 1.0, 1e-6, "here"), Row("z", math.nan, 0.0, 1e-6, "here", "folded")]
    chapters = {"Some": lambda quick: (c.row(quick=quick) for c in some), "Exact": lambda quick: iter(exact)}
    monkeypatch.setattr(report, "CHAPTERS", chapters)
    assert report.run(tmp_path / "out", quick=False, force=False, quiet=False) == 0
    said = capsys.readouterr().out
    assert "misses  x" in said
    for line in (
        "robot: 1 of 2 agree\n",
        "animal: 0 of 1 agree, 1 more only for the values assumed in the scene",
        "closed form: 1 of 2 agree",
        "of them trends: 1 of 1 have the right sign, over their whole spreads",
        "not counted, fitted or following from an input: 1",
    ):
        assert line in said
    content = json.loads((tmp_path / "out" / "validate.json").read_text())
    rows = content["rows"]
    assert content["counts"] == {
        "robot": {"rows": 2, "agrees": 1, "depends": 0},
        "animal": {"rows": 1, "agrees": 0, "depends": 1},
        "closed form": {"rows": 2, "agrees": 1, "depends": 0},
    }
    assert [row["standing"] for row in rows] == [*["prediction"] * 3, "fitted", *["verification"] * 2]
    assert [(row["model"], row["published"], row["ratio"], row["ok"]) for row in rows] == [
        (2.0, None, None, True),
        (0.5, 1.0, 0.5, False),
        (1.0, 1.0, 1.0, True),
        (1.0, 1.0, 1.0, True),
        (1.0 + 2e-7, 1.0, 1.0 + 2e-7, True),
        (None, 0.0, None, False),
    ]
    text = (tmp_path / "out" / "validate.md").read_text()
    assert "| misses | x | robot | prediction | 0.5 | 1 | 0.5 | 0.8 to 1.2 | 0.5 to 1.5 |" in text
    assert "| fitted | x | robot | fitted | 1 | 1 | 1 | 0.8 to 1.2 |" in text
    assert "| agrees | y | closed form | verification | 1 | 1 | 1 + 2e-07 | within 1e-06 |" in text
    assert "chosen to meet the published numbers only in fitted rows" in text
    assert "\n![Model over published, and bands](validate.png)\n\n## Some\n" in text
    quick = report.verdict(report.Found({"Some": [c.row(quick=True) for c in some]}, quick=True))
    assert "animal: 1 of 1 agree" in quick
    assert "of them trends: 1 of 1 have the right sign" in quick
    assert quick[-1].startswith("without the spreads")
    assert (tmp_path / "out" / "validate.png").stat().st_size > 1000


def test_periods_are_tried_until_two_in_a_row_are_slower(monkeypatch):
    speeds = {10.0: 1.0, 7.0: 3.0, 5.0: 2.0, 3.5: 4.0, 2.5: 3.9, 1.7: 3.0}
    tried = []

    def figure(name, scene, told):
        period = float(told[0].partition("=")[2])
        tried.append(period)
        return lambda changes: speeds[round(period, 6)]

    monkeypatch.setattr(powered, "Figure", figure)
    assert powered.Fastest("none", 10.0)() == 4.0
    assert tried == pytest.approx(list(speeds))
