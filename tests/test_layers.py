"""Import contracts cover every room and file, and fail where a new one is not covered or a circle is made."""

import tomllib
from collections.abc import Callable
from copy import deepcopy
from graphlib import TopologicalSorter
from itertools import permutations
from pathlib import Path
from typing import Any

import grimp
import pytest
from importlinter import configuration
from importlinter.contracts.acyclic_siblings import AcyclicSiblingsContract
from importlinter.contracts.layers import LayersContract
from importlinter.domain.contract import Contract

ROOT = Path(__file__).parents[1]
LINTER = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]
KINDS: dict[str, type[Contract]] = {"layers": LayersContract, "acyclic_siblings": AcyclicSiblingsContract}
ELSEWHERE = {"fit", "optimise", "sweep"}
"""Public names of worm3d that stand in packages above it."""
BY_NAME = {"worm3d.results.files"}
"""Modules of worm3d that look a class up by its public name."""


@pytest.fixture(scope="module")
def built() -> grimp.ImportGraph:
    """Return all imports, those within functions and for type checkers too."""
    configuration.configure()
    return grimp.build_graph(*LINTER["root_packages"], include_external_packages=False)


def contract_of(kind: str, has: Callable[[dict[str, Any]], bool]) -> Contract:
    """Return the only contract of a kind for which `has` is true, as import-linter reads it."""
    (options,) = (each for each in LINTER["contracts"] if each["type"] == kind and has(each))
    as_read = {name: str(value) if isinstance(value, bool) else value for name, value in options.items()}
    return KINDS[kind](options["name"], session_options=LINTER, contract_options=as_read)


def is_kept(contract: Contract, graph: grimp.ImportGraph) -> bool:
    """Return whether a graph, which may be changed, keeps a contract."""
    return contract.check(graph, verbose=False).kept


@pytest.mark.parametrize("package", [*LINTER["root_packages"], "scenes.studies"])
def test_a_new_room_or_file_needs_a_layer(package: str, built: grimp.ImportGraph) -> None:
    layers = contract_of("layers", lambda given: given.get("containers") == [package])
    assert is_kept(layers, deepcopy(built))
    new = deepcopy(built)
    new.add_module(f"{package}.made_up_room")
    new.add_module(f"{package}.made_up_room.file")
    assert not is_kept(layers, new)


@pytest.mark.parametrize("package", LINTER["root_packages"])
def test_an_import_from_a_lower_layer_to_a_higher_one_is_refused(package: str, built: grimp.ImportGraph) -> None:
    layers = contract_of("layers", lambda given: given.get("containers") == [package])
    (options,) = (each for each in LINTER["contracts"] if each.get("containers") == [package])
    high, low = (f"{package}.{options['layers'][k].split(' | ')[0]}" for k in (0, -1))
    upward = deepcopy(built)
    upward.add_import(importer=low, imported=high)
    assert not is_kept(layers, upward)


def test_the_contract_on_circles_covers_every_package() -> None:
    assert [each["ancestors"] for each in LINTER["contracts"] if each["type"] == "acyclic_siblings"] == [
        LINTER["root_packages"]
    ]


@pytest.mark.parametrize("room", ["worm3d", "worm3d.physics.technologies", "control", "planar", "scenes"])
def test_a_circle_in_any_room_is_refused(room: str, built: grimp.ImportGraph) -> None:
    acyclic = contract_of("acyclic_siblings", lambda given: True)
    children = sorted(built.find_children(room))
    pair = next(
        (a, b) for a, b in permutations(children, 2) if built.find_shortest_chain(a, b, as_packages=True) is not None
    )
    closed = deepcopy(built)
    closed.add_import(importer=pair[1], imported=pair[0])
    assert not is_kept(acyclic, closed)


def test_no_files_import_each_other_in_a_circle(built: grimp.ImportGraph) -> None:
    # Siblings alone are compared by the contract: here a folder's own file counts, too.
    TopologicalSorter({name: built.find_modules_directly_imported_by(name) for name in built.modules}).prepare()


def test_worm3d_takes_no_public_name_from_itself(built: grimp.ImportGraph) -> None:
    # `from worm3d import Name` would be an import of any layer, which no contract sees.
    importers = {name for name in built.find_modules_that_directly_import("worm3d") if name.startswith("worm3d.")}
    assert importers == BY_NAME


def test_public_names_stand_in_worm3d_but_for_those_that_are_named() -> None:
    lines = [line.split() for line in (ROOT / "worm3d" / "__init__.pyi").read_text().splitlines()]
    assert {line[-1] for line in lines if not line[1].startswith("worm3d.")} == ELSEWHERE
