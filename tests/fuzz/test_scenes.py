"""Scenes at random: each is refused with sentences, or loaded as it is written; nothing else, and in no long time."""

import math
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from typing import Any

import numpy as np
from fuzzing import examples, no_hang
from hypothesis import given
from hypothesis import strategies as st

from scenes import models
from scenes.language.errors import SceneError
from scenes.language.loader import SHIPPED_FOLDER, read_text, shipped_scenes
from scenes.models.loading import parse_scene
from scenes.models.template import template

TEXTS = [*map(read_text, shipped_scenes().values()), *(template(models.get(name)) for name in models.names())]

VALUES = (
    *("0", "-1", "1", "2", "-0.0", "0.5", "1e-300", "5e-324", "1e-9", "1e9", "1e300", "1.7976931348623157e308"),
    *("nan", "inf", "-inf", "true", "false", "9223372036854775807", "-9223372036854775808", "9" * 30, "9" * 400),
    *("10000000", "200", "201", "1e25", "0x7fffffff", "1979-05-27T07:32:00Z", "1979-05-27", "07:32:00"),
    *(
        '""',
        '"x"',
        '"3"',
        '"\\u001b[31m\\u0007"',
        '"\\u202e\\ud7ff"',
        '"."',
        '"/"',
        '"/dev/zero"',
        '"' + "a" * 5000 + '"',
    ),
    *("[]", "[1]", "[1, 2]", "[1, 2, 3]", "[[0, 0, 0], [1, 0, 0]]", "[[0, 0, 0], [0, 0, 0], [1, 1e300, 0]]"),
    *('["a"]', "[[]]", "[nan, 1]", "[1e308, -1e308]", "{}", "{a = 1}", "[{grip = 1}]", "[{bend_deg = 90}]"),
    *("[" * 30 + "]" * 30, "[" + "1, " * 3000 + "1]", '"none"', '"worm"', '"pipe"', '"mesh"', '"heightfield"'),
)

NOISE = st.text(st.characters(codec="utf-8"), max_size=8)


def changed(text: str, draw: st.DrawFn) -> str:
    """Return a text with one change: to a value, a line, or a few characters."""
    lines = text.split("\n")
    k = draw(st.integers(0, len(lines) - 1))
    match draw(st.sampled_from(("value", "value", "value", "value", "drop", "double", "move", "noise", "cut", "key"))):
        case "value" if "=" in lines[k]:
            lines[k] = f"{lines[k].split('=')[0]}= {draw(st.sampled_from(VALUES))}"
        case "drop":
            del lines[k]
        case "double":
            lines.insert(k, lines[k])
        case "move":
            lines.insert(draw(st.integers(0, len(lines) - 1)), lines.pop(k))
        case "noise":
            at = draw(st.integers(0, len(lines[k])))
            lines[k] = lines[k][:at] + draw(NOISE) + lines[k][at:]
        case "cut":
            lines[k] = lines[k][: draw(st.integers(0, len(lines[k])))]
        case "key":
            other = draw(st.sampled_from(TEXTS)).split("\n")
            lines.insert(k, draw(st.sampled_from(other)))
    return "\n".join(lines)


@st.composite
def texts(draw: st.DrawFn) -> str:
    text = draw(st.sampled_from(TEXTS))
    for _ in range(draw(st.integers(1, 4))):
        text = changed(text, draw)
    return text


@st.composite
def overrides(draw: st.DrawFn) -> list[str]:
    """Return overrides of keys that a scene has, and of some that none has."""
    text = draw(st.sampled_from(TEXTS))
    section, found = "", []
    for line in text.split("\n"):
        section = line.strip("[]").split("]")[0] if line.startswith("[") else section
        if "=" in line and not line.startswith("#"):
            found.append(f"{section}.{line.split('=')[0].strip()}".strip("."))
    keys = st.one_of(st.sampled_from(found), NOISE)
    values = st.one_of(st.sampled_from(VALUES), NOISE)
    pairs = draw(st.lists(st.tuples(keys, values), min_size=1, max_size=4))
    return [f"{key}={item}" for key, item in pairs]


def leaves(data: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[tuple[Any, ...], Any]]:
    items = data.items() if isinstance(data, Mapping) else enumerate(data) if isinstance(data, list | tuple) else None
    if items is None:
        yield path, data
    else:
        for key, inner in items:
            yield from leaves(inner, (*path, key))


def _require_showable(lines: tuple[str, ...]) -> None:
    assert lines
    assert all(line.isprintable() and 0 < len(line) < 1100 for line in lines)


def loaded_as_written(text: str, given: list[str]) -> None:
    """Load a text: it is refused by lines that a terminal may show, or its values are those that are written."""
    try:
        with no_hang(), np.errstate(all="warn"):
            scene = parse_scene(text, "fuzzed", given, SHIPPED_FOLDER)
    except SceneError as refused:
        _require_showable(refused.lines)
        return
    kept = dict(leaves(asdict(scene.settings)))
    if given:
        return
    written = {name: keys for name, keys in tomllib.loads(text).items() if name != "sweep"}  # a plan, no setting
    for path, value in leaves(written):
        assert path in kept, f"{path} was dropped"
        if isinstance(kept[path], float) and type(value) is int:
            value = float(value)
        assert kept[path] == value and isinstance(value, bool) == isinstance(kept[path], bool), f"{path} was changed"  # noqa: PT018
        assert not isinstance(value, float) or math.isfinite(value)


@examples(40)
@given(texts())
def test_scenes_are_refused_or_loaded_as_written(text: str) -> None:
    loaded_as_written(text, [])


@examples(15)
@given(st.sampled_from(TEXTS), overrides())
def test_overrides_are_refused_or_taken(text: str, given: list[str]) -> None:
    loaded_as_written(text, given)


@examples(20)
@given(NOISE, st.binary(max_size=40))
def test_noise_is_refused(text: str, content: bytes) -> None:
    for noise in (text, content.decode("latin-1")):
        loaded_as_written(noise or " ", [])


def test_the_texts_themselves_are_right() -> None:
    for text in TEXTS:
        parse_scene(text, "written", folder=SHIPPED_FOLDER)
