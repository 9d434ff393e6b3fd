"""Every part and command in one process, and then all again in a second one that finds what the first has compiled.

    python tests/twice.py         # both processes, with a new cache of their own
    python tests/twice.py first   # one of them, with the cache of $XDG_CACHE_HOME: "again" after "first"

A process that crashes has named the part last. The second one may import no compiler: all compiled functions are kept.
"""

from __future__ import annotations

import contextlib
import faulthandler
import io
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

Part = tuple[str, Callable[[], object]]

STEPS = ("run.duration_s=0.2",)
"""What shortens a scene to a few steps."""
SECOND = ("-o", "run.duration_s=0.2", "-o", "gait.period_s=0.2")
COMMANDS = """
list
info
check path_line
init mine.toml
run flat --out flat
run flat -o gait.kind=ei_chain --out chain
run planar_published --out planar
resume flat --duration 0.1 --out further
plot flat --out figures
animate planar --force
export flat --csv flat.csv --glb flat.glb
sweep flat --vary worm.segments=5,6 --out grid
compare flat further --out both
fit flat --to flat.csv --vary gait.amplitude=0.1:0.3 --out fitted
"""
"""Commands, a line each; longer ones follow in the tests of the README, in other processes with the same cache."""
LENGTHENED = ("run", "sweep", "fit")


def main() -> int:
    """Run the process that is asked for, or both; return the exit code."""
    if len(sys.argv) > 1:
        return everything(again=sys.argv[1] == "again")
    with tempfile.TemporaryDirectory() as cache:
        places = os.environ | {"XDG_CACHE_HOME": cache}
        codes = [subprocess.run([sys.executable, __file__, name], env=places).returncode for name in ("first", "again")]
    return int(any(codes))


def everything(again: bool) -> int:
    """Run all parts; return 1 where one has failed, or something was compiled again."""
    faulthandler.enable()
    began, failed = time.perf_counter(), []
    with tempfile.TemporaryDirectory() as place, contextlib.chdir(place):
        for name, part in parts():
            say(f"{name} ... ")
            since = time.process_time()
            try:
                part()
            except Exception as error:
                failed.append(f"{name}: {type(error).__name__}: {error}")
            say(f"{time.process_time() - since:.1f} s\n")
    compiled = "numba" in sys.modules
    say(f"{time.perf_counter() - began:.0f} s; compiler {'imported' if compiled else 'not needed'}\n")
    failed += (
        ["something was compiled again: what the first process compiles is not kept"] if again and compiled else []
    )
    say("".join(f"FAILED {line}\n" for line in failed))
    return int(bool(failed))


def parts() -> Iterator[Part]:
    """Yield all parts by name."""
    sys.path.append(str(Path(__file__).parent / "worm3d"))
    from learned_laws import written

    from control import gaits
    from scenes.commands.cli import main as command
    from scenes.language.loader import shipped_scenes
    from scenes.language.schema import keys_in
    from scenes.models.loading import load_scene
    from scenes.running.runner import simulate
    from worm3d.physics.friction_laws import LAWS

    def scene(name: str, *changes: str) -> Part:
        return f"{name} {' '.join(changes)}", lambda: simulate(load_scene(name, [*STEPS, *changes]))

    settings = load_scene("flat", []).settings
    for name in shipped_scenes():
        text = shipped_scenes()[name].read_text()  # with steps that come later than such a run ends
        steps = [f"reference.{kind}_steps=[]" for kind in ("speed", "heading") if f"{kind}_steps" in text]
        yield scene(name, *steps)
    for section in ("actuator", "hysteresis", "medium", "segment"):
        kinds = keys_in(type(getattr(settings, section)))["kind"].choices
        more = {"learned": (f"segment.file={written(Path())}",)}
        for kind in kinds:
            yield scene("flat", f"{section}.kind={kind}", "worm.drag_N_s_m=0.1", *more.get(kind, ()))
    yield from (scene("flat", f"gait.kind={kind}") for kind in gaits.GAITS)
    yield from (scene("flat", f"friction.law={law}") for law in LAWS)
    yield from (scene("flat", f"world.kind={kind}") for kind in ("clamped", "groove", "none"))
    yield from compiled_elsewhere()
    for line in COMMANDS.strip().splitlines():
        words = line.split()
        yield (
            f"worm3d {line}",
            lambda words=words: ended(command, [*words, *(SECOND if words[0] in LENGTHENED else ())]),
        )


def ended(command: Callable[[list[str]], object], words: list[str]) -> None:
    """Run a command, which must end with 0."""
    out = io.StringIO()
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(out):
            command(words)
    except SystemExit as end:
        if end.code not in (0, None):
            raise RuntimeError(f"ended with {end.code}: {out.getvalue()}") from None


def compiled_elsewhere() -> Iterator[Part]:
    """Yield what is compiled and called by no scene."""
    from control.gaits.larva_ei.network import crawling
    from control.gaits.neural import kernel

    rng = np.random.default_rng(1)
    chain = rng.uniform(0.5, 1.5, (9, 6, 2))
    yield "larva_ei crawling", lambda: crawling(1.0)
    yield "onsets of ei_chain", lambda: kernel.onsets(np.zeros((2, 6, 2)), chain, np.ones((6, 2)), 1e-3, 100)


def say(text: str) -> None:
    """Write at once, so that a crash finds it written."""
    sys.stdout.write(text)
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
