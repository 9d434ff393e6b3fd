"""Closed forms of crawling: the report's cases, their neighbourhoods, and the formulas' own limits."""

from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from scenes.studies.validate import formulas as forms
from scenes.studies.validate.chain import Chain, Crawl
from scenes.studies.validate.closed_forms import (
    CASES,
    DIRECT,
    LEAST,
    RETROGRADE,
    WIDE,
    Case,
    body,
    friction,
    phase_step,
)


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_the_run_gives_the_closed_form(case: Case) -> None:
    row = case.row()
    assert row.ok, (row.model, row.published, row.note)


def test_names_are_unique() -> None:
    names = [case.name for case in CASES]
    assert len(set(names)) == len(names)


def draw(rng: np.random.Generator, feet: int) -> tuple[float, float]:
    """Return coefficients whose N q is at least 0.15 off a whole number, which the uneven loads cannot make up for."""
    while True:
        forward, backward = np.round(np.exp(rng.uniform(np.log(0.05), np.log(0.8), 2)), 4)
        slipping = feet * forward / (forward + backward)
        if abs(slipping - round(slipping)) > 0.15:
            return float(forward), float(backward)


@pytest.mark.parametrize("seed", range(6))
def test_breathing_of_random_crawlers(seed: int) -> None:
    """Stiff anchors give way by LEAST 1e-5 l0 larger/smaller mu, twice a cycle, of a stroke (N - 1) A l0."""
    rng = np.random.default_rng(seed)
    feet = int(rng.integers(2, 20))
    forward, backward = draw(rng, feet)
    amplitude = rng.uniform(0.2, 0.6)
    chain = Chain.of(
        "breathing", (*body(feet), *friction(forward, backward, feet), f"gait.amplitude={amplitude}", "run.dt_s=2.0")
    )
    crawl = Crawl.of(chain)
    ratio = max(forward, backward) / min(forward, backward)
    gives_way = 2.0 * LEAST * 1e-5 * ratio / amplitude / (feet - 1)
    assert_allclose(forms.of_stroke(crawl), forms.breathing(chain), rtol=0, atol=2e-7 + 1.5 * gives_way)
    assert crawl.unevenness < 0.03
    assert_allclose(crawl.loads.sum(axis=1), 9.81 * chain.settings.worm.mass_kg, rtol=1e-3)


@pytest.mark.parametrize("seed", range(4))
def test_elastic_crawlers_of_random_springs(seed: int) -> None:
    rng = np.random.default_rng(100 + seed)
    forward, backward = np.round(rng.uniform(0.1, 0.5, 2), 3).tolist()
    k = rng.uniform(1.2, 4.0)
    chain = Chain.of("elastic_crawler", (f"worm.spring_N={[1e7, k, k, k, k, 1e7]}", *friction(forward, backward, 2, 4)))
    crawl = Crawl.of(chain)
    assert abs(forms.elastic(chain)) < 0.97
    assert_allclose(forms.of_stroke(crawl), forms.elastic(chain), rtol=0, atol=1.5e-6)
    assert_allclose(crawl.loads, 9.81 * 0.06 / 2.0, rtol=1e-6)


@pytest.mark.parametrize("seed", range(6))
def test_sine_waves_of_random_crawlers(seed: int) -> None:
    rng = np.random.default_rng(200 + seed)
    feet = int(rng.integers(5, 16))
    forward, backward = draw(rng, feet)
    overrides = (*body(feet, **WIDE), *friction(forward, backward, feet), phase_step(2.0 * np.pi / feet, feet))
    chain = Chain.of("phase_steps", (*overrides, (DIRECT, RETROGRADE)[seed % 2]))
    crawl = Crawl.of(chain)
    ratio = max(forward, backward) / min(forward, backward)
    assert_allclose(forms.of_wave(crawl), forms.sine(chain), rtol=0, atol=1e-5 + 2e-6 * ratio)
    assert crawl.unevenness < 0.02


def by_the_law(crawl: Crawl) -> float:
    """Return the way in the last period by the quantile law with equal loads, of how the feet moved [m].

    V = -(quantile at the level q of the velocities relative to the body), Gidoni, Noselli, DeSimone 2014.
    """
    relative = np.sort(np.diff(crawl.places - crawl.places.mean(axis=1, keepdims=True), axis=0), axis=1)
    return -float(relative[-crawl.chain.steps :, crawl.chain.slipping_back].sum())


@pytest.mark.parametrize("seed", range(3))
def test_any_phases_follow_the_quantile_law_with_equal_loads(seed: int) -> None:
    """The law of how the feet moved relative to each other, with equal loads put in for the true ones."""
    rng = np.random.default_rng(300 + seed)
    feet = int(rng.integers(5, 12))
    overrides = (*body(feet, **WIDE), *friction(*draw(rng, feet), feet), phase_step(rng.uniform(0.3, 3.0), feet))
    crawl = Crawl.of(Chain.of("phase_steps", overrides))
    law = by_the_law(crawl)
    assert_allclose(crawl.travel, law, rtol=0, atol=3e-5 * feet * crawl.chain.swing)
    assert abs(law) > 1e-2 * crawl.chain.swing


def test_loads_of_the_feet_under_a_payload_are_those_of_statics() -> None:
    """Moments about the rear foot and about the front one, see `scenes.studies.validate.chain`."""
    crawl = Crawl.of(Chain.of("two_contacts", ()))
    distance = np.diff(crawl.places[1:], axis=1)[:, 0]
    moved = 0.01 * 9.81 * 0.02 / (2.0 * distance)
    rear, front = crawl.loads.T
    assert_allclose(rear, 0.05 * 9.81 / 2.0 - moved, rtol=2e-4)
    assert_allclose(front, 0.05 * 9.81 / 2.0 + 0.01 * 9.81 + moved, rtol=2e-4)


def crawler(feet: int, forward: float, backward: float) -> Chain:
    """Return a chain of which only the feet and the friction are known."""
    pair = SimpleNamespace(forward=forward, backward=backward)
    chain = Chain(SimpleNamespace(friction=pair))
    vars(chain)["is_foot"] = np.ones(feet, dtype=bool)
    return chain


@pytest.mark.parametrize(
    ("feet", "forward", "backward", "published"), [(7, 0.1, 0.35, 2 / 3), (11, 0.1, 0.23, 0.4), (1001, 0.1, 0.3, 0.5)]
)
def test_breathing_has_the_published_values(feet: int, forward: float, backward: float, published: float) -> None:
    assert_allclose(forms.breathing(crawler(feet, forward, backward)), published, rtol=1e-12)
    assert_allclose(forms.breathing(crawler(feet, backward, forward)), -published, rtol=1e-12)


@pytest.mark.parametrize(("ratio", "published"), [(1.5, 0.30902), (4.0, 0.80902), (10.0, 0.9594)])
def test_the_sine_law_has_the_published_values_at_4000_feet(ratio: float, published: float) -> None:
    chain = crawler(4000, 0.1, 0.1 * ratio)
    assert_allclose(forms.sine(chain), published, rtol=2e-3)
    assert_allclose(forms.sine_continuum(chain), published, rtol=2e-4)


def test_loads_that_pass_the_limit_have_no_closed_form() -> None:
    with pytest.raises(ValueError, match=r"the ratio of loads, .* passes 0\.286"):
        forms.two_loads(Chain.of("two_contacts", ("worm.payload_kg=0.026",)))


def test_a_run_that_does_not_fit_the_form_is_a_row_that_says_why() -> None:
    row = Case("wrong", "breathing", forms.breathing, ("worm.half_height_m=0.016",)).row()
    assert np.isnan(row.model)
    assert not row.ok
    assert "a muscle touches the ground" in row.note
