"""Segment laws: closed forms, derivatives, the ledger with a command that moves apexes, and files that are refused."""

import json
import pickle
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from planar import linkage
from planar.linkage import Friction, Learned, Linkage
from planar.linkage.ledger import _stacked, _Terms
from planar.linkage.segment_law import ENERGY_LAYERS, RADIUS_LAYERS, network, spring, values
from planar.linkage.shape import cross_products
from planar.status import Status

L0, N = 0.16, 4


def states() -> tuple[np.ndarray, np.ndarray]:
    """Return lengths and contractions in the domain of the learned law, each of shape (20, N)."""
    rng = np.random.default_rng(4)
    return L0 * rng.uniform(0.6, 1.2, (20, N)), rng.uniform(0.01, 0.34, (20, N))


def crawling(t: float) -> np.ndarray:
    """Return a wave of contractions that begins and stays smooth."""
    begun = min(1.0, 2.0 * t)
    wave = 1.0 - np.cos(2.0 * np.pi * ((np.arange(N) + 0.5) / N + t))
    return 0.1 * begun**2 * (3.0 - 2.0 * begun) * wave


@pytest.fixture(scope="module")
def crawls(law_worm: Linkage) -> list[linkage.Run]:
    worm = law_worm.with_changes(mass=0.2)
    return [linkage.simulate(worm, crawling, duration=1.5, dt=dt) for dt in (0.01, 0.005, 0.0025)]


@pytest.mark.parametrize(("key", "layers"), [("energy", ENERGY_LAYERS), ("radius", RADIUS_LAYERS)])
def test_networks_and_their_derivatives(law_content: dict, closed_form: SimpleNamespace, key: str, layers: int) -> None:
    weights = np.array(law_content[key]["weights"])
    for x, y, along in ((0.3, -0.7, (1.0, 0.0)), (-0.9, 0.4, (0.0, 1.0)), (0.1, 0.2, (0.6, -0.3))):
        value, first, second = network(weights, layers, x, y, *along)
        at = [(x + step * along[0], y + step * along[1]) for step in (-1e-4, 0.0, 1e-4)]
        below, here, above = closed_form.network(weights, layers, *np.array(at).T)
        assert_allclose(value, here, rtol=1e-13)
        assert_allclose(first, (above - below) / 2e-4, rtol=1e-6)
        assert_allclose(second, (above - 2.0 * here + below) / 1e-8, rtol=1e-5, atol=1e-6)


def test_learned_law_is_the_potential_that_it_was_fitted_to(law_worm: Linkage, closed_form: SimpleNamespace) -> None:
    length, contraction = states()
    found = values(length, L0 * (1.0 - contraction), law_worm.segment_law)
    energy, dl = closed_form.energy, 1e-6
    tension = (energy(length + dl, contraction) - energy(length - dl, contraction)) / (2.0 * dl)
    assert_allclose(found.energy, energy(length, contraction), rtol=1e-2)
    assert_allclose(found.tension, tension, rtol=1e-2, atol=0.02)
    assert_allclose(found.height, closed_form.radius(length, contraction), rtol=1e-3)
    assert np.abs(tension).max() > 5.0


def test_derivatives_of_a_learned_law(law_worm: Linkage) -> None:
    length, contraction = states()
    l_cmd, law, step = L0 * (1.0 - contraction), law_worm.segment_law, 1e-6
    found = values(length, l_cmd, law)
    above, below = values(length + step, l_cmd, law), values(length - step, l_cmd, law)
    assert_allclose(found.tension, (above.energy - below.energy) / (2.0 * step), rtol=1e-6, atol=1e-8)
    assert_allclose(found.along, (above.height - below.height) / (2.0 * step), rtol=1e-6)
    curve = spring(0, float(length[0, 0]), float(l_cmd[0, 0]), law)[2]
    assert_allclose(curve, (above.tension - below.tension)[0, 0] / (2.0 * step), rtol=1e-6)
    above, below = values(length, l_cmd + step, law), values(length, l_cmd - step, law)
    assert_allclose(found.widening, (above.height - below.height) / (2.0 * step), rtol=1e-6)
    assert (found.widening < 0.0).all(), "a stronger command makes the segment wider"


def test_a_free_segment_has_neither_energy_nor_tension(law_worm: Linkage) -> None:
    free = L0 * (1.0 - states()[1])
    found = values(free, free, law_worm.segment_law)
    assert_allclose(found.energy, 0.0, atol=1e-28)
    assert_allclose(found.tension, 0.0, atol=1e-13)


def test_without_networks_it_is_a_spring_of_constant_radius(law_worm: Linkage) -> None:
    """(P7), the same bits, and the radius R_mid whatever length and command are."""
    assert isinstance(law_worm.segment, Learned)
    scales = np.array([*law_worm.segment.scales[:5], 0.05, 0.02])
    plain = replace(law_worm.segment, energy=np.zeros(67), radius=np.zeros(25), scales=scales)
    length, contraction = states()
    l_cmd = L0 * (1.0 - contraction)
    found = values(length, l_cmd, law_worm.with_changes(segment=plain).segment_law)
    spring_alone = values(length, l_cmd, Linkage(segments=N, length=N * L0).segment_law)
    assert_allclose(found.energy, spring_alone.energy, rtol=1e-15)
    assert_allclose(found.tension, spring_alone.tension, rtol=1e-15)
    assert_array_equal(found.height, 0.05)
    assert_array_equal(found.along, 0.0)
    assert_array_equal(found.widening, 0.0)


def test_a_hydrostat_keeps_its_volume(default_worm: Linkage) -> None:
    """The volume of a cylinder, pi h^2 l, through a run; energy of the spring alone."""
    worm = default_worm.with_changes(segment="hydrostat")
    run = linkage.simulate(worm, lambda t: 0.3 * min(1.0, t) * (np.arange(6) % 2), duration=1.5)
    assert run.status is Status.DONE
    h = np.linalg.norm(run.apexes[:, :, 1] - run.apexes[:, :, 0], axis=-1) / 2.0
    assert_allclose(np.pi * h**2 * run.length, np.pi * 0.05**2 * worm.l0, rtol=1e-12)
    assert np.ptp(run.length[:, 1]) > 0.02
    energy = (6.5 * worm.l0 * (1.0 - run.length / (worm.l0 * (1.0 - run.contraction))) ** 2).sum(axis=1)
    bent = 5.0 * (cross_products(run.joints) ** 2).sum(axis=1)
    assert_allclose(run.ledger.elastic.sum(), (energy + bent)[-1] - (energy + bent)[0], rtol=1e-9)
    assert run.ledger.balance_error < 1e-12


def test_a_hydrostat_carries_a_weight_that_flattens_a_rhombus(default_worm: Linkage) -> None:
    heavy = default_worm.with_changes(mass=1.0)
    with pytest.raises(linkage.LimitPointError):
        linkage.simulate(heavy, lambda t: np.zeros(6))
    run = linkage.simulate(heavy.with_changes(segment="hydrostat"), lambda t: np.zeros(6), duration=0.5)
    assert run.status is Status.DONE
    assert_array_equal(run.worm.flattening_weight(), np.inf)


@pytest.mark.slow
def test_the_ledger_books_the_work_of_a_command_that_moves_apexes(crawls: list[linkage.Run]) -> None:
    """The balance closes without that work too: then the work is missing, and the numerical loss has it."""
    run = crawls[1]
    ledger = run.ledger
    assert run.status is Status.DONE
    assert ledger.balance_error < 1e-12
    assert abs(ledger.numerical_loss.sum()) < 0.02 * run.work_contract
    assert ledger.friction_loss.min() >= 0.0
    length, l_cmd, law = run.length, L0 * (1.0 - run.contraction), run.worm.segment_law
    changes = [
        values(at, l_cmd[1:], law).energy - values(at, l_cmd[:-1], law).energy for at in (length[:-1], length[1:])
    ]
    of_springs = sum(change.sum() for change in changes) / 2.0
    unbooked = ledger.numerical_loss.sum() - (run.work_contract - of_springs)
    assert abs(unbooked) > 0.05 * run.work_contract, "that work is not small"


def test_inflating_a_held_segment_lifts_its_weight(law_worm: Linkage) -> None:
    """With its joints' x held, only the command widens it: work on the apexes is the weight times the rise."""
    worm = Linkage(segments=1, mass=0.07, segment=law_worm.segment)
    held = np.array([[True, False], [True, False]])
    run = linkage.simulate(
        worm, lambda t: np.array([0.1 * t**2]), duration=1.5, held=held, friction=Friction(0.2, 0.2), dt=2.5e-3
    )
    assert run.status is Status.DONE
    l_cmd, law = worm.l0 * (1.0 - run.contraction), worm.segment_law
    height = values(run.length, l_cmd, law).height[:, 0]
    rise = height[-1] - height[0]
    assert rise > 3e-3
    assert_allclose(run.joints[-1, :, 1] - run.joints[0, :, 1], rise, rtol=1e-3)
    of_spring = np.diff(values(run.length, l_cmd, law).energy.sum(axis=1)).sum()
    assert_allclose(run.work_contract - of_spring, 0.07 * 9.81 * rise, rtol=2e-3)
    end = run.steps[-1][-1].end
    opening = (end.apex_velocity[0, 1] - end.apex_velocity[0, 0])[1] / 2.0
    assert_allclose(opening, (height[-1] - height[-2]) / 2.5e-3, rtol=1e-9)


@pytest.mark.parametrize("what", ["inertia", "friction"])
def test_work_of_the_command_on_the_apexes_of_held_joints(law_worm: Linkage, what: str) -> None:
    """In the air it becomes kinetic energy; a tilted segment, pressed on the ground, rubs along it."""
    worm, tilt = Linkage(segments=1, mass=0.07, segment=law_worm.segment), 0.3 * (what == "friction")
    along = worm.l0 / 2.0 * np.array([np.cos(tilt), np.sin(tilt)])
    height = worm.rest_half_height[0] * np.cos(tilt) + (what == "inertia")
    run = linkage.simulate(
        worm,
        lambda t: np.array([0.1 * t**2]),
        duration=0.5,
        dt=1e-3,
        friction=Friction(0.3, 0.3),
        gravity=0.0 if what == "inertia" else 9.81,
        start=np.array([-along, along]) + np.array([0.0, height]),
        held=np.ones((2, 2), dtype=bool),
        settle=False,
    )
    ledger = run.ledger
    assert run.status is Status.DONE
    on_apexes = ledger.work_contract.sum() - ledger.elastic.sum()
    stored = {"inertia": ledger.kinetic, "friction": ledger.penetration + ledger.friction_loss}[what].sum()
    assert stored > 5e-8
    assert_allclose(on_apexes, stored, rtol=0.05)
    assert abs(ledger.numerical_loss.sum()) < 0.02 * on_apexes
    if what == "friction":
        assert ledger.friction_loss.sum() > 0.05 * on_apexes


def test_first_order_displacement_of_the_apexes_has_the_command(crawls: list[linkage.Run]) -> None:
    """Its error falls with the square of the time step; without the command it would fall with the step itself."""
    errors = []
    for run in crawls[1:]:
        step = run.steps[round(0.8 / run.dt)]
        terms = _Terms(_stacked(step), run.worm, run.ground, run.gravity, True)
        errors.append(np.abs(terms.dx - terms.first_order).max())
        assert np.abs(terms.commanded).max() > 10.0 * errors[-1]
    assert errors[1] < 0.35 * errors[0]


def test_the_integrator_is_of_first_order(law_worm: Linkage) -> None:
    """A bent worm in the air, with a command that moves the apexes."""
    start = law_worm.rest() + np.column_stack([np.zeros(N + 1), 1.0 + 0.02 * np.sin(np.arange(N + 1))])
    ends = []
    for dt in (4e-3, 2e-3, 1e-3, 5e-4):
        run = linkage.simulate(law_worm, crawling, duration=0.2, dt=dt, gravity=0.0, start=start, settle=False)
        assert run.ledger.balance_error < 1e-12
        assert_allclose(run.com[-1], run.com[0], atol=1e-12)
        ends.append(run.joints[-1])
    steps = [np.abs(fine - coarse).max() for coarse, fine in pairwise(ends)]
    assert_allclose(np.log2(np.array(steps[:-1]) / steps[1:]), 1.0, atol=0.2)


def test_the_distance_converges_with_the_time_step(crawls: list[linkage.Run]) -> None:
    coarse, middle, fine = (run.distance for run in crawls)
    assert fine > 0.02
    assert_allclose([coarse, middle], fine, rtol=0.01)


def written(folder: Path, content: object) -> Path:
    """Write the file of a segment law and return its path."""
    path = folder / "law.json"
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def test_a_worm_stands_on_the_radius_of_the_network(law_content: dict, tmp_path: Path) -> None:
    """The rest radius in the file may be 24 um smaller; the worm must not start inside the ground."""
    worm = Linkage(segments=N, mass=0.07, segment=written(tmp_path, law_content | {"rest_radius_m": 0.05 - 24e-6}))
    run = linkage.simulate(worm, lambda t: np.zeros(N), duration=0.05)
    assert run.status is Status.DONE
    assert_allclose(run.normal_load[0].sum(), 0.07 * 9.81, rtol=1e-9)
    assert_allclose(run.normal_load[-1].sum(), 0.07 * 9.81, rtol=1e-6)


@pytest.mark.parametrize("way", ["command", "force"])
def test_a_run_stops_outside_the_domain(law_worm: Linkage, way: str) -> None:
    pull = np.zeros((N + 1, 2))
    pull[[0, -1], 0] = -6.0, 6.0
    run = linkage.simulate(
        law_worm,
        lambda t: np.full(N, 0.5 * t if way == "command" else 0.0),
        duration=2.0,
        external_force=(lambda t: 0.0 * pull) if way == "command" else (lambda t: t * pull),
    )
    assert run.status is Status.OUTSIDE
    assert "left the domain of the segment law" in run.stop.sentence
    assert run.contraction.max() < 0.35 + 1e-9
    assert run.length.max() < 1.25 * L0
    assert 0.3 < run.stop.time < 1.6
    start = law_worm.rest() * [1.3, 1.0] + [0.0, 0.1]
    with pytest.raises(
        ValueError, match=r"is 0.208 m long, must lie between 0.088 and 0.2 m, the domain of the segment"
    ):
        linkage.simulate(law_worm, lambda t: np.zeros(N), start=start)


def test_sizes_follow_from_the_law(law_worm: Linkage, law_file: Path) -> None:
    assert law_worm.length == N * L0
    assert_array_equal(law_worm.half_height, 0.05)
    assert_array_equal(law_worm.k_spring, 13.0)
    assert_array_equal(law_worm.k_apex, 0.0)
    same = Linkage(segments=N, length=N * L0, half_height=0.05, k_spring=13.0, k_apex=0.0, segment=str(law_file))
    assert same.length == law_worm.length
    assert pickle.loads(pickle.dumps(law_worm)).segment.contains(np.array([L0]), np.zeros(1))
    assert law_worm.with_changes(mass=0.2).segment is law_worm.segment
    for given, sentence in (
        ({"length": 0.7}, "length: got 0.7, must be left out or be 0.64 m, 4 times the rest length in the file"),
        ({"half_height": 0.06}, "half_height: got .*, must be left out or be 0.05 m, the radius at rest in the file"),
        ({"k_spring": 14.0}, "k_spring: got .*, must be left out or be 13 N, the stiffness in the file"),
        ({"k_apex": 0.2}, "k_apex: got .*, must be left out or be 0: only a rhombus has apex hinges"),
    ):
        with pytest.raises(ValueError, match=sentence):
            Linkage(segments=N, segment=law_file, **given)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"kind": "worm3d friction"}, "kind: got 'worm3d friction', must be 'worm3d segment law'; write the file with"),
        ({"version": 2}, "version: got 2, must be 1"),
        ({"stiffness_N": -13.0}, "stiffness: got -13.0 N, must be finite and above 0"),
        ({"rest_length_m": "long"}, "rest_length: got 'long' m, must be"),
        ({"rest_radius_m": 50.0}, "rest_radius_m: got 50 m, but the network has 0.05.* m at rest; check the units"),
        ({"energy": {"sizes": [2, 6, 6, 1], "weights": [0.0] * 66}}, r"energy: got shape \(66,\), must be \(67,\)"),
        ({"radius": {"sizes": [2, 6, 1]}}, "there is no key 'radius.weights'"),
        (
            {"radius": {"sizes": [2, 6, 1], "weights": [float("nan")] * 25}},
            "radius: got nan, every value must be finite",
        ),
        ({"domain": {"length_m": [0.2, 0.1], "contraction": [0.0, 0.3]}}, "domain.length_m: got 0.2 to 0.1 m, must be"),
        (
            {"domain": {"length_m": [0.1, 0.2], "contraction": [0.1, 0.3]}},
            "domain.contraction: got 0.1 to 0.3, must be",
        ),
        (
            {"domain": {"length_m": [0.1, 0.2], "contraction": [0.0, 0.3], "shortest_m": [0.1, 0.13]}},
            r"longest: got shape \(1,\), must be \(2,\)",
        ),
        (
            {
                "domain": {
                    "length_m": [0.1, 0.2],
                    "contraction": [0.0, 0.3],
                    "shortest_m": [0.1, 0.13],
                    "longest_m": [0.2, 0.2],
                }
            },
            "domain.shortest_m, domain.longest_m: must include the free length at each contraction",
        ),
        ({"scales": {}}, "there is no key 'scales.x_mid'"),
    ],
)
def test_bad_files(law_content: dict, tmp_path: Path, change: dict, sentence: str) -> None:
    with pytest.raises(ValueError, match=f"segment law 'law.json': {sentence}"):
        Linkage(segment=written(tmp_path, law_content | change))


@pytest.mark.parametrize(
    ("text", "sentence"),
    [("{", "must be JSON: Expecting"), ("[]", "there is no key 'kind'"), ("{}", "there is no key 'kind'")],
)
def test_files_that_are_no_laws(tmp_path: Path, text: str, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        Linkage(segment=written(tmp_path, text))


def test_segments_that_are_no_laws() -> None:
    with pytest.raises(ValueError, match=r"segment: must be 'rhombus', 'hydrostat' or a file .* there is no such file"):
        Linkage(segment="hydrostt")
    with pytest.raises(ValueError, match="segment: got int, must be 'rhombus', 'hydrostat', the path of a file, or"):
        Linkage(segment=3)
