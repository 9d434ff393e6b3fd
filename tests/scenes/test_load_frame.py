"""The load frame: closed forms, a real mesh segment, and what is refused."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import least_squares

from scenes.language.errors import SceneError
from scenes.language.loader import SHIPPED_FOLDER
from scenes.models.load_frame import figures, overview
from scenes.models.loading import load_scene, parse_scene
from scenes.records import measured
from scenes.records.record import Record
from scenes.running.runner import simulate
from scenes.studies.validate import robots

DATA = SHIPPED_FOLDER / "data" / "mesh_segment_load_frame.csv"


RUBS = ("moment_N_m", "load_ratio", "give_J", "spread")
"""Keys of the friction in the shipped scene."""
NO_FRICTION = ("hysteresis.kind=none",)


def pulled(*overrides: str) -> Record:
    if not {*NO_FRICTION} <= {*overrides}:
        return simulate(load_scene("load_frame", overrides))
    text = (SHIPPED_FOLDER / "load_frame.toml").read_text()
    kept = [line for line in text.splitlines() if not line.startswith(RUBS)]
    return simulate(parse_scene("\n".join(kept), "load_frame", overrides))


def both_ways(record: Record) -> tuple[np.ndarray, np.ndarray]:
    """Return which rows are on the way in, and which on the way out."""
    rows, most = np.arange(len(record["cable"])), int(np.argmax(record["cable"]))
    return rows <= most, rows > most


def share_lost(cable: np.ndarray, force: np.ndarray) -> float:
    work = np.diff(cable) * (force[1:] + force[:-1]) / 2.0
    return 1.0 + float(work[np.diff(cable) < 0.0].sum() / work[np.diff(cable) > 0.0].sum())


def assert_met(record: Record) -> None:
    """Within 10 % rms of the peak, in and out, and within five points of the share of the work that is lost."""
    data = measured.load(DATA)
    force = measured.simulated_like(record, data)["force"]
    known = np.isfinite(force)
    for way in both_ways(data):
        rms = np.sqrt(np.mean((force - data["force"])[way & known] ** 2))
        assert rms < 0.10 * data["force"].max()
    assert known.mean() > 0.99
    assert_allclose(share_lost(data["cable"], data["force"]), 0.91, atol=0.005)
    assert abs(record.summary["work_lost_share"] - share_lost(data["cable"], data["force"])) < 0.05  # type: ignore[operator]


def test_the_data_are_those_of_the_source() -> None:
    digest = hashlib.sha256(DATA.read_bytes()).hexdigest()
    assert digest.startswith("5374cb5c262f537c")


def test_the_shipped_segment_meets_the_measured_one() -> None:
    record = pulled()
    assert_met(record)
    assert record.summary["work_damping_J"] == 0.0
    assert record.summary["energy_balance_error"] < 1e-4  # type: ignore[operator]


def test_a_fit_finds_a_segment_that_meets_it() -> None:
    from scenes.studies.fit.figure import draw
    from scenes.studies.fit.fitting import fit

    start = ["worm.apex_hinge_N_m_rad=0.6", "hysteresis.moment_N_m=0.3", "hysteresis.load_ratio=0.4", "run.dt_s=0.25"]
    keys = ["worm.apex_hinge_N_m_rad", "hysteresis.moment_N_m", "hysteresis.load_ratio", "hysteresis.give_J"]
    found = fit("load_frame", DATA, keys, start)
    assert found.finished
    assert [channel.name for channel in found.channels] == ["force_N"]  # the cable is what the scene is given
    cable = measured.load(DATA)["cable"]
    known = np.isfinite(found.abscissa.values)
    assert_allclose(found.abscissa.values[known], cable[known], atol=1e-3)
    assert draw(found)[0].axes[0].get_lines()[1].get_xydata()[:, 0].max() == np.nanmax(found.abscissa.values)
    alone = measured.load(DATA)
    alone = replace(alone, variables=tuple(v for v in alone.variables if v.name != "force"))
    with pytest.raises(SceneError, match="has only cable, an input of load_frame"):
        fit("load_frame", alone, keys, start)
    assert_met(pulled(*(f"{key}={value!r}" for key, value in found.values.items())))


def test_damping_cannot_give_its_loop() -> None:
    """The best springs and dampers miss the record on both ways, and lose a smaller share of the work."""
    data = measured.load(DATA)

    def away(logarithms: np.ndarray) -> np.ndarray:
        away: np.ndarray = measured.simulated_like(viscous(logarithms), data)["force"] - data["force"]
        return away[np.isfinite(away)]

    def viscous(logarithms: np.ndarray) -> Record:
        keys = ("worm.spring_N", "worm.apex_hinge_N_m_rad", "worm.kelvin_voigt_time_s")
        values = [f"{key}={value!r}" for key, value in zip(keys, np.exp(logarithms).tolist(), strict=True)]
        return pulled(*NO_FRICTION, *values, "run.dt_s=0.25")

    best = least_squares(away, np.log([5.0, 1.0, 10.0]), x_scale=0.5, diff_step=1e-3).x
    record = viscous(best)
    force = measured.simulated_like(record, data)["force"]
    rms = [np.sqrt(np.nanmean((force - data["force"])[way] ** 2)) / data["force"].max() for way in both_ways(data)]
    assert min(rms) > 0.15
    assert record.summary["work_lost_share"] < 0.85  # type: ignore[operator]


def test_friction_loses_the_same_however_slowly_and_dampers_do_not() -> None:
    friction, damped = [], []
    for slower in (1.0, 10.0, 100.0):
        timed = (f"frame.speed_m_s={0.02 / slower}", f"run.duration_s={20.0 * slower}", f"run.dt_s={0.02 * slower}")
        way = ("frame.file=none", "frame.cable_m=0.2", *timed)
        friction.append(pulled(*way).summary["work_lost_share"])
        damped.append(pulled(*way, *NO_FRICTION, "worm.kelvin_voigt_time_s=0.1").summary["work_lost_share"])
    assert_allclose(friction, friction[0], rtol=1e-9)
    assert_allclose(np.divide(damped[:-1], damped[1:]), 10.0, rtol=0.03)


def test_a_segment_without_losses_pulls_by_its_energy() -> None:
    """F = dE/du, E the energy of two chambers' springs and hinges, l = 2 sqrt(a^2 - h^2), h = h0 - u/(2 kappa)."""
    kept = ("worm.length_m=0.2", "worm.half_height_m=0.15", "worm.spring_N=20", "worm.apex_hinge_N_m_rad=0.7")
    way = ("frame.file=none", "frame.cable_m=0.3", "frame.speed_m_s=0.05", "run.duration_s=9", "run.dt_s=0.1")
    record = pulled(*kept, *way, *NO_FRICTION, "frame.cable_per_diameter=3.1416")
    u = np.where(record["time"] <= 6.0, 0.05 * record["time"], 0.6 - 0.05 * record["time"])
    assert_allclose(record["cable"], u, rtol=0, atol=1e-12)
    assert_allclose(record["force"], (energy(u + 1e-5) - energy(u - 1e-5)) / 2e-5, rtol=0, atol=1e-7)
    assert_allclose(record["diameter"], 0.3 - u / 3.1416, rtol=1e-12)
    assert abs(record.summary["work_lost_share"] - 0.4) < 1.0  # type: ignore[operator]


def energy(u: np.ndarray) -> np.ndarray:
    a = np.hypot(0.15, 0.1)
    length = 2.0 * np.sqrt(a**2 - (0.15 - u / (2.0 * 3.1416)) ** 2)
    angle = 2.0 * np.arcsin(length / (2.0 * a)) - 2.0 * np.arcsin(0.2 / (2.0 * a))
    return np.asarray(20.0 * 0.2 / 2.0 * (1.0 - length / 0.2) ** 2 + 0.7 * angle**2)


def test_the_first_curve_and_the_turn_are_masings() -> None:
    """After a turn each slider's spring takes twice its give before it slides: in y the curve is the first, doubled."""
    own = ("hysteresis.moment_N_m=0.5", "hysteresis.load_ratio=0", "hysteresis.give_J=0.01", "hysteresis.spread=2")
    way = ("frame.file=none", "frame.cable_m=0.3", "frame.speed_m_s=0.05", "run.duration_s=12", "run.dt_s=0.005")
    way = ("worm.length_m=0.15", *way)
    free = pulled(*way, *own, "hysteresis.moment_N_m=0")
    record = pulled(*way, *own)
    angle = 2.0 * np.arcsin(record["length"] / (2.0 * np.hypot(0.16, 0.075)))
    y = 0.5 * (angle - angle[0])
    share = (record["pull"] - free["pull"]) * record["diameter"] / 2.0 / (2.0 * 0.5)
    turn = int(np.argmax(record["cable"]))
    gives = 0.01 * 2.0 ** np.array([-1.0, -1.0 / 3.0, 1.0 / 3.0, 1.0])

    def first(y: np.ndarray) -> np.ndarray:
        return np.asarray(np.minimum(y[:, None] / gives, 1.0).mean(axis=1))

    assert_allclose(share[: turn + 1], first(y[: turn + 1]), rtol=0, atol=1e-9)
    assert_allclose(share[turn:], 1.0 - 2.0 * first((y[turn] - y[turn:]) / 2.0), rtol=0, atol=1e-9)
    assert share[turn] > 1.0 - 1e-12
    assert share[-1] < -1.0 + 1e-12


def without_sizes(*overrides: str) -> Record:
    """Return a run of a load frame without values of its own."""
    return simulate(parse_scene('model = "load_frame"', "load_frame", overrides))


def test_a_hydrostat_in_the_frame_is_a_cylinder_of_constant_volume() -> None:
    """l = l0 (h0/h)^2 and F = dE/du, with the spring of both chambers."""
    kept = ("worm.length_m=0.2", "worm.half_height_m=0.15", "worm.spring_N=20", "worm.kelvin_voigt_time_s=0")
    way = ("frame.cable_m=0.3", "frame.speed_m_s=0.05", "run.duration_s=9", "run.dt_s=0.1")
    record = without_sizes("segment.kind=hydrostat", *kept, *way)

    def length(u: np.ndarray) -> np.ndarray:
        return np.asarray(0.2 * (0.15 / (0.15 - u / 6.0)) ** 2)

    def stored(u: np.ndarray) -> np.ndarray:
        return np.asarray(20.0 * 0.2 / 2.0 * (1.0 - length(u) / 0.2) ** 2)

    u = record["cable"]
    assert_allclose(record["length"], length(u), rtol=1e-8)
    assert_allclose(record["diameter"], 0.3 - u / 3.0, rtol=1e-12)
    force = (stored(u + 1e-6) - stored(u - 1e-6)) / 2e-6
    assert_allclose(record["force"], force, rtol=0, atol=1e-6 * force.max())


MESH = Path(robots.__file__).with_name("mesh_segment.toml")


def test_a_law_fitted_to_the_record_follows_it_within_four_percent_both_ways() -> None:
    record, data = simulate(load_scene(MESH)), measured.load(DATA)
    force = measured.simulated_like(record, data)["force"]
    errors = [np.sqrt(np.nanmean((force - data["force"])[way] ** 2)) for way in both_ways(data)]
    assert np.array(errors) / data["force"].max() == pytest.approx([0.0301, 0.0217], abs=0.002)
    assert abs(record.summary["peak_force_N"] - data["force"].max()) < 0.02 * data["force"].max()  # type: ignore[operator]
    assert record.summary["energy_balance_error"] < 1e-5  # type: ignore[operator]
    assert record["hysteresis_loss"].min() >= 0.0


@pytest.mark.parametrize(
    ("overrides", "sentence"),
    [
        (["frame.file=none", "frame.cable_m=0.35"], "the cable is taken in by 0 to 0.35 m, must be from 0 to 0.3299 m"),
        (["worm.length_m=0.2"], "worm.length_m: got 0.2, must be 0.262072975 as in the segment law, or be left out"),
    ],
)
def test_what_a_law_does_not_allow_is_said(overrides: Sequence[str], sentence: str) -> None:
    with pytest.raises(SceneError) as caught:
        load_scene(MESH, overrides)
    assert sentence in str(caught.value)


@pytest.mark.parametrize(
    ("overrides", "sentence"),
    [
        (["frame.file=nowhere.csv"], "frame.file: nowhere.csv: no such file"),
        (["frame.cable_per_diameter=1"], "the cable is taken in by 3e-06 to 0.33 m, must be above"),
        (["frame.file=none", "frame.cable_m=2", "frame.speed_m_s=0.1"], "m with this half_height_m and length_m"),
        (["run.dt_s=1e-6"], "run.dt_s: got 1e-06 s: makes 6.62e+07 steps of run.duration_s"),
        (["worm.half_height_m=[0.1, 0.2]"], "half_height_m: got"),
        (["hysteresis.give_J=0"], "hysteresis.give_J: got 0"),
        (["worm.segments=2"], "worm.segments: "),
    ],
)
def test_what_is_wrong_is_said(overrides: Sequence[str], sentence: str) -> None:
    with pytest.raises(SceneError) as caught:
        pulled(*overrides)
    assert sentence in str(caught.value)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("time_s,force_N\n0,1\n1,2\n", "no column of the cable taken in, must have one named cable_mm (or cable_m)"),
        ("time_s,cable_mm\n0,\n1,\n", "its column of the cable has no number"),
        ("time_s,cable_s\n0,1\n1,2\n", "no column of the cable taken in"),
        ("time_s,cable_mm\n0,1\n0,2\n", "must ascend"),
    ],
)
def test_a_file_without_a_cable_is_said(tmp_path: Path, text: str, sentence: str) -> None:
    path = tmp_path / "cable.csv"
    path.write_text(text)
    with pytest.raises(SceneError) as caught:
        pulled(f"frame.file={path}")
    assert sentence in str(caught.value)


def test_its_pictures_show_model_and_measurement() -> None:
    record = pulled()
    _, axes = figures.force_over_cable(record)
    assert [line.get_label() for line in axes.get_lines()[:2]] == ["measured", "the segment of the model"]
    _, axes = figures.energy(record)
    assert len(axes.get_lines()) == 4
    assert overview.draw(record).size[0] > 500
