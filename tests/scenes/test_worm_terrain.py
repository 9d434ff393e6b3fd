"""Scenes on terrain and in a mesh: their measured figures, and what can be wrong with them."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest

import worm3d
from scenes.language.errors import SceneError
from scenes.language.loader import SHIPPED_FOLDER
from scenes.models.loading import load_scene, parse_scene
from scenes.models.worlds.build import world_of
from scenes.models.worm import build as worm_build

MODEL = 'model = "worm"\n[world]\n'


def run(name: str, *overrides: str) -> worm3d.Result:
    result = worm_build.simulate(load_scene(name, overrides).settings, lambda steps: True)
    assert result.status is worm3d.Status.DONE
    assert result.energy.balance_error < 1e-9
    return result


def lines_about(text: str, *overrides: str) -> list[str]:
    with pytest.raises(SceneError) as caught:
        parse_scene(text, "test", overrides)
    return list(caught.value.lines)


def test_rubble_is_crossed_as_the_scene_says() -> None:
    """About 0.8 m; each stone counts, so that rounding shows, by several centimetres."""
    assert run("rubble").distance == pytest.approx(0.84, abs=0.2)
    assert run("rubble", "world.height_m=0.02").distance > 1.3
    assert abs(run("rubble", "world.height_m=0.05").distance) < 0.3


def test_the_tunnel_is_followed_as_the_scene_says() -> None:
    result = run("mesh_tunnel")
    assert result.distance == pytest.approx(1.31, abs=0.05)
    assert np.rad2deg(result.heading[-1] - result.heading[0]) == pytest.approx(11.0, abs=5.0)
    assert result.com[-1, 2] - result.com[0, 2] == pytest.approx(0.055, abs=0.01)
    assert result.world is not None
    assert -result.world.distance(result.points[::50]).min() < 1e-3 * result.worm.l0, "it stays in the air"


def test_the_shipped_mesh_is_what_its_generator_makes() -> None:
    path = Path(__file__).parents[1] / "mesh_tunnel.py"
    spec = importlib.util.spec_from_file_location("mesh_tunnel", path)
    assert spec is not None
    assert spec.loader is not None
    generator = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(generator)
    shipped, made = (
        np.frombuffer(data[84:], dtype=np.dtype([("numbers", "<f4", 12), ("_", "<u2")]))["numbers"]
        for data in (generator.FILE.read_bytes(), generator.content())
    )
    np.testing.assert_allclose(shipped, made, rtol=0, atol=1e-5)
    assert generator.FILE.stat().st_size < 100_000


@pytest.mark.parametrize("surface", ["rubble", "steps", "sinusoid"])
def test_each_surface_becomes_terrain(surface: str) -> None:
    settings = parse_scene(
        f'{MODEL}kind = "heightfield"\nsurface = "{surface}"\nsize_m = 0.5\ngrip = 0.5', "test"
    ).settings
    world = world_of(settings.world)  # type: ignore[attr-defined]
    assert isinstance(world, worm3d.Heightfield)
    assert np.ptp(world.heights) > 0.02
    assert world.grip == 0.5


def test_a_picture_becomes_terrain(tmp_path: Path) -> None:
    from PIL import Image

    ramp = np.repeat(np.arange(0, 256, 2, dtype=np.uint8)[None], 64, axis=0)
    Image.fromarray(ramp).save(tmp_path / "ramp.png")
    text = f'{MODEL}kind = "heightfield"\nsurface = "image"\nfile = "{tmp_path / "ramp.png"}"\nheight_m = 0.1'
    world = world_of(parse_scene(text + "\n[start]\nposition_m = [0.2, 0.6]", "test").settings.world)  # type: ignore[attr-defined]
    assert isinstance(world, worm3d.Heightfield)
    np.testing.assert_allclose(world.heights[[0, -1], 5], [0.0, 0.1 * 254 / 255], rtol=1e-12)


@pytest.mark.parametrize(
    ("section", "lines"),
    [
        (
            'kind = "mesh"',
            ["line 3: world.kind: missing: world.kind = 'mesh' needs it; give the path of a mesh"],
        ),
        (
            'kind = "mesh"\nfile = "gone.stl"\nunits = "m"',
            ["line 4: world.file: mesh 'gone.stl': there is no such file in '.'; check the path"],
        ),
        (
            'kind = "mesh"\nfile = "mesh_tunnel.stl"',
            [
                "line 4: world.file: mesh 'mesh_tunnel.stl': units: got none, must be one of 'm', 'cm', 'mm', "
                "'in', 'ft': STL files do not say theirs"
            ],
        ),
        (
            'kind = "plane"\nfile = "mesh_tunnel.stl"',
            [
                "line 4: world.file: only for world.kind = 'heightfield' or 'mesh', but this scene has 'plane': "
                "leave it out (default 'none'), or change world.kind"
            ],
        ),
        (
            'kind = "heightfield"\nextent_m = [100.0, 100.0]',
            ["line 4: world.extent_m: got [100.0, 100.0] m at world.spacing_m = 0.02: makes 2.5e+07 heights, at most"],
        ),
        (
            'kind = "heightfield"\nsurface = "steps"\nramp_m = 0.5',
            ["line 5: world.ramp_m: got 0.5 m: a step rises over at most its tread, world.size_m (0.15 m)"],
        ),
    ],
)
def test_mistakes_get_their_line(section: str, lines: list[str]) -> None:
    found = lines_about(MODEL + section)
    assert len(found) == len(lines)
    for line, expected in zip(found, lines, strict=True):
        assert line.startswith(expected)


def test_a_mesh_is_looked_up_beside_its_scene_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also from another folder, where a file of that name is something else; shipped ones keep their short names."""
    (tmp_path / "mine").mkdir()
    shipped = SHIPPED_FOLDER / "mesh_tunnel.stl"
    (tmp_path / "mine" / "rock.stl").write_bytes(shipped.read_bytes())
    (tmp_path / "rock.stl").write_text("no mesh")
    monkeypatch.chdir(tmp_path)
    scene = 'kind = "mesh"\nunits = "m"\nsolid = "outside"\ncell_m = 0.03\n[start]\nposition_m = [0.1, 0.0]'
    for file, found in (("rock.stl", str(tmp_path / "mine" / "rock.stl")), ("mesh_tunnel.stl", "mesh_tunnel.stl")):
        (tmp_path / "mine" / "scene.toml").write_text(f'{MODEL}file = "{file}"\n{scene}')
        settings = load_scene(tmp_path / "mine" / "scene.toml").settings
        assert settings.world.file == found  # type: ignore[attr-defined]


def test_terrain_that_the_worm_cannot_start_on() -> None:
    high = lines_about(f'{MODEL}kind = "heightfield"\nheight_m = 0.08\nsize_m = 0.08')
    assert len(high) == 1
    assert "finer than the worm's contact points" in high[0]
    away = lines_about(f'{MODEL}kind = "heightfield"\n[start]\nposition_m = [3.5, 0.0]')
    assert len(away) == 1
    assert "beyond the terrain" in away[0]
