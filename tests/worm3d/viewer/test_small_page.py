"""Small pages: their script lies in a file beside them, and their data are compressed."""

import base64
import re
import zlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from worm3d.viewer import Frames, write_html
from worm3d.viewer.packed import packed
from worm3d.viewer.recorder import ALL_BITS, script, shortened


@pytest.fixture(scope="module")
def small(short: Frames, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("a collection")
    (folder / "pages").mkdir()
    page = folder / "pages" / "small.html"
    write_html(short, page, title="a small page", script=folder / "the player.js")
    return page


def test_it_is_many_times_smaller(make_crawl: Callable[..., Frames], tmp_path: Path) -> None:
    frames = make_crawl(duration=10.0, fps=10.0)
    write_html(frames, tmp_path / "whole.html")
    write_html(frames, tmp_path / "small.html", script=tmp_path / "player.js")
    write_html(frames, tmp_path / "least.html", script=tmp_path / "player.js", without=["links", "skin"])
    whole, small, least = ((tmp_path / f"{name}.html").stat().st_size for name in ("whole", "small", "least"))
    assert 4 * small < whole
    assert least < 0.8 * small
    assert '"links"' not in unpacked_scene(tmp_path / "least.html")
    assert (tmp_path / "player.js").read_text(encoding="utf-8") == script()


def unpacked(text: str) -> list[bytes]:
    """Return the byte strings of `packed`, as the page does."""
    data, parts, at = zlib.decompress(base64.b64decode(text)), [], 0
    while at < len(data):
        end = at + 4 + int.from_bytes(data[at : at + 4], "little")
        parts.append(data[at + 4 : end])
        at = end
    return parts


def unpacked_scene(page: Path) -> str:
    """Return the data of a small page as JSON."""
    found = re.search(r'<script id="scene"[^>]*>([^<]*)<', page.read_text(encoding="utf-8"))
    assert found
    return unpacked(found[1])[0].decode()


def test_the_policy_allows_this_file_only(small: Path, short: Frames) -> None:
    text = small.read_text(encoding="utf-8")
    loaded = re.search(r'<script nonce="([^"]+)" src="([^"]+)">', text)
    allowed = re.search(r"script-src ([^;]*);", text)
    assert loaded
    assert loaded[2] == "../the%20player.js"
    assert allowed
    assert [each.split("-")[0] for each in allowed[1].split()] == ["'sha256", "'nonce"]
    assert f"'nonce-{loaded[1]}'" in allowed[1].split()
    write_html(short, small.with_name("again.html"), title="a small page", script=small.parents[1] / "the player.js")
    assert small.with_name("again.html").read_text(encoding="utf-8") == text, "the same frames, the same bytes"
    write_html(short, small.with_name("again.html"), title="another", script=small.parents[1] / "the player.js")
    assert loaded[1] not in small.with_name("again.html").read_text(encoding="utf-8")


def test_an_unknown_layer_is_refused(short: Frames, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"^without: got link, must be names of layers: skin, faces, "):
        write_html(short, tmp_path / "page.html", without=["link", "skin"])


def test_byte_strings_come_back() -> None:
    for parts in ([], [b""], [b"a", b"", b"\0" * 1000]):
        assert unpacked(packed(parts)) == parts


def test_numbers_are_rounded_to_some_bits() -> None:
    values = np.random.default_rng(1).normal(size=1000).astype("<f4")
    near = shortened(values, 13)
    assert_allclose(near, values, rtol=2.0**-14)
    assert not (near.view("<u4") & 0x3FF).any()
    assert np.array_equal(shortened(values, ALL_BITS), values)


@pytest.mark.slow
def test_it_opens_from_disc_and_shows_the_same_as_a_whole_page(browser: Any, small: Path, short: Frames) -> None:
    whole = small.with_name("whole.html")
    write_html(short, whole, title="a small page")
    pictures = []
    for page in (whole, small):
        browser.open(page, "t=1&camera=side")
        assert not browser.errors, browser.errors
        assert browser.value("document.documentElement.dataset.state") == "ready"
        pictures.append(browser.picture())
    assert np.mean(np.abs(pictures[0] - pictures[1]).max(axis=2) > 30) < 0.01
    assert browser.worm_share(pictures[1]) > 0.01


@pytest.mark.slow
def test_a_page_without_its_file_says_which_is_missing(browser: Any, short: Frames, tmp_path: Path) -> None:
    write_html(replace(short), tmp_path / "page.html", script=tmp_path / "player.js")
    (tmp_path / "player.js").unlink()
    browser.open(tmp_path / "page.html")
    assert "needs the file player.js" in browser.value("document.querySelector('#trouble').textContent")
