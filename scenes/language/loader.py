"""Loading of scenes by name or path: read, override and check; all mistakes are reported together."""

from __future__ import annotations

import errno
import os
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cache, cached_property, partial
from pathlib import Path
from typing import Any, Generic, Protocol, TypeVar

from scenes.language import own, toml
from scenes.language.checks import Check, Passed, cross_mistakes, kind_checks
from scenes.language.errors import DiscError, SceneError, printable
from scenes.language.mistakes import Mistake, report, validated
from scenes.language.overrides import apply_overrides
from scenes.language.schema import Section, key_at, keys_in, with_own_defaults
from scenes.language.sweep_section import OUTSIDE, STUDY, SWEEP, outside_mistakes
from worm3d.values import regular_file
from worm3d.values.spelling import did_you_mean

SHIPPED_FOLDER = Path(__file__).parents[1]
"""Folder of the scenes that come with the program."""

LARGEST_FILE = 4_000_000
"""Largest scene file [byte]: enough for a pipe through 50,000 points."""

_EMPTY: dict[str, Any] = {}
"""Data of a section that the file leaves out."""


class Model(Protocol):
    """Interface of a model for the scene language."""

    @property
    def name(self) -> str:
        """Name of the model: the value of `model` in a scene."""

    @property
    def title(self) -> str:
        """Noun phrase that describes the model to users."""

    @property
    def schema(self) -> type[Section]:
        """Schema of the whole scene."""

    @property
    def checks(self) -> tuple[Check, ...]:
        """Checks across keys."""


M = TypeVar("M", bound=Model)
M_co = TypeVar("M_co", bound=Model, covariant=True)


class Models(Protocol[M_co]):
    """A registry of models, such as the module `scenes.models`."""

    def names(self) -> tuple[str, ...]:
        """Return the names of all models."""

    def get(self, name: str) -> M_co:
        """Return a model by name."""


@dataclass(frozen=True)
class Scene(Generic[M]):
    """A checked scene: name, model and settings, with every default filled in."""

    name: str
    model: M
    settings: Any
    sweep: Mapping[str, Any] = field(default_factory=dict)
    """The section [sweep], if the scene has one (`scenes.language.sweep_section`)."""
    study: Mapping[str, Any] = field(default_factory=dict)
    """The section [study], if the scene has one."""

    def to_toml(self) -> str:
        """Return the resolved scene as TOML that can be loaded again, without [sweep] and [study]."""
        return self._toml

    @cached_property
    def _toml(self) -> str:
        return toml.document(self.settings)


class ImpossibleError(SceneError):
    """A scene whose keys are each valid, but do not fit together or are refused by the plant."""

    def __init__(self, scene: Scene[Any], lines: Iterable[str]) -> None:
        super().__init__(*lines)
        self.scene = scene


def load_scene(models: Models[M], name_or_path: str | Path, overrides: Iterable[str] = ()) -> Scene[M]:
    """Read and check a scene.

    Parameters
    ----------
    models : Models
        Models from which the scene may choose.
    name_or_path : str or Path
        Name of a shipped scene, or a TOML file. Files named in a TOML file are first looked up in the same folder.
    overrides : iterable of str
        Items of the form `section.key=value`; the value is TOML, and a bare word is a text.

    Raises
    ------
    SceneError
        One line per mistake.
    """
    path = find_scene(str(name_or_path))
    return parse_scene(models, read_text(path), path.stem, overrides, path.parent)


def parse_scene(
    models: Models[M], text: str, name: str, overrides: Iterable[str] = (), folder: Path | None = None
) -> Scene[M]:
    """Check a scene given as TOML text; see `load_scene`. Files named in the text are first looked up in `folder`."""
    return Draft(models, text, name, overrides, folder).checked()


class Draft(Generic[M]):
    """A scene as written, to be checked with many sets of overrides; checks that the overrides do not affect run once.

    The parameters are the same as in `parse_scene`.
    """

    def __init__(
        self, models: Models[M], text: str, name: str, overrides: Iterable[str] = (), folder: Path | None = None
    ) -> None:
        self._models, self._text, self._name = models, text, name
        written = toml.parse(text)
        if folder is not None and folder != SHIPPED_FOLDER:
            _look_beside(written, _model_of(models, written)[0].schema, folder)
        self._data, self._overridden, self._mistakes = apply_overrides(written, overrides)
        self._passed: dict[type[Section], Passed] = {}

    def checked(self, overrides: Iterable[str] = ()) -> Scene[M]:
        """Return the scene with further overrides; SceneError with one line per mistake.

        The error is an ImpossibleError if each key is valid on its own.
        """
        data, overridden, mistakes = apply_overrides(self._data, overrides)
        overridden, mistakes = self._overridden + overridden, self._mistakes + mistakes
        outside = {name: data.pop(name) for name in OUTSIDE if name in data}
        mistakes += outside_mistakes(outside)
        model, model_mistakes = _model_of(self._models, data)
        model, data, own_mistakes = with_own_parts(model, {**data, "model": model.name})
        data = _with_every_section(model, data)
        filled = with_own_defaults(model.schema, data)
        settings, wrong = validated(model.schema, filled, partial(_models_with, self._models))
        mistakes += model_mistakes + own_mistakes + wrong
        passed = self._passed.setdefault(model.schema, {})
        mistakes += cross_mistakes(
            (*kinds_checked(model.schema), *model.checks), model.schema, data, mistakes, overridden, passed, filled
        )
        scene = Scene(printable(self._name), model, settings, outside.get(SWEEP, {}), outside.get(STUDY, {}))
        if mistakes:
            lines = report(mistakes, toml.key_lines(self._text), overridden)
            of_one_key = settings is None or any(_is_of_one_key(model.schema, mistake) for mistake in mistakes)
            raise SceneError(*lines) if of_one_key else ImpossibleError(scene, lines)
        return scene


def with_own_parts(model: M, data: Mapping[str, Any]) -> tuple[M, dict[str, Any], list[Mistake]]:
    """Return a model extended by the keys of the user's own parts in a scene; see `own.completed` for the rest."""
    schema, filled, mistakes = own.completed(model.schema, data)
    known: Any = model
    return known if schema is model.schema else replace(known, schema=schema), filled, mistakes


@cache
def kinds_checked(schema: type[Section]) -> tuple[Check, ...]:
    """Return the checks that each key set in a section is for the kind that the section chooses."""
    sections = {name: known.section for name, known in keys_in(schema).items()}
    chosen = {name: (each, key) for name, each in sections.items() for key in [*getattr(each, "holds", ())][:1]}
    return tuple(
        check for name, (each, key) in chosen.items() if each and key for check in kind_checks(each, name, key)
    )


def _is_of_one_key(schema: type[Section], mistake: Mistake) -> bool:
    """Return whether a key is wrong whatever the other keys are: no other key is suspected, or the file is wrong."""
    key = key_at(schema, mistake.path)
    return not mistake.suspects or key is None or key.is_file


def _look_beside(data: dict[str, Any], schema: type[Section], folder: Path) -> None:
    """Replace each file name in a scene by the full path of the file in a folder, if the folder contains the file."""
    for name, known in keys_in(schema).items():
        given = data.get(name)
        if isinstance(given, dict) and known.section is not None:
            for key in given.keys() & {key for key, inner in keys_in(known.section).items() if inner.is_file}:
                if isinstance(given[key], str) and os.path.isfile(folder / given[key]):
                    given[key] = str((folder / given[key]).resolve())


def shipped_scenes() -> dict[str, Path]:
    """Return the files of the shipped scenes by name."""
    return {path.stem: path for path in sorted(SHIPPED_FOLDER.glob("*.toml"))}


def find_scene(name_or_path: str) -> Path:
    """Return the file of a scene, given by name or path.

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
    """Return whether the path exists, or cannot be examined; in the latter case, reading the file raises the error."""
    try:
        os.stat(path)
    except (OSError, ValueError) as error:
        return not (isinstance(error, OSError) and error.errno in (errno.ENOENT, errno.ENOTDIR))
    return True


def read_text(path: Path, instead: str = "'worm3d init FILE' writes a scene to start from") -> str:
    """Return the text of a scene or of a file that a scene needs, without a byte order mark.

    If the file is empty, the error says what to do `instead`.
    """
    try:
        text = regular_file.read(path, LARGEST_FILE).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise SceneError(f"{path}: not a text in UTF-8 (byte {error.start + 1}); save it as UTF-8") from error
    except OSError as error:
        why = error.strerror or str(error)
        raise DiscError(f"cannot read {path}: {why[:1].lower()}{why[1:]}") from error
    if not text.strip():
        raise SceneError(f"{path}: the file is empty; {instead}")
    return text


def _model_of(models: Models[M], data: Mapping[str, Any]) -> tuple[M, list[Mistake]]:
    """Return the scene's model; if the name is wrong, the likeliest model, so that the rest can be checked."""
    given, known = data.get("model"), models.names()
    if isinstance(given, str) and given in known:
        return models.get(given), []
    meant = did_you_mean(str(given), [(name, name) for name in known])
    likeliest = (
        models.get(meant)
        if meant
        else max(map(models.get, known), key=lambda each: len(keys_in(each.schema).keys() & data.keys()))
    )
    found = f"got {toml.shown(given)}" if "model" in data else "missing"
    guess = f"; did you mean '{meant}'?" if meant else ""
    allowed = ", ".join(f"'{name}'" for name in known)
    text = f"{found}: must be one of {allowed}{guess} (the rest is checked as '{likeliest.name}')"
    return likeliest, [Mistake(("model",), text)]


def _models_with(models: Models[Model], section: str) -> list[str]:
    return [name for name in models.names() if section in keys_in(models.get(name).schema)]


def _with_every_section(model: Model, data: Mapping[str, Any]) -> dict[str, Any]:
    """Add the sections that the data leave out, so that each missing mandatory key is reported by name."""
    sections = [name for name, known in keys_in(model.schema).items() if known.section]
    return {**dict.fromkeys(sections, _EMPTY), **data}


def says(path: Path) -> str:
    """Return the line of a scene file that describes the scene, without checking the scene."""
    return str(tomllib.loads(read_text(path)).get("says", ""))
