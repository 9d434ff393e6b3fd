"""The paper's study: its verdicts follow from its numbers."""

from dataclasses import replace

import pytest
from numpy.testing import assert_allclose

from planar import published
from planar.published import Parameters
from scenes.paper import claims, differences, report, tables
from scenes.paper.corrected import CorrectedRow, Overstatement
from scenes.paper.tables import Row

ROW = Row(6, 2.0, 0.7, 4.5, 6.2, 1.2, 100.0)
CORRECTED = CorrectedRow(6, 2.0, "contact", "anchored", -0.1, 0.6, 0.01, None, 8000.0, 0.01, 8.0, 0, "it ended")
OVERSTATED = Overstatement(2.0, 0.03, 120.0, None)


def rows_by_segments(values: list[float]) -> list[Row]:
    return [replace(ROW, n=n, reported_distance_m=v) for n, v in zip(tables.SEGMENTS, values, strict=True)]


@pytest.mark.parametrize(
    ("values", "verdict"),
    [
        ([1.0, 2.0, 3.0, 4.0, 3.5], "holds"),
        ([1.0, 2.0, 1.5, 4.0, 3.5], "does not hold"),
        ([1.0, 2.0, 3.0, 4.0, 5.0], "does not hold"),
    ],
)
def test_verdict_on_the_number_of_segments(values: list[float], verdict: str) -> None:
    judged = claims._segment_claims(rows_by_segments(values))
    assert judged[0].verdict == verdict


def test_verdict_on_the_period() -> None:
    rows = [replace(ROW, T_wave_s=T, work_J=10.0 / T) for T in tables.PERIODS]
    work, _, per_metre = claims._period_claims(rows)
    assert work.verdict == "holds"
    assert per_metre.verdict == "does not hold", "equal values do not rise"


def test_verdicts_on_the_mechanism_see_through_the_sign() -> None:
    assert claims._mechanism_claim(published.simulate()).verdict == "holds only by the inverted sign"
    right = published.simulate(parameters=Parameters(elastic_sign=1.0))
    assert claims._mechanism_claim(right).verdict == "does not hold"


def test_the_differences_are_measured() -> None:
    run = published.simulate()
    by_name = {e.what: e.effect for e in differences._ENTRIES}
    assert by_name["centre of mass"](run) == "distance 0.739210 m instead of 1.250650 m"
    assert by_name["work"](run).startswith("work 4.547915 J instead of -0.899385 J")
    amplitude = published.simulate(parameters=Parameters(contraction_force=1.0))
    assert f"reported distance {amplitude.reported_distance:.6g} m" in by_name["amplitude"](run)
    assert "44% of the work" in by_name["predictor and corrector"](run)


def test_report_holds_every_row_claim_and_difference() -> None:
    rows = [replace(ROW, n=n) for n in tables.SEGMENTS] + [replace(ROW, T_wave_s=T) for T in tables.PERIODS if T != 2.0]
    claim = claims.Claim("the claim", "IV.A", "holds", "the evidence")
    difference = differences.Difference("thing", "the text", "the program", "the effect")
    study = report.Study(rows, [claim], [difference], [CORRECTED], [replace(claim, claim="another")], [OVERSTATED])
    text = report.markdown(study)
    assert text.count("| 6 |") == 7  # once in Table II, five times in Table III, once corrected
    assert "| 6 | 2 | contact | anchored | -0.1000 | 0.6000 | 0.0100 | none | 0.0100 |" in text
    assert "| 2 | 0.0300 | 120 % | none |" in text
    assert "* **holds**: another (IV.A). Evidence: the evidence." in text
    assert "* **holds**: the claim (IV.A). Evidence: the evidence." in text
    assert "* **thing**. Text: the text. Program: the program. Effect: the effect." in text
    lines = list(report.terminal_lines(study, 100))
    assert max(map(len, lines)) <= 100
    assert "  holds: another" in lines
    assert any(line.startswith("Threshold friction overstates the distance of six segments by 120 %") for line in lines)


def test_tables_hold_the_papers_runs_once_each() -> None:
    assert tables.keys() == [(3, 2.0), (4, 2.0), (5, 2.0), (6, 2.0), (7, 2.0), (6, 1.0), (6, 3.0), (6, 4.0), (6, 5.0)]
    (row,) = tables.rows({(3, 2.0): tables.simulate((3, 2.0))})
    assert_allclose(row.total_cot_J_per_m, 6.0267, rtol=0, atol=1e-4)
    assert_allclose(row.cumulative_cot_J_per_m, 1432.166, rtol=1e-6)
