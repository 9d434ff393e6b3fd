"""Tutorials run from top to bottom as plain Python, and become notebooks that say the same."""

from __future__ import annotations

import ast
import json
import linecache
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any

import matplotlib.pyplot as plt
import pytest

from control.parts import PART_KINDS
from scenes.commands import tutorials
from scenes.commands.tutorials import Cell, cells, notebook, plain, shipped_tutorials

TEXT = """---
file_format: mystnb
kernelspec: {display_name: Python 3, language: python, name: python3}
---

# A worm

The [glossary](../reference/glossary.md) and the [web](https://example.org) say more about $l_0$.
![A drawing](../drawings/worm.svg)

```{code-cell} ipython3
:tags: [hide-input]

length = 1.0
for number in range(2):

    print(number)
```

Lengths are in metres.

```text
worm3d run flat
```

```{code-cell}
assert length == 1.0
```

The end.
"""
LONGER = (
    *("04_friction_and_slopes", "07_control", "08_sweeps", "09_fitting", "10_your_own_actuator", "12_optimising"),
)
"""Tutorials that compute for more than five seconds."""
CODE = ("length = 1.0\nfor number in range(2):\n\n    print(number)", "assert length == 1.0")


@pytest.fixture
def kept() -> Iterator[None]:
    """Registries of parts, and figures, as they were: tutorials define parts of their own."""
    registries = [kind.registry for kind in PART_KINDS.values() if isinstance(kind.registry, dict)]
    before = [dict(registry) for registry in registries]
    yield
    plt.close("all")
    for registry, entries in zip(registries, before, strict=True):
        registry.clear()
        registry.update(entries)


@pytest.mark.parametrize(
    "name", [pytest.param(each, marks=[pytest.mark.slow] * (each in LONGER)) for each in sorted(shipped_tutorials())]
)
def test_the_cells_of_a_tutorial_run_in_order(name: str, kept: None, monkeypatch: Any, tmp_path: Path) -> None:
    """Warnings are errors, as in all tests; the value of the last line of a cell is printed, as in a notebook."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("PATH", os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]]))
    monkeypatch.setattr(plt, "show", lambda *_, **__: None)
    module = ModuleType("__main__")
    vars(module)["display"] = repr
    monkeypatch.setitem(sys.modules, "__main__", module)
    for number, cell in enumerate(cells(shipped_tutorials()[name].read_text(encoding="utf-8"))):
        if cell.is_code:
            body, last = compiled(cell.text, f"<{name}, cell {number}>")
            exec(body, vars(module))
            repr(eval(last, vars(module)))


def compiled(text: str, place: str) -> tuple[CodeType, CodeType]:
    """Return the code of a cell, and the expression in its last line (None if it is no expression)."""
    linecache.cache[place] = (len(text), None, text.splitlines(keepends=True), place)
    tree = ast.parse(text)
    last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    shown = last.value if isinstance(last, ast.Expr) else ast.Constant(None)
    expression = ast.fix_missing_locations(ast.Expression(shown))
    return compile(tree, place, "exec"), compile(expression, place, "eval")


def test_text_and_code_of_a_tutorial_are_its_cells_in_order() -> None:
    found = [*cells(TEXT)]
    assert [cell.is_code for cell in found] == [False, True, False, True, False]
    assert tuple(cell.text for cell in found if cell.is_code) == CODE
    assert found[0].text.startswith("# A worm")
    assert "worm3d run flat" in found[2].text
    assert found[4] == Cell(is_code=False, text="The end.")
    assert [*cells(TEXT.replace("\n", "\r\n"))] == found


def test_a_notebook_has_the_cells_and_no_links_to_pages_that_are_not_beside_it() -> None:
    content = json.loads(json.dumps(notebook(TEXT)))
    assert (content["nbformat"], content["nbformat_minor"]) == (4, 5)
    assert content["metadata"]["kernelspec"]["name"] == "python3"
    assert tuple("".join(cell["source"]) for cell in content["cells"] if cell["cell_type"] == "code") == CODE
    ids = [cell["id"] for cell in content["cells"]]
    assert len(set(ids)) == len(ids)
    first = "".join(content["cells"][0]["source"])
    assert "The glossary and the [web](https://example.org) say" in first
    assert "A drawing" in first
    assert ".svg" not in first
    assert plain("see [keys](../reference/scene_keys.md#gait).") == "see keys."


@pytest.fixture
def shipped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "shipped"
    folder.mkdir()
    for name in ("01_first", "02_second"):
        (folder / f"{name}.md").write_text(TEXT)
    monkeypatch.setattr(tutorials, "TUTORIALS", folder)


def test_init_writes_the_tutorials_and_does_not_overwrite(shipped: None, worm3d, tmp_path: Path) -> None:
    ended = worm3d("init", "--tutorials", "mine")
    assert (ended.code, ended.err) == (0, "")
    assert ended.out.splitlines()[:2] == ["mine/01_first.ipynb", "mine/02_second.ipynb"]
    path = tmp_path / "mine" / "01_first.ipynb"
    assert json.loads(path.read_text()) == notebook(TEXT)
    path.write_text("precious")
    (tmp_path / "mine" / "02_second.ipynb").unlink()
    ended = worm3d("init", "--tutorials", "mine")
    said = "mine/01_first.ipynb exists: choose another folder, or replace the notebooks with --force"
    assert (ended.code, ended.complaints) == (2, [said])
    assert [each.name for each in (tmp_path / "mine").iterdir()] == ["01_first.ipynb"]
    assert worm3d("init", "--tutorials", "mine", "--force").code == 0
    assert json.loads(path.read_text()) == notebook(TEXT)


def test_mistakes_of_init_with_tutorials(shipped: None, worm3d, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    ended = worm3d("init", "--tutorials", "file")
    assert (ended.code, ended.complaints) == (2, ["file is a file: name a folder for the tutorials"])
    ended = worm3d("init", "mine.toml", "--tutorials", "mine")
    assert ended.complaints == ["init: --tutorials writes notebooks and no scene; leave out FILE and -o"]
    ended = worm3d("init")
    assert ended.code == 2
    assert "name a FILE for a scene, or give --tutorials DIR" in ended.err
    assert not (tmp_path / "mine").exists()


def test_a_package_without_tutorials_says_so(worm3d, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tutorials, "TUTORIALS", tmp_path / "none")
    ended = worm3d("init", "--tutorials", "mine")
    assert (ended.code, ended.complaints) == (1, [f"{tmp_path / 'none'}: no tutorials there; install worm3d again"])
