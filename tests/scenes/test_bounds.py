"""What is too large, too deep or no file is refused before anything works on it."""

import math
import os
from pathlib import Path

import pytest
from fuzzing import no_hang

from scenes.language.errors import SceneError, printable
from scenes.models.loading import load_scene, parse_scene

LONG = "a" * 5000

WORLDS = {
    "stones": ('kind = "heightfield"\nstones = 1' + "0" * 25, r"world\.stones: got 1000.*less than or equal to 922337"),
    "narrow field": ('kind = "heightfield"\nextent_m = [2e5, 0.001]', r"world\.extent_m: .* at most 4e6 are allowed"),
    "many stones": (
        'kind = "heightfield"\nsize_m = 1e-4',
        r"size: got 0\.0001 m, which makes .* stones, at most 1e\+05",
    ),
    "long path": (
        f'kind = "mesh"\nunits = "m"\nfile = "{LONG}.stl"',
        r"world\.file: mesh 'aaa.* \.\.\. .*File name too",
    ),
    "null": (
        'kind = "mesh"\nunits = "m"\nfile = "a\\u0000.stl"',
        r"mesh 'a.*x00\.stl': cannot be read \(embedded null",
    ),
    "device": (
        'kind = "mesh"\nunits = "m"\nfile = "zero.stl"',
        r"mesh 'zero\.stl': cannot be read \(not a regular file",
    ),
    "fifo": ('kind = "mesh"\nunits = "m"\nfile = "fifo.stl"', r"mesh 'fifo\.stl': cannot be read \(not a regular file"),
    "folder": (
        'kind = "mesh"\nunits = "m"\nfile = "folder.stl"',
        r"mesh 'folder\.stl': cannot be read \(Is a directory",
    ),
    "fifo as a picture": (
        'kind = "heightfield"\nsurface = "image"\nfile = "fifo.stl"',
        r"heightfield image 'fifo\.stl': cannot be read \(not a regular file",
    ),
    "patches": (
        "\n".join(f"[[world.patches]]\ngrip = 0.5\nalong_m = [{k}, {k + 1}]" for k in range(10_000)),
        r"patches: got 10000, must be at most 1000; take fewer",
    ),
    "radii": (
        'kind = "pipe"\n' + "\n".join(f"[[world.radii]]\nat_m = {k}\nradius_m = 0.12" for k in range(3000)),
        r"along: got 3000 places, must be at most 200",
    ),
}


@pytest.fixture(autouse=True)
def _odd_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    os.mkfifo("fifo.stl")
    os.mkfifo("fifo.toml")
    os.symlink("/dev/zero", "zero.stl")
    Path("folder.stl").mkdir()


def refused(text: str, sentence: str, *overrides: str) -> None:
    with no_hang(), pytest.raises(SceneError, match=sentence) as caught:
        parse_scene(text, "test", overrides)
    assert all(line.isprintable() and len(line) < 1100 for line in caught.value.lines)
    assert len(caught.value.lines) <= 101


@pytest.mark.parametrize("case", WORLDS)
def test_worlds(case: str) -> None:
    keys, sentence = WORLDS[case]
    refused(f'model = "worm"\n[world]\n{keys}\n', sentence)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("[run]\nduration_s = 1e9\ndt_s = 1.0\nrecord_every = 999999937\n", "run.dt_s: .* at most a 10th"),
        ("x = " + "{a = " * 50 + "1" + "}" * 50, "nested too deeply: got more than 20"),
        ("[worm" + ".a" * 3000 + "]\nb = 1\n", "nested too deeply: got more than 20"),
        ("[worm]\nlength_m = " + "[" * 60 + "]" * 60, "nested too deeply: got more than 20"),
        ("".join(f"key{k} = 1\n" for k in range(20_000)), r"line 2: key0: unknown key(.|\n)*and 19900 mistakes more"),
        ("[worm]\n" + "".join(f"key{k} = 1\n" for k in range(20_000)), "and 19900 mistakes more"),
        ("[[world.patches]]\n" * 20_000, "world.patches.0..grip: missing"),
        ('"\\u001b[31mred\\u0007\\u202e" = 1', r"\\x1b\[31mred\\x07\\u202e: unknown key"),
        ("mass = " + "9" * 400, "mass: unknown"),
        ("x = " + "y" * 100_000 + "\n", "broken TOML"),
    ],
    ids=["divisor", "tables", "sections", "lists", "keys", "keys of a section", "patches", "control", "digits", "line"],
)
def test_texts(text: str, sentence: str) -> None:
    refused(f'model = "worm"\n{text}', sentence)


@pytest.mark.parametrize(
    ("override", "sentence"),
    [
        ("worm.length_m=" + "[" * 5000, "worm.length_m: got"),
        (".".join("a" * 3000) + "=1", "must be written as section.key=value"),
        ("run.duration_s=" + "9" * 5000, "run.duration_s: got"),
    ],
)
def test_overrides(override: str, sentence: str) -> None:
    refused('model = "worm"\n', sentence, override)
    refused('model = "worm"', "got 1001 overrides, at most 1000", *["seed=1"] * 1001)


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("fifo.toml", "cannot read fifo.toml: not a regular file but a pipe, socket or device"),
        ("/dev/zero", "cannot read /dev/zero: not a regular file"),
        (LONG, "cannot read aaa.*file name too long"),
        (f"{LONG}.toml", "cannot read aaa.*file name too long"),
        ("a\0b.toml", r"cannot read a\\x00b.toml: embedded null"),
        ("large.toml", "cannot read large.toml: larger than 4 MB"),
        ("folder.stl", "folder.stl is a folder"),
    ],
)
def test_files_that_are_no_scenes(name: str, sentence: str) -> None:
    Path("large.toml").write_bytes(b"#" * 4_000_001)
    with no_hang(), pytest.raises(SceneError, match=sentence) as caught:
        load_scene(name)
    assert all(len(line) < 1100 for line in caught.value.lines)


def test_a_line_of_output_is_shown_by_any_terminal() -> None:
    assert printable("a\x1b[2J\r\n\u202e\ud800é…") == r"a\x1b[2J\r\n\u202e\ud800é…"
    assert len(printable("x" * 10_000)) < 1100


def test_a_pipe_through_many_points_is_no_mistake() -> None:
    """Its cost grows with their number alone, also where it comes back upon itself."""
    for turns in (0.0, 8.0):
        angle = [2.0 * math.pi * turns * k / 1000 for k in range(1000)]
        points = [f"[{0.002 * k + math.sin(a)}, {1.0 - math.cos(a)}, {1e-4 * k}]" for k, a in enumerate(angle)]
        with no_hang():
            parse_scene(f'model = "worm"\n[world]\nkind = "pipe"\npoints_m = [{", ".join(points)}]\n', "test")
