"""Every world is visited, and ratios are those of the counts and times; no time is asserted."""

from pathlib import Path

import pytest
import worlds
from speed_measures import StoppedError


def test_the_page_has_every_world(tmp_path: Path) -> None:
    table = worlds.markdown(worlds.measure_worlds(0.05, 1))
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
