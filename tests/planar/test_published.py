"""The published program against the figures that it printed, and against its own equations."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from planar import published
from planar.metrics import p12_cost_of_transport
from planar.published import Parameters
from planar.published_worm import NET_HALF_BANDWIDTH, Net
from planar.status import Status

# n, reported distance [m], work [J], total cost of transport [J/m], true displacement [m]; T_wave = 2 s
PRINTED = [
    (3, 0.176235, 1.062124, 6.0267, 0.332435),
    (4, 0.529555, 2.017679, 3.8101, 0.852656),
    (5, 0.556600, 1.876227, 3.3709, 1.078139),
    (6, 0.739210, 4.547915, 6.1524, 1.250650),
    (7, 0.534746, 2.023594, 3.7842, 1.021245),
]


@pytest.mark.parametrize(("n", "distance", "work", "cot", "displacement"), PRINTED)
def test_printed_results(n: int, distance: float, work: float, cot: float, displacement: float) -> None:
    run = published.simulate(n=n, T_wave=2.0)
    assert_allclose(run.reported_distance, distance, rtol=0, atol=1.5e-6)
    assert_allclose(run.work, work, rtol=0, atol=1.5e-6)
    assert_allclose(run.total_cot, cot, rtol=0, atol=1e-4)
    assert_allclose(run.true_displacement, displacement, rtol=0, atol=1.5e-6)
    assert run.q.shape == (1001, 3 * n + 1, 2)
    assert run.status is Status.DONE
    assert run.unconverged_steps == 0


@pytest.fixture
def net() -> Net:
    return Net(3, Parameters())


def test_p7_derivatives_against_central_differences(net: Net, dense_hessian) -> None:
    q = net.rest.ravel() + 0.02 * np.random.default_rng(0).standard_normal(net.rest.size)
    gradient, hessian = net.p7_gradient_and_band(q)[0], dense_hessian(net, q)
    assert_allclose(net.p7_gradient(q.reshape(1, -1, 2)).ravel(), gradient, rtol=1e-12, atol=1e-9)
    step = 1e-6
    for i in range(q.size):
        e = step * np.eye(q.size)[i]
        slope = (net.p7_energy((q + e).reshape(-1, 2)) - net.p7_energy((q - e).reshape(-1, 2))) / (2 * step)
        column = (net.p7_gradient_and_band(q + e)[0] - net.p7_gradient_and_band(q - e)[0]) / (2 * step)
        assert_allclose(gradient[i], slope, rtol=1e-6, atol=1e-4)
        assert_allclose(hessian[:, i], column, rtol=1e-6, atol=1e-2)


def test_p7_of_one_stretched_spring() -> None:
    """E = k l0/2 (1 - l/l0)^2: the horizontal spring stretched by a tenth of l0, the links of no stiffness."""
    net = Net(1, Parameters(length=0.5, k_link=1e-99, mass=1.0, connector_mass=0.1))
    x = net.rest.copy()
    x[3, 0] *= 1.1
    assert_allclose(net.p7_energy(x), 13.0 * 0.5 / 2 * 0.01, rtol=1e-12)


def test_newton_leaves_no_residual_on_the_free_coordinates() -> None:
    run = published.simulate(n=4, steps=50, parameters=Parameters(tolerance=1e-10))
    net, dt = run.net, run.dt
    u = np.concatenate([np.zeros((1, *run.q.shape[1:])), (run.q[1:] - run.start) / dt])
    gradient = net.p7_gradient(run.q[1:])
    inertia = net.mass[:, None] / dt * (u[1:] - u[:-1])
    residual = inertia - gradient - run.contraction_force - run.friction_force
    assert np.abs(residual[..., 0]).max() < 1e-9  # x is free everywhere


def test_friction_acts_against_the_motion_with_its_own_coefficient() -> None:
    """(P10): forward motion meets 0.03 N, backward motion 0.20 N, on the main nodes only."""
    run = published.simulate(steps=300)
    v = (run.q[1:-1] - run.start[:-1])[:, run.net.main, 0] / run.dt
    force = run.friction_force[1:, run.net.main, 0] / (run.net.mass[run.net.main] * 9.8)
    assert_allclose(force[v > 1e-6], -0.03, rtol=1e-12)
    assert_allclose(force[v < -1e-6], 0.20, rtol=1e-12)
    assert (v > 1e-6).any()
    assert (v < -1e-6).any()
    connectors = np.concatenate([run.net.top, run.net.bottom])
    assert_array_equal(run.friction_force[:, connectors], 0.0)


def test_swapped_friction_turns_the_worm_round() -> None:
    backward = published.simulate(parameters=Parameters(mu_forward=0.20, mu_backward=0.03))
    assert backward.true_displacement < -0.5


def test_active_segments_shorten_and_widen() -> None:
    run = published.simulate()
    active, passive = run.activation > 0.99, run.activation == 0.0
    length = np.diff(run.q[1:, run.net.main, 0], axis=1)
    height = run.q[1:, run.net.top, 1] - run.q[1:, run.net.bottom, 1]
    assert length[active].mean() < 0.8 * length[passive].mean()
    assert height[active].mean() > 1.2 * height[passive].mean()


def test_energy_ledger_closes_for_both_signs() -> None:
    for sign in (-1.0, 1.0):
        run = published.simulate(steps=200, parameters=Parameters(elastic_sign=sign))
        assert run.energy_balance_error < 1e-9


def test_reported_centre_of_mass_is_the_slip_and_not_the_mean_of_x() -> None:
    run = published.simulate(n=3, steps=20)
    flat = run.q.reshape(21, -1)
    assert_allclose(run.reported_com, (flat[:, 0] + flat[:, 3] + flat[:, 6] + flat[:, 9]) / 4, rtol=1e-12)


def test_cumulative_cost_sums_the_magnitude_of_far_steps() -> None:
    run = published.simulate(n=3, steps=30)
    total = 0.0
    for work, dx in zip(run.work_contract, np.diff(run.reported_com), strict=True):
        total += abs(work / dx) if abs(dx) > 1e-6 else 0.0
    assert_allclose(run.cumulative_cot[-1], total, rtol=1e-12)


def test_any_callable_is_a_gait() -> None:
    run = published.simulate(n=2, steps=5, activation=lambda t: np.array([t, 0.0]))
    assert_allclose(run.activation[:, 0], [0.01, 0.02, 0.03, 0.04, 0.05])
    assert_allclose(run.contraction_force[:, run.net.bottom[0], 1], 10.0 * run.activation[:, 0])
    assert_allclose(run.contraction_force[:, run.net.top[0], 1], -10.0 * run.activation[:, 0])


def test_observer_stops_the_run_and_keeps_it() -> None:
    seen: list[int] = []

    def observe(step: int) -> bool:
        seen.append(step)
        return step < 7

    run = published.simulate(n=3, steps=50, observer=observe)
    assert seen == [1, 2, 3, 4, 5, 6, 7]
    assert run.status is Status.INTERRUPTED
    assert run.q.shape == (8, 10, 2)
    assert_array_equal(run.q, published.simulate(n=3, steps=7).q)


@pytest.mark.parametrize("broken", [np.array([0.0, 0.0, np.nan]), np.zeros(4)])
def test_a_gait_that_breaks_stops_the_run_and_says_where(broken: np.ndarray) -> None:
    run = published.simulate(n=3, steps=50, activation=lambda t: np.full(3, 0.1) if t < 0.045 else broken)
    assert run.status is Status.BAD_COMMAND
    assert run.status.diverged
    assert len(run.time) == 5
    assert np.isfinite(run.q).all()
    assert "step 5, t = 0.05 s" in run.stop.sentence


def test_the_gait_is_asked_once_a_step() -> None:
    """What a gait with a memory returned is what was applied and what is stored."""
    asked: list[float] = []

    def gait(t: float) -> np.ndarray:
        asked.append(t)
        return np.full(2, float(len(asked)))

    run = published.simulate(n=2, steps=3, activation=gait)
    assert_allclose(asked[-3:], [0.01, 0.02, 0.03])
    assert_allclose(run.contraction_force[:, run.net.bottom[0], 1], 10.0 * run.activation[:, 0])


def test_a_singular_matrix_has_a_name(monkeypatch: pytest.MonkeyPatch) -> None:
    held = np.zeros(20, dtype=bool)
    with pytest.raises(np.linalg.LinAlgError):
        published._solve_free(np.zeros((2 * NET_HALF_BANDWIDTH + 1, 20)), np.ones(20), held, published._free_band(held))
    solve, calls = published._solve_free, []

    def singular_in_the_end(J: np.ndarray, *arguments: np.ndarray) -> np.ndarray:
        calls.append(1)
        return solve(np.zeros_like(J) if len(calls) > 25 else J, *arguments)

    monkeypatch.setattr(published, "_solve_free", singular_in_the_end)
    run = published.simulate(n=3, steps=50)
    assert run.status is Status.SINGULAR
    assert 1 < len(run.time) < 20
    assert run.stop.residual > 0.0


def test_a_fast_overflow_is_named_with_its_segment() -> None:
    run = published.simulate(n=3, steps=50, activation=lambda t: np.array([0.0, 0.0, 1e200 if t > 0.045 else 0.1]))
    assert run.status is Status.NOT_FINITE
    assert np.isfinite(run.q).all()
    assert run.stop.segment == 2


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ({"n": 0}, "n: got 0, must be a whole number of at least 1"),
        ({"steps": 5.5}, "steps: got 5.5, must be a whole number of at least 1"),
        ({"T_wave": -1.0}, "T_wave: got -1.0 s, must be finite and above 0"),
        ({"dt": float("nan")}, "dt: got nan s, must be finite and above 0"),
        ({"activation": lambda t: np.zeros(5)}, r"activation: got shape \(5,\), must be \(6,\)"),
    ],
)
def test_bad_arguments(arguments: dict, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        published.simulate(**arguments)


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"k_link": 0.0}, "k_link: got 0.0 N, must be finite and above 0"),
        ({"connector_mass": 1.0}, "connector_mass: got 1.0 kg, must lie between 0 and mass"),
        ({"elastic_sign": 0.5}, "elastic_sign: got 0.5, must be -1"),
        ({"mu_forward": float("nan")}, "mu_forward: got nan, must be finite and at least 0"),
        ({"gravity": float("inf")}, "gravity: got inf m/s.2, must be finite and at least 0"),
        ({"contraction_force": float("nan")}, "contraction_force: got nan N, must be finite"),
        ({"ground_clearance": -0.1}, "ground_clearance: got -0.1 m, must be finite and at least 0"),
        ({"max_iterations": 2.5}, "max_iterations: got 2.5, must be a whole number"),
        ({"normal_load": "none"}, "normal_load: got 'none', must be 'weight' or 'residual'"),
    ],
)
def test_bad_parameters(changes: dict, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        Parameters(**changes)


def test_cost_of_transport_of_each_step() -> None:
    com_x = np.array([0.0, 0.5, 0.5, 0.25])
    assert_allclose(p12_cost_of_transport(np.array([1.0, 1.0, 1.0]), com_x), [2.0, 0.0, -4.0])


def test_a_run_that_blows_up_is_not_called_done() -> None:
    """A heavy worm under the inverted elastic force grows exponentially until it overflows."""
    run = published.simulate(n=6, dt=0.001, steps=2000, parameters=Parameters(mass=1.0, connector_mass=0.1))
    assert run.status is Status.NOT_FINITE
    assert 0 < len(run.time) < 2000
    assert np.isfinite(run.q).all()


@pytest.mark.slow
def test_every_parameter_of_the_program_counts() -> None:
    """A parameter that is ignored leaves the run as it is."""
    changes = {
        "length": 1.1,
        "k_spring": 14.0,
        "k_link": 9e3,
        "mass": 2e-8,
        "connector_mass": 1e-9,
        "gravity": 5.0,
        "mu_forward": 0.05,
        "mu_backward": 0.1,
        "velocity_threshold": 0.05,
        "normal_load": "residual",
        "contraction_force": 9.0,
        "wavelength": 0.7,
        "ground_clearance": 0.01,
        "snap": False,
        "elastic_sign": 1.0,
        "rectified": False,
        "tolerance": 1e-3,
        "max_iterations": 2,
    }
    reference = published.simulate(steps=150)
    for name, value in changes.items():
        changed = published.simulate(steps=150, parameters=Parameters(**{name: value}))
        assert not np.array_equal(changed.q, reference.q), name
    few = published.simulate(steps=150, parameters=Parameters(max_iterations=2))
    assert few.newton_iterations.max() <= 4  # predictor and corrector
    assert few.unconverged_steps > 10


def test_residual_loads_are_the_vertical_reactions() -> None:
    """(P9): with N = |r_y| the friction is far above the weight's, and on nodes that carry nothing it is zero."""
    run = published.simulate(steps=100, parameters=Parameters(normal_load="residual"))
    weight = run.net.mass[run.net.main] * 9.8
    assert np.abs(run.friction_force[:, run.net.main, 0]).max() > 1e3 * weight.max()


def test_centre_of_mass_weighs_the_nodes() -> None:
    run = published.simulate(n=3, steps=20, parameters=Parameters(connector_mass=5e-9))
    expected = (run.q * run.net.mass[:, None]).sum(axis=1) / run.net.mass.sum()
    assert_allclose(run.com, expected, rtol=1e-12, atol=1e-15)
    assert np.abs(run.com - run.q.mean(axis=1)).max() > 1e-5


def test_inside_out_segments_are_counted() -> None:
    assert published.simulate(steps=200).inverted_steps == 0
    assert published.simulate(steps=200, parameters=Parameters(elastic_sign=1.0)).inverted_steps > 50


def test_work_by_p11_counts_the_snaps() -> None:
    run = published.simulate()
    assert_allclose(run.work_contract.sum(), -0.899385, atol=2e-6)
    assert_allclose(run.work_contract_p11.sum(), -1.142440, atol=2e-6)


def test_cost_grows_linearly_with_the_segments() -> None:
    """The solver is banded: the work arrays, which set its cost, are."""
    small, large = (Net(n, Parameters()) for n in (10, 100))
    sizes = [net.p7_gradient_and_band(net.rest.ravel())[1].size for net in (small, large)]
    assert sizes[1] / sizes[0] == pytest.approx(602 / 62)


def test_arrays_of_a_run_are_read_only() -> None:
    run = published.simulate(n=2, steps=2)
    for name in ("q", "time", "activation", "residual", "newton_iterations", "start"):
        with pytest.raises(ValueError, match="read-only"):
            getattr(run, name)[0] = 0
