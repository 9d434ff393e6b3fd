"""Native kernels equal CasADi's virtual machine, whatever the operation, count, host and state of the cache."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_array_equal

from worm3d.machine.codegen import Host, Kernel, UnsupportedError, compile_kernel, emit, evaluate, this_host
from worm3d.machine.codegen import kernel as kernels
from worm3d.machine.compiled import njit

EDGES = [0.0, 1.0, 0.5, 0.25, 2.0, 3.0, 1e-8, 1e-160, 1e-300, 5e-324, 1e160, 1e290, 1e308, np.inf, 700.0, 709.7, 745.1]
EDGES += [np.pi / 2, np.pi, 1e5 * np.pi, 355.0, 1e6, 1.1e6, 1e22]
EDGES += [np.sqrt(2) - 1, np.sqrt(2) + 1, np.sqrt(0.5), 1 - 1e-16]
SIGNED_EDGES = np.array([*EDGES, *(-x for x in EDGES), np.nan])

TRANSCENDENTAL = ("sin", "cos", "tan", "asin", "acos", "atan", "exp", "log")
LIBRARY_ONLY = ("sinh", "cosh", "tanh", "asinh", "acosh", "atanh", "log1p", "expm1", "erf")
UNARY: dict[str, Callable[[ca.SX], ca.SX]] = {
    "neg": lambda x: -x,
    "sq": lambda x: x * x,
    "twice": lambda x: 2 * x,
    "inv": lambda x: 1 / x,
    "not": ca.logic_not,
    **{name: getattr(ca, name) for name in ("sqrt", "fabs", "sign", "floor", "ceil", *TRANSCENDENTAL, *LIBRARY_ONLY)},
    "square_and_inverse": lambda x: x**-2,
    **{f"power_{n}": lambda x, n=n: ca.constpow(x, n) for n in (-16, -3, 0, 1, 3, 4, 5, 7, 15, 17, 0.5, 1.7)},
}
BINARY: dict[str, Callable[[ca.SX, ca.SX], ca.SX]] = {
    "add": lambda x, y: x + y,
    "sub": lambda x, y: x - y,
    "mul": lambda x, y: x * y,
    "div": lambda x, y: x / y,
    "lt": lambda x, y: x < y,
    "le": lambda x, y: x <= y,
    "eq": lambda x, y: x == y,
    "ne": lambda x, y: x != y,
    "if_else": lambda x, y: ca.if_else(ca.logic_or(x < y, ca.logic_and(x > 1, y)), x, y),
    "if_else_zero": ca.if_else_zero if hasattr(ca, "if_else_zero") else (lambda x, y: ca.if_else(x, y, 0)),
    "and": ca.logic_and,
    "or": ca.logic_or,
    "pow": lambda x, y: x**y,
    **{name: getattr(ca, name) for name in ("fmin", "fmax", "atan2", "copysign", "hypot", "fmod", "remainder")},
    "const": lambda x, y: ca.SX(2.5) + 0 * x + y * 1e-3,
}


def _hosts() -> list[Host]:
    """Return this host and, if it has AVX2, two older ones: with four lanes, and with two and no fused multiply-add."""
    own = this_host()
    older = [Host("x86-64-v3", "", 4, True), Host("x86-64", "", 2, False)]
    return [own, *(older if own.width >= 4 else [])]


HOSTS = pytest.mark.parametrize("host", _hosts(), ids=lambda host: f"{host.width}-lanes")


@pytest.fixture(autouse=True)
def _own_cache(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(kernels, "_LOADED", {})


def run(kernel: Kernel, columns: np.ndarray) -> np.ndarray:
    """Evaluate on the columns; shapes (rows_in, count) to (rows_out, count)."""
    count = columns.shape[1]
    inputs, outputs = kernel.allocate(count)
    inputs[:, :count] = columns
    evaluate(kernel.address, inputs, outputs, count)
    return outputs[:, :count]


def reference(function: ca.Function, columns: np.ndarray) -> np.ndarray:
    """Evaluate by calling the CasADi function, which the kernels know nothing of; dense inputs."""
    bounds = np.cumsum([0, *(function.nnz_in(i) for i in range(function.n_in()))])
    results = []
    for column in columns.T:
        arguments = [
            column[bounds[i] : bounds[i + 1]].reshape(function.size_in(i), order="F") for i in range(function.n_in())
        ]
        values = function.call([ca.DM(a) for a in arguments])
        results.append(np.concatenate([np.array(v.nonzeros()) for v in values]))
    return np.array(results).T


def assert_equal(actual: np.ndarray, expected: np.ndarray, scale: np.ndarray | None = None) -> None:
    """NaN and infinities in the same places, the rest within 1e-13 of the magnitude."""
    odd = ~np.isfinite(expected)
    assert_array_equal(actual[odd], expected[odd])
    assert np.all(np.isfinite(actual[~odd])), "finite values have become infinite or NaN"
    with np.errstate(over="ignore", under="ignore"):
        size = np.abs(expected if scale is None else np.broadcast_to(scale, expected.shape))[~odd]
        excess = np.abs(actual[~odd] - expected[~odd]) > 1e-13 * size + 1e-307
    assert not np.any(excess), (actual[~odd][excess], expected[~odd][excess])


def rhombus(couplings: int = 1) -> ca.Function:
    """Potential, gradient and Hessian of two segments: springs, apexes with inertia, contact and friction, torsion."""
    q, p = ca.SX.sym("q", 6), ca.SX.sym("p", 12)
    dt, a, k, l_cmd, k_apex, mass, stiff, mu_forward, mu_backward, yield_gauge, k_torsion, side_hat = ca.vertsplit(p)
    phi = 0
    tangents = []
    for i in range(2):
        e = q[2 * i + 2 : 2 * i + 4] - q[2 * i : 2 * i + 2]
        square = ca.dot(e, e)
        length, w = ca.sqrt(square), ca.sqrt(a * a / square - 0.25)
        tangents.append(e / length)
        phi += 0.5 * k * (1 - length / l_cmd) ** 2 + k_apex * (2 * ca.asin(0.5 * length / a) - 1.5) ** 2
        for side in (-1, 1):
            x = 0.5 * (q[2 * i] + q[2 * i + 2]) - side * w * e[1]
            z = 0.5 * (q[2 * i + 1] + q[2 * i + 3]) + side * w * e[0]
            slide = x - side_hat * side
            mu = ca.if_else(slide > 0, mu_forward, mu_backward)
            rho = mu * ca.fabs(slide)
            depth = ca.fmax(-z, 0)
            phi += 0.5 * mass / dt**2 * (slide**2 + z**2) + 0.5 * stiff * depth**2
            phi += ca.if_else(rho <= yield_gauge, rho**2 / (2 * yield_gauge), rho - 0.5 * yield_gauge)
    cross = tangents[0][0] * tangents[1][1] - tangents[0][1] * tangents[1][0]
    phi += 0.5 * k_torsion * cross**2 + couplings * ca.atan2(cross, ca.dot(*tangents)) ** 2
    hessian, gradient = ca.hessian(phi, q)
    return ca.Function("rhombus", [q, p], [phi, gradient, ca.tril(hessian)])


def rhombus_columns(count: int, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    rest = np.array([0.0, 0.02, 0.1, 0.03, 0.2, 0.025])[:, None] + 0.01 * rng.standard_normal((6, count))
    means = np.array([0.01, 0.1, 50, 0.1, 2, 0.05, 1e4, 0.3, 0.9, 1e-2, 20, 0.05])[:, None]
    return np.vstack([rest, means * rng.uniform(0.8, 1.2, (12, count))])


def rhombus_scale(function: ca.Function, expected: np.ndarray) -> np.ndarray:
    """Largest magnitude in potential, gradient and Hessian each, for each instance."""
    sizes = [function.nnz_out(i) for i in range(function.n_out())]
    parts = np.split(np.abs(expected), np.cumsum(sizes)[:-1])
    return np.vstack([np.broadcast_to(part.max(axis=0), part.shape) for part in parts])


def operations(family: dict[str, Callable[..., ca.SX]]) -> ca.Function:
    args = [ca.SX.sym("x"), ca.SX.sym("y")][: 1 if family is UNARY else 2]
    return ca.Function("operations", args, [operation(*args) for operation in family.values()])


def test_every_supported_operation_is_tested() -> None:
    tested = set()
    for function in map(operations, (UNARY, BINARY)):
        tested |= {emit.OPERATION_NAMES[function.instruction_id(k)] for k in range(function.n_instructions())}
    assert emit.SUPPORTED - tested <= {"assign", "lift"}, "copies, which SX removes by itself"


@HOSTS
@pytest.mark.parametrize("family", [UNARY, BINARY], ids=["unary", "binary"])
def test_every_operation_equals_the_virtual_machine(family: dict[str, Callable[..., ca.SX]], host: Host) -> None:
    function, size = operations(family), 1 if family is UNARY else 2
    rng = np.random.default_rng(1)
    scales = 10.0 ** rng.integers(-9, 7, (size, 400))
    columns = np.hstack([rng.standard_normal((size, 400)) * scales, rng.uniform(-1.2, 1.2, (size, 400))])
    pairs = np.meshgrid(*[SIGNED_EDGES] * size)
    columns = np.hstack([columns, np.array([pair.ravel() for pair in pairs])])
    expected = reference(function, columns)
    actual = run(compile_kernel(function, host=host), columns)
    for row, name in enumerate(family):
        try:
            assert_equal(actual[row], expected[row])
        except AssertionError as error:
            raise AssertionError(f"{name}: {error}") from None


@pytest.mark.parametrize("name", TRANSCENDENTAL)
def test_transcendentals_are_accurate_over_their_ranges(name: str) -> None:
    x = ca.SX.sym("x")
    function = ca.Function(name, [x], [getattr(ca, name)(x)])
    low, high = {"asin": (-1, 1), "acos": (-1, 1), "exp": (-699, 699), "log": (1e-9, 1e3)}.get(name, (-1e4, 1e4))
    points = np.linspace(low, high, 20001)
    near = points[:2000:100, None] + np.linspace(-1e-3, 1e-3, 201)
    columns = np.concatenate([points, np.clip(near.ravel(), low, high)])[None, :]
    expected = np.array(function(columns))
    actual = run(compile_kernel(function), columns)
    assert np.all(np.abs(actual - expected) <= 1e-15 * np.abs(expected))


def test_quarter_turns_are_taken_off_exactly() -> None:
    """Among all multiples of pi/2 in the formulas' range, those whose sine or cosine is smallest."""
    multiples = np.arange(1.0, 636_000.0) * (0.5 * np.pi)
    closest = np.argsort(np.minimum(np.abs(np.sin(multiples)), np.abs(np.cos(multiples))))[:300]
    x = ca.SX.sym("x")
    function = ca.Function("turns", [x], [ca.sin(x), ca.cos(x), ca.tan(x)])
    expected = reference(function, multiples[None, closest])
    assert np.min(np.abs(expected)) < 1e-15
    assert np.all(np.abs(run(compile_kernel(function), multiples[None, closest]) / expected - 1) <= 1e-15)


@HOSTS
def test_gradient_and_hessian_of_a_segment_equal_the_virtual_machine(host: Host) -> None:
    function, columns = rhombus(), rhombus_columns(100)
    assert function.n_instructions() > 1000
    expected = reference(function, columns)
    assert_equal(run(compile_kernel(function, host=host), columns), expected, rhombus_scale(function, expected))


@HOSTS
def test_any_count_fills_its_instances_and_no_lane_beyond_the_padding(host: Host) -> None:
    function = rhombus()
    kernel = compile_kernel(function, host=host)
    columns = rhombus_columns(17)
    expected = run(kernel, columns)
    for count in range(18):
        inputs, outputs = np.full((18, 32), 1e-310), np.full((kernel.rows_out, 32), 7.0)
        inputs[0, 1::2] = np.nan
        inputs[:, :count] = columns[:, :count]
        evaluate(kernel.address, inputs, outputs, count)
        lanes = kernel.lanes(count)
        assert lanes % kernel.width == 0
        assert count <= lanes < count + kernel.width
        assert_array_equal(outputs[:, :count], expected[:, :count])
        assert_array_equal(outputs[:, lanes:], 7.0)
        if count:  # the padding repeats the last instance: no NaN, no denormals of its own
            assert_array_equal(outputs[:, count:lanes], np.repeat(outputs[:, count - 1 : count], lanes - count, axis=1))


def test_nan_goes_where_it_goes_in_the_virtual_machine_and_stays_in_its_lane() -> None:
    function = rhombus()
    columns = rhombus_columns(18)
    np.fill_diagonal(columns, np.nan)
    expected = reference(function, columns)
    actual = run(compile_kernel(function), columns)
    assert_array_equal(np.isnan(actual), np.isnan(expected))
    assert np.all(np.isnan(expected).any(axis=0))
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    check = ca.Function("check", [x, y], [ca.if_else(x * y <= np.inf, 1, -1)])
    assert_array_equal(run(compile_kernel(check), np.array([[2.0, np.nan], [3.0, 3.0]])), [[1, -1]])
    clean = rhombus_columns(18)
    clean[3, 5] = np.nan
    others = np.arange(18) != 5
    assert np.all(np.isfinite(run(compile_kernel(function), clean)[:, others]))


def test_rows_are_the_nonzeros_of_all_inputs_and_outputs() -> None:
    x, y = ca.SX.sym("x", ca.Sparsity.lower(2)), ca.SX.sym("y", 2, 2)
    function = ca.Function("rows", [x, y], [y.T, x * 10, ca.SX.sym("none", 0, 1)])
    actual = run(compile_kernel(function), np.arange(7.0)[:, None])
    assert_array_equal(actual[:, 0], [3, 5, 4, 6, 0, 10, 20])


def test_what_derivatives_repeat_is_computed_once() -> None:
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    function = ca.Function("repeats", [x, y], [ca.sin(x) * y, y * ca.sin(x) + ca.cos(x), ca.cos(x) / (x + y), y + x])
    text = emit.module(function, 4, fused=True)
    block = text[text.index('void @"block"(') :].split("\n}")[0]
    assert block.count("lanes_sincos") == 1
    assert block.count("fmul") - block.count("mul i64") <= 1
    assert block.count("fadd") == 2


def test_lanes_of_a_padded_kernel_compute_what_they_hold() -> None:
    x = ca.SX.sym("x")
    kernel = compile_kernel(ca.Function("padded", [x], [x * x]), padded=True)
    inputs, outputs = kernel.allocate(1)
    inputs[0] = np.arange(3.0, 3.0 + inputs.shape[1])
    evaluate(kernel.address, inputs, outputs, 1)
    assert_array_equal(outputs, inputs**2)
    kernel = compile_kernel(ca.Function("padded", [x], [x * x]))
    evaluate(kernel.address, inputs, outputs, 1)
    assert_array_equal(outputs, np.full_like(outputs, 9.0))


@njit
def _doubled(address: int, inputs: np.ndarray, outputs: np.ndarray, count: int) -> float:
    evaluate(address, inputs, outputs, count)
    return float(2.0 * outputs[0, count - 1])


def test_compiled_code_calls_a_kernel_by_its_address() -> None:
    kernel = compile_kernel(rhombus())
    columns = rhombus_columns(6)
    inputs, outputs = kernel.allocate(6)
    inputs[:, :6] = columns
    assert _doubled(kernel.address, inputs, outputs, 6) == 2.0 * run(kernel, columns)[0, 5]
    for wrong in ((inputs[1:], outputs, 6), (inputs, outputs, inputs.shape[1] + 1), (inputs, outputs, -1)):
        with pytest.raises(ValueError, match="wrong number of rows or too few lanes"):
            _doubled(kernel.address, *wrong)
    with pytest.raises(ValueError, match="C-contiguous"):
        _doubled(kernel.address, inputs[:, ::2], outputs, 3)


@njit
def _some(address: int, inputs: np.ndarray, outputs: np.ndarray, first: int, count: int) -> None:
    evaluate(address, inputs, outputs, count, first)


def test_some_lanes_alone() -> None:
    kernel = compile_kernel(rhombus())
    columns, first = rhombus_columns(3 * kernel.width), kernel.width
    inputs, outputs = kernel.allocate(3 * kernel.width)
    inputs[:] = columns
    _some(kernel.address, inputs, outputs, first, kernel.width)
    assert_array_equal(outputs[:, first : 2 * first], run(kernel, columns)[:, first : 2 * first])
    assert not outputs[:, :first].any()
    assert not outputs[:, 2 * first :].any()
    with pytest.raises(ValueError, match="too few lanes"):
        _some(kernel.address, inputs, outputs, 3 * first, 1)


def test_threads_may_share_a_kernel() -> None:
    kernel = compile_kernel(rhombus())
    columns = [rhombus_columns(50, seed) for seed in range(8)]
    expected = [run(kernel, part) for part in columns]
    with ThreadPoolExecutor(4) as pool:
        for actual, right in zip(pool.map(run, [kernel] * 8, columns), expected, strict=True):
            assert_array_equal(actual, right)


def test_what_cannot_be_compiled_is_named() -> None:
    x, free = ca.SX.sym("x"), ca.SX.sym("free")
    with pytest.raises(UnsupportedError, match="the operation 'erfinv' has no native form"):
        compile_kernel(ca.Function("inverse", [x], [ca.erfinv(x)]))
    m = ca.MX.sym("m")
    with pytest.raises(UnsupportedError, match="got a MXFunction, need an SXFunction"):
        compile_kernel(ca.Function("matrices", [m], [m * m]))
    with pytest.raises(UnsupportedError, match=r"the variables .*free.* are no inputs"):
        compile_kernel(ca.Function("open", [x], [x + free], {"allow_free": True}))
