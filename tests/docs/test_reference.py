"""The reference of the book has a page for each kind of things, and each page has all of them."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

import pytest

from scenes import models
from worm3d.measures import MEASURES
from worm3d.recorded.energy import Energy
from worm3d.recorded.series import Recorded, Steps, series_of

BOOK = Path(__file__).parents[2] / ".docs"
PAGES = ["index", "scene_keys", "summary", "series", "commands", "exit_codes", "file_format", "api", "glossary"]


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, str]]:
    folder = tmp_path_factory.mktemp("book")
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(BOOK)
        import_module("reference").main(folder)
        yield {path.stem: path.read_text() for path in (folder / "reference").iterdir()}
    for name in [name for name in sys.modules if name.split(".")[0] in ("reference", "pages")]:
        del sys.modules[name]


def lacking(page: str, names: set[str]) -> list[str]:
    """Return the names that are not on a page as code or in a heading."""
    return sorted(name for name in names if f"`{name}`" not in page and f"# {name}\n" not in page)


def test_each_page_has_all_of_its_kind(pages: dict[str, str]) -> None:
    assert sorted(pages) == sorted(PAGES)
    assert all(text.startswith("# ") for text in pages.values())
    assert not lacking(pages["scene_keys"], import_module("pages.scene_keys").every_key())
    own = {name for model in map(models.get, models.names()) for name in model.entries}
    assert not lacking(pages["summary"], {*MEASURES, *own})
    series = {name for holder in (Recorded, Steps, Energy) for name in series_of(holder)}
    assert not lacking(pages["series"], series)
    assert not lacking(pages["api"], import_module("pages.api").every_name())
    assert not [option for option in import_module("pages.commands").every_option() if option not in pages["commands"]]
    assert all(f"| `{code}` | " in pages["exit_codes"] for code in (0, 1, 2, 3, 4, 5, 130))
    assert all(f"`{group}`" in pages["file_format"] for group in ("/", "timing", "checkpoint", "run"))
    assert 40 <= pages["glossary"].count("\n: ") <= 60


def test_units_ranges_and_reasons_stand_beside_the_names(pages: dict[str, str]) -> None:
    assert "`period_s`\n: T\\_wave: time between two contractions" in pages["scene_keys"]
    assert "Unit `s`. Range `0 < …`." in pages["scene_keys"]
    assert "Null: a vertical body has no heading." in pages["summary"]
    assert "Definition: mean d\\_k.e\\_k / L (J1)." in pages["summary"]
    assert "| `com` | `m` | (T, 3) | " in pages["series"]
