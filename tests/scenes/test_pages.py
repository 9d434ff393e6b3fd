"""What a browser without a network shows of the page that a run writes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

SCENES = (
    "flat",
    pytest.param("pipe_bend", marks=pytest.mark.slow),
    pytest.param("slope_into_pipe", marks=pytest.mark.slow),
)
BARE = "hide=forces,anchors,trail"


@pytest.mark.parametrize("name", SCENES)
def test_the_page_of_a_run_shows_the_worm_as_it_moves(worm3d, browser: Any, tmp_path: Path, name: str) -> None:
    ended = worm3d("run", name, "-o", "run.duration_s=2", "--out", "x")
    page = tmp_path / "x" / "viewer.html"
    assert f"x/{page.name}" in ended.out
    first, later, above = (
        browser.look(page, f"{state}&{BARE}") for state in ("t=0&camera=side", "t=1.5&camera=side", "t=0&camera=top")
    )
    for picture in (first, later, above):
        assert 0.005 < browser.worm_share(picture) < 0.4, "a worm, and no giant"
    assert 0.003 < changed(browser, first, later) < 0.4, "the worm moved, the rest stood still"
    assert changed(browser, first, above) > 0.1, "another camera sees another picture"


def changed(browser: Any, one: Any, other: Any) -> float:
    """Return the share of the scene that differs between two pictures."""
    return float((np.abs(browser.scene(one) - browser.scene(other)).max(axis=2) > 30).mean())
