"""Files are written whole or not at all."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from scenes.language.errors import DiscError
from scenes.records.lock import PREFIX


@contextmanager
def written_whole(path: Path) -> Iterator[Path]:
    """Give a path ending in `.part` to write to, of this call alone; it becomes `path` only if all went well.

    Raises
    ------
    DiscError
        The disc refused; the previous file, if any, stands as it was.
    """
    part = path.with_name(f"{PREFIX}{os.getpid()}-{secrets.token_hex(4)}.part")
    try:
        yield part
        os.replace(part, path)
    except OSError as error:
        raise DiscError.writing(path, error) from error
    finally:
        with suppress(OSError):
            part.unlink(missing_ok=True)


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file whole or not at all."""
    with written_whole(path) as part:
        part.write_bytes(content)
