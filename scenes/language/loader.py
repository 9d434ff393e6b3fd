"""Scenes from disc: found by name or path, read, overridden, checked; all mistakes are reported at once."""

from __future__ import annotations

import errno
import os
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from scenes import models
from scenes.language import toml_text
from scenes.language.errors import DiscError, SceneError, printable
from scenes.language.mistakes import Mistake, did_you_mean, report, schema_mistakes
from scenes.language.overrides import apply_overrides
from scenes.language.schema import section_type
from scenes.language.toml_lines import key_lines
from scenes.language.toml_syntax import parse
from scenes.models.base import Model
from scenes.models.checks import cross_mistakes
from scenes.models.sections import Settings
from worm3d.values import regular_file

SHIPPED = Path(__file__).parents[1]
"""Folder of the scenes that come with the program."""

LARGEST_FILE = 4_000_000
"""Largest scene file [byte]: a pipe through 50,000 points."""


@dataclass(frozen=True)
class Scene:
    """A checked scene: its name, its model and its settings, every default filled in."""

    name: str
    model: Model[Any]
    settings: Settings

    def to_toml(self) -> str:
        """Return the resolved scene as TOML; it can be loaded again."""
        return toml_text.document(self.settings)


def load_scene(name_or_path: str | Path, overrides: Iterable[str] = ()) -> Scene:
    """Read and check a scene.

    Parameters
    ----------
    name_or_path : str or Path
        Name of a shipped scene, or a TOML file. A file named in it is looked up beside it first.
    overrides : iterable of str
        `section.key=value` each; the value is TOML, a bare word is a text.

    Raises
    ------
    SceneError
        With one line for each mistake.
    """
    path = find_scene(str(name_or_path))
    return parse_scene(read_text(path), path.stem, overrides, path.parent)


def parse_scene(text: str, name: str, overrides: Iterable[str] = (), folder: Path | None = None) -> Scene:
    """Check a scene given as TOML text; see `load_scene`. Files that it names are looked up in a folder first."""
    written = parse(text)
    if folder is not None and folder != SHIPPED:
        _look_beside(written, folder)
    data, overridden, mistakes = apply_overrides(written, overrides)
    model, model_mistakes = _model_of(data)
    data = _with_every_section(model, {**data, "model": model.name})
    mistakes += model_mistakes + schema_mistakes(model.schema, data, _models_with)
    mistakes += cross_mistakes(model.checks, model.schema, data, mistakes, overridden)
    if mistakes:
        raise SceneError(*report(mistakes, key_lines(text), overridden))
    return Scene(printable(name), model, model.schema.model_validate(data))


def _look_beside(data: dict[str, Any], folder: Path) -> None:
    """Give the file of a scene's world its whole path, if it is in a folder."""
    world = data.get("world")
    if isinstance(world, dict) and isinstance(world.get("file"), str) and os.path.isfile(folder / world["file"]):
        world["file"] = str((folder / world["file"]).resolve())


def shipped_scenes() -> dict[str, Path]:
    """Return the files of the scenes that come with the program, by name."""
    return {path.stem: path for path in sorted(SHIPPED.glob("*.toml"))}


def find_scene(name_or_path: str) -> Path:
    """Return the file that a name or path means.

    Raises
    ------
    SceneError
        There is no such scene.
    """
    shipped, path = shipped_scenes(), Path(name_or_path)
    if name_or_path in shipped:
        return shipped[name_or_path]
    if os.path.isdir(path):
        raise SceneError(f"{path} is a folder; a scene is a TOML file or one of the names of 'worm3d list'")
    if _is_there(path):
        return path
    if path.suffix == ".toml" or len(path.parts) > 1:
        raise SceneError(f"{path}: no such file; 'worm3d init {path}' writes a scene to start from")
    meant = did_you_mean(name_or_path, [(name, name) for name in shipped])
    guess = f"; did you mean '{meant}'?" if meant else ";"
    raise SceneError(f"unknown scene '{name_or_path}'{guess} 'worm3d list' names all scenes")


def _is_there(path: Path) -> bool:
    """Return whether there is such a file, or something that keeps one from looking: reading it will tell."""
    try:
        os.stat(path)
    except (OSError, ValueError) as error:
        return not (isinstance(error, OSError) and error.errno in (errno.ENOENT, errno.ENOTDIR))
    return True


def read_text(path: Path) -> str:
    """Return the text of a scene file; a byte order mark is dropped."""
    try:
        text = regular_file.read(path, LARGEST_FILE).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise SceneError(f"{path}: not a text in UTF-8 (byte {error.start + 1}); save it as UTF-8") from error
    except OSError as error:
        why = error.strerror or str(error)
        raise DiscError(f"cannot read {path}: {why[:1].lower()}{why[1:]}") from error
    if not text.strip():
        raise SceneError(f"{path}: the file is empty; 'worm3d init FILE' writes a scene to start from")
    return text


def _model_of(data: Mapping[str, Any]) -> tuple[Model[Any], list[Mistake]]:
    """Return the scene's model; if that is wrong, the likeliest one, so that the rest can be checked."""
    model, known = data.get("model"), models.names()
    if isinstance(model, str) and model in known:
        return models.get(model), []
    meant = did_you_mean(str(model), [(name, name) for name in known])
    model = models.get(meant) if meant else max(map(models.get, known), key=lambda k: _shared_sections(k, data))
    found = f"got {toml_text.shown(model)}" if "model" in data else "missing"
    guess = f"; did you mean '{meant}'?" if meant else ""
    allowed = ", ".join(f"'{name}'" for name in known)
    text = f"{found}: must be one of {allowed}{guess} (the rest is checked as '{model.name}')"
    return model, [Mistake(("model",), text)]


def _models_with(section: str) -> list[str]:
    return [name for name in models.names() if section in models.get(name).schema.model_fields]


def _shared_sections(model: Model[Any], data: Mapping[str, Any]) -> int:
    return len(model.schema.model_fields.keys() & data.keys())


def _with_every_section(model: Model[Any], data: Mapping[str, Any]) -> dict[str, Any]:
    """Write out sections that were left out, so that each of their mandatory keys is missed by name."""
    fields = model.schema.model_fields.items()
    return {**{name: {} for name, field in fields if section_type(field)}, **data}


def says(path: Path) -> str:
    """Return the line by which a scene introduces itself, without checking the scene."""
    return str(tomllib.loads(read_text(path)).get("says", ""))
