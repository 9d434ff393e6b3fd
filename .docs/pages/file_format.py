"""The page with the format of result files, from the code that writes the files and from a file of a short run."""

from __future__ import annotations

import ast
import inspect
from collections.abc import Iterator, Mapping
from itertools import pairwise

from pages.text import code, page, prose, sentence, table
from scenes.records import record as records_module
from scenes.records.record import Record
from scenes.records.store import content_of
from worm3d.values import netcdf
from worm3d.values.netcdf import RESULT_FORMAT, Content

PAGE_INTRODUCTION = f"""
A result file, `result.nc`, is a NetCDF4 file. NetCDF4 files are HDF5 files, so that programs for either format can read
the file, for example `xarray`, `h5py`, `ncdump` or MATLAB. `worm3d.load` returns the file as a `worm3d.Result`. The
attribute `format` of the root group is `{RESULT_FORMAT}`.

Each variable has the attributes `units` and `long_name`, and its dimensions have names. Numbers are not compressed.
Nothing in the file is pickled. Reading a file runs no code from the file.
""".strip()

DIGESTS = f"""
The attribute `digest` is the SHA-256 of the content: of the attributes {", ".join(map(code, netcdf.SAID))},
and of the names, dimensions, units, types and values of the variables. The digest does not depend on the layout of the
file. After the last byte of the HDF5 file stands a second SHA-256, of all bytes before. `worm3d.load` refuses a file
whose digest is wrong. Computing times, in the group `timing`, differ from run to run. All other groups are equal bit
for bit if a scene is run again on the same machine with the same versions.
""".strip()

ATTRIBUTES = {
    "format": "name and version of the format",
    "digest": "SHA-256 of the content",
    "model": "model of the scene, or python for a file of `Result.save`",
    "status": "how the run ended, as one word",
    "seed": "seed of the random numbers of the run",
    "summary": "figures of the run, with the reasons for missing values, as JSON text",
}
"""Meanings of attributes that `Record` does not describe."""

FILE_GROUPS = {
    netcdf.ROOT: "The root group has the recorded series.",
    netcdf.TIMING: "Computing times.",
    "checkpoint": "State at the end of the run, from which `worm3d run --resume` continues.",
    "run": "Larger arrays of the worm and the world, to which the attribute `run` refers.",
}


def file_format(records: Mapping[str, Record]) -> str:
    """Return the page; `records` has a short run of the model `worm`."""
    content = netcdf.signed(content_of(records["worm"]))
    rows = [[code(name), code(_type(content, name)), prose(text)] for name, text in _attributes(content)]
    blocks = [PAGE_INTRODUCTION, "## Attributes", table(["attribute", "type", "meaning"], rows), "## Digests", DIGESTS]
    for name, said in FILE_GROUPS.items():
        blocks += [f"## Group {code(name or '/')}", said, _variables(content, name)]
    return page("File format of results", *blocks)


def _type(content: Content, name: str) -> str:
    return "integer" if isinstance(content.attributes[name], int) else "text"


def _attributes(content: Content) -> Iterator[tuple[str, str]]:
    described = _fields()
    for name in content.attributes:
        yield name, sentence_of(ATTRIBUTES.get(name) or described[name])


def sentence_of(text: str) -> str:
    """Return a text with a capital letter and a full stop."""
    return text[0].upper() + text[1:].rstrip(".") + "."


def _fields() -> dict[str, str]:
    """Return the strings below the fields of `Record`, by name."""
    (record,) = [node for node in ast.parse(inspect.getsource(records_module)).body if _is_record(node)]
    body: list[ast.stmt] = getattr(record, "body", [])
    return {
        ast.unparse(field.target): " ".join(str(below.value.value).split())
        for field, below in pairwise(body)
        if isinstance(field, ast.AnnAssign) and isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant)
    }


def _is_record(node: ast.stmt) -> bool:
    return isinstance(node, ast.ClassDef) and node.name == "Record"


def _variables(content: Content, group: str) -> str:
    if group == netcdf.ROOT:
        names = ", ".join(code(each.name) for each in content.groups[group])
        return f"[Recorded series](series.md) describes the variables. A run of the scene `flat` has {names}."
    rows = (
        [code(each.name), code(each.units), f"({', '.join(each.dims)})", sentence(each.long_name)]
        for each in content.groups.get(group, ())
    )
    return table(["variable", "unit", "dimensions", "meaning"], rows)
