"""Markdown for generated pages: escaped prose, lists of definitions, tables, and docstrings."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from inspect import cleandoc

CODE = re.compile(r"(`+[^`]+`+)")
SPECIAL = re.compile(r"([\\*_$<>\[\]{}~|#])")
"""Characters with a meaning in Markdown, or in its extension MyST."""
EMPHASIS = re.compile(r"\\\*(?=\w)((?:(?!\\\*).)*[\w.])\\\*(?!\w)")
"""Words between asterisks, after the asterisks have been escaped."""
SECTION = re.compile(r"^(\w[\w ]*)\n-{3,}$", re.MULTILINE)
"""Title of a section of a docstring, underlined as numpydoc requires."""

Definition = tuple[str, Sequence[str]]
"""A term, and the blocks of Markdown that define the term."""


def prose(text: str) -> str:
    """Return plain text as Markdown. Words between backticks stay code, and words between asterisks are emphasised."""
    parts = CODE.split(text)
    escaped = (part if k % 2 else SPECIAL.sub(r"\\\1", part) for k, part in enumerate(parts))
    return EMPHASIS.sub(r"*\1*", "".join(escaped))


def sentence(text: str, names: Sequence[str] = ()) -> str:
    """Return a text as Markdown, with a capital letter and a full stop.

    A first word that is a name, such as `speed_bias` or one of `names`, or a single letter, such as g, is kept.
    """
    first = re.split(r"[\s,:]", text)[0]
    is_word = first.isalpha() and first not in names and (len(first) > 1 or first == "a")
    start = text[0].upper() + text[1:] if is_word else text
    return prose(start if start.endswith((".", "!", "?")) else f"{start}.")


def code(text: object) -> str:
    """Return text as code within a line."""
    return f"``{text}``" if "`" in str(text) else f"`{text}`"


def definitions(entries: Iterable[Definition]) -> str:
    """Return a list of terms with their definitions."""
    return "\n\n".join(_definition(term, blocks) for term, blocks in entries)


def _definition(term: str, blocks: Sequence[str]) -> str:
    lines = "\n\n".join(block for block in blocks if block).split("\n")
    return "\n".join([term, f": {lines[0]}", *(f"  {line}".rstrip() for line in lines[1:])])


def bullets(items: Iterable[str]) -> str:
    """Return a list; an item may have several lines."""
    return "\n".join("* " + item.replace("\n", "\n  ") for item in items)


def table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table. The cells are Markdown without line breaks."""
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def page(title: str, *blocks: str) -> str:
    """Return a page with a title."""
    return "\n\n".join([f"# {title}", *(block for block in blocks if block)]) + "\n"


def docstring(text: str) -> str:
    """Return a docstring in the style of numpydoc as Markdown."""
    head, *rest = SECTION.split(cleandoc(text))
    sections = zip(rest[::2], rest[1::2], strict=True)
    return "\n\n".join([paragraphs(head), *(block for name, body in sections for block in _section(name, body))])


def paragraphs(text: str) -> str:
    """Return paragraphs and indented formulas of a docstring as Markdown."""
    blocks: list[str] = []
    for block in re.split(r"\n[ \t]*\n", text.strip("\n")):
        if blocks and _is_indented(block) and _is_indented(blocks[-1]):  # lines of code with an empty line between them
            blocks[-1] += f"\n\n{block}"
        elif block.strip():
            blocks.append(block)
    return "\n\n".join(map(_paragraph, blocks))


def _is_indented(block: str) -> bool:
    return all(line.startswith("    ") or not line for line in block.split("\n"))


def _paragraph(block: str) -> str:
    """Return a paragraph. Lines that are indented by four columns are a formula or code."""
    said = [] if _is_indented(block) else [line for line in block.split("\n") if not line.startswith("    ")]
    if not said:
        return f"```text\n{cleandoc(block)}\n```"
    if len(said) == len(block.split("\n")):
        items = block.startswith(("* ", "- "))
        return "\n".join(f"{line[:2]}{prose(line[2:])}" if items else prose(line) for line in said)
    return "\n\n".join(map(_paragraph, _runs(block)))


def _runs(block: str) -> Iterator[str]:
    """Yield the parts of a block whose lines are all indented, or all not indented."""
    run: list[str] = []
    for line in block.split("\n"):
        if run and line.startswith("    ") != run[-1].startswith("    "):
            yield "\n".join(run)
            run = []
        run.append(line)
    yield "\n".join(run)


def _section(name: str, body: str) -> Iterator[str]:
    yield f"**{name}**"
    entries = re.findall(r"^(\S[^\n]*)\n((?:[ \t]+[^\n]*(?:\n|\Z)|\n)*)", body.strip("\n") + "\n", re.MULTILINE)
    yield definitions((_term(name, head), [paragraphs(cleandoc(text)) or "No description."]) for head, text in entries)


def _term(section: str, head: str) -> str:
    """Return the head of an entry: a name with its type, or for a result or an error the type alone."""
    names, colon, kind = head.partition(" : ")
    return f"{code(names)} ({prose(kind)})" if colon else code(head)
