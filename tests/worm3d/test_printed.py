"""What `print` shows of the objects that people meet: a few lines, however many numbers they hold."""

from __future__ import annotations

import numpy as np
import pytest

import worm3d
from control.gaits import TravellingWave
from worm3d.values.read_only import PRINTED_COLUMNS, PRINTED_LINES

LINE = worm3d.Centreline.through([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.8, 0.2, 0.05), (2.5, 0.7, 0.1)])
LONG = worm3d.Worm(segments=150, length=20.0, half_height=np.linspace(0.04, 0.06, 150))

OBJECTS = {
    "worm": LONG,
    "command": worm3d.Command(np.linspace(0.0, 0.3, 300).reshape(150, 2)),
    "friction": worm3d.Friction(np.linspace(0.1, 0.2, 150), 0.2, 0.2),
    "pipe": worm3d.Pipe(LINE, radius=0.12),
    "terrain": worm3d.Heightfield.rubble(4.0, 2.0, 0.02, height=0.02, size=0.15),
    "union": worm3d.Union((worm3d.Plane(), worm3d.Pipe(LINE, radius=0.12))),
}


@pytest.fixture(scope="module")
def result() -> worm3d.Result:
    return worm3d.simulate(worm3d.Worm(), worm3d.Plane(), actuation=TravellingWave(), duration=3.0)


@pytest.mark.parametrize("name", ["result", "energy", "state", *OBJECTS])
def test_it_is_a_few_lines(result: worm3d.Result, name: str) -> None:
    thing = {**OBJECTS, "result": result, "energy": result.energy, "state": result.state}[name]
    lines = repr(thing).splitlines()
    assert len(lines) <= PRINTED_LINES
    assert max(map(len, lines)) <= PRINTED_COLUMNS
    assert lines[0].startswith(type(thing).__name__)


def test_a_result_says_how_it_ended_and_what_matters(result: worm3d.Result) -> None:
    text = repr(result)
    assert text.splitlines()[0] == "Result: the run reached its end"
    assert "301 rows of 300 steps of 0.01 s; 6 segments, 1 m, 0.1 kg on Plane(" in text
    assert f"distance {result.distance:.4g} m, mean speed " in text


def test_short_arrays_are_printed_whole_and_long_ones_by_their_range() -> None:
    text = repr(LONG)
    assert "segments=150, length=20.0" in text
    assert "half_height=<150 from 0.04 to 0.06>" in " ".join(text.split())
