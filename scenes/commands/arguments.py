"""Arguments and options that several commands of `worm3d` have."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated

import typer


def path_of(text: str) -> Path:
    """Return a text as a path. An empty text is an error, since as a path it would mean the current folder."""
    if not text.strip():
        raise typer.BadParameter("got an empty name: must name a file or folder, '.' is this folder")
    return Path(text)


def _refuse_code(context: typer.Context, asked: bool) -> None:
    from worm3d.values.named import code_refused

    if asked:
        context.with_resource(code_refused())


SceneArgument = Annotated[str, typer.Argument(metavar="SCENE", help="A name of 'worm3d list', or a TOML file.")]
ResultArgument = Annotated[Path, typer.Argument(metavar="RESULT", help="Folder of a run, or its result.nc.")]
Overrides = Annotated[
    list[str] | None, typer.Option("-o", metavar="KEY=VALUE", help="Override, e.g. gait.period_s=3; repeatable.")
]
file_option = partial(typer.Option, metavar="FILE", parser=path_of)
"""Function that returns an option whose value is the path of a file."""
Out = Annotated[Path | None, typer.Option("--out", metavar="DIR", parser=path_of, help="Folder to write to.")]
Force = Annotated[bool, typer.Option("--force", help="Replace existing files.")]
NoCode = Annotated[
    bool,
    typer.Option(
        "--no-code",
        callback=_refuse_code,
        help="Refuse a scene that names a module (module:NAME), whose code would run.",
    ),
]
"""Option whose callback does everything. Commands that have this option need not use the value."""
Quiet = Annotated[bool, typer.Option("--quiet", help="Print only errors and warnings.")]
RetryFailed = Annotated[bool, typer.Option("--retry-failed", help="Run cases again that failed before.")]
Workers = Annotated[int | None, typer.Option("--workers", metavar="N", help="Run on N processes of this machine.")]
CaseLimit = Annotated[
    float | None,
    typer.Option(
        "--case-limit-s",
        metavar="SECONDS",
        help="Time limit of a case; a slower case fails. Default: the limit in [sweep], or 3600.",
    ),
]
ForceAll = Annotated[bool, typer.Option("--force", help="Run all cases anew, and write to a folder with other files.")]
