"""Keys of a sweep that follow from others: choices and formulas give each case its keys, and mistakes are told."""

from __future__ import annotations

import tomllib
import zlib
from pathlib import Path
from typing import Any

import pytest

from scenes.language.errors import SceneError
from scenes.sweep.plan import Plan, Source, planned

GROWING = """
vary = { "worm.segments" = [3, 6], ratio = [1.0, 4.0] }
set = { "friction.forward" = "= 0.2 / ratio", "friction.backward" = 0.2 }
[sweep.choices.body]
"one body" = {}
"one kind" = { worm.length_m = "= worm.segments / 6", worm.spring_N = "= 10 * worm.length_m", friction.backward = 0.3 }
"""


def plan(section: str, tmp_path: Path) -> Plan:
    path = tmp_path / "scene.toml"
    path.write_text(f'model = "worm"\n[worm]\nhalf_height_m = 0.08\n[sweep]\n{section}')
    return planned(Source.of(path))


def scenes(given: Plan) -> list[dict[str, Any]]:
    return [tomllib.loads(zlib.decompress(case.packed).decode()) for case in given.cases]


def test_each_case_has_the_keys_of_its_choice_and_its_formulas(tmp_path: Path) -> None:
    given = plan(GROWING, tmp_path)
    assert given.design.sizes == {"worm.segments": 2, "ratio": 2, "body": 2}
    for case, scene in zip(given.cases, scenes(given), strict=True):
        segments, ratio, grown = case.values["worm.segments"], case.values["ratio"], case.values["body"] == "one kind"
        assert scene["worm"]["segments"] == segments
        assert scene["friction"]["forward"] == pytest.approx(0.2 / ratio, rel=1e-12)
        assert scene["friction"]["backward"] == (0.3 if grown else 0.2)
        assert scene["worm"]["length_m"] == pytest.approx(segments / 6 if grown else 1.0)
    assert len({case.key for case in given.cases}) == len({case.seed for case in given.cases}) == 8


def test_a_formula_may_be_of_the_varied_key_itself_or_one_for_each_segment(tmp_path: Path) -> None:
    section = """
vary = { "gait.amplitude" = [0.2, 0.3], stiff = [6, 8] }
set = { "gait.amplitude" = "= gait.amplitude / 2" }
[sweep.choices.where]
front = { "worm.spring_N" = ["= stiff", "= 2 * stiff", 7, 7, 7, 7] }
"""
    first = scenes(plan(section, tmp_path))[0]
    assert first["gait"]["amplitude"] == 0.1
    assert first["worm"]["spring_N"] == [6, 12, 7, 7, 7, 7]


@pytest.mark.parametrize(
    ("section", "complaint"),
    [
        (
            'vary = { ratio = [1, 2] }\nset = { "worm.mass_kg" = "= ratoi" }',
            "sweep, worm.mass_kg: formula '= ratoi': ratoi is not known",
        ),
        ('vary = { seed = [1] }\nset = { "worm.mass_kg" = "= ratio" }', "ratio is not known; the names in"),
        ('vary = { seed = [1] }\nset = { "worm.mass_kg" = "= gait.kind" }', "no number"),
        ('vary = { ratio = [1] }\nset = { "worm.mass" = "= ratio" }', "worm.mass: unknown key"),
        ("vary = { seed = [1] }\nchoices = { seed = { a = {} } }", "sweep.choices.seed: it is varied too"),
        ("vary = {}\nchoices = { body = 3 }", "sweep.choices.body: got 3"),
        ("vary = {}\nchoices = { body = {} }", "no values"),
    ],
)
def test_mistakes(section: str, complaint: str, tmp_path: Path) -> None:
    with pytest.raises(SceneError) as error:
        plan(section, tmp_path)
    assert complaint in str(error.value)
