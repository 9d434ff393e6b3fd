"""Every command and snippet of the README, and of the guides that it leads to, does what it says."""

import functools
import json
import os
import re
import shlex
import signal
import subprocess
import sys
import tomllib
import urllib.request
from collections.abc import Iterable, Mapping
from importlib import metadata
from pathlib import Path

import pytest
from numpy.testing import assert_allclose
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from planar import linkage
from scenes.commands.cli import main
from scenes.studies.paper import cases, corrected_claims
from scenes.sweep.command import Options, checked
from scenes.sweep.plan import Source

ROOT = Path(__file__).parents[1]
README = ROOT / "README.md"
BOOK = ROOT / ".docs"
IN_ORDER = (
    "scenes",
    "play",
    "files",
    "accuracy",
    "compare",
    "gaits",
    "control",
    "faults",
    "learn",
    "sweeps",
    "studies",
    "fit",
)
"""Guides with commands. Those of a guide may need the folders that commands before them have written."""
GUIDES = sorted((BOOK / "guides").glob("*.md"))
ROOMS = [
    ROOT / folder / "README.md"
    for folder in ("scenes", "scenes/studies/bench", "control", "worm3d/physics", "worm3d/solver", "tests/benchmarks")
]
PAGES = [README, *GUIDES, *sorted((BOOK / "evidence").glob("*.md")), BOOK / "citing.md", *ROOMS]
MADE_BY_THE_BUILD = ("physics", "reference", "tutorials", "gallery")
"""Folders of the book that other parts of the tree fill; the build of the book checks links to them."""
BIN = Path(sys.executable).parent
SHORTER = {"anisotropy": ("run.integrator=implicit_euler", "run.dt_s=0.04"), "technologies": ("run.dt_s=0.02",)}
"""Overrides of commands that make a hundred runs: larger steps, whose errors nobody asks for here."""


def blocks(page: Path, language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", page.read_text(), flags=re.DOTALL)


ALL_COMMANDS = (README, *(BOOK / "guides" / f"{name}.md" for name in IN_ORDER))


def commands(pages: Iterable[Path] = ALL_COMMANDS) -> list[list[str]]:
    """Return the shell lines of the README and of the guides, without their set-up, as arguments."""
    lines = [line for page in pages for block in blocks(page, "sh") for line in block.splitlines()]
    lines = [line for line in lines if line and not line.startswith("#")]
    return [shlex.split(line.split("&&")[-1], comments=True) for line in lines]


def subject(arguments: list[str]) -> str:
    """Return the command, or the study that it runs."""
    return arguments[2] if arguments[1:2] == ["study"] else (arguments[1:] or [""])[0]


def run(arguments: list[str], folder: Path) -> str:
    program = str(BIN / Path(arguments[0]).name)
    options = [part for override in SHORTER.get(subject(arguments), ()) for part in ("-o", override)]
    no_browser = {**os.environ, "BROWSER": "true"}  # the program `true` opens nothing
    if subject(arguments) == "play":
        return play([program, *arguments[1:]], folder, no_browser)
    done = subprocess.run(
        [program, *arguments[1:], *options], cwd=folder, capture_output=True, text=True, check=False, env=no_browser
    )
    assert done.returncode == 0, f"{' '.join(arguments)}\n{done.stdout}\n{done.stderr}"
    return done.stdout


def play(command: list[str], folder: Path, no_browser: Mapping[str, str]) -> str:
    """Play a scene until its page has been served."""
    pipe = subprocess.PIPE
    with subprocess.Popen(command, cwd=folder, stdout=pipe, stderr=pipe, text=True, env=no_browser) as playing:
        assert playing.stdout is not None
        said = playing.stdout.readline()
        with urllib.request.urlopen(re.findall(r"http://[^;]*", said)[0], timeout=60) as page:
            assert b"Controls" in page.read()
        playing.send_signal(signal.SIGINT)
        out, errors = playing.communicate(timeout=60)
    assert (playing.returncode, errors) == (0, "")
    return said + out


@pytest.mark.slow
def test_the_paper_is_reproduced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """In this process, with all runs of the published program; those of the corrected worm take a second."""
    (command,) = (arguments for arguments in commands() if subject(arguments) == "paper")
    for module in (cases.linkage, corrected_claims):
        monkeypatch.setattr(module, "simulate", functools.partial(linkage.simulate, duration=1.0))
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit, match=r"^0$"):
        main(command[1:])
    assert "Written to paper" in capsys.readouterr().out
    study = json.loads((tmp_path / "paper" / "paper.json").read_text())
    row = next(r for r in study["rows"] if (r["n"], r["T_wave_s"]) == (6, 2.0))
    assert_allclose(row["reported_distance_m"], 0.739210, rtol=0, atol=1.5e-6)
    assert_allclose(row["work_J"], 4.547915, rtol=0, atol=1.5e-6)
    assert len(study["rows"]) == 9
    assert {c["verdict"] for c in study["claims"]} > {"holds", "does not hold"}
    for figure in range(7, 14):
        assert len(list((tmp_path / "paper").glob(f"figure_{figure}_*.png"))) == 1


def test_the_first_command_shows_a_worm_and_the_second_is_the_one_that_ci_runs() -> None:
    assert commands()[0] == [".venv/bin/worm3d", "run", "flat", "--out", "flat"]
    assert commands()[1] == [".venv/bin/pytest"]
    assert "grep -m 1 'bin/pytest' README.md" in (ROOT / ".ci" / "run").read_text()


def test_what_the_first_command_installs_has_one_version_each_and_runs_sweeps_on_workers() -> None:
    """All that the plain dependencies need in turn stands in the lock file, Dask's worker processes among it."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    lock = (ROOT / "requirements.lock").read_text().splitlines()
    locked = {canonicalize_name(line.partition("==")[0]) for line in lock if "==" in line}
    waiting, needed = list(project["dependencies"]), set()
    while waiting:
        each = Requirement(waiting.pop())
        name = canonicalize_name(each.name)
        if name not in needed and (each.marker is None or each.marker.evaluate({"extra": ""})):
            needed.add(name)
            waiting += metadata.requires(name) or []
    assert "distributed" in needed
    assert needed <= locked


ALONE = ("sweep", "anisotropy", "technologies", "validate")
"""Commands and studies that need no result of another one."""


def test_all_guides_with_commands_are_in_the_order() -> None:
    assert sorted(IN_ORDER) == [page.stem for page in GUIDES if blocks(page, "sh")]


@pytest.mark.parametrize("name", ["sweep", *(pytest.param(name, marks=pytest.mark.slow) for name in ALONE[1:])])
def test_the_commands_that_need_no_result(name: str, tmp_path: Path) -> None:
    asked = [arguments for arguments in commands() if subject(arguments) == name]
    assert asked
    for arguments in asked:
        run(arguments, tmp_path)


def test_the_commands_of_the_readme(tmp_path: Path) -> None:
    for arguments in commands([README]):
        if subject(arguments):
            run(arguments, tmp_path)
    for folder in ("flat", "turn", "circle"):
        assert (tmp_path / folder / "result.nc").is_file()
    assert (tmp_path / "both").is_dir()


@pytest.mark.slow
def test_the_commands(tmp_path: Path) -> None:
    for arguments in commands():
        if subject(arguments) not in ("", "paper", *ALONE):
            run(arguments, tmp_path)
    for folder in ("flat", "further", "turn", "circle", "exact", "turning", "around", "dead"):
        assert (tmp_path / folder / "result.nc").is_file()
    assert (tmp_path / "flat" / "viewer.html").is_file()
    assert (tmp_path / "flat.glb").read_bytes()[:4] == b"glTF"
    assert len((tmp_path / "flat.csv").read_text().splitlines()) > 100
    assert (tmp_path / "my_worm.toml").is_file()


def test_no_snippet_is_lost() -> None:
    """Two of the guide on worlds, one on accuracy, four on controllers, one on a new law of friction."""
    assert len([block for page in GUIDES for block in blocks(page, "python")]) >= 8


@pytest.mark.parametrize("snippet", [block for page in PAGES for block in blocks(page, "python")])
def test_snippets(snippet: str, tmp_path: Path) -> None:
    done = subprocess.run([sys.executable, "-c", snippet], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert [line for line in done.stderr.splitlines() if "compiling, once" not in line] == []
    assert "the run reached its end" in done.stdout


def test_the_readme_needs_ten_lines_of_python() -> None:
    (snippet,) = blocks(README, "python")
    assert len([line for line in snippet.splitlines() if line]) <= 10


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_what_pages_lead_to_is_there(page: Path) -> None:
    links = re.findall(r"\]\(([^)#:]+)\)", page.read_text())
    assert links or page != README
    for link in links:
        place = (page.parent / link).resolve()
        if not any(place.is_relative_to(BOOK / folder) for folder in MADE_BY_THE_BUILD):
            assert place.is_file(), link


def test_files_to_change_are_there() -> None:
    guide = (BOOK / "guides" / "extend.md").read_text()
    places = re.findall(r"`((?:worm3d|control|scenes|planar|tests)/[^`*]*)`", guide)
    assert len(places) > 40
    for place in places:
        assert (ROOT / place).exists(), place


def test_the_sweeps_of_the_guide_are_right() -> None:
    page = BOOK / "guides" / "sweeps.md"
    lines = [line for block in blocks(page, "text") for line in block.splitlines() if line.startswith("worm3d sweep ")]
    lines = [line for line in lines if "--scheduler" not in line]
    assert len(lines) == 3
    for line in lines:
        _, _, scene, *options = shlex.split(line)
        given = list(zip(options[::2], options[1::2], strict=True))
        vary = [value for option, value in given if option == "--vary"]
        random = 5 if "--random" in options else None
        plan = checked(Source.of(scene), Options(vary=vary, random=random, quiet=True))
        assert len(plan.design) in (25, 40, 5), line
