"""Files of the cache: whatever happened to them, or whoever wrote them, the next process computes the same."""

from __future__ import annotations

import errno
import os
import resource
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from kept_files import AS_ROOT, fresh, total

from worm3d.machine import cache
from worm3d.machine.cache import files, trust
from worm3d.machine.functions import Function

KEY, CONTENT = "ab" * 32, bytes(range(256)) * 4


@pytest.fixture(autouse=True)
def home(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(files, "_told", set())
    return tmp_path / "worm3d"


def test_what_is_kept_comes_back(home: Path) -> None:
    assert cache.load(home / "kernels", KEY) is None
    assert cache.store(home / "kernels", KEY, CONTENT)
    assert cache.load(home / "kernels", KEY) == CONTENT
    assert cache.load(home / "kernels", "cd" * 32) is None
    for place in (home, home / "kernels"):
        assert place.stat().st_mode & 0o777 == 0o700
    (home / "kernels" / f"{KEY}.kernel").rename(home / "kernels" / f"{'cd' * 32}.kernel")
    assert cache.load(home / "kernels", "cd" * 32) is None, "the checksum covers the key"


def test_compiled_functions_are_kept(home: Path) -> None:
    assert fresh() == (14.0, 3.0, 2)
    assert fresh() == (14.0, 3.0, 0)
    assert len(list((home / "compiled").iterdir())) == 2
    other = Function(total, lambda: "2", 1, lambda: None)
    assert other(np.arange(3.0)) == 5.0
    assert len(list((home / "compiled").iterdir())) == 3, "of other sources it is another function"


@pytest.mark.parametrize("spoilt", ["worm3d", "worm3d/kernels", f"worm3d/kernels/{KEY}.kernel"])
@pytest.mark.parametrize("mode", [0o020, 0o002])
def test_what_others_may_write_is_refused(spoilt: str, mode: int, home: Path, capsys) -> None:
    assert cache.store(home / "kernels", KEY, CONTENT)
    place = home.parent / spoilt
    place.chmod(place.stat().st_mode | mode)
    assert cache.load(home / "kernels", KEY) is None
    said = capsys.readouterr().err
    assert f"worm3d: the cache {home / 'kernels'} is not used, everything is made anew each time: others may" in said
    assert f"{place} (mode" in said
    assert said.count("\n") == 1
    assert f"chmod -R go-w {home}'" in said
    assert cache.store(home / "kernels", KEY, CONTENT) == (place.is_file()), "a folder of doubt is not written either"


@pytest.mark.skipif(not AS_ROOT, reason="only root can give files away")
@pytest.mark.parametrize("spoilt", ["", "worm3d", "worm3d/kernels", f"worm3d/kernels/{KEY}.kernel"])
def test_what_belongs_to_others_is_refused(spoilt: str, home: Path, capsys) -> None:
    assert cache.store(home / "kernels", KEY, CONTENT)
    os.chown(home.parent / spoilt, 12345, 0)
    assert cache.load(home / "kernels", KEY) is None
    assert "belongs to another user (12345); make it your own" in capsys.readouterr().err
    assert cache.store(home / "kernels", KEY, CONTENT) == spoilt.endswith(".kernel")


def test_a_link_is_followed_where_nobody_else_can_set_one(home: Path, tmp_path: Path) -> None:
    safe, open_to_all = tmp_path / "safe", tmp_path / "open"
    safe.mkdir(mode=0o700)
    open_to_all.mkdir()
    open_to_all.chmod(0o777)
    (tmp_path / "link").symlink_to(safe)
    (open_to_all / "link").symlink_to(safe)
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    assert cache.store(tmp_path / "link" / "kernels", KEY, CONTENT)
    assert cache.load(tmp_path / "link" / "kernels", KEY) == CONTENT
    for way in ("open", "open/link", "loop"):
        assert cache.load(tmp_path / way / "kernels", KEY) is None
        assert not cache.store(tmp_path / way / "kernels", KEY, CONTENT)
    open_to_all.chmod(0o1777)
    assert cache.load(open_to_all / "link" / "kernels", KEY) == CONTENT, "as in /tmp"


def test_a_home_that_its_private_group_may_write_to_is_safe(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    home.parent.chmod(0o770)
    monkeypatch.setattr(trust, "_is_private", lambda group: True)
    assert cache.store(home / "kernels", KEY, CONTENT)
    monkeypatch.setattr(trust, "_is_private", lambda group: False)
    assert not cache.store(home / "kernels", KEY, CONTENT)


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EROFS, errno.EDQUOT])
def test_a_disc_that_refuses_is_told_once(number: int, home: Path, monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(files.os, "open", refuse)
    assert fresh() == fresh() == (14.0, 3.0, 2)
    said = [line for line in capsys.readouterr().err.splitlines() if "nothing can be kept in the cache" in line]
    assert len(said) == 1
    assert f"{home / 'compiled'} ({os.strerror(number)})" in said[0]


def test_the_oldest_files_make_room_and_abandoned_ones_go(home: Path) -> None:
    home.mkdir(mode=0o700)
    for name, age in (("other.part", 7200.0), ("busy.part", 0.0)):
        (home / name).write_text("half")
        os.utime(home / name, (files.time.time() - age,) * 2)
    for age, key in enumerate("abcd"):
        assert cache.store(home, key, CONTENT, most=2)
        os.utime(home / f"{key}.kernel", (age, age))
    assert cache.store(home, "e", CONTENT, most=2)
    assert sorted(path.name for path in home.iterdir()) == ["busy.part", "d.kernel", "e.kernel"]


SCRIPT = r"""
import os
import sys
from worm3d.machine.functions import Function

def double(value: float) -> float:
    return 2.0 * value

def compute():
    missed = []
    kept = Function(double, lambda: "1", 1, lambda: missed.append(1))
    line = f"{kept(1.5)} {len(missed)}\n"
    os.write(1, line.encode())

reading, writing = os.pipe()
for _ in range(int(sys.argv[1])):
    if os.fork() == 0:
        os.close(writing)
        os.read(reading, 1)  # until the last one is there
        compute()
        os._exit(0)
os.close(writing)
while True:
    try:
        os.wait()
    except ChildProcessError:
        break
"""


def together(count: int, folder: Path, prepare: Callable[[], None] | None = None) -> tuple[list[str], str]:
    """Return the lines of so many processes that compute at once, and what they complained of."""
    script = folder / "script.py"
    script.write_text(SCRIPT)
    command = [sys.executable, "-W", "error", str(script), str(count)]
    done = subprocess.run(command, text=True, preexec_fn=prepare, capture_output=True, timeout=300, check=True)
    return done.stdout.splitlines(), done.stderr


def test_eight_processes_at_once_keep_the_cache(home: Path, tmp_path: Path) -> None:
    lines, errors = together(8, tmp_path)
    assert {line.rsplit(maxsplit=1)[0] for line in lines} == {"3.0"}
    assert (len(lines), errors) == (8, "")
    assert len(list((home / "compiled").iterdir())) == 1, "one function, and nothing unfinished"
    assert together(1, tmp_path) == (["3.0 0"], "")


def test_a_process_that_may_write_no_file_computes_all_the_same(home: Path, tmp_path: Path) -> None:
    def refuse() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (100, 100))

    lines, errors = together(1, tmp_path, refuse)
    assert lines[0].startswith("3.0 ")
    assert errors == (
        f"worm3d: nothing can be kept in the cache {home / 'compiled'} (File too large); what it would keep is made "
        "anew each time\n"
    )
    assert not list((home / "compiled").iterdir())


def test_nothing_unverified_is_loaded() -> None:
    root = Path(cache.__file__).parents[3]
    sources = [path for name in ("worm3d", "planar", "control", "scenes") for path in (root / name).rglob("*.py")]
    assert not [path for path in sources if "pickle.load" in path.read_text()]
