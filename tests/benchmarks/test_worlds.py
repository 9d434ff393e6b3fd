"""Every world is visited, and ratios are those of the counts and times; no time is asserted."""

from pathlib import Path

import pytest
import worlds
from numpy.testing import assert_allclose
from speed_measures import StoppedError
from worlds import Visit

VISITS = [
    Visit("plane", 20.0, 1.0, 2.0, 3.0),
    Visit("pipe bend", 30.0, 1.5, 4.0, 4.0),
    Visit("mesh box", 35.0, 1.75, 2.5, 2.5),
]


def test_the_figure_shows_times_and_iterations_over_the_planes() -> None:
    axes = worlds.draw(VISITS).axes[0]
    assert_allclose([bar.get_height() for bar in axes.patches], [1.0, 1.5, 1.75])
    assert_allclose(axes.lines[0].get_ydata(), [1.0, 1.6, 1.0])
    bars = axes.collections[0].get_segments()
    assert_allclose([bar[0][1] for bar in bars], [1.5, 2.0])


def test_the_page_has_every_world(tmp_path: Path) -> None:
    table = worlds.markdown(worlds.measure_worlds(0.05, 1), "worlds.png")
    rows = [line.split(" | ") for line in table.splitlines() if line.startswith(("| p", "| mesh"))]
    assert [row[0][2:] for row in rows] == [name for name in worlds.worlds(tmp_path) if not name.startswith("height")]
    for row in rows:
        us, ratio, jacobians, residuals, each = (float(row[k].rstrip(" |")) for k in (1, 2, 4, 5, 6))
        assert us / float(rows[0][1]) == pytest.approx(ratio, abs=0.02 * ratio)
        assert each == pytest.approx(us / (jacobians + residuals), rel=0.02)
        assert float(row[3] or 0.0) == {"pipe": 1.5, "mesh": 2.0}.get(row[0].split()[1], 0.0)


def test_a_run_that_stops_is_a_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    class Stopped:
        status = "FOLDED"
        stop = type("Stop", (), {"sentence": "it folded"})

    monkeypatch.setattr("worm3d.simulate", lambda *_, **__: Stopped)
    with pytest.raises(StoppedError, match=r"^bench: plane: it folded$"):
        worlds.measure_worlds(0.05, 1)
