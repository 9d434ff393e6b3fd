"""Loading of scenes by name or path. All mistakes in a scene and its overrides are reported together."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

from scenes import models
from scenes.language import own, toml
from scenes.language.checks import Check, Passed, cross_mistakes, kind_checks
from scenes.language.errors import SceneError, printable
from scenes.language.loader import SHIPPED_FOLDER, find_scene, read_text
from scenes.language.mistakes import Mistake, report, schema_mistakes, validated
from scenes.language.overrides import apply_overrides, override_texts
from scenes.language.reading import trusted
from scenes.language.schema import Section, key_at, keys_in, with_own_defaults
from scenes.language.sweep_section import STUDY, SWEEP, Outside
from scenes.language.toml import KeyPath
from scenes.models.base import Model
from worm3d.values.spelling import did_you_mean

FRAGMENT = ".toml"
"""End of the name of a file that contains a section of a scene, for example `gait = "gait.toml"`."""


@dataclass(frozen=True)
class Scene:
    """A checked scene, with defaults for all keys that were left out."""

    name: str
    model: Model[Any]
    settings: Any
    sweep: Mapping[str, Any] = field(default_factory=dict)
    """The section [sweep], if the scene has one (`scenes.language.sweep_section`)."""
    study: Mapping[str, Any] = field(default_factory=dict)
    """The section [study], if the scene has one."""

    def to_toml(self) -> str:
        """Return the scene with all defaults as TOML, without [sweep] and [study]; it can be loaded again."""
        return toml.document(self.settings)


class ImpossibleError(SceneError):
    """An error of a scene whose keys are each valid on their own, but do not fit together."""

    def __init__(self, scene: Scene, lines: Iterable[str]) -> None:
        super().__init__(*lines)
        self.scene = scene


def load_scene(name_or_path: str | Path, overrides: Iterable[str] = ()) -> Scene:
    """Read and check a scene.

    Parameters
    ----------
    name_or_path : str or Path
        Name of a shipped scene, or path of a TOML file. Files named in a TOML file are first sought in its folder.
    overrides : iterable of str
        Items of the form `section.key=value`. The value is written as in TOML, but a text needs no quotation marks.

    Raises
    ------
    SceneError
        One line per mistake.
    """
    return draft_of(name_or_path, overrides).checked()


def draft_of(name_or_path: str | Path, overrides: Iterable[str] = ()) -> Draft:
    """Return a scene that can be checked with further overrides. The parameters are the same as in `load_scene`."""
    path = find_scene(str(name_or_path))
    return Draft(read_text(path), path.stem, overrides, path.parent)


def parse_scene(text: str, name: str, overrides: Iterable[str] = (), folder: Path | None = None) -> Scene:
    """Check a scene given as TOML text, as `load_scene` does. Files named in the text are first sought in `folder`."""
    return Draft(text, name, overrides, folder).checked()


def trusted_scene(data: Mapping[str, Any], name: str) -> Scene:
    """Return the scene of data that have been checked before; this is many times faster than `parse_scene`."""
    model, data, _ = with_own_parts(models.get(data["model"]), data)
    return Scene(name, model, trusted(model.schema, data))


class Draft:
    """A scene as written, which can be checked with many sets of overrides.

    Checks that do not depend on the overrides run only once. The parameters are the same as in `parse_scene`.
    """

    def __init__(self, text: str, name: str, overrides: Iterable[str] = (), folder: Path | None = None) -> None:
        self._text, self._name, self._folder = text, name, folder or Path()
        written = toml.parse(text)
        if folder is not None and folder != SHIPPED_FOLDER:
            _look_beside(written, _model_of(written)[0].schema, folder)
        self._data, self._overridden, self._mistakes = _applied(written, overrides, self._folder)
        self._passed: dict[type[Section], Passed] = {}

    def checked(self, overrides: Iterable[str] = ()) -> Scene:
        """Return the checked scene with further overrides.

        Raises
        ------
        SceneError
            One line per mistake. The error is an ImpossibleError if each key is valid on its own.
        """
        data, overridden, mistakes = _applied(self._data, overrides, self._folder)
        overridden, mistakes = self._overridden + overridden, self._mistakes + mistakes
        mistakes += _read_sections(data, self._folder)
        outside = {name: data.pop(name) for name in keys_in(Outside) if name in data}
        mistakes += schema_mistakes(Outside, outside)
        model, model_mistakes = _model_of(data)
        # Add all missing sections as empty sections, so that each missing mandatory key is reported by its name.
        sections: dict[str, Any] = {name: {} for name, known in keys_in(model.schema).items() if known.section}
        model, data, own_mistakes = with_own_parts(model, {**sections, **data, "model": model.name})
        schema: type[Section] = model.schema
        filled = with_own_defaults(schema, data)
        settings, wrong = validated(schema, filled, _models_with)
        mistakes += model_mistakes + own_mistakes + wrong
        checks, passed = (*kinds_checked(schema), *model.checks), self._passed.setdefault(schema, {})
        mistakes += cross_mistakes(checks, schema, data, mistakes, overridden, passed, filled)
        scene = Scene(printable(self._name), model, settings, outside.get(SWEEP, {}), outside.get(STUDY, {}))
        if mistakes:
            lines = report(mistakes, toml.key_lines(self._text), overridden)
            of_one_key = settings is None or any(_is_of_one_key(schema, mistake) for mistake in mistakes)
            raise SceneError(*lines) if of_one_key else ImpossibleError(scene, lines)
        return scene


def with_own_parts(model: Model[Any], data: Mapping[str, Any]) -> tuple[Model[Any], dict[str, Any], list[Mistake]]:
    """Return a model with the keys of the user's own parts in a scene, the completed scene, and mistakes.

    See `scenes.language.own.completed`.
    """
    schema, filled, mistakes = own.completed(model.schema, data)
    return model if schema is model.schema else replace(model, schema=schema), filled, mistakes


@cache
def kinds_checked(schema: type[Section]) -> tuple[Check, ...]:
    """Return the checks that each key of a section belongs to the kind that the section chooses."""
    checks: list[Check] = []
    for name, known in keys_in(schema).items():
        key = next(iter(getattr(known.section, "holds", ())), "")
        checks += kind_checks(known.section, name, key) if known.section and key else ()
    return tuple(checks)


def _is_of_one_key(schema: type[Section], mistake: Mistake) -> bool:
    """Return whether a mistake is independent of other keys: only one key can be wrong, or the key names a file."""
    key = key_at(schema, mistake.path)
    return not mistake.suspects or key is None or key.is_file


def _applied(
    data: dict[str, Any], overrides: Iterable[str], folder: Path
) -> tuple[dict[str, Any], list[KeyPath], list[Mistake]]:
    """Return the data with overrides, their paths and mistakes, as `apply_overrides` does.

    Files of sections are read where they are named, so that later overrides can change a section from a file.
    """
    texts, data = override_texts(overrides), dict(data)
    ends = [k for k, text in enumerate(texts, start=1) if text.rstrip(" \"'").endswith(FRAGMENT)]
    paths, mistakes = list[KeyPath](), list[Mistake]()
    for begin, end in pairwise((0, *ends, len(texts))):
        _read_sections(data, folder)  # `Draft.checked` reports a missing file
        data, more, wrong = apply_overrides(data, texts[begin:end])
        paths, mistakes = paths + more, mistakes + wrong
    return data, paths, mistakes


def _read_sections(data: dict[str, Any], folder: Path) -> list[Mistake]:
    """Replace each section that is the name of a TOML file by the section of this name in the file; return mistakes.

    The file is sought in `folder`, then in the current folder.
    """
    mistakes = []
    for name, given in data.items():
        if isinstance(given, str) and given.endswith(FRAGMENT):
            path = folder / given if (folder / given).is_file() else Path(given)
            try:
                found = toml.parse(read_text(path)).get(name)
            except SceneError as error:
                mistakes.append(Mistake((name,), "; ".join(error.lines)))
                continue
            if isinstance(found, dict):
                data[name] = found
            else:
                mistakes.append(Mistake((name,), f"the file '{given}' has no section [{name}]"))
    return mistakes


def _look_beside(data: dict[str, Any], schema: type[Section], folder: Path) -> None:
    """Replace each file name in a scene by the full path, if the given folder contains the file."""
    for name, known in keys_in(schema).items():
        given = data.get(name)
        if isinstance(given, dict) and known.section is not None:
            for key in given.keys() & {key for key, inner in keys_in(known.section).items() if inner.is_file}:
                if isinstance(given[key], str) and os.path.isfile(folder / given[key]):
                    given[key] = str((folder / given[key]).resolve())


def _model_of(data: Mapping[str, Any]) -> tuple[Model[Any], list[Mistake]]:
    """Return the model of the scene, and mistakes.

    If the name of the model is wrong, return the most likely model, so that the rest of the scene can be checked.
    """
    given, known = data.get("model"), models.names()
    if isinstance(given, str) and given in known:
        return models.get(given), []
    meant = did_you_mean(str(given), [(name, name) for name in known])
    fits = {name: len(keys_in(models.get(name).schema).keys() & data.keys()) for name in known}
    likeliest = models.get(meant or max(fits, key=fits.__getitem__))
    found = f"got {toml.shown(given)}" if "model" in data else "missing"
    guess = f"; did you mean '{meant}'?" if meant else ""
    allowed = ", ".join(f"'{name}'" for name in known)
    text = f"{found}: must be one of {allowed}{guess} (the rest is checked as '{likeliest.name}')"
    return likeliest, [Mistake(("model",), text)]


def _models_with(section: str) -> list[str]:
    return [name for name in models.names() if section in keys_in(models.get(name).schema)]
