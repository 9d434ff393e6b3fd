"""Build the book: `python .docs/build.py OUT`. The pages open in a browser from the folder OUT, without a network.

The sources are assembled in a temporary folder: the Markdown files of this folder, the tutorials in
`scenes/tutorials`, and the pages and pictures that `drawings/*.py`, `reference.py` and `gallery.py` write. Sphinx then
runs the cells of the tutorials and makes the pages. A failed cell, a broken link, a warning, a missing page or a
reference to the network ends the build with an error.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from html import unescape
from importlib.util import find_spec
from pathlib import Path
from time import perf_counter
from urllib.parse import unquote, urlsplit

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
TUTORIALS = ROOT / "scenes" / "tutorials"

PAGES: Mapping[str, str] = {
    ".": "index citing changes",
    "tutorials": "01_first_crawl 02_reading_a_result 03_your_own_gait 04_friction_and_slopes 05_turning 06_pipes "
    "07_control 08_sweeps 09_fitting 10_your_own_actuator 11_soft_segments 12_optimising",
    "guides": "install scenes play worlds gaits parts accuracy control pipes_control faults sweeps optimise compare "
    "fit bridge studies learn soft_segments files extend",
    "physics": "index segment strains joints actuators contact sticking energy time_step worlds limits",
    "reference": "index scene_keys summary series commands exit_codes file_format api glossary",
    "evidence": "index speed accuracy validation controllers optimised",
    "gallery": "index",
}
"""Pages that the book must have, by folder."""

STUB = "# {}\n\nThis page is missing.\n"
CONTENTS = "\n```{toctree}\n:glob:\n\n*\n```\n"
"""Parts of a page in place of a missing page."""

NOT_PAGES = ("*.py", "__pycache__", "pages", "glossary.md", "README.md")
"""Files of this folder that are not copied to the sources of Sphinx."""

MATHJAX = "static/mathjax/tex-svg-full.js"
"""The file of the package sphinx-mathjax-offline that draws formulas. The file needs no fonts and no other files."""

NETWORK = re.compile(r"""<(?:script|img|iframe|source|video|audio|link)\b[^>]*?(?:src|href)=["'](?:https?:)?//[^>]*>""")
"""A part of a page that a browser would load from the network. Links, which the reader follows, are allowed."""
STYLE_NETWORK = re.compile(r"""(?:url\(\s*["']?|@import\s+["'])(?:https?:)?//""")

CODE_BLOCK = re.compile(r"^(`{3,})[^\n]*\n.*?^\1", re.MULTILINE | re.DOTALL)
COMMENT = re.compile(r"^[ \t]*%.*$", re.MULTILINE)
"""A line that MyST takes as a comment and leaves out, such as the second half of "5 %" after a line break."""

PROCESSES = 2
"""Number of generators, and of tutorials, that run at the same time."""

PAGE_LINK = re.compile(r'\s(?:href|src)="([^"]*)"')
"""A link of a page, or the file of a picture, frame, script or style."""

LARGEST = 40e6
"""Largest size of the book [byte]."""


def main() -> None:
    """Build the book and end with an exit code."""
    options = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    options.add_argument("out", type=Path, help="folder for the pages; an earlier book there is replaced")
    options.add_argument("--partial", action="store_true", help="put a short page in place of each missing page")
    given = options.parse_args()
    out = given.out.resolve()
    if not is_replaceable(out):
        sys.exit(f"{given.out} holds other files than a book: choose an empty or a new folder")
    begun = perf_counter()
    mistakes = build(out, partial=given.partial)
    for line in mistakes:
        sys.stderr.write(f"{line}\n")
    if mistakes:
        sys.exit(1)
    sys.stdout.write(f"{given.out / 'index.html'}: built in {perf_counter() - begun:.0f} s\n")


def is_replaceable(out: Path) -> bool:
    """Return whether the folder is missing, empty or an earlier book, so that no other files are lost."""
    return not out.exists() or (out.is_dir() and (not any(out.iterdir()) or (out / "objects.inv").is_file()))


def build(out: Path, *, partial: bool) -> list[str]:
    """Build the book into a folder, and return the mistakes. If `partial`, missing pages are no mistakes."""
    with tempfile.TemporaryDirectory(prefix="worm3d-book-") as name:
        sources = Path(name) / "sources"
        for path in ROOT.iterdir():  # pages may include and show files of the tree, such as ../scenes/CHANGES.md
            if not path.name.startswith((".git", ".venv", ".docs")):
                (Path(name) / path.name).symlink_to(path)
        mistakes = [*assemble(sources), *lost_lines(sources)]
        missing = [*missing_pages(sources)]
        for page in missing:
            page.parent.mkdir(exist_ok=True)
            page.write_text(STUB.format(page.stem), encoding="utf-8")
            if page.stem == "index" and len(PAGES[page.parent.name].split()) > 1:
                page.write_text(STUB.format(page.parent.name) + CONTENTS, encoding="utf-8")
        if not partial:
            mistakes += [f"missing page: {page.relative_to(sources)}" for page in missing]
        made = Path(name) / "html"
        failed = sphinx(sources, made, partial=partial)
        mistakes += failed
        if not failed:
            copy_assets(sources, made)
            mistakes += [*wrong_files(made), *(() if partial else broken_links(sources, made))]
            shutil.rmtree(out, ignore_errors=True)
            shutil.copytree(made, out, ignore=shutil.ignore_patterns(".doctrees", ".buildinfo", "jupyter_execute"))
    return mistakes


def assemble(sources: Path) -> list[str]:
    """Copy and generate the sources into a folder, and return the mistakes."""
    shutil.copytree(HERE, sources, ignore=shutil.ignore_patterns(*NOT_PAGES))
    shutil.copy(HERE / "conf.py", sources)
    (sources / "_static" / "mathjax").mkdir(parents=True, exist_ok=True)
    shutil.copy(mathjax(), sources / "_static" / "mathjax")
    if TUTORIALS.is_dir():
        shutil.copytree(TUTORIALS, sources / "tutorials", dirs_exist_ok=True)
    generators = [HERE / "gallery.py", HERE / "reference.py", *sorted((HERE / "drawings").glob("[!_]*.py"))]
    with ThreadPoolExecutor(PROCESSES) as pool:
        return [*filter(None, pool.map(lambda each: generate(each, sources), filter(Path.exists, generators)))]


def mathjax() -> Path:
    """Return the file that draws formulas."""
    package = find_spec("sphinx-mathjax-offline")
    if package is None or package.origin is None:
        sys.exit("no package sphinx-mathjax-offline: pip install -c requirements.lock -e '.[docs]'")
    return Path(package.origin).parent / MATHJAX


def generate(script: Path, sources: Path) -> str:
    """Run a generator, which writes files into the folder of the sources, and return a mistake if it fails."""
    begun = perf_counter()
    ended = subprocess.run([sys.executable, str(script), str(sources)], env=environment(), cwd=sources, check=False)
    sys.stdout.write(f"{script.relative_to(ROOT)}: {perf_counter() - begun:.0f} s\n")
    sys.stdout.flush()
    return f"{script.relative_to(ROOT)} failed" if ended.returncode else ""


def environment() -> dict[str, str]:
    """Return the environment of generators and cells: the command `worm3d`, and pictures without a screen."""
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])
    modules = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH", "")]))
    return {
        **os.environ,
        "PATH": path,
        "PYTHONPATH": modules,
        "MPLBACKEND": "Agg",
        "PYDEVD_DISABLE_FILE_VALIDATION": "1",
    }


def missing_pages(sources: Path) -> Iterator[Path]:
    """Yield the pages that the book must have and that are not in the sources."""
    for folder, names in PAGES.items():
        for name in names.split():
            page = sources / folder / f"{name}.md"
            if not page.exists():
                yield page


def lost_lines(sources: Path) -> Iterator[str]:
    """Yield the lines of text that MyST would leave out as comments."""
    for page in sorted(sources.rglob("*.md")):
        for line in COMMENT.findall(CODE_BLOCK.sub("", _text(page))):
            yield f"{page.relative_to(sources)}: a line begins with %, and would be left out: {line[:60]}"


def sphinx(sources: Path, made: Path, *, partial: bool) -> list[str]:
    """Run Sphinx, and return a mistake if Sphinx has warnings. A stub of a missing page has no headings to link to."""
    lenient = ["-D", "suppress_warnings=myst.xref_missing"] if partial else []
    options = [
        "-b",
        "html",
        "-W",
        "--keep-going",
        "-n",
        "-q",
        "-j",
        str(PROCESSES),
        "-d",
        str(made.parent / "doctrees"),
        *lenient,
    ]
    env = {name: value for name, value in environment().items() if name != "MPLBACKEND"}  # cells draw into the page
    command = [sys.executable, "-m", "sphinx", *options, str(sources), str(made)]
    return ["Sphinx found mistakes"] if subprocess.run(command, env=env, check=False).returncode else []


def copy_assets(sources: Path, made: Path) -> None:
    """Copy the files of the gallery that pages show in frames, which Sphinx does not know."""
    for path in (sources / "gallery").rglob("*"):
        if path.is_file() and path.suffix != ".md":
            target = made / path.relative_to(sources)
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(path, target)


def wrong_files(made: Path) -> Iterator[str]:
    """Yield the pages and styles that need a network, and a line if the book is too large."""
    for path in sorted(made.rglob("*.html")):
        yield from (f"{path.name}: needs the network: {found[0][:200]}" for found in NETWORK.finditer(_text(path)))
    for path in sorted(made.rglob("*.css")):
        yield from (f"{path.name}: needs the network" for _ in STYLE_NETWORK.finditer(_text(path)))
    size = sum(path.stat().st_size for path in made.rglob("*") if path.is_file())
    if size > LARGEST:
        yield f"the book has {size / 1e6:.0f} MB, must have at most {LARGEST / 1e6:.0f} MB"


def broken_links(sources: Path, made: Path) -> Iterator[str]:
    """Yield the links and pictures of pages that lead to no file, or to no place within a page.

    Sphinx checks links in Markdown only, and not frames and links that are written as HTML.
    """
    for source in sorted(sources.rglob("*.md")):
        page = made / source.relative_to(sources).with_suffix(".html")
        for link in sorted(set(PAGE_LINK.findall(_text(page)))):
            parts = urlsplit(unescape(link))
            target = page.parent / unquote(parts.path) if parts.path else page
            if not parts.scheme and not parts.netloc and not _is_there(target, unquote(parts.fragment)):
                yield f"{source.relative_to(sources)}: {link} leads nowhere"


def _is_there(path: Path, place: str) -> bool:
    return path.exists() and (not place or path.suffix != ".html" or place in _places(path))


@cache
def _places(path: Path) -> frozenset[str]:
    return frozenset(re.findall(r'\bid="([^"]*)"', _text(path)))


def _text(path: Path) -> str:
    return path.read_text(encoding="utf-8", errors="replace")


if __name__ == "__main__":
    main()
