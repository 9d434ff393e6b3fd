"""Pages side by side: one file, one set of controls, all at the same time of their runs."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from worm3d.viewer import Frames, policy
from worm3d.viewer.beside import Page, side_by_side
from worm3d.viewer.html import html


@pytest.fixture(scope="module")
def pages(make_crawl: Callable[..., Frames]) -> list[Page]:
    runs = (make_crawl(duration=2.0, fps=10.0), make_crawl(duration=1.0, fps=10.0, turn=0.0))
    return [Page(f"<run> {k}", html(run, skin=False), k, k + run.time[-1]) for k, run in enumerate(runs)]


def test_a_page_stands_alone_and_allows_the_scripts_of_those_in_it_only(pages: list[Page]) -> None:
    text = side_by_side(pages, "a & b")
    assert text == side_by_side(pages, "a & b")
    assert "<title>a &amp; b</title>" in text
    assert text.count("<figcaption>&lt;run&gt; ") == 2
    assert not re.search(r'(src|href)="(https?:)?//', text)
    allowed = re.search(r"script-src ([^;]*);", text)
    assert allowed is not None
    inner = {each for page in pages for each in re.findall("'sha256-[^']*'", policy.of_page(page.html))}
    assert set(allowed[1].split()) > inner
    assert "unsafe" not in allowed[1]


@pytest.mark.parametrize("number", [0, 1, 7])
def test_too_few_or_too_many(pages: list[Page], number: int) -> None:
    with pytest.raises(ValueError, match=f"^pages: got {number}, must be 2 to 6$"):
        side_by_side(pages[:1] * number)


@pytest.mark.slow
def test_runs_move_together_in_a_browser(browser: Any, pages: list[Page], tmp_path: Path) -> None:
    path = tmp_path / "compare.html"
    path.write_text(side_by_side(pages), encoding="utf-8")
    inside = "[...document.querySelectorAll('iframe')].map(f => f.contentDocument.documentElement.dataset.time)"

    browser.open(path, "t=1.5&camera=top")
    first = browser.picture()
    assert not browser.errors, browser.errors
    assert browser.value(inside) == ["1.500", "0.500"], "the second run begins a second later"
    assert not browser.value(
        "[...document.querySelectorAll('iframe')].some(f => f.contentDocument.querySelector('#bar').checkVisibility())"
    )

    browser.click("#cameras button[value=side]")
    assert np.mean(np.abs(first - browser.picture()).max(axis=2) > 30) > 0.05, "both are seen from the side"
    browser.go("t=0.2")
    assert browser.value(inside) == ["0.200", "0.000"]
    browser.press("End")
    assert browser.value(inside) == ["2.000", "1.000"]
    browser.value("document.querySelector('#loop').checked = false")
    browser.press("Home")
    browser.click("#play")
    browser.value("new Promise(done => setTimeout(done, 700))")
    now = float(browser.value("document.documentElement.dataset.time"))
    assert 0.0 < now <= 2.0
    browser.click("#play")
    stopped = browser.value(inside)
    assert float(stopped[0]) == pytest.approx(float(browser.value("document.documentElement.dataset.time")))
