"""The corrected worm in the paper's study: what is run, how it is compared, what follows for the claims."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from fnmatch import fnmatch
from itertools import pairwise

import numpy as np
import pytest
from numpy.testing import assert_allclose

from planar.linkage import Linkage, Run, simulate
from scenes.studies.paper import cases, corrected_claims
from scenes.studies.paper.cases import PAPER_PERIODS_S, SEGMENTS, CorrectedRow, GroundKey
from scenes.studies.paper.figures import corrected_figures

ROW = CorrectedRow(6, 2.0, "contact", "anchored", 0.1, 0.6, 0.01, 5.0, 8000.0, 0.01, 8.0, 0, "it ended")


@pytest.fixture(scope="module")
def brief_runs() -> dict[GroundKey, Run]:
    """Every run of the study, cut short."""
    return {
        (n, T, ground): simulate(
            Linkage(segments=n),
            cases.wave(n, T),
            duration=0.3,
            ground="clamped" if ground == "clamped" else "contact",
            friction_law="threshold" if ground == "threshold" else "anchored",
        )
        for n, T, ground in cases.corrected_keys()
    }


def test_the_papers_nine_cases_and_the_other_grounds_of_six_segments() -> None:
    keys = cases.corrected_keys()
    assert len(set(keys)) == len(keys) == 19
    assert [key for key in keys if key[2] == "anchored"][:5] == [(n, 2.0, "anchored") for n in SEGMENTS]
    for ground in ("anchored", "threshold", "clamped"):
        assert {T for n, T, g in keys if (n, g) == (6, ground)} == set(PAPER_PERIODS_S)


@pytest.mark.slow
def test_threshold_friction_and_clamping_overstate_the_distance() -> None:
    runs = {key: cases.corrected_run(key) for key in ((6, 2.0, "anchored"), (6, 2.0, "threshold"), (6, 2.0, "clamped"))}
    anchored, threshold, clamped = cases.corrected_rows(runs)
    assert_allclose(
        [anchored.distance_m, threshold.distance_m, clamped.distance_m], [0.0343, 0.0755, 0.3032], atol=1e-4
    )
    assert [(r.ground, r.law) for r in (anchored, threshold, clamped)] == [
        ("contact", "anchored"),
        ("contact", "threshold"),
        ("clamped", "threshold"),
    ]
    assert_allclose(anchored.cost_of_transport, runs[6, 2.0, "anchored"].cost_of_transport)
    assert_allclose(anchored.work_contract_J, 0.564, atol=1e-3)
    assert anchored.halved_steps == 0
    json.dumps(asdict(anchored), allow_nan=False)


def test_overstatement_in_percent_and_none_without_way_forward() -> None:
    distances = {"anchored": 0.1, "threshold": 0.17, "clamped": 0.3}
    (first, *_) = cases.overstatements(lambda key: distances[key[2]])
    assert_allclose([first.threshold_percent, first.clamped_percent], [70.0, 200.0])
    back = cases.overstatements(lambda key: -distances[key[2]])
    assert {each.threshold_percent for each in back} == {None}


@pytest.mark.parametrize(
    ("distances", "verdict"),
    [([1.0, 2.0, 3.0, 4.0, 3.0], "holds"), ([1.0, 2.0, 1.0, 4.0, 3.0], "does not hold")],
)
def test_verdict_on_the_number_of_segments(distances: list[float], verdict: str) -> None:
    rows = [replace(ROW, n=n, distance_m=d) for n, d in zip(SEGMENTS, distances, strict=True)]
    assert corrected_claims.segment_claims(rows)[0].verdict == verdict


def test_a_cost_without_a_value_neither_rises_nor_drops() -> None:
    costs = [1.0, 2.0, 3.0, None, 2.0]
    rows = [replace(ROW, n=n, cost_of_transport=cost) for n, cost in zip(SEGMENTS, costs, strict=True)]
    claim = corrected_claims.segment_claims(rows)[2]
    assert claim.verdict == "does not hold"
    assert claim.evidence == "n = 3: 1, 4: 2, 5: 3, 6: none, 7: 2"


def test_verdict_on_the_period() -> None:
    rows = [replace(ROW, T_wave_s=T, work_contract_J=1.0 / T) for T in PAPER_PERIODS_S]
    work, cumulative, cost = corrected_claims.period_claims(rows)
    assert (work.verdict, cumulative.verdict, cost.verdict) == ("holds", "does not hold", "does not hold")


def test_an_active_segment_shortens_and_widens() -> None:
    run = simulate(Linkage(), cases.wave(6, 2.0), duration=2.0)
    assert corrected_claims.mechanism_claim(run).verdict == "holds"
    wrong = simulate(Linkage(), lambda t: -cases.wave(6, 2.0)(t), duration=2.0)
    flipped = replace(wrong, steps=[[replace(p, end=replace(p.end, l_cmd=2 / 6 - p.end.l_cmd)) for p in parts]
                                    for parts in wrong.steps])  # fmt: skip
    assert corrected_claims.mechanism_claim(flipped).verdict == "does not hold"


@pytest.mark.slow
def test_the_further_runs_judge_torsion_mass_friction_and_wave(monkeypatch: pytest.MonkeyPatch) -> None:
    def brief(*arguments: object, **options: object) -> Run:
        return simulate(*arguments, duration=4.0, **options)  # type: ignore[arg-type]

    monkeypatch.setattr(corrected_claims, "simulate", brief)
    main = brief(Linkage(), cases.wave(6, 2.0))
    verdicts = {
        judge: getattr(corrected_claims, judge)(main)
        for judge in ("_torsion_claim", "_mass_claim", "_friction_claim", "_wave_claim")
    }
    assert {name: claim.verdict for name, claim in verdicts.items()} == {
        "_torsion_claim": "does not hold",
        "_mass_claim": "does not hold",
        "_friction_claim": "holds",
        "_wave_claim": "holds",
    }
    assert "0 steps halved" in verdicts["_torsion_claim"].evidence
    assert all(f"{k:g} J: " in verdicts["_torsion_claim"].evidence for k in corrected_claims.TORSIONS)
    assert "the run reached its end" in verdicts["_mass_claim"].evidence


def test_figures_are_told_from_the_papers_by_their_names(brief_runs: dict[GroundKey, Run]) -> None:
    over = cases.overstatements(lambda key: {"anchored": 0.1, "threshold": 0.17, "clamped": 0.3}[key[2]])
    drawn = corrected_figures(brief_runs, over)
    for number in (10, 11, 12, 13):
        assert len([stem for stem in drawn if stem.startswith(f"corrected_figure_{number}_")]) == 1
        assert not [stem for stem in drawn if fnmatch(stem, f"figure_{number}_*")]
    panels = drawn["friction_threshold_against_set_valued"].axes
    assert [axes.get_title() for axes in panels] == ["six segments, T = 2 s", "six segments, T = 5 s"]
    labels = [text.get_text() for text in panels[0].get_legend().get_texts()]
    assert labels == [
        "contact, set-valued friction",
        "contact, threshold friction (P10): +70 %",
        "clamped, (P9) and (P10): +200 %",
    ]
    com = drawn["corrected_figure_10_centre_of_mass_by_segments"].axes[0]
    for line, n in zip(com.lines, SEGMENTS, strict=True):
        x = brief_runs[n, 2.0, "anchored"].com[:, 0]
        assert_allclose(line.get_ydata(), x - x[0])
    cost = drawn["corrected_figure_13_cost_by_period"].axes[0]
    assert all(a >= b for line in cost.lines for b, a in pairwise(np.asarray(line.get_ydata())))
