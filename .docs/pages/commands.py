"""The page with all commands and their options, from the command line itself."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import typer

from pages.text import Definition, code, definitions, docstring, page, prose, table
from scenes.commands.app import SECTIONS, app
from scenes.language.loader import says
from scenes.studies.study.command import shipped_studies

PAGE_INTRODUCTION = """
`worm3d` is the program on the command line. `worm3d --help` lists the commands, and `worm3d COMMAND --help` describes a
command. The program makes this page from the same declarations. [Exit codes](exit_codes.md) are on a page of their own.
""".strip()


def commands() -> str:
    """Return the page."""
    group: Any = typer.main.get_command(app)
    blocks = [PAGE_INTRODUCTION]
    for title, names in SECTIONS.items():
        blocks.append(f"## {title}")
        blocks += [block for name in names for block in _command(group.commands[name], f"worm3d {name}")]
    return page("Commands", *blocks)


def every_option() -> set[str]:
    """Return the names of all options."""
    group: Any = typer.main.get_command(app)
    found: set[str] = set()
    for names in SECTIONS.values():
        for name in names:
            programs = getattr(group.commands[name], "commands", {}).values()
            found |= {opt for each in (group.commands[name], *programs) for p in each.params for opt in p.opts}
    return found


def _command(command: Any, name: str) -> Iterator[str]:
    inner = getattr(command, "commands", {})
    yield f"### {name}"
    context = command.context_class(command, info_name=name)
    yield f"```text\n{command.get_usage(context).removeprefix('Usage: ')}\n```"
    yield docstring(command.help or "")
    yield definitions(_option(each, context) for each in command.params)
    if inner:
        yield from _studies()
    for other, program in inner.items():
        if not program.hidden:
            yield from _command(program, f"{name} {other}")


def _option(option: Any, context: Any) -> Definition:
    head, said = option.get_help_record(context) or (option.name, option.help or "")
    return code(head.strip()), [prose(said.strip()) or "No description."]


def _studies() -> Iterator[str]:
    yield "These studies are sweeps. `worm3d study NAME` runs a study, and `worm3d study --all` runs all of them."
    yield table(["study", "question"], ([code(name), prose(says(path))] for name, path in shipped_studies().items()))
