"""The verdicts on the paper's claims change when the program does."""

import numpy as np
import pytest

from planar import published
from planar.published import Parameters, Run
from scenes.studies.paper import claims


@pytest.fixture(scope="module")
def as_printed() -> Run:
    return published.simulate()


@pytest.mark.slow
def test_friction_propels_but_no_load_anchors(as_printed: Run) -> None:
    propels, anchors = claims._friction_claims(as_printed)
    assert propels.verdict == "holds"
    assert anchors.verdict == "does not hold"
    _, anchors = claims._friction_claims(published.simulate(parameters=Parameters(mu_forward=0.18)))
    assert anchors.verdict == "holds", "a worm that moves no more than with equal coefficients is anchored otherwise"


@pytest.mark.slow
def test_the_wave_is_told_by_the_activation_not_by_the_motion(as_printed: Run) -> None:
    x = (np.arange(6) + 0.5) / 6
    retrograde = published.simulate(activation=lambda t: np.maximum(0.0, np.sin(2 * np.pi * (x + t / 2))))
    backwards = published.simulate(parameters=Parameters(mu_forward=0.20, mu_backward=0.03))
    assert retrograde.true_displacement > 0.0 > backwards.true_displacement
    assert claims._wave_claim(as_printed).verdict == "does not hold"
    assert claims._wave_claim(retrograde).verdict == "holds"
    assert claims._wave_claim(backwards).verdict == "holds"
    assert "towards index 0" in claims._wave_claim(retrograde).evidence
    assert "index 0 is its head" in claims._wave_claim(backwards).evidence


@pytest.mark.slow
def test_the_mechanism_is_judged_with_both_signs(as_printed: Run) -> None:
    claim = claims._mechanism_claim(as_printed)
    assert claim.verdict == "holds only by the inverted sign"
    right = published.simulate(parameters=Parameters(elastic_sign=1.0))
    assert claims._mechanism_claim(right).verdict == "does not hold"
    widens, _ = claims._widens(published.simulate(parameters=Parameters(elastic_sign=1.0, contraction_force=-1.0)))
    assert widens, "with the right sign the forces have to pull"


def test_a_collapse_is_seen() -> None:
    run = published.simulate(steps=10)
    assert claims._mass_claim(run).verdict == "does not hold for the inverted sign"
    assert "inside out in 0 steps" in claims._mass_claim(run).evidence


def test_loads_that_vary_would_be_seen() -> None:
    assert claims._loads_claim(published.simulate(steps=100)).verdict == "does not hold"
    varying = published.simulate(steps=100, parameters=Parameters(normal_load="residual"))
    assert claims._loads_claim(varying).verdict == "holds"


@pytest.mark.slow
def test_alternating_signs_make_no_difference() -> None:
    assert claims._alternating_claim().verdict == "does not hold"


def test_the_drop_from_six_to_seven_is_stated() -> None:
    assert "(-50% from 6 to 7)" in claims.by_segments("x", [1.0, 2.0, 3.0, 4.0, 2.0]).evidence
    assert "from 6 to 7" not in claims.by_segments("x", [1.0, 2.0, 3.0, None, 2.0]).evidence
