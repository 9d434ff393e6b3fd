"""The tables of the rules of `worm3d study control`: `python tests/benchmarks/control_page.py` writes them anew.

They stand in `.docs/evidence/controllers.md`. The numbers in its text are kept by a test.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from scenes.records.text import markdown_table
from scenes.studies.bench.control_trials import CLASSES, GROUPS

PAGE = Path(__file__).parents[2] / ".docs" / "evidence" / "controllers.md"


def page(text: str) -> str:
    """Return the text of the page with the tables of the program."""
    classes = markdown_table(("class", "task"), _classes())
    drawn = markdown_table(("what", "share of the trials", "key", "from", "to"), _drawn())
    for lines in map(list, (classes, drawn)):
        before, _, after = text.partition(lines[0])
        rest = after.partition("\n\n")[2]
        text = before + "\n".join(lines) + ("\n\n" + rest if rest else "\n")
    return text


def _classes() -> Iterator[tuple[str, str]]:
    for name, (_, maker) in CLASSES.items():
        yield name, str(maker.__doc__).removeprefix("Yield ").removesuffix(".")


def _drawn() -> Iterator[tuple[str, ...]]:
    for group in GROUPS:
        share = "all" if group.share == 1.0 else f"{group.share:.0%}"
        for switch in group.switch:
            yield group.says, share, f"`{switch}`", "", ""
        for each in group.ranges:
            yield group.says, share, f"`{each.key}`", f"{each.least:g}", f"{each.most:g}"


if __name__ == "__main__":
    PAGE.write_text(page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
