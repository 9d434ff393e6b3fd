"""Every command and snippet of the README does what it says."""

import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from numpy.testing import assert_allclose

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text()
BIN = Path(sys.executable).parent


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", README, flags=re.DOTALL)


def commands() -> list[list[str]]:
    """Return the README's shell lines, without their set-up, as arguments."""
    lines = [line for block in blocks("sh") for line in block.splitlines() if line]
    return [shlex.split(line.split("&&")[-1], comments=True) for line in lines]


def run(arguments: list[str], folder: Path) -> str:
    program = str(BIN / Path(arguments[0]).name)
    no_browser = {**os.environ, "BROWSER": "true"}  # the program `true` opens nothing
    done = subprocess.run(
        [program, *arguments[1:]], cwd=folder, capture_output=True, text=True, check=False, env=no_browser
    )
    assert done.returncode == 0, f"{' '.join(arguments)}\n{done.stdout}\n{done.stderr}"
    return done.stdout


def test_the_first_command_reproduces_the_paper(tmp_path: Path) -> None:
    assert commands()[0] == [".venv/bin/worm3d", "paper"]
    out = run(commands()[0], tmp_path)
    (folder,) = (tmp_path / "runs").iterdir()
    assert f"Written to runs/{folder.name}" in out
    study = json.loads((folder / "paper.json").read_text())
    row = next(r for r in study["rows"] if (r["n"], r["T_wave_s"]) == (6, 2.0))
    assert_allclose(row["reported_distance_m"], 0.739210, rtol=0, atol=1.5e-6)
    assert_allclose(row["work_J"], 4.547915, rtol=0, atol=1.5e-6)
    assert len(study["rows"]) == 9
    assert {c["verdict"] for c in study["claims"]} > {"holds", "does not hold"}
    for figure in range(7, 14):
        assert len(list(folder.glob(f"figure_{figure}_*.png"))) == 1


def test_the_second_command_is_the_one_that_ci_runs() -> None:
    assert commands()[1] == [".venv/bin/pytest"]
    assert "grep -m 1 'bin/pytest' README.md" in (ROOT / ".ci" / "run").read_text()


def test_the_other_commands(tmp_path: Path) -> None:
    for arguments in commands()[2:]:
        run(arguments, tmp_path)
    for folder in ("flat", "further", "slow"):
        assert (tmp_path / folder / "result.nc").is_file()
    assert (tmp_path / "segments" / "summary.json").is_file()
    assert (tmp_path / "flat" / "viewer.html").is_file()
    assert (tmp_path / "flat.glb").read_bytes()[:4] == b"glTF"
    assert len((tmp_path / "slow.csv").read_text().splitlines()) == 1002


@pytest.mark.parametrize("snippet", blocks("python"))
def test_snippets(snippet: str, tmp_path: Path) -> None:
    done = subprocess.run([sys.executable, "-c", snippet], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert [line for line in done.stderr.splitlines() if "compiling, once" not in line] == []
    assert len([line for line in snippet.splitlines() if line]) <= 10
    assert "the run reached its end" in done.stdout


def test_pictures_exist() -> None:
    pictures = re.findall(r"!\[[^]]*\]\(([^)]+)\)", README)
    assert pictures
    for picture in pictures:
        assert (ROOT / picture).is_file()
