"""Settings written as TOML: resolved scenes in results, and values in error lines."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

from pydantic import BaseModel


def value(item: Any) -> str:
    """Return a value as TOML writes it."""
    match item:
        case bool():
            return "true" if item else "false"
        case int() | float():
            return repr(item)
        case list() | tuple():
            return f"[{', '.join(value(inner) for inner in item)}]"
        case dict():
            return f"{{{', '.join(f'{key} = {value(inner)}' for key, inner in item.items())}}}"
        case _:
            # JSON's escapes are TOML's, save for the one control character that JSON lets pass.
            return json.dumps(str(item), ensure_ascii=False).replace("\x7f", "\\u007F")


def shown(item: Any) -> str:
    """Return a value as an error line shows it: short, strings in single quotes."""
    text = repr(item) if isinstance(item, str) else value(item)
    return text if len(text) <= 60 else f"{text[:57]}..."


def document(settings: BaseModel) -> str:
    """Return all settings as a TOML text, every default written out; what has no value (None) is left out."""
    return "\n".join(_lines(settings, "")).strip() + "\n"


def _lines(section: BaseModel, prefix: str) -> Iterator[str]:
    inner = {name: item for name, item in section if isinstance(item, BaseModel)}
    arrays = {name: item for name, item in section if _is_array_of_tables(item)}
    plain = {name: item for name, item in section if name not in {*inner, *arrays} and item is not None}
    yield from (f"{name} = {value(item)}" for name, item in plain.items())
    for name, items in arrays.items():
        for item in items:
            yield from ("", f"[[{prefix}{name}]]")
            yield from _lines(item, f"{prefix}{name}.")
    for name, item in inner.items():
        yield from ("", f"[{prefix}{name}]")
        yield from _lines(item, f"{prefix}{name}.")


def _is_array_of_tables(item: Any) -> bool:
    return isinstance(item, tuple) and bool(item) and isinstance(item[0], BaseModel)
