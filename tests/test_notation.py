"""NOTATION.md says where the equations of each tag are."""

import re
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).parents[1]
SOURCES = [path for room in ("worm3d", "control", "planar", "scenes") for path in sorted((ROOT / room).rglob("*.py"))]
TAG = r"\(([A-Z]{1,3})\d+[a-z]?\)"


def listed() -> dict[str, list[Path]]:
    """Return the modules and folders in the table of NOTATION.md, by the letters of the tag."""
    found = defaultdict(list)
    text = (ROOT / "worm3d" / "NOTATION.md").read_text(encoding="utf-8")
    for folder, cell in re.findall(r"^\| `(\w[\w/]*/)` \| (.*) \|$", text, re.MULTILINE):
        for tags, places in re.findall(r"((?:\(\w+\.\.\),? )+)((?:`[\w/.]+`(?:, )?)+)", cell):
            for letters in re.findall(r"\w+", tags):
                found[letters] += [ROOT / folder / place for place in re.findall(r"`([\w/.]+)`", places)]
    return found


def test_all_tags_are_listed_and_no_others() -> None:
    used = {letters for path in SOURCES for letters in re.findall(TAG, path.read_text(encoding="utf-8"))}
    assert sorted(listed()) == sorted(used)


def test_the_listed_modules_have_the_equations() -> None:
    for letters, places in listed().items():
        for place in places:
            files = [place] if place.is_file() else sorted(place.rglob("*.py"))
            tags = {tag for path in files for tag in re.findall(TAG, path.read_text(encoding="utf-8"))}
            assert letters in tags, (letters, place)


def test_equations_with_a_tag_at_the_end_of_the_line_are_in_a_listed_module() -> None:
    where, seen = listed(), 0
    for path in SOURCES:
        for letters in re.findall(rf"   {TAG}$", path.read_text(encoding="utf-8"), re.MULTILINE):
            seen += 1
            assert any(path.is_relative_to(place) for place in where[letters]), (letters, path)
    assert seen > 150
