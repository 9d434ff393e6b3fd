"""What differs between results, against differences that are known."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from scenes.language.errors import SceneError
from scenes.records.record import Record, Summary
from scenes.studies.compare import differences
from scenes.studies.compare.aligned import aligned
from scenes.studies.compare.differences import Difference, settings, unit_of
from scenes.studies.compare.sources import Source
from worm3d.values.arrays import FloatArray
from worm3d.values.variable import Variable

TIME = np.linspace(0.0, 2.0, 41)


def of(model: str, time: FloatArray, **series: tuple[FloatArray, str]) -> Record:
    """A record with series whose last dimension is "axis" where they have as many as 2 or 3 of a length or speed."""
    variables = [Variable("time", ("time",), time, "s", "time")]
    for name, (values, unit) in series.items():
        dims = ["time", *(f"{name}_{k}" for k in range(values.ndim - 1))]
        if values.ndim > 1 and unit in ("m", "m/s"):
            dims[-1] = "axis"
        variables.append(Variable(name, tuple(dims), values, unit, name))
    scene = '[worm]\nlength_m = 1.0\n[header]\n"marker a" = "joint 1"\n'
    return Record(model, model, scene, "done", "", 0, {}, Summary({}), tuple(variables))


def way(time: FloatArray) -> FloatArray:
    return np.column_stack([0.1 * time, 0.02 * time**2, 0.01 + 0.0 * time])


def source(label: str, record: Record | None, **figures: float | None) -> Source:
    return Source(label, {}, figures, {}, record)


def found(first: Record, *others: Record) -> dict[tuple[str, str, str], Difference]:
    given = [source("first", first), *(source(f"other {k}", each) for k, each in enumerate(others))]
    return {(each.source, each.kind, each.name): each for each in differences.series(given)}


def test_figures_of_a_summary_are_taken_from_each_other() -> None:
    given = [
        source("a", None, distance_m=2.0, work_J=0.0, mean_speed_m_s=1e-15),
        source("b", None, distance_m=1.5, work_J=1.0),
    ]
    given.append(source("c", None, mean_speed_m_s=1.0, cost=4.0))
    rows = {(each.name, each.source): each for each in differences.figures(given)}
    assert rows["distance_m", "b"] == Difference("figure", "distance_m", "m", "b", 2.0, 1.5, -0.5, -0.25)
    assert rows["distance_m", "c"] == Difference("figure", "distance_m", "m", "c", 2.0, None, None, None)
    assert rows["work_J", "b"] == Difference("figure", "work_J", "J", "b", 0.0, 1.0, 1.0, None)
    assert rows["mean_speed_m_s", "c"].relative is None, "of rounding there are no percent"
    assert rows["cost", "c"] == Difference("figure", "cost", "1", "c", None, 4.0, None, None)
    assert [unit_of(name) for name in ("a_m", "a_m_s", "cot_J_per_m", "v_BL_per_period", "a_deg", "ratio")] == [
        *("m", "m/s", "J/m", "BL/period", "deg", "1")
    ]


def test_settings_that_differ() -> None:
    one = {"model": "worm", "title": "x", "worm": {"segments": 6, "mass_kg": 0.1}, "patches": [{"grip": 2}]}
    other = {"model": "worm", "title": "y", "worm": {"segments": 5, "mass_kg": 0.1, "law": "own"}, "patches": []}
    rows = settings([Source("a", one, {}, {}, None), Source("b", other, {}, {}, None)])
    assert {row.key: row.values for row in rows} == {
        "worm.segments": ("6", "5"),
        "patches": ('[{"grip": 2}]', "[]"),
        "worm.law": ("-", "own"),
    }


def test_a_record_does_not_differ_from_itself() -> None:
    record = of("worm", TIME, com=(way(TIME), "m"), heading=(0.3 * TIME, "rad"))
    rows = found(record, record)
    assert {name for _, _, name in rows} == {"com", "com_displacement", "heading", "heading_change"}
    assert all(each.difference == 0.0 for each in rows.values())


def test_known_differences_over_the_common_time() -> None:
    shift = np.array([0.03, -0.04, 0.12])
    later = np.linspace(0.5, 3.0, 26)  # other instants, and another span
    first = of("worm", TIME, com=(way(TIME), "m"), heading=(np.zeros(41), "rad"), force=(np.sin(TIME), "N"))
    other = of("worm", later, com=(way(later) + shift, "m"), heading=(0.25 * later, "rad"), force=(np.sin(later), "J"))
    rows = found(first, other)
    assert not any(name == "force" for _, _, name in rows), "with another unit they are not the same quantity"
    com = rows["other 0", "series", "com"]
    assert com.difference == pytest.approx(np.linalg.norm(shift) / math.sqrt(3.0), rel=1e-3)
    assert com.value == pytest.approx(0.12, abs=1e-4)
    assert com.reference == pytest.approx(0.2, abs=1e-12), "the range along x"
    assert com.relative == pytest.approx(com.difference / 0.2)
    moved = rows["other 0", "both", "com_displacement"]
    assert moved.reference == pytest.approx(np.linalg.norm(way(np.array([0.5, 2.0])).T @ [-1.0, 1.0]), rel=1e-12)
    assert moved.value == pytest.approx(moved.reference, rel=1e-3)
    turned = rows["other 0", "both", "heading_change"]
    assert (turned.unit, turned.reference) == ("deg", 0.0)
    assert turned.value == pytest.approx(math.degrees(0.25 * 1.5), rel=1e-12)


def test_a_measurement_is_compared_at_its_own_instants_whichever_comes_first() -> None:
    at = np.array([0.25, 0.5, 0.75, 1.3, 5.0])
    joints = way(TIME)[:, None] + np.array([[0.0, 0.0, 0.0], [0.5, 0.0, 0.0], [1.0, 0.0, 0.0]])
    sim = of("worm", TIME, joints=(joints, "m"))
    marker = way(at) + np.array([0.5, 0.01, np.nan])
    lab = of("measured", at, marker_a=(marker, "m"))
    for rows in (found(sim, lab), found(lab, sim)):
        assert rows.keys() == {("other 0", "series", "marker_a"), ("other 0", "both", "marker_a_displacement")}
        each = rows["other 0", "series", "marker_a"]
        assert each.difference == pytest.approx(0.01 / math.sqrt(2.0), rel=5e-3)  # x and y, of which y is off
        moved = math.hypot(0.1 * 1.05, 0.02 * (1.3**2 - 0.25**2))
        assert rows["other 0", "both", "marker_a_displacement"].value == pytest.approx(moved, rel=5e-3)


def test_what_does_not_vary_has_no_range_to_be_a_share_of() -> None:
    first, other = (of("worm", TIME, com=(np.zeros((41, 3)) + 0.1 + k, "m")) for k in (0.0, 0.2))
    each = found(first, other)["other 0", "series", "com"]
    assert each.difference == pytest.approx(0.2)
    assert each.relative is None


def test_rounding_is_no_range_to_be_a_share_of() -> None:
    first, other = (of("worm", TIME, heading=(k * 1e-14 * TIME, "rad")) for k in (1.0, 2.0))
    assert found(first, other)["other 0", "series", "heading"].relative is None


def test_measured_quantities_that_are_not_compared_are_named() -> None:
    sim = source("sim", of("worm", TIME, com=(way(TIME), "m")))
    lab = source("lab", of("measured", TIME, com=(way(TIME), "m"), force=(TIME, "N")))
    for given in ([sim, lab], [lab, sim]):
        assert differences.left_out(given) == ["lab: worm has no force"]


def test_nothing_in_common_is_no_row() -> None:
    early, late = (of("worm", TIME + 10.0 * k, com=(way(TIME), "m")) for k in (0, 1))
    assert found(early, late) == {}
    long, short = (of("worm", TIME, strain=(np.zeros((41, n)), "1")) for n in (4, 5))
    assert found(long, short) == {}


@pytest.mark.parametrize("seed", range(5))
def test_a_record_that_was_moved_and_turned_is_brought_back(seed: int) -> None:
    rng = np.random.default_rng(seed)
    angle, shift = rng.uniform(-3.0, 3.0), rng.normal(size=3)
    c, s = math.cos(angle), math.sin(angle)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    joints = rng.normal(size=(41, 4, 3))
    heading, velocity = rng.normal(size=41), rng.normal(size=(41, 3))
    first = of("worm", TIME, joints=(joints, "m"), heading=(heading, "rad"), com_velocity=(velocity, "m/s"))
    other = of(
        "worm",
        TIME,
        joints=(joints @ turn.T + shift, "m"),
        heading=(heading + angle, "rad"),
        com_velocity=(velocity @ turn.T, "m/s"),
    )
    again = aligned(first, other)
    assert_allclose(again["joints"], joints, atol=1e-12)
    assert_allclose(again["com_velocity"], velocity, atol=1e-12)
    assert_allclose(again["heading"], heading, atol=1e-12)


def test_no_small_turn_fits_better() -> None:
    rng = np.random.default_rng(0)
    first = of("worm", TIME, com=(way(TIME), "m"))
    other = of("measured", TIME, com=(way(TIME)[:, [1, 0, 2]] + rng.normal(0.0, 0.01, (41, 3)), "m"))
    best = aligned(first, other)["com"]

    def off(angle: float) -> float:
        c, s = math.cos(angle), math.sin(angle)
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        middle = best.mean(axis=0)
        return float(np.sum(((best - middle) @ turn.T + middle - way(TIME)) ** 2))

    assert off(0.0) < min(off(1e-4), off(-1e-4))
    assert_allclose(best.mean(axis=0), way(TIME).mean(axis=0), atol=1e-14)


def test_what_was_not_measured_does_not_spoil_what_was_when_it_is_turned() -> None:
    flat = way(TIME)
    flat[:, 2] = np.nan
    lab = of("measured", TIME, com=(flat * [-1.0, -1.0, 1.0], "m"), marker_b=(way(TIME), "m"))
    again = aligned(of("worm", TIME, com=(way(TIME), "m")), replace(lab, variables=lab.variables[:2]))
    assert_allclose(again["com"][:, :2], way(TIME)[:, :2], atol=1e-12)
    assert np.isnan(again["com"][:, 2]).all()


def test_a_worm_in_a_vertical_plane_is_not_turned() -> None:
    plane = way(TIME)[:, :2]
    first, other = (
        of("planar_linkage", TIME, com=(plane, "m")),
        of("planar_linkage", TIME, com=(plane[:, ::-1] + 1.0, "m")),
    )
    moved = aligned(first, other)["com"]
    assert_allclose(moved - moved[0], plane[:, ::-1] - plane[0, ::-1], atol=1e-14)
    assert_allclose(moved.mean(axis=0), plane.mean(axis=0), atol=1e-14)


def test_a_marker_of_which_only_x_is_known_counts_with_x() -> None:
    rng = np.random.default_rng(3)
    head, middle = way(TIME), way(TIME) - [0.2, 0.05, 0.0]
    c, s = math.cos(0.4), math.sin(0.4)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    bent = {"com": (head @ turn.T + 1.0, "m"), "joints": (np.stack([middle, middle + 0.1], axis=1) @ turn.T + 1.0, "m")}
    noisy = head + rng.normal(0.0, 0.02, head.shape) * [1.0, 1.0, 0.0]
    seen = np.stack([middle, middle + 0.1], axis=1)
    seen[:, :, 1:] = np.nan
    first, other = of("worm", TIME, com=(noisy, "m"), joints=(seen, "m")), of("worm", TIME, **bent)

    def off(moved: Record) -> float:
        gaps = [moved["com"] - noisy, moved["joints"] - seen]
        return sum(float(np.nansum(gap[..., :2] ** 2)) for gap in gaps)

    best = aligned(first, other)
    without = aligned(replace(first, variables=first.variables[:2]), other)
    assert off(best) < off(without)
    for angle, step in ((1e-4, 0.0), (-1e-4, 0.0), (0.0, 1e-4), (0.0, -1e-4)):
        c, s = math.cos(angle), math.sin(angle)
        little = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        moved = {name: (best[name] @ little + [step, 0.0, 0.0], "m") for name in bent}
        assert off(best) < off(of("worm", TIME, **moved))
    exact = aligned(of("worm", TIME, com=(head, "m"), joints=(seen, "m")), other)
    assert_allclose(exact["com"], head, atol=1e-9)
    back = aligned(other, of("worm", TIME, com=(head, "m"), joints=(seen, "m")))
    assert_allclose(back["com"], bent["com"][0], atol=1e-9)
    lone = aligned(of("worm", TIME, com=(head * [1.0, np.nan, np.nan], "m")), of("worm", TIME, com=(head + 0.3, "m")))
    assert_allclose(lone["com"][:, 0], head[:, 0], atol=1e-12)


def test_without_a_position_nothing_is_aligned(tmp_path: Path) -> None:
    first, other = of("worm", TIME, com=(way(TIME), "m")), of("measured", TIME, force=(TIME, "N"))
    with pytest.raises(SceneError, match=r"^--align: measured and worm have no position in common$"):
        aligned(first, other)
