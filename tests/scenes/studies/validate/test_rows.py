import json
import math

import pytest

from scenes.studies.validate.rows import Row


@pytest.mark.parametrize(
    ("model", "published", "tolerance", "ok", "ratio"),
    [
        (1.01, 1.0, 0.01, True, 1.01),
        (1.02, 1.0, 0.01, False, 1.02),
        (-1.02, -1.0, 0.03, True, 1.02),
        (1e-13, 0.0, 1e-12, True, None),
        (1e-11, 0.0, 1e-12, False, None),
        (2.0, 1.0, (0.5, 2.0), True, 2.0),
        (2.1, 1.0, (0.5, 2.0), False, 2.1),
        (1.2, None, (1.0, math.inf), True, None),
        (math.nan, 1.0, 0.1, False, None),
        (math.nan, None, (-math.inf, math.inf), False, None),
    ],
)
def test_row(model, published, tolerance, ok, ratio):
    row = Row("x", model, published, tolerance, "here")
    assert row.ok is ok
    assert row.ratio == (ratio if ratio is None else pytest.approx(ratio))
    text = json.dumps(row.to_dict(), allow_nan=False)
    assert json.loads(text)["ok"] is ok
