"""Finding and reading the files of scenes."""

from __future__ import annotations

import errno
import os
import tomllib
from pathlib import Path

from scenes.language.errors import DiscError, SceneError
from worm3d.values import regular_file
from worm3d.values.spelling import did_you_mean

SHIPPED_FOLDER = Path(__file__).parents[1]
"""Folder of the scenes that come with the program."""


def shipped_scenes() -> dict[str, Path]:
    """Return the files of the shipped scenes by name."""
    return {path.stem: path for path in sorted(SHIPPED_FOLDER.glob("*.toml"))}


def find_scene(name_or_path: str) -> Path:
    """Return the path of the file of a scene, given the name of a shipped scene or a path.

    Raises
    ------
    SceneError
        If there is no such scene.
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
    """Return whether the path exists. If this cannot be determined, return True; reading then raises the error."""
    try:
        os.stat(path)
    except (OSError, ValueError) as error:
        return not (isinstance(error, OSError) and error.errno in (errno.ENOENT, errno.ENOTDIR))
    return True


def file_named(name: str) -> Path:
    """Return the path of a file that a scene names: `name` as a path if it exists, otherwise a shipped file."""
    path, shipped = Path(name), SHIPPED_FOLDER / name
    return shipped if not os.path.exists(path) and os.path.isfile(shipped) else path


def read_text(path: Path, instead: str = "'worm3d init FILE' writes a scene to start from") -> str:
    """Return the text of a scene, or of a file that a scene names, without a byte order mark.

    `instead` is the advice in the error message for an empty file.
    """
    try:
        # The limit of 4 MB is enough for a pipe through 50,000 points.
        text = regular_file.read(path, 4_000_000).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise SceneError(f"{path}: not a text in UTF-8 (byte {error.start + 1}); save it as UTF-8") from error
    except OSError as error:
        why = error.strerror or str(error)
        raise DiscError(f"cannot read {path}: {why[:1].lower()}{why[1:]}") from error
    if not text.strip():
        raise SceneError(f"{path}: the file is empty; {instead}")
    return text


def says(path: Path) -> str:
    """Return the value of the key `says` of a scene file, a line that describes the scene, without other checks."""
    return str(tomllib.loads(read_text(path)).get("says", ""))
