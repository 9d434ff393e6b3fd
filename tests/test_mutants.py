"""Mutations that `mutants.py` draws: of every area and operator, the same for a seed, each a change of the code."""

import ast
import importlib.util
from pathlib import Path

import pytest

HERE = Path(__file__).parent


@pytest.fixture(scope="module")
def mutants():
    spec = importlib.util.spec_from_file_location("mutants", HERE / "mutants.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.slow
def test_thirty_mutations_are_of_all_areas_and_operators_and_change_what_runs(mutants) -> None:
    chosen = mutants.drawn(3, 30)
    assert len({(each.area, each.operator) for each in chosen}) == len(mutants.AREAS) * len(mutants.OPERATORS) == 30
    assert mutants.drawn(3, 30) == chosen
    for each in chosen:
        source = (mutants.ROOT / each.path).read_bytes()
        mutated = source[: each.begin] + each.new.encode() + source[each.end :]
        assert ast.dump(ast.parse(mutated)) != ast.dump(ast.parse(source)), each


def test_every_area_has_its_tests(mutants) -> None:
    for area, (_, _, names) in mutants.AREAS.items():
        tests = mutants.tests_of(mutants.Mutation(area, "", "", 0, 0, 0, "", ""), mutants.ROOT)
        assert len(tests) == len(names.split()), area


def test_tests_that_are_named_after_a_file_come_first_whether_the_area_lists_them_or_not(mutants) -> None:
    area = mutants.tests_of(mutants.Mutation("solver", "", "", 0, 0, 0, "", ""), mutants.ROOT)
    tests = mutants.tests_of(mutants.Mutation("solver", "", "worm3d/solver/loads.py", 0, 0, 0, "", ""), mutants.ROOT)
    assert tests == ["tests/worm3d/test_loads.py", *area]
    tests = mutants.tests_of(mutants.Mutation("solver", "", "worm3d/solver/newton.py", 0, 0, 0, "", ""), mutants.ROOT)
    assert tests == list(dict.fromkeys([*(f"tests/worm3d/test_newton{more}.py" for more in ("", "_counts")), *area]))


@pytest.mark.parametrize(
    ("code", "operator", "expected"),
    [
        ("a - b", "swapped sides", {"b - a"}),
        ("a + b", "dropped term", {"a", "b"}),
        ("a - 1e-12", "dropped term", set()),
        ("'a' + b", "sign", set()),
        ("a < b", "limit", {"a > b"}),
        ("min(a, b)", "swapped sides", set()),
        ("min(a, b)", "limit", {"max(a, b)"}),
        ("x.left", "swapped sides", {"x.right"}),
        ("sorted(a)", "order", {"list(a)"}),
        ("a[::-1]", "order", {"a"}),
    ],
)
def test_what_a_mutation_makes_of_code(mutants, code: str, operator: str, expected: set[str]) -> None:
    (node,) = ast.parse(code).body
    found = {ast.unparse(changed) for kind, changed in mutants.changes(node.value) if kind == operator}
    assert found == expected
