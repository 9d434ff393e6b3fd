"""What is no argument is refused with a sentence of ours that names it, each argument of the public functions."""

import numpy as np
import pytest
from abuses import TARGETS, cases
from fuzzing import no_hang

import worm3d

ABUSES = list(cases())


@pytest.fixture(scope="module", autouse=True)
def _compiled() -> None:
    """Compile the plant before the clock of a hang runs."""
    worm3d.simulate(worm3d.Worm(), worm3d.Plane(), duration=0.01)


@pytest.mark.parametrize("name", TARGETS)
def test_what_is_no_argument_is_refused_by_name(name: str) -> None:
    target, wrong = TARGETS[name], []
    for _, argument, value in (case for case in ABUSES if case[0] == name):
        try:
            with no_hang(), np.errstate(all="warn"):
                target.make(**{**target.good, argument: value})
        except ValueError as refused:
            text = str(refused)
            if argument not in text or "must" not in text or "\n" in text or len(text) > 400:
                wrong.append(f"{argument}={value!r:.60}: {text:.200}")
        except Exception as raw:
            wrong.append(f"{argument}={value!r:.60}: {type(raw).__name__}: {raw!s:.200}")
        else:
            wrong.append(f"{argument}={value!r:.60}: accepted")
    assert not wrong, "\n".join(wrong)


def test_there_are_many() -> None:
    assert len(ABUSES) > 1500
