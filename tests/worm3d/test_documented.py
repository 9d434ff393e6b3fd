"""`help` shows what public classes hold, though each field's meaning stands below the field."""

import pydoc

import pytest

import worm3d


@pytest.mark.parametrize("name", ["Command", "Held", "Observation", "State", "Stop"])
def test_help_says_what_each_field_is(name: str) -> None:
    holder = getattr(worm3d, name)
    shown = pydoc.plain(pydoc.render_doc(holder))
    for field in holder.__dataclass_fields__:
        assert f" {field} : " in shown.replace("|", ""), field


def test_sections_of_a_docstring_stand_in_the_usual_order() -> None:
    text = worm3d.Command.__doc__ or ""
    assert text.index("Attributes") < text.index("contraction : FloatArray") < text.index("Raises")
    assert "Hinge angle of joints 1 to N-1" in text
