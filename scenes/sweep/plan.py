"""Plan of a sweep: the scene and the seed of each case. All scenes are checked before the first run."""

from __future__ import annotations

import hashlib
import json
import re
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from scenes.language import toml
from scenes.language.errors import SceneError
from scenes.language.loader import find_scene, read_text
from scenes.language.overrides import override_texts
from scenes.language.sweep_section import varied_keys
from scenes.language.toml import path_of
from scenes.models.loading import Draft, ImpossibleError, Scene
from scenes.running.terminal import counted
from scenes.sweep.design import Design, told
from scenes.sweep.key import key_of
from scenes.sweep.links import Links, value_at
from scenes.sweep.vary import design_of, with_meaning

SEED_KEY = "seed"
"""Key of a scene with the seed of all random numbers."""
LARGEST_SEED = 2**53 - 1
"""Largest seed of a case. Floating-point numbers represent all integers up to this value exactly, so that any program
can read the seed from a table."""
_NUMBER_PATTERN = re.compile(r"[-+]?\d[\d.]*(?:e[-+]?\d+)?")

MOST_WRONG = 20
"""After this number of cases with invalid keys, no further cases are checked."""


@dataclass(frozen=True)
class Source:
    """A scene whose keys have not been varied yet."""

    text: str
    """The scene as TOML."""
    name: str
    folder: Path | None = None
    """Base folder of relative paths of files in the scene."""
    overrides: tuple[str, ...] = ()
    """Overrides `section.key=value` that apply to all cases."""

    @classmethod
    def of(cls, scene: str | Path, overrides: Iterable[str] = ()) -> Source:
        """Return the scene with a name or path; raise SceneError if there is none, or the overrides are no texts."""
        path = find_scene(str(scene))
        return cls(read_text(path), path.stem, path.parent, override_texts(overrides))

    def parse(self, overrides: Iterable[str] = ()) -> Scene:
        """Return the checked scene, with further overrides."""
        return self._draft.checked(overrides)

    def base(self) -> Scene:
        """Return the scene without variation.

        Each key must be valid. The combination of the values may be impossible, since the sweep replaces some values.
        """
        try:
            return self.parse()
        except ImpossibleError as error:
            return error.scene

    @cached_property
    def _draft(self) -> Draft:
        return Draft(self.text, self.name, self.overrides, self.folder)


@dataclass(frozen=True)
class Case:
    """A case of a sweep whose scene has been checked."""

    values: Mapping[str, Any]
    """Values of the varied keys."""
    key: str
    """Identifier of the case, which depends on its scene."""
    seed: int
    packed: bytes
    """The scene with all defaults as TOML, compressed."""
    refused: str = ""
    """Reason why the scene is impossible although each of its keys is valid; empty if the scene is possible."""


@dataclass(frozen=True)
class Plan:
    """A design whose cases have all been checked. Impossible cases are part of the plan, but are not run."""

    base: Scene
    """Scene whose keys are varied."""
    design: Design
    cases: tuple[Case, ...]
    """Cases in the order of the design. Cases with the same scene have the same key."""


def planned(
    source: Source,
    vary: Mapping[str, Any] | None = None,
    *,
    random: int | None = None,
    listed: Sequence[Mapping[str, Any]] = (),
    watch: Callable[[int, int], None] = lambda done, total: None,
) -> Plan:
    """Return the plan of a sweep. Without `vary` and `listed`, the scene's section [sweep] defines the varied keys.

    Parameters
    ----------
    source : Source
    vary, random, listed
        The same as in `scenes.sweep.vary.design_of`.
    watch : callable
        Called with the number of checked cases and the number of all cases, after the check of each case.

    Raises
    ------
    SceneError
        A key is invalid regardless of the other keys, or all cases are impossible. The error has one line for each
        kind of mistake, with the values of the first case that has this mistake.
    """
    base = source.base()
    if not vary and not listed:
        sweep = base.sweep
        vary, random = varied_keys(sweep.get("vary", {})), random or sweep.get("random")
        links = Links(sweep.get("choices", {}), varied_keys(sweep.get("set", {})), base.settings)
    else:
        links = Links({}, {}, base.settings)
    schema, seed = base.model.schema, base.settings.seed
    design = design_of(base.name, schema, links.axes(vary or {}), random=random, listed=listed, seed=seed)
    fixed = {path_of(override.partition("=")[0]) for override in source.overrides}
    keys = {each.key for each in design.varied}
    if twice := sorted(key for key in keys if path_of(key) in fixed):
        raise SceneError(f"{twice[0]}: both varied and fixed by an override (-o); leave one of them out")
    given = SEED_KEY in keys or path_of(SEED_KEY) in fixed
    cases, wrong, impossible = [], _Mistakes(tuple(keys)), _Mistakes(tuple(keys))
    for done, values in enumerate(design.cases(), start=1):
        reasons: Sequence[str] = ()
        try:
            scene = source.parse(f"{key}={toml.value(value)}" for key, value in links.keys_of(values).items())
        except ImpossibleError as error:
            scene, reasons = error.scene, impossible.add(values, error.lines)
        except SceneError as error:
            wrong.add(values, error.lines)
            if wrong.number >= MOST_WRONG:
                break
            continue
        design = _explained(design, scene)
        cases.append(_case(scene if given else _seeded(scene, seed, keys, values), values, "; ".join(reasons)))
        watch(done, len(design))
    if wrong.number:
        raise SceneError(*wrong.report(len(design), done))
    if impossible.number == len(design):
        raise SceneError(*impossible.report(len(design), done))
    return Plan(base, design, tuple(cases))


def _explained(design: Design, scene: Scene) -> Design:
    """Return a design with the units and meanings of all keys.

    Some keys, such as the keys of parts that a case selects, are not in the base scene but only in the scene of a case.
    """
    if all(each.title for each in design.varied):
        return design
    schema = scene.model.schema
    return replace(design, varied=tuple(each if each.title else with_meaning(each, schema) for each in design.varied))


def _case(scene: Scene, values: Mapping[str, Any], refused: str) -> Case:
    key = key_of(scene, possible=not refused)
    return Case(values, key, scene.settings.seed, zlib.compress(scene.to_toml().encode()), refused)


def _seeded(scene: Scene, base: int, keys: Iterable[str], values: Mapping[str, Any]) -> Scene:
    """Return the scene of a case with a seed that depends only on the seed of the sweep and the values of the case."""
    said = json.dumps([base, [(key, value_at(scene.settings, key, values.get(key))) for key in sorted(keys)]])
    seed = int.from_bytes(hashlib.sha256(said.encode()).digest()[:8], "big") & LARGEST_SEED
    return replace(scene, settings=replace(scene.settings, **{SEED_KEY: seed}))


class _Mistakes:
    """Mistakes of the cases. Mistakes whose texts differ only in numbers are of the same kind, and reported once."""

    def __init__(self, keys: Sequence[str]) -> None:
        self.number = 0
        """Number of cases with mistakes."""
        self._keys = keys
        self._found: dict[str, tuple[str, str, int]] = {}
        """For each kind of mistake: values of the first such case, text of its mistake, and number of such cases."""

    def add(self, values: Mapping[str, Any], lines: Iterable[str]) -> list[str]:
        """Record the mistakes of a case, and return their texts."""
        self.number += 1
        texts = []
        for line in lines:
            label, _, rest = line.partition(": ")
            key = label.removeprefix("override ")
            kind = _NUMBER_PATTERN.sub("#", line)
            texts.append(f"{key}: {rest}" if key in self._keys else line)
            first, text, number = self._found.get(kind, (told(values), texts[-1], 0))
            self._found[kind] = first, text, number + 1
        return texts

    def report(self, total: int, checked: int) -> Iterator[str]:
        """Yield one line for each kind of mistake.

        The line contains the values of the first case with this mistake, unless all checked cases have it.
        """
        for kind, (first, line, number) in self._found.items():
            more = f" (and {counted(number - 1, 'case')} more)" if number > 1 else ""
            in_all = number == checked > 1 and "#" not in kind
            yield line if in_all else f"with {first}{more}: {line}"
        if checked < total:
            yield (
                f"{self.number} of the first {checked} cases are invalid; the other {total - checked} were not checked"
            )
