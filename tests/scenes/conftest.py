"""Fixtures of the tests of scenes, results and the command line."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from control.sensing.sensors import QUANTITIES
from scenes.commands.cli import main
from scenes.models.loading import load_scene
from scenes.records.record import Record
from scenes.running.runner import simulate
from worm3d.measures import MEASURES
from worm3d.running.plant import entries

SHORT = ("-o", "run.duration_s=0.2", "-o", "gait.period_s=0.2")


@dataclass(frozen=True)
class Ended:
    code: int
    out: str
    err: str

    @property
    def complaints(self) -> list[str]:
        return self.err.splitlines()


Command = Callable[..., Ended]


@pytest.fixture(scope="session", autouse=True)
def _compiled() -> None:
    """Compile the plant before any test looks at stderr, where a cold start says so."""
    assert all(entry.address for entry in entries().values())


@pytest.fixture
def worm3d(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Command:
    """The command line, in this process and in an empty folder."""
    monkeypatch.chdir(tmp_path)

    def call(*arguments: object) -> Ended:
        capsys.readouterr()
        with pytest.raises(SystemExit) as ended:
            main([str(argument) for argument in arguments])
        captured = capsys.readouterr()
        return Ended(int(ended.value.code or 0), captured.out, captured.err)

    return call


@pytest.fixture(scope="session")
def script() -> str:
    """Path of the console script."""
    return str(Path(sys.executable).parent / "worm3d")


@pytest.fixture
def console(script: str, tmp_path: Path) -> Command:
    """The console script as its users start it, in an empty folder."""

    def call(*arguments: object, **options: object) -> Ended:
        command = [script, *map(str, arguments)]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=60, **options)  # type: ignore[call-overload]
        return Ended(done.returncode, done.stdout, done.stderr)

    return call


@pytest.fixture(scope="session")
def record() -> Record:
    """A short run."""
    return simulate(load_scene("planar_published", SHORT[1::2]))


@pytest.fixture
def zoo(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The module `zoo`, a user's own with parts of every kind, in the folder where the program is started."""
    file = tmp_path / "zoo.py"
    file.write_text(Path(__file__).with_name("parts_of_every_kind.py").read_text())
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    yield file
    sys.modules.pop("zoo", None)
    QUANTITIES.pop("tail", None)
    MEASURES.pop("lift_m", None)
