"""`worm3d fem`: table and pictures of a small segment, mistakes, and the sentence where scikit-fem is missing."""

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from PIL import Image
from scipy.io import netcdf_file

from scenes.studies.law.table import load as load_table

HERE = importlib.util.find_spec("skfem") is not None
needs = pytest.mark.skipif(not HERE, reason="scikit-fem is not installed (extra 'fem')")

SEGMENT = """
[profile]
kind = "barrel"
length_m = 0.1
plate_radius_m = 0.02
middle_radius_m = 0.03
[wall]
thickness_m = 0.002
[rubber]
kind = "neo-Hookean"
shear_modulus_Pa = 1e5
[[fibres]]
stiffness_N = 5.0
per_m = 500.0
[load]
pressure_Pa = [0.0, 2000.0]
"""


@needs
def test_a_small_table_and_its_pictures(worm3d, tmp_path: Path) -> None:
    (tmp_path / "segment.toml").write_text(SEGMENT)
    given = ("fem", "segment.toml", "--out", "out/table.nc", "--states", 13, "--mesh", "6x1")
    ended = worm3d(*given)
    assert (ended.code, ended.complaints) == (0, ["finite elements: 13 states", "mesh error: 5 states"])
    assert ended.out.startswith("13 stable states, ")
    with netcdf_file(tmp_path / "out" / "table.nc", mmap=False) as file:
        columns = {name: np.array(each[:]) for name, each in file.variables.items()}
        assert file.segment.decode() == SEGMENT
        assert 0.0 < file.mesh_error < 0.2
        assert file.rest_length_m == 0.1
    assert columns["stable"].sum() == 13
    free = np.abs(columns["force_N"]) < 1e-6
    assert free.sum() >= 11
    assert (np.diff(columns["length_m"][free]) < 0.0).all()  # pressure shortens the segment
    for name in ("table_shapes.png", "table_states.png"):
        with Image.open(tmp_path / "out" / name) as picture:
            assert picture.size[0] >= 1000
    assert worm3d(*given).complaints == ["out/table.nc exists: choose another name, or replace it with --force"]


@pytest.mark.slow
@needs
def test_bent_states_are_held_by_a_moment_in_their_direction(worm3d, tmp_path: Path) -> None:
    (tmp_path / "segment.toml").write_text(SEGMENT)
    ended = worm3d("fem", "segment.toml", "--out", "t.nc", "--states", 13, "--mesh", "6x1", "--bending", 2)
    assert ended.code == 0
    assert "2 of 2 bent states found" in ended.out
    with netcdf_file(tmp_path / "t.nc", mmap=False) as file:
        bend, moment, stable = (np.array(file.variables[name][:]) for name in ("bend_rad", "moment_Nm", "stable"))
    assert_array_equal(bend[-2:], [0.1, 0.2])
    assert (bend[:-2] == 0.0).all()
    assert (moment[-2:][stable[-2:] > 0] > 0.0).all()
    assert stable[-2:].any()


@pytest.mark.slow
@needs
def test_ground_presses_states_and_the_law_reads_the_stiffness(worm3d, tmp_path: Path) -> None:
    (tmp_path / "segment.toml").write_text(SEGMENT)
    ended = worm3d("fem", "segment.toml", "--out", "t.nc", "--states", 13, "--mesh", "6x1", "--patch", 2)
    assert ended.code == 0
    assert ended.out.count("compliance at ") == 2
    assert (tmp_path / "t_patch.png").exists()
    with netcdf_file(tmp_path / "t.nc", mmap=False) as file:
        rows = {name: np.array(each[:]) for name, each in file.variables.items() if each.dimensions == ("pressed",)}
        stiffness = float(file.contact_stiffness_N_m)
    load, way = rows["pressed_load_N"].reshape(2, -1), rows["pressed_indentation_m"].reshape(2, -1)
    assert (np.diff(load) > 0.0).all()
    assert (np.diff(way) > 0.0).all()
    assert load.min() / way.max() < 2.0 * stiffness < load.max() / way.min()
    assert f"friction.contact_stiffness_N_m = {stiffness:.3g}" in ended.out
    table = load_table(tmp_path / "t.nc")
    assert table.facts["contact_stiffness_N_m"] == stiffness
    assert len(table) == 13  # pressed states are no straight states


@needs
@pytest.mark.parametrize(
    ("given", "complaint"),
    [
        (("nothing",), "there is no segment 'nothing': must be a TOML file, or one of barrel"),
        (("barrel", "--mesh", "20"), "--mesh: got '20', must be two numbers such as 20x2"),
        (("barrel", "--mesh", "20x9"), "--mesh: got '20x9', must be two numbers such as 20x2"),
        (("wrong.toml",), "wrong.toml: wall.thickness_m: got -1.0 m, must be finite and in (0, 0.02)"),
    ],
)
def test_mistakes_are_told(worm3d, tmp_path: Path, given: tuple[str, ...], complaint: str) -> None:
    (tmp_path / "wrong.toml").write_text(SEGMENT.replace("0.002", "-1.0"))
    ended = worm3d("fem", *given, "--out", "table.nc")
    assert ended.code == 2
    assert ended.complaints[0].startswith(complaint)


def test_without_scikit_fem_a_sentence_tells_how_to_get_it(worm3d, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("scenes.studies.fem.command", "worm3d.fem.axisymmetric"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    monkeypatch.setitem(sys.modules, "skfem", None)
    ended = worm3d("fem", "barrel", "--out", "table.nc")
    assert (ended.code, ended.complaints) == (4, ["worm3d fem needs scikit-fem: pip install 'worm3d[fem]'"])
