"""Names of what happens to be installed, put where a scene may name a part of a user's own: is any of it called?

    python tests/fuzz/strangers.py SEED NUMBER

takes classes and functions of all installed distributions at random, this one's included, and puts `module:NAME` of
each into every key that takes one. Each is replaced in its module by a stand-in that notes a call. Prints the number of
values, and what was called, as JSON; a program of its own, because it imports whatever there is.
"""

from __future__ import annotations

import contextlib
import functools
import io
import json
import random
import sys
import warnings
from collections.abc import Callable, Iterator
from importlib import import_module, metadata
from pathlib import Path
from typing import Any

import control
from control.parts import PART_KINDS
from scenes.language.errors import SceneError
from scenes.language.loader import find_scene, read_text
from scenes.models.loading import Draft

ROOT = Path(control.__file__).parents[1]
OURS = ("control", "planar", "scenes", "worm3d")
KEYS = {
    "controller.kind={}": "controller",
    "controller.estimator={}": "estimator",
    "controller.model={}": "model",
    'cost.parts=["speed", "{}"]': "term",
    'constraints.parts=["roll", "{}"]': "constraint",
    "reference.kind={}": "path",
    "world.kind={}": "world",
    "actuator.kind={}": "actuator",
    "hinge_actuator.kind={}": "actuator",
    "hysteresis.kind={}": "hysteresis",
    "medium.kind={}": "medium",
    "segment.kind={}": "segment",
    "load.kind={}": "load",
    "friction.law={}": "law",
    'measures.parts=["{}"]': "measure",
    'fault."{}"=true': "fault",
    'sensor."{}"=true': "channel",
    'reference.obstacles=[{{kind="{}", x_m=1, y_m=1, radius_m=0.1}}]': "obstacle",
}
"""Overrides of the scene path_line that name a part, and the kind of part that the key takes."""
OF_GAITS = {"gait.kind={}": "gait", 'reflexes."{}"=true': "reflex", 'sensor."{}"=true': "channel"}
"""Those of the scene flat that it has beside or in place of these."""
TRIED = {"path_line": KEYS, "flat": OF_GAITS}


def modules() -> list[str]:
    """Return the names of all modules of Python source of installed distributions, and of this one."""
    others = {str(file) for each in metadata.distributions() for file in each.files or ()}
    ours = {str(path.relative_to(ROOT)) for name in OURS for path in (ROOT / name).rglob("*.py")}
    paths = [file.removesuffix(".py").removesuffix("/__init__") for file in sorted(others | ours) if file[-3:] == ".py"]
    return [".".join(path.split("/")) for path in paths if all(map(_is_plain, path.split("/")))]


def _is_plain(name: str) -> bool:
    return name.isidentifier() and not name.startswith(("_", "test", "conftest"))


def candidates(rng: random.Random) -> Iterator[tuple[Any, str, Any]]:
    """Yield modules, and a class or function of each with its name there."""
    known = modules()
    while True:
        module, names = None, []
        with contextlib.suppress(BaseException), contextlib.redirect_stdout(io.StringIO()):
            module = import_module(rng.choice(known))
            names = sorted(name for name, each in vars(module).items() if callable(each) and name.isidentifier())
        if module is not None and names:
            name = rng.choice(names)
            yield module, name, vars(module)[name]


def stand_in(thing: Any, note: Callable[[], None]) -> Any:
    """Return what looks like a class or function, with its methods and attributes, and notes each call."""

    def called(*args: Any, **given: Any) -> Any:
        note()

    if isinstance(thing, type):
        with contextlib.suppress(Exception):
            return type(thing)(thing.__name__, (thing,), {"__new__": called, "__init__": called})
    with contextlib.suppress(Exception):
        functools.update_wrapper(called, thing)
    return called


def _check(scene: Draft, override: str, module: Any, name: str, replaced: Any) -> bool:
    """Return whether a scene is accepted with an override, while a name of a module means something else."""
    before = vars(module)[name]
    setattr(module, name, replaced)
    try:
        scene.checked([override])
    except SceneError:
        return False
    finally:
        setattr(module, name, before)
    return True


def main(seed: int, number: int) -> None:
    """Print what is called of so many values in each key."""
    warnings.simplefilter("ignore")
    scenes = {name: Draft(read_text(find_scene(name)), name, ["run.duration_s=1"]) for name in TRIED}
    for each in scenes.values():
        each.checked()
    asked = [(scenes[name], key, kind) for name, keys in TRIED.items() for key, kind in keys.items()]
    found = candidates(random.Random(seed))
    tried, called, accepted = 0, [], []
    while tried < number:
        module, name, thing = next(found)
        value, tried = f"{module.__name__}:{name}", tried + 1
        for scene, key, kind in asked:
            if isinstance(thing, type) and PART_KINDS[kind].base_class in thing.__mro__:
                continue  # a part that ships
            usual: list[str] = []  # calls by the check itself, of functions of this distribution
            if module.__name__.split(".")[0] in OURS:
                _check(
                    scene,
                    key.format("json:loads"),
                    module,
                    name,
                    stand_in(thing, functools.partial(usual.append, value)),
                )
            if usual:
                continue
            note = functools.partial(called.append, key.format(value))
            if _check(scene, key.format(value), module, name, stand_in(thing, note)):
                accepted.append(key.format(value))
    sys.stdout.write(json.dumps({"tried": tried, "called": called, "accepted": accepted}))


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
