"""Pattern generators of the validation report."""

import numpy as np

from scenes.studies.validate.pattern_generators import rows


def test_the_rows_agree() -> None:
    found = list(rows(True))
    assert [row.name for row in found if not row.ok] == []
    assert len(found) == 9
    assert {(row.kind, row.standing) for row in found} == {("pattern generator", "verification")}
    larva, cycles = found[:4], found[4:8]
    assert np.ptp([row.ratio for row in larva]) < 0.02
    assert all(abs(row.ratio - 1.0) > 1e-5 for row in cycles)  # sampled, not computed by the formula
