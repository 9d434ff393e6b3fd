"""`worm3d law`: laws of segments that are known in closed form, of the load frame, and what is refused."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.interpolate import PchipInterpolator
from scipy.io import netcdf_file
from scipy.optimize import brentq

from scenes.language.errors import SceneError
from scenes.language.loader import SHIPPED_FOLDER
from scenes.studies.law import bench, command, fitting, law, table
from scenes.studies.law.fitting import Fit
from scenes.studies.law.free import start
from scenes.studies.law.law import Law, content, make
from scenes.studies.law.prepared import Prepared, prepared
from scenes.studies.law.surface import Spline
from scenes.studies.law.table import Table
from worm3d.physics.hysteresis import Hysteresis, Jenkins
from worm3d.physics.segment_laws.learned import Learned
from worm3d.physics.segment_laws.network import ENERGY_SIZES
from worm3d.physics.worm import Worm
from worm3d.running.segment_law import stretch_segment

DATA = SHIPPED_FOLDER / "data" / "mesh_segment_load_frame.csv"
HOOP = ("rest_length_m=0.1122", "rest_radius_m=0.16", "cable_per_diameter=3")


EVEN = np.array([0.7548776662466927, 0.5698402909980532])


@dataclass(frozen=True)
class Membrane:
    """Closed form of a pressurised segment: force and volume are derivatives of one potential.

    Pi(l, p) = W(l) - p V0(l) - p^2 C(l)/2, with the volume V0 of a braided tube, a rubber W that stiffens, and a radial
    compliance C. Then F = dPi/dl and V = -dPi/dp.
    """

    rest: float = 0.06
    fibre: float = 0.075
    turns: float = 0.3
    rubber: float = 30.0
    soft: float = 3e-9
    most: float = 4500.0

    def force(self, length: np.ndarray, p: np.ndarray) -> np.ndarray:
        strain, k = np.log(length / self.rest), 1.0 / (4.0 * np.pi * self.turns**2)
        rubber = self.rubber * (strain + 6.0 * strain**3 + 0.3 * strain**2)
        return np.asarray(
            rubber - p * k * (self.fibre**2 - 3.0 * length**2) + 0.75 * p**2 * self.compliance(length) / self.rest
        )

    def volume(self, length: np.ndarray, p: np.ndarray) -> np.ndarray:
        return length * (self.fibre**2 - length**2) / (4.0 * np.pi * self.turns**2) + p * self.compliance(length)

    def compliance(self, length: np.ndarray) -> np.ndarray:
        return np.asarray(self.soft * np.exp(-1.5 * (length / self.rest - 1.0)))

    def radius(self, length: np.ndarray, p: np.ndarray) -> np.ndarray:
        return (
            np.sqrt(self.fibre**2 - length**2) / (2.0 * np.pi * self.turns) + 5e-3 * p / self.most * length / self.rest
        )

    def free(self, p: float) -> float:
        return float(brentq(lambda length: self.force(np.array(length), np.array(p)), 0.3 * self.rest, 1.2 * self.rest))

    def points(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Lengths and pressures that fill 0.62 to 1.12 rest lengths and all pressures evenly."""
        unit = (0.5 + np.arange(count)[:, None] * EVEN) % 1.0
        return self.rest * (0.62 + 0.5 * unit[:, 0]), self.most * unit[:, 1]

    def table(self, count: int, noise: float = 0.0) -> Table:
        length, p = self.points(count)
        rng = np.random.default_rng(1)
        columns = {"force": self.force(length, p), "radius": self.radius(length, p), "volume": self.volume(length, p)}
        noisy = {name: v + noise * v.std() * rng.standard_normal(count) for name, v in columns.items()}
        facts = {"rest_length_m": self.rest, "plate_radius_m": 0.02}
        return Table({"length": length, "pressure": p, **noisy}, facts, "a membrane", "0" * 64, {}, False)


OTHER = replace(Membrane(), rest=0.1, fibre=0.14, turns=0.5, rubber=80.0, soft=1e-8, most=8000.0)
"""A segment of another geometry and rubber."""


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def quick(given: Prepared | Table, monkeypatch: pytest.MonkeyPatch, members: int = 1) -> Law:
    """Return a law from few fits."""
    for name, value in {"PENALTIES": (1e-5, 1e-7), "MEMBERS": members, "MEDIAN_POINTS": 200}.items():
        monkeypatch.setattr(law, name, value)
    return make(given if isinstance(given, Prepared) else prepared(given), seed=0)


@pytest.fixture(scope="module")
def membrane_law() -> Law:
    with pytest.MonkeyPatch.context() as patch:
        return quick(Membrane().table(100), patch, members=2)


def assert_close_to(fit: Fit, truth: Membrane, *, all_forces: float, band: float) -> None:
    """Compare a law with the closed form at states that it has not seen."""
    length, p = (each[200:] for each in truth.points(800))
    force = truth.force(length, p)
    miss, near = fit.force(length, p) - force, np.abs(force) < law.BAND * np.abs(force).max()
    assert rms(miss) < all_forces * rms(force)
    assert rms(miss[near]) < band * rms(force[near])
    assert rms(fit.volume(length, p) - truth.volume(length, p)) < all_forces * rms(truth.volume(length, p))
    assert rms(fit.outer_radius(length, p) - truth.radius(length, p)) < 1e-4
    pressures = np.linspace(0.0, truth.most, 30)
    free = [truth.free(each) for each in pressures]
    assert_allclose(truth.rest * (1.0 - fit.free.contraction(pressures)), free, rtol=0, atol=1e-3 * truth.rest)


@pytest.mark.slow
def test_a_law_is_close_to_a_membrane_in_closed_form(membrane_law: Law) -> None:
    assert_close_to(membrane_law.fit, Membrane(), all_forces=0.003, band=0.016)
    errors = membrane_law.errors()
    assert errors["held_out"] == 20
    assert errors["force_rms_relative"] < 0.003  # type: ignore[operator]


def test_falling_penalties_keep_a_fit_of_few_states_free_of_creases() -> None:
    """From the same start, a fit with the last penalty alone has an error of 7 % between the states."""
    truth, rng = Membrane(), np.random.default_rng(0)
    states = prepared(truth.table(50)).states
    free = start(states, truth.rest)
    length, p = (each[200:] for each in truth.points(800))
    force = truth.force(length, p)
    for _ in range(2):
        begin = Fit(law._scales(states, free), fitting.drawn(ENERGY_SIZES, rng), np.zeros(25), free)
        found = law._path(fitting.fit_energy, begin, states, law.PENALTIES)
        assert rms(found[-1].force(length, p) - force) < 0.002 * rms(force)
    alone = fitting.fit_energy(begin, states, law.PENALTIES[-1])
    assert rms(alone.force(length, p) - force) > 0.02 * rms(force)


def test_a_vanished_step_of_the_free_contraction_comes_back() -> None:
    """The force has no slope over the logarithm of such a step, only the penalty has one."""
    states = prepared(Membrane().table(60)).states
    free = start(states, 0.06)
    steps = np.array(free.log_steps)
    steps[1] = -20.0
    weights = fitting.drawn(ENERGY_SIZES, np.random.default_rng(0))
    begin = Fit(law._scales(states, free), weights, np.zeros(25), replace(free, log_steps=steps))
    found = law._path(fitting.fit_energy, begin, states, law.PENALTIES)[-1]
    assert_allclose(found.free.log_steps[1], found.free.log_steps[[0, 2]].mean(), atol=1.0)
    assert rms(found.force(states.length, states.input) - states.force) < 0.002 * rms(states.force)


@pytest.mark.slow
@pytest.mark.parametrize("truth", [Membrane(), OTHER])
@pytest.mark.parametrize(("count", "all_forces", "band"), [(100, 0.003, 0.016), (60, 0.01, 0.03)])
def test_segments_of_other_size_and_rubber_need_no_tuning(
    truth: Membrane, count: int, all_forces: float, band: float
) -> None:
    found = make(prepared(truth.table(count)), seed=0)
    assert_close_to(found.fit, truth, all_forces=all_forces, band=band)
    assert len(found.members) == 4
    assert not list(command.warnings(found))


@pytest.mark.slow
def test_noise_is_smoothed() -> None:
    truth = Membrane()
    found = make(prepared(truth.table(100, noise=0.01)), seed=0)
    length, p = (each[:500] for each in truth.points(600))
    inside = (np.abs(length / truth.rest - 0.87) < 0.22) & (np.abs(p / truth.most - 0.5) < 0.45)
    length, p = length[inside], p[inside]
    assert rms(found.fit.force(length, p) - truth.force(length, p)) < 0.012 * rms(truth.force(length, p))
    assert found.penalty > 1e-7


def test_forces_are_the_gradient_of_one_energy(membrane_law: Law) -> None:
    """DF/dp = -dV/dl, and the force is 0 at the free length, also of a law with random weights."""
    rng, fit = np.random.default_rng(2), membrane_law.fit
    for each in (fit, replace(fit, energy=rng.standard_normal(67))):
        length, p = Membrane().points(50)
        p = np.clip(p, 100.0, 4400.0)
        across = (each.force(length, p + 1.0) - each.force(length, p - 1.0)) / 2.0
        along = (each.volume(length + 1e-6, p) - each.volume(length - 1e-6, p)) / 2e-6
        assert_allclose(across, -along, rtol=2e-4, atol=1e-5 * np.abs(along).max())
        free = each.free.rest_length * (1.0 - each.free.contraction(p))
        assert_allclose(each.force(free, p), 0.0, atol=1e-9)
        assert_allclose(each.volume(free, p), each.free.volume(p), rtol=1e-12)


def test_the_jacobian_against_central_differences() -> None:
    states = prepared(Membrane().table(60)).states
    free = start(states, 0.06)
    scales = law._scales(states, free)
    rng = np.random.default_rng(0)
    begin = Fit(scales, rng.standard_normal(67), np.zeros(25), free)
    problem = fitting._EnergyProblem(begin, states, 1e-3)
    at = np.concatenate([begin.energy, free.log_steps, free.volumes])
    jacobian = problem.jacobian(at)
    for k in range(len(at)):
        step = np.zeros(len(at))
        step[k] = 1e-6 * max(abs(at[k]), 1e-6)
        change = (problem.residuals(at + step) - problem.residuals(at - step)) / (2.0 * step[k])
        assert_allclose(jacobian[:, k], change, rtol=1e-5, atol=1e-5 * max(np.abs(change).max(), 1e-3))


def network(sizes: list[int], weights: list[float], x: np.ndarray) -> np.ndarray:
    """Return the output of a network by the rule of the file format, independent of CasADi."""
    used, values = 0, x
    for layer in range(len(sizes) - 1):
        rows, columns = sizes[layer + 1], sizes[layer]
        matrix = np.reshape(weights[used : used + rows * columns], (rows, columns))
        used += rows * columns
        values = matrix @ values + np.array(weights[used : used + rows])[:, None]
        used += rows
        if layer < len(sizes) - 2:
            values = values / np.sqrt(1.0 + values**2)
    assert used == len(weights)
    return np.asarray(values[0])


def test_the_file_has_the_law(membrane_law: Law) -> None:
    """Energy, radius and volume from the numbers in the file give the forces of the fit."""
    data = json.loads(json.dumps(content(membrane_law)))
    assert (data["kind"], data["version"], data["input"]["unit"]) == ("worm3d segment law", 1, "Pa")
    contraction, value = np.array(data["input"]["contraction"]), np.array(data["input"]["value"])
    assert contraction[0] == value[0] == 0.0
    assert (np.diff(contraction) > 0.0).all()
    l0, s = data["rest_length_m"], data["scales"]
    pressure_of = PchipInterpolator(contraction, value)

    def inputs(length: np.ndarray, a: np.ndarray) -> np.ndarray:
        return np.array([(length / l0 - s["x_mid"]) / s["x_half"], (a - s["y_mid"]) / s["y_half"]])

    def potential(length: np.ndarray, a: np.ndarray) -> np.ndarray:
        learned = network(data["energy"]["sizes"], data["energy"]["weights"], inputs(length, a))
        strain = 1.0 - length / (l0 * (1.0 - a))
        return np.asarray(2.0 * strain**2 * (data["stiffness_N"] * l0 / 4.0 + s["energy_J"] * learned))

    length = np.linspace(0.04, 0.065, 40)
    a = np.linspace(0.005, data["domain"]["contraction"][1] - 0.005, 40)
    p = pressure_of(a)
    force = (potential(length + 1e-7, a) - potential(length - 1e-7, a)) / 2e-7
    assert_allclose(force, membrane_law.fit.force(length, p), rtol=1e-3, atol=5e-3)
    volume = PchipInterpolator(contraction, data["free_volume_m3"])(a)
    volume -= (potential(length, a + 1e-6) - potential(length, a - 1e-6)) / 2e-6 / pressure_of.derivative()(a)
    assert_allclose(volume, membrane_law.fit.volume(length, p), rtol=3e-3)
    radius = s["radius_mid_m"] + s["radius_m"] * network(
        data["radius"]["sizes"], data["radius"]["weights"], inputs(length, a)
    )
    assert_allclose(radius, membrane_law.fit.outer_radius(length, p), rtol=1e-5)
    assert 0.0 < data["chamber_offset_m"] < radius.min()
    assert data["domain"]["length_m"][0] < l0 < data["domain"]["length_m"][1]
    assert len(data["ensemble"]) == 2


def test_the_domain_has_the_states_and_ends_where_the_laws_differ(membrane_law: Law) -> None:
    """Forces are differences of energies from the numbers in the file."""
    data = content(membrane_law)
    most, l0, s = data["domain"]["contraction"][1], data["rest_length_m"], data["scales"]
    at = np.linspace(0.0, most, len(data["domain"]["shortest_m"]))
    low, high = np.array(data["domain"]["shortest_m"]), np.array(data["domain"]["longest_m"])
    states = membrane_law.states
    contraction = membrane_law.fit.free.contraction(states.input)
    inside = (states.length >= np.interp(contraction, at, low)) & (states.length <= np.interp(contraction, at, high))
    assert inside.mean() > 0.9

    def apart(length: np.ndarray) -> np.ndarray:
        inputs = [np.array([(x / l0 - s["x_mid"]) / s["x_half"], (at - s["y_mid"]) / s["y_half"]]) for x in
                  (length + 1e-7, length - 1e-7)]  # fmt: skip
        strain = [1.0 - x / (l0 * (1.0 - at)) for x in (length + 1e-7, length - 1e-7)]
        forces = []
        for weights in (data["energy"]["weights"], *(each["energy"] for each in data["ensemble"])):
            above, below = (
                own**2 * (data["stiffness_N"] * l0 / 4.0 + s["energy_J"] * network([2, 6, 6, 1], weights, x))
                for own, x in zip(strain, inputs, strict=True)
            )
            forces.append((above - below) / 1e-7)
        return np.asarray(np.std(forces, axis=0))

    for end in (low, high):
        assert (apart(end) <= 1.01 * data["spread"]["force_N"]).all()


def test_a_smaller_limit_of_the_spread_makes_the_domain_smaller(
    membrane_law: Law, monkeypatch: pytest.MonkeyPatch
) -> None:
    of = Learned(content=json.dumps(content(membrane_law)))
    monkeypatch.setattr(law, "SPREAD_RATIO", 0.0)
    spans = []
    for share in (1.0, 1e-4, 0.0):
        monkeypatch.setattr(law, "KNOWN_FORCE", share)
        low, high = law.region(membrane_law, of)
        spans.append(high - low)
    assert (spans[1] <= spans[0]).all()
    assert spans[1].sum() < 0.9 * spans[0].sum()
    assert_allclose(spans[2], 0.0, atol=1e-12)
    shortest, longest = membrane_law.states.length.min(), membrane_law.states.length.max()
    assert spans[0].max() <= longest - shortest


def test_the_file_and_the_report_have_the_stiffness_of_contacts(membrane_law: Law) -> None:
    prepared = membrane_law.prepared
    assert content(membrane_law)["contact_stiffness_N_m"] is None
    known = replace(prepared.table, facts={**prepared.table.facts, "contact_stiffness_N_m": 123.4})
    found = replace(membrane_law, prepared=replace(prepared, table=known))
    assert content(found)["contact_stiffness_N_m"] == 123.4
    told = [each for each in command._sentences(found) if "friction.contact_stiffness_N_m = 123" in each]
    assert len(told) == 1


def test_members_disagree_outside_the_states(membrane_law: Law) -> None:
    ensemble = (membrane_law.fit, *membrane_law.members)

    def apart(length: float) -> float:
        at = np.full(20, length), np.linspace(500.0, 4500.0, 20)
        return float(np.median(np.std([each.force(*at) for each in ensemble], axis=0)))

    assert apart(0.05) < membrane_law.spread()["force_N"]
    assert apart(0.02) > 5.0 * apart(0.05)


def test_held_out_states_are_within_the_others(membrane_law: Law) -> None:
    states, held = membrane_law.states, membrane_law.held_out
    for each in (states.length, states.input):
        assert each[~held].min() < each[held].min()
        assert each[~held].max() > each[held].max()


def test_bending_stiffness_from_bent_states(membrane_law: Law) -> None:
    """Moments from two chambers and a known polynomial give the polynomial back."""
    fit, offset = membrane_law.fit, 0.01
    length, p = Membrane().points(40)
    bend, s = np.linspace(0.05, 0.3, 40), membrane_law.fit.scales
    x, y = (length / s.rest_length - s.x_mid) / s.x_half, (fit.free.contraction(p) - s.y_mid) / s.y_half
    wanted = np.array([0.3, -0.1, 0.2, 0.05, 0.02, -0.04])
    extra = np.column_stack([np.ones(40), x, y, x * x, x * y, y * y]) @ wanted
    chambers = offset * (fit.force(length + offset * bend, p) - fit.force(length - offset * bend, p)) / 2.0
    bent = np.column_stack([length, p, bend, chambers + extra * bend])
    found, error = law._bending(replace(membrane_law.prepared, bent=bent), fit, offset)
    assert_allclose(found, wanted, atol=1e-9)
    assert error is not None
    assert error < 1e-9
    assert not membrane_law.bending.any()


@pytest.mark.parametrize("offset", [0.004, 0.009])
def test_the_offset_is_the_best_one_for_bent_states(membrane_law: Law, offset: float) -> None:
    """A positive moment holds a positive bend. Moments of two chambers alone give their offset back, and no m."""
    fit = membrane_law.fit
    length, p = Membrane().points(40)
    bend = np.linspace(0.05, 0.3, 40)
    moment = offset * (fit.force(length + offset * bend, p) - fit.force(length - offset * bend, p)) / 2.0
    assert np.mean(moment * bend) > 0.0
    prepared = replace(membrane_law.prepared, bent=np.column_stack([length, p, bend, moment]))
    found = law._offset(prepared, fit)
    assert_allclose(found, offset, rtol=1e-3)
    assert_allclose(law._bending(prepared, fit, offset)[0], 0.0, atol=1e-12)


def test_a_base_input_is_the_zero_of_the_contraction() -> None:
    """Without the states below a pressure, contractions are counted from the free length at this pressure."""
    membrane = Membrane()
    whole = prepared(membrane.table(90)).states
    kept = whole.part(whole.input >= 0.2 * membrane.most)
    at, some = kept.input.min(), np.array([0.5, 0.9]) * membrane.most
    above = start(kept, membrane.rest, from_least=True)
    assert above.rest_length == pytest.approx(membrane.free(at), rel=5e-3)
    assert above.contraction(np.array([at]))[0] == pytest.approx(0.0, abs=1e-12)
    exact = [membrane.free(each) for each in some]
    assert_allclose(above.rest_length * (1.0 - above.contraction(some)), exact, rtol=5e-3)


def test_rows_below_the_least_input_are_left_out(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    rows = [f"{0.05 + 1e-4 * k},{k - 20.0},{100.0 * k}" for k in range(60)]
    path.write_text("\n".join(["length_m,force_N,pressure_Pa", *rows]))
    found = table.load(path, (), ("least_input=1500",))
    assert found.input.min() == 1500.0
    assert found.left_out == {"an input below 1500": 15}
    assert table.load(path, (), ()).left_out == {}


@pytest.mark.slow
def test_an_input_that_lengthens_counts_from_its_greatest_value(monkeypatch: pytest.MonkeyPatch) -> None:
    """A bellows: F = k (length - l0 - c p), V = V0 + k c (length - l0) - ..., from one potential."""
    k, l0, c, most = 200.0, 0.05, 4e-6, 5000.0
    unit = (0.5 + np.arange(80)[:, None] * EVEN) % 1.0
    length, p = 0.045 + 0.03 * unit[:, 0], most * unit[:, 1]
    force = k * (length - l0 - c * p)
    columns = {
        "length": length,
        "pressure": p,
        "force": force,
        "radius": 0.02 + 0.0 * length,
        "volume": 1e-4 + k * c * (length - l0),
    }
    found = quick(Table(columns, {"rest_length_m": l0}, "", "", {}, False), monkeypatch)
    assert found.fit.free.lengthens
    assert_allclose(found.fit.free.rest_length, l0 + c * most, rtol=2e-3)
    assert rms(found.fit.force(length, p) - force) < 0.01 * rms(force)
    data = content(found)
    assert data["input"]["counted_down_from"] == p.max()
    assert (np.diff(data["input"]["contraction"]) > 0.0).all()


# ---- measured cycles


@pytest.fixture(scope="module")
def cycle() -> bench.Cycle:
    record = bench.record_of(table.load(DATA, given=HOOP))
    assert record is not None
    return bench.fit_cycle(record)


def test_friction_is_that_of_the_plant() -> None:
    """Elements, coordinate and signs agree with the compiled kernels, along three ways."""
    worm = Worm(
        segments=1, length=0.11, half_height=0.16, k_spring=8.0, k_apex=0.0,
        hysteresis=Jenkins(moment=0.06, load_ratio=0.5, give=0.01, spread=2.0),
    )  # fmt: skip
    length = np.interp(np.linspace(0.0, 3.0, 400), [0.0, 1.0, 2.0, 3.0], [0.11, 0.2, 0.13, 0.18])
    wanted = stretch_segment(worm, length, np.arange(400.0)).force
    spline = Spline(0.11, 0.2, 10)
    passive = stretch_segment(
        replace(worm, hysteresis=type(worm.hysteresis).__mro__[1]()), length, np.arange(400.0)
    ).force
    elastic = np.linalg.lstsq(spline.matrix(length), passive, rcond=None)[0][None]
    link = float(worm.link_length[0])
    ways = bench.ways_of(length)
    assert [way.start for way in ways] == [0, 133, 266]
    record = bench.Record(length, wanted, np.zeros(400, dtype=int), np.zeros(1), link, ways, 0.11, None)
    found = bench.predicted(record, spline, elastic, np.array([0.06, 0.5, np.log(0.01), np.log(2.0)]))
    assert_allclose(found, wanted, atol=2e-3 * np.abs(wanted).max())


def test_the_load_frame_within_four_percent_both_ways(cycle: bench.Cycle) -> None:
    ways = cycle.errors(cycle.elastic)
    assert {(way.number, way.use) for way in ways} == {(1, "fitted"), (1, "held out"), (2, "fitted"), (2, "held out")}
    assert max(way.error for way in ways) < 0.03
    assert 0.7 < cycle.load_ratio < 0.9
    assert cycle.scene_keys()[:2] == ["[hysteresis]", 'kind = "jenkins"']


def test_the_shipped_law_and_its_friction_follow_the_record_in_the_plant(cycle: bench.Cycle) -> None:
    """The loop of one segment is the loop that the fit predicts, up to the spline through the law's force."""
    own = Jenkins(moment=cycle.moment, load_ratio=cycle.load_ratio, give=cycle.give, spread=cycle.spread)
    segment, record = Learned("mesh_segment.json"), cycle.record
    elastic, rubbing = (
        Worm(segments=1, segment=segment, kelvin_voigt_time=0.0, hysteresis=each) for each in (Hysteresis(), own)
    )
    grid = np.linspace(cycle.spline.low, cycle.spline.high, 200)
    curve = stretch_segment(elastic, grid, np.arange(200.0)).force / record.lever(grid)
    coefficients = np.linalg.lstsq(cycle.spline.matrix(grid), curve, rcond=None)[0]
    found = stretch_segment(rubbing, record.length, np.arange(float(len(record.length))))
    force, peak = found.force / record.lever(record.length), np.abs(record.force).max()
    assert_allclose(force, cycle.predicted(coefficients[None]), rtol=0, atol=0.006 * peak)
    for way, most in zip(record.ways, (0.031, 0.027), strict=True):
        assert rms((force - record.force)[way]) < most * peak
    assert found.hysteresis_loss.min() >= 0.0


def test_one_cycle_predicts_the_next_ones() -> None:
    """A record of three cycles of a known segment: the first is fitted, the others are met, friction comes back."""
    rng = np.random.default_rng(0)
    length = np.interp(np.linspace(0.0, 6.0, 900), np.arange(7.0), [0.06, 0.045, 0.06, 0.042, 0.062, 0.045, 0.06])
    spline, elastic = Spline(0.042, 0.062, 4), np.array([[-9.0, -5.0, 0.5, 2.0]])
    ways = bench.ways_of(length)
    true = np.array([0.003, 0.3, np.log(2e-4), np.log(2.0)])
    record = bench.Record(length, length, np.zeros(900, dtype=int), np.zeros(1), 0.05, ways, None, None)
    force = bench.predicted(record, spline, elastic, true) + 0.03 * rng.standard_normal(900)
    columns = {"length": length, "force": force}
    facts = {"rest_length_m": 0.06, "rest_radius_m": 0.04}
    own = bench.record_of(Table(columns, facts, "", "", {}, True))
    assert own is not None
    assert len(own.cycles) == 3
    found = bench.fit_cycle(replace(own, rest_length=None))
    errors = found.errors(found.elastic)
    assert [way.use for way in errors] == ["fitted"] * 2 + ["held out"] * 4
    assert max(way.error for way in errors) < 0.02
    assert_allclose(found.load_ratio, 0.3, atol=0.06)


@pytest.mark.slow
def test_the_command_fits_the_load_frame(worm3d, tmp_path: Path) -> None:
    given = [text for fact in HOOP for text in ("-o", fact)]
    ended = worm3d("law", DATA, "--out", "law.json", *given)
    assert ended.code == 0
    assert "load_ratio = " in ended.out
    errors = [float(line.split()[-1]) for line in ended.out.splitlines() if line.split()[:1] in (["1"], ["2"])]
    assert len(errors) == 4
    assert max(errors) < 4.0
    keys = ended.out[ended.out.index("[hysteresis]") : ended.out.index("Written:")]
    frame = f'[frame]\nfile = "{DATA}"\n[run]\nduration_s = 66.25\ndt_s = 0.05\n[worm]\nkelvin_voigt_time_s = 0.0\n'
    scene = f'model = "load_frame"\n[segment]\nkind = "learned"\nfile = "law.json"\n{keys}{frame}'
    (tmp_path / "frame.toml").write_text(scene)
    assert worm3d("run", "frame.toml", "--out", "frame").code == 0
    summary = json.loads((tmp_path / "frame" / "summary.json").read_text())
    assert_allclose(summary["work_lost_share"], 0.91, atol=0.02)
    assert (tmp_path / "law.png").stat().st_size > 20_000
    assert worm3d("law", DATA, "--out", "law.json", *given).complaints == [
        "law.json exists: choose another name, or replace it with --force"
    ]


# ---- reading


def written(path: Path, columns: dict[str, np.ndarray], **facts: object) -> Path:
    """Write a CSV file of states."""
    lines = [f"# {name}: {value}" for name, value in facts.items()]
    rows = (",".join(f"{value:.17g}" for value in row) for row in zip(*columns.values(), strict=True))
    path.write_text("\n".join([*lines, ",".join(columns), *rows]) + "\n")
    return path


def good(count: int = 100) -> dict[str, np.ndarray]:
    given = Membrane().table(count).columns
    units = {"length": "m", "pressure": "Pa", "force": "N", "radius": "m", "volume": "m3"}
    return {f"{name}_{units[name]}": np.array(values) for name, values in given.items()}


def test_units_titles_and_facts(tmp_path: Path) -> None:
    columns = good()
    netcdf = tmp_path / "table.nc"
    with netcdf_file(netcdf, "w") as file:
        file.createDimension("state", 100)
        for name, values in columns.items():
            file.createVariable(name, "d", ("state",))[:] = values
        file.rest_length_m, file.source = np.array(0.06), b"a membrane"
    one = table.load(netcdf)
    changed = {
        "Position": 1e3 * columns["length_m"],
        "pressure_kPa": 1e-3 * columns["pressure_Pa"],
        "volume_ml": 1e6 * columns["volume_m3"],
        "force_mN": 1e3 * columns["force_N"],
        "radius_cm": 100.0 * columns["radius_m"],
        "room_C": 0.0 * columns["force_N"],
    }
    path = written(tmp_path / "table.csv", changed, rest_length_m=0.05)
    other = table.load(path, ["length_mm=Position"], ["rest_length_m=0.06"])
    assert (one.source, one.facts, other.facts) == ("a membrane", {"rest_length_m": 0.06}, {"rest_length_m": 0.06})
    assert one.columns.keys() == other.columns.keys() == {"length", "pressure", "volume", "force", "radius"}
    for name, values in one.columns.items():
        assert_allclose(other.columns[name], values, rtol=1e-12)


def test_crumpled_and_incomplete_rows_are_left_out_and_counted(tmp_path: Path) -> None:
    columns = {**good(), "stable": np.ones(100)}
    columns["stable"][[3, 8]] = 0.0
    columns["force_N"][[3, 20, 21, 22]] = np.nan
    found = table.load(written(tmp_path / "table.csv", columns, rest_length_m=0.06))
    assert len(found) == 95
    assert found.left_out == {"a missing number": 3, "a crumpled shape": 2}


def begun(path: Path) -> None:
    """Do all that comes before a fit."""
    found = prepared(table.load(path))
    start(found.states, found.table.facts.get("rest_length_m"), found.table.input_name)


def without(*names: str) -> dict[str, np.ndarray]:
    return {name: values for name, values in good().items() if name not in names}


@pytest.mark.parametrize(
    ("columns", "facts", "sentence"),
    [
        (without("force_N"), {}, "must have rows and the columns force_N; rename with --column"),
        (without("length_m"), {}, "must have rows and the columns length_m"),
        (
            {**without("length_m"), "length_N": good()["length_m"]},
            {},
            "column 'length_N': got a unit of [N], must be one of length_m",
        ),
        ({**without("force_N"), "force": good()["force_N"]}, {}, "column 'force': got no unit, must be one of force_N"),
        ({**good(), "length_mm": good()["length_m"]}, {}, "a second column of the length"),
        ({**good(), "length_m": 1e3 * good()["length_m"]}, {}, "correct the unit of the column or of rest_length_m"),
        ({**good(), "volume_m3": 1e3 * good()["volume_m3"]}, {}, "correct a unit, or the sign of the force"),
        ({**good(), "force_N": -good()["force_N"]}, {}, "must grow; change its sign"),
        ({**good(), "pressure_Pa": good()["pressure_Pa"] - 100.0}, {}, "subtract the zero reading of the sensor"),
        (
            {**good(), "force_N": np.where(np.arange(100) % 3, good()["force_N"], np.nan)},
            {},
            "34 of 100 rows lack a number",
        ),
        (
            {name: values[:30] for name, values in good().items()},
            {},
            "got 30 straight states that can be used, must be 40 or more",
        ),
        ({**good(), "stable": np.zeros(100)}, {}, "got 0 straight states"),
        (
            {**good(), "force_N": 30.0 + np.abs(good()["force_N"]) + 1e3 * good()["length_m"]},
            {},
            "changes its sign at 0 of 25 inputs",
        ),
        (good(), {"rest_length_m": "soft"}, "rest_length_m: got soft, must be a number above 0"),
        (without("radius_m"), {}, "rest_radius_m: the table does not have it"),
    ],
)
def test_what_is_wrong_is_said(
    tmp_path: Path, columns: dict[str, np.ndarray], facts: dict[str, object], sentence: str
) -> None:
    path = written(tmp_path / "table.csv", columns, **{"rest_length_m": 0.06, **facts})
    with pytest.raises(SceneError) as caught:
        begun(path)
    assert sentence in str(caught.value)


def test_a_free_length_that_turns_back_is_said() -> None:
    length, p = Membrane().points(100)
    force = 100.0 * (length - 0.05 - 0.008 * np.cos(2.0 * np.pi * p / 4500.0))
    columns = {"length": length, "pressure": p, "force": force, "radius": 0.02 + 0.0 * length}
    found = prepared(Table(columns, {"rest_length_m": 0.058}, "", "", {}, False))
    with pytest.raises(SceneError, match=r"the free length changes its direction: .* leave out rows beyond 22"):
        start(found.states, 0.058, "pressure")


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (b"CDF\x01 broken", "neither a NetCDF file nor a table"),
        (b"", "neither a NetCDF file"),
        (b"\x89HDF\r\n\x1a\n", "damaged"),
    ],
)
def test_damaged_tables_are_said(tmp_path: Path, content: bytes, sentence: str) -> None:
    (tmp_path / "table.nc").write_bytes(content)
    with pytest.raises(SceneError, match=sentence):
        table.load(tmp_path / "table.nc")


def test_the_command_says_what_is_wrong(worm3d, tmp_path: Path) -> None:
    path = written(tmp_path / "table.csv", good(30), rest_length_m=0.06)
    assert worm3d("law", path, "--out", "law.txt").complaints == [
        "--out: got 'law.txt', must be a file ending in .json"
    ]
    ended = worm3d("law", path, "--out", "law.json")
    assert ended.code == 2
    assert ended.complaints[-1].startswith(f"{path}: got 30 straight states")
    ended = worm3d("law", path, "--out", "law.json", "--column", "length_mm")
    assert ended.complaints[-1] == f"{path}: --column: got 'length_mm', must be NAME=VALUE"
    assert worm3d("law", tmp_path / "none.nc", "--out", "law.json").complaints[-1].endswith("none.nc: no such file")
