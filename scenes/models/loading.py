"""Loading of scenes by name or path: read, override and check; all mistakes are reported together."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

from scenes import models
from scenes.language import own, toml
from scenes.language.checks import Check, Passed, cross_mistakes, kind_checks
from scenes.language.errors import SceneError, printable
from scenes.language.loader import SHIPPED_FOLDER, find_scene, read_text
from scenes.language.mistakes import Mistake, report, schema_mistakes, validated
from scenes.language.overrides import apply_overrides
from scenes.language.reading import trusted
from scenes.language.schema import Section, key_at, keys_in, with_own_defaults
from scenes.language.sweep_section import STUDY, SWEEP, Outside
from scenes.models.base import Model
from worm3d.values.spelling import did_you_mean


@dataclass(frozen=True)
class Scene:
    """A checked scene: name, model and settings, with every default filled in."""

    name: str
    model: Model[Any]
    settings: Any
    sweep: Mapping[str, Any] = field(default_factory=dict)
    """The section [sweep], if the scene has one (`scenes.language.sweep_section`)."""
    study: Mapping[str, Any] = field(default_factory=dict)
    """The section [study], if the scene has one."""

    def to_toml(self) -> str:
        """Return the resolved scene as TOML that can be loaded again, without [sweep] and [study]."""
        return toml.document(self.settings)


class ImpossibleError(SceneError):
    """A scene whose keys are each valid, but do not fit together or are refused by the plant."""

    def __init__(self, scene: Scene, lines: Iterable[str]) -> None:
        super().__init__(*lines)
        self.scene = scene


def load_scene(name_or_path: str | Path, overrides: Iterable[str] = ()) -> Scene:
    """Read and check a scene.

    Parameters
    ----------
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
    return parse_scene(read_text(path), path.stem, overrides, path.parent)


def parse_scene(text: str, name: str, overrides: Iterable[str] = (), folder: Path | None = None) -> Scene:
    """Check a scene given as TOML text; see `load_scene`. Files named in the text are first looked up in `folder`."""
    return Draft(text, name, overrides, folder).checked()


def trusted_scene(data: Mapping[str, Any], name: str) -> Scene:
    """Return a resolved scene from data that have been checked before; many times as fast as `parse_scene`."""
    model, data, _ = with_own_parts(models.get(data["model"]), data)
    return Scene(name, model, trusted(model.schema, data))


class Draft:
    """A scene as written, to be checked with many sets of overrides; checks that the overrides do not affect run once.

    The parameters are the same as in `parse_scene`.
    """

    def __init__(self, text: str, name: str, overrides: Iterable[str] = (), folder: Path | None = None) -> None:
        self._text, self._name = text, name
        written = toml.parse(text)
        if folder is not None and folder != SHIPPED_FOLDER:
            _look_beside(written, _model_of(written)[0].schema, folder)
        self._data, self._overridden, self._mistakes = apply_overrides(written, overrides)
        self._passed: dict[type[Section], Passed] = {}

    def checked(self, overrides: Iterable[str] = ()) -> Scene:
        """Return the scene with further overrides; SceneError with one line per mistake.

        The error is an ImpossibleError if each key is valid on its own.
        """
        data, overridden, mistakes = apply_overrides(self._data, overrides)
        overridden, mistakes = self._overridden + overridden, self._mistakes + mistakes
        outside = {name: data.pop(name) for name in keys_in(Outside) if name in data}
        mistakes += schema_mistakes(Outside, outside)
        model, model_mistakes = _model_of(data)
        # Every section, so that each missing mandatory key is reported by name.
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
    """Return a model extended by the keys of the user's own parts in a scene; see `own.completed` for the rest."""
    schema, filled, mistakes = own.completed(model.schema, data)
    return model if schema is model.schema else replace(model, schema=schema), filled, mistakes


@cache
def kinds_checked(schema: type[Section]) -> tuple[Check, ...]:
    """Return the checks that each key set in a section is for the kind that the section chooses."""
    checks: list[Check] = []
    for name, known in keys_in(schema).items():
        key = next(iter(getattr(known.section, "holds", ())), "")
        checks += kind_checks(known.section, name, key) if known.section and key else ()
    return tuple(checks)


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


def _model_of(data: Mapping[str, Any]) -> tuple[Model[Any], list[Mistake]]:
    """Return the scene's model; if the name is wrong, the likeliest model, so that the rest can be checked."""
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
