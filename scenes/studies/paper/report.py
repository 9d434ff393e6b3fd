"""Run the paper's study and write the results: `paper.json`, `report.md`, the figures and the animation."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from planar import linkage
from planar.animation import Movie
from planar.published import Run
from scenes.records.text import Column, json_bytes
from scenes.running.packages import versions
from scenes.running.report import Block, Heading, Items, Picture, Report, Table, report_study
from scenes.running.terminal import busy, each
from scenes.studies.paper import cases
from scenes.studies.paper.cases import PAPER_PERIODS_S, SEGMENTS, CorrectedRow, GroundKey, Key, Overstatement, Row
from scenes.studies.paper.claims import Claim, claims
from scenes.studies.paper.corrected_claims import corrected_claims
from scenes.studies.paper.differences import Difference, differences
from scenes.studies.paper.figures import corrected_figures, published_figures

MOVIE = "animation_6_segments.gif"

PUBLISHED = {
    "n": Column("n"),
    "T_wave [s]": Column("T_wave_s", "g"),
    "distance [m]": Column("reported_distance_m", ".6f"),
    "work [J]": Column("work_J", ".6f"),
    "total CoT [J/m]": Column("total_cot_J_per_m", ".4f"),
    "true displacement [m]": Column("true_displacement_m", ".6f"),
}
CORRECTED = {
    "n": Column("n"),
    "T_wave [s]": Column("T_wave_s", "g"),
    "ground": Column("ground"),
    "friction": Column("law"),
    "distance [m]": Column("distance_m", ".4f"),
    "work [J]": Column("work_contract_J", ".4f"),
    "friction loss [J]": Column("work_friction_J", ".4f"),
    "CoT": Column("cost_of_transport", ".3f", none="none"),
    "BL/wave": Column("speed_BL_per_wave", ".4f", none="none"),
}
OVERSTATED = {
    "T_wave [s]": Column("T_wave_s", "g"),
    "set-valued [m]": Column("set_valued_distance_m", ".4f"),
    "threshold [%]": Column("threshold_percent", ".0f", none="none"),
    "clamped [%]": Column("clamped_percent", ".0f", none="none"),
}

PRINTED = {
    3: (0.176235, 1.062124, 6.0267, 0.332435),
    4: (0.529555, 2.017679, 3.8101, 0.852656),
    5: (0.556600, 1.876227, 3.3709, 1.078139),
    6: (0.739210, 4.547915, 6.1524, 1.250650),
    7: (0.534746, 2.023594, 3.7842, 1.021245),
}
"""Output of the author's program at T_wave = 2 s, by number of segments: distance [m], work [J], total cost of
transport [J/m] and true displacement [m]."""


@dataclass(frozen=True)
class Study:
    """Results of the published program, and of the corrected worm."""

    rows: Sequence[Row]
    claims: Sequence[Claim]
    differences: Sequence[Difference]
    corrected: Sequence[CorrectedRow]
    corrected_claims: Sequence[Claim]
    overstatements: Sequence[Overstatement]


def run(out: Path | None, force: bool, quiet: bool) -> int:
    """Make all runs, write the report and return the exit code. The options are those of the command.

    Raises
    ------
    SceneError
        The folder cannot be used, or the disc refused a file.
    """

    def study(folder: Path) -> Report:
        runs = each("the paper's runs", cases.published_keys(), cases.published_run, "run", quiet=quiet)
        corrected = each("the corrected worm's runs", cases.corrected_keys(), cases.corrected_run, "run", quiet=quiet)
        with busy("judging the claims", quiet=quiet):
            found = _study(runs, corrected)
        with busy("drawing", quiet=quiet):
            drawn = published_figures(runs) | corrected_figures(corrected, found.overstatements)
        pictures = {f"{stem}.png": figure for stem, figure in drawn.items()}
        return report(found, {**pictures, MOVIE: _movie(runs[6, 2.0])})

    return report_study("paper", study, out, force=force, quiet=quiet)


def _study(runs: Mapping[Key, Run], corrected: Mapping[GroundKey, linkage.Run]) -> Study:
    rows, corrected_rows = cases.published_rows(runs), cases.corrected_rows(corrected)
    return Study(
        rows=rows,
        claims=claims(runs, rows),
        differences=differences(runs[6, 2.0]),
        corrected=corrected_rows,
        corrected_claims=corrected_claims(corrected, corrected_rows),
        overstatements=cases.overstatements(lambda key: corrected[key].distance),
    )


def _movie(run: Run) -> Movie:
    net = run.net
    activation = np.vstack([run.activation[:1], run.activation])
    return Movie(run.time, run.q[:, net.main], run.q[:, net.top], run.q[:, net.bottom], activation, run.ground)


def report(study: Study, pictures: Mapping[str, Figure | Movie]) -> Report:
    """Return the report. Its page shows all pictures."""
    page = [*_published(study), *_corrected(study), Heading("Figures")]
    page += [Picture(name, name.rpartition(".")[0].replace("_", " ")) for name in pictures]
    return Report(
        said=list(_said(study)),
        pages={"report.md": page},
        files={"paper.json": json_bytes({**asdict(study), "versions": versions()})},
        pictures=pictures,
    )


def _published(study: Study) -> Iterator[Block]:
    yield Heading("The paper's results, from our own runs", 1)
    yield (
        "Distance, work and cost of transport are counted as the author's program counts them; the true displacement "
        "is the mean displacement of the main nodes. The program inverts the sign of the elastic force: these numbers "
        "are a regression target, not physics."
    )
    yield from _tables(study.rows)
    yield Heading("What the program prints at T_wave = 2 s, ours, and ours less the printed")
    columns = {title: column for title, column in PUBLISHED.items() if title != "T_wave [s]"}
    printed = [row for row in study.rows if row.T_wave_s == 2.0 and row.n in PRINTED]
    yield Table(tuple(columns), [tuple(_compared_cells(row, list(columns.values()))) for row in printed])
    yield "The program prints six decimals, the total CoT to four."
    yield from (Heading("The paper's claims"), _judged(study.claims))
    yield Heading("Where text and program differ")
    yield Items(
        [
            f"**{each.what}**. Text: {each.text}. Program: {each.program}. Effect: {each.effect}."
            for each in study.differences
        ]
    )


def _compared_cells(row: Row, columns: Sequence[Column]) -> Iterator[str]:
    yield f"{row.n}"
    for column, printed in zip(columns[1:], PRINTED[row.n], strict=True):
        off = column.value(row) - printed
        yield f"{printed:{column.form}} / {column.cell(row)} ({off:+.1e})"


def _corrected(study: Study) -> Iterator[Block]:
    yield Heading("The corrected worm")
    yield (
        "The same cases with the physics right: rigid rhombi, Table I's mass, torsion and hinges, the contraction as "
        "a commanded rest length, friction 0.03 and 0.20. CoT is the net work of the actuators over weight and "
        "distance; none: the worm did not move forward. In contact the friction is set-valued with anchors, or for "
        "comparison the paper's threshold (P10); clamped, the joints' heights are held, with (P9) and (P10)."
    )
    yield Table.of(CORRECTED, study.corrected)
    yield "What the distance of six segments is overstated by, against set-valued friction in contact:"
    yield Table.of(OVERSTATED, study.overstatements)
    yield from (Heading("The paper's claims, by the corrected worm in contact"), _judged(study.corrected_claims))


def _judged(claims: Sequence[Claim]) -> Items:
    return Items([f"**{c.verdict}**: {c.claim} ({c.source}). Evidence: {c.evidence}." for c in claims])


def _said(study: Study) -> Iterator[Block]:
    """Yield the printed blocks: the tables and the verdicts. The numbers behind the verdicts are in `report.md`."""
    yield from _tables(study.rows)
    yield from (Heading("The paper's claims"), _verdicts(study.claims))
    yield f"{len(study.differences)} differences between text and program, each with its effect, are in the report."
    yield from (Heading("The corrected worm"), Table.of(CORRECTED, study.corrected))
    percents = [(each.threshold_percent, each.T_wave_s) for each in study.overstatements]
    overstated = ", ".join(f"{'none' if by is None else f'{by:.0f} %'} at T = {T:g} s" for by, T in percents)
    yield f"Threshold friction overstates the distance of six segments by {overstated}."
    yield from (Heading("The paper's claims, by the corrected worm in contact"), _verdicts(study.corrected_claims))


def _verdicts(claims: Sequence[Claim]) -> Items:
    return Items([f"{c.verdict}: {c.claim}" for c in claims])


def _tables(rows: Sequence[Row]) -> Iterator[Block]:
    yield Heading("Table II: segments")
    yield Table.of(PUBLISHED, [r for r in rows if r.T_wave_s == 2.0 and r.n in SEGMENTS])
    yield Heading("Table III: wave period")
    by_period = sorted((r for r in rows if r.n == 6 and r.T_wave_s in PAPER_PERIODS_S), key=lambda r: r.T_wave_s)
    yield Table.of(PUBLISHED, by_period)
