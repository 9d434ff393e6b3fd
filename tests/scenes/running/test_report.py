"""Reports of studies: the page and the terminal show the same blocks, and the folder has what the last line names."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pytest
from matplotlib.figure import Figure

from scenes.language.errors import SceneError
from scenes.records.text import Column
from scenes.running.report import (
    Block,
    Heading,
    Items,
    Picture,
    Report,
    StudyStoppedError,
    Table,
    markdown,
    report_study,
    terminal_lines,
)
from scenes.running.runner import EXIT_CODES


@dataclass
class Row:
    name: str
    speed: float | None


COLUMNS = {"worm": Column("name"), "speed [mm/s]": Column("speed", ".1f", 1e3, none="none")}
BLOCKS: list[Block] = [
    Heading("Worms", 1),
    "Two worms ran.",
    Table.of(COLUMNS, [Row("a", 0.0123), Row("long", None)]),
    Items(["one is fast", "the other one stands"]),
    Items([]),
    Picture("worms.png", "both"),
]


def test_a_page_has_every_block_and_a_blank_line_between_them() -> None:
    assert markdown(BLOCKS) == (
        "# Worms\n\nTwo worms ran.\n\n| worm | speed [mm/s] |\n|---|---|\n| a | 12.3 |\n| long | none |\n\n"
        "* one is fast\n* the other one stands\n\n![both](worms.png)\n"
    )


def test_a_terminal_shows_all_but_pictures_with_blank_lines_around_tables() -> None:
    assert list(terminal_lines(BLOCKS)) == [
        "Worms",
        "Two worms ran.",
        "",
        "worm  speed [mm/s]",
        "   a          12.3",
        "long          none",
        "",
        "  one is fast",
        "  the other one stands",
    ]
    assert list(terminal_lines(["one two three", Items(["four five six"])], 10)) == [
        "one two",
        "    three",
        "  four",
        "    five",
        "    six",
    ]


def carried_out(report: Report, out: Path, **options: bool) -> int:
    return report_study("worms", lambda folder: report, out, **options)


def test_the_last_line_names_the_files_and_warnings_stand_apart(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    report = Report(
        said=["Two worms ran."],
        pages={"worms.md": BLOCKS},
        files={"worms.csv": b"name\n"},
        pictures={"worms.png": Figure()},
        warnings=["one stands"],
        exit_code=5,
    )
    out = tmp_path / "x"
    assert carried_out(report, out) == 5
    said, complaints = capsys.readouterr()
    assert said == f"Two worms ran.\nWritten to {out}: worms.md, worms.csv, worms.png\n"
    assert complaints == "warning: one stands\n"
    assert {path.name for path in out.iterdir()} == {"worms.md", "worms.csv", "worms.png"}
    assert (out / "worms.md").read_text() == markdown(BLOCKS)
    with pytest.raises(SceneError, match="not empty"):
        carried_out(report, out)
    assert carried_out(report, out, force=True, quiet=True) == 5
    assert capsys.readouterr() == ("", "warning: one stands\n")


def test_a_study_that_is_stopped_says_so_and_writes_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def study(folder: Path) -> Report:
        raise StudyStoppedError("Ctrl-C")

    assert report_study("worms", study, tmp_path / "x") == EXIT_CODES["interrupted"]
    assert capsys.readouterr() == ("", "worms: stopped by Ctrl-C; nothing of it was kept\n")
    assert list((tmp_path / "x").iterdir()) == []
