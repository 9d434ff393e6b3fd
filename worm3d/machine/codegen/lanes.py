"""Transcendental functions on vectors, as LLVM functions `lanes_<name>` in the kernel's module.

There is no vector library to count on, so sin, cos, tan, asin, acos, atan, atan2, exp and log are written out: argument
reduction and then a polynomial, with the coefficients of Sun's fdlibm, equal to the C library's to a few units in the
last place. They need fused multiply-add. Where an argument is outside the range in which that holds (huge, infinite,
NaN, zero denominators), and for every other function, each lane calls the C library.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable

from worm3d.machine.codegen.text import Writer

LIBRARY = {
    **dict.fromkeys(("sin", "cos", "tan", "asin", "acos", "atan", "exp", "log"), 1),
    **dict.fromkeys(("sinh", "cosh", "tanh", "asinh", "acosh", "atanh", "erf", "log1p", "expm1"), 1),
    **dict.fromkeys(("atan2", "pow", "hypot", "fmod", "remainder"), 2),
}
"""Functions of the C library that a kernel may call, with the number of their arguments."""

SIN = (
    1.58969099521155010221e-10,
    -2.50507602534068634195e-08,
    2.75573137070700676789e-06,
    -1.98412698298579493134e-04,
    8.33333333332248946124e-03,
    -1.66666666666666324348e-01,
)
COS = (
    -1.13596475577881948265e-11,
    2.08757232129817482790e-09,
    -2.75573143513906633035e-07,
    2.48015872894767294178e-05,
    -1.38888888888741095749e-03,
    4.16666666666666019037e-02,
)
ASIN_P = (
    3.47933107596021167570e-05,
    7.91534994289814532176e-04,
    -4.00555345006794114027e-02,
    2.01212532134862925881e-01,
    -3.25565818622400915405e-01,
    1.66666666666666657415e-01,
)
ASIN_Q = (
    7.70381505559019352791e-02,
    -6.88283971605453293030e-01,
    2.02094576023350569471e00,
    -2.40339491173441421878e00,
    1.0,
)
ATAN = (
    1.62858201153657823623e-02,
    -3.65315727442169155270e-02,
    4.97687799461593236017e-02,
    -5.83357013379057348645e-02,
    6.66107313738753120669e-02,
    -7.69187620504482999495e-02,
    9.09088713343650656196e-02,
    -1.11111104054623557880e-01,
    1.42857142725034663711e-01,
    -1.99999999998764832476e-01,
    3.33333333333329318027e-01,
)
LOG = (
    1.479819860510658591e-01,
    1.531383769920937332e-01,
    1.818357216161805012e-01,
    2.222219843214978396e-01,
    2.857142874366239149e-01,
    3.999999999940941908e-01,
    6.666666666666735130e-01,
)
EXP = tuple(1.0 / math.factorial(k) for k in range(13, -1, -1))
HALF_PI = (1.57079632679489655800e00, 6.12323399573676603587e-17, -1.49738490485916983e-33)
"""pi/2 as a sum, each term rounded."""
LN_2 = (6.93147180369123816490e-01, 1.90821492927058770002e-10)
"""ln 2 as a sum; the first has trailing zeros, so that its products with exponents are exact."""
ROOT_HALF_BITS = 0x3FE6A09E667F3BCD
PURE = "noinline nounwind willreturn memory(none)"
"""Attributes of the functions here; not inlined, for they would cut the kernel's one long block into many."""


def definitions(names: Iterable[str], width: int, fused: bool) -> str:
    """Return the LLVM functions `lanes_<name>` and what they call.

    Parameters
    ----------
    names : iterable of str
        "sincos" or keys of `LIBRARY`.
    width : int
        Lanes of a vector.
    fused : bool
        Whether the processor has fused multiply-add; otherwise each lane calls the C library.
    """
    wanted = set(names)
    library = (wanted - {"sincos"}) | ({"sin", "cos"} if "sincos" in wanted else set())
    declared = [f"declare double @{name}({', '.join(['double'] * LIBRARY[name])}) nounwind" for name in sorted(library)]
    one_by_one = [_one_by_one(name, width) for name in sorted(library)]
    return "\n".join([*declared, *one_by_one, *(_define(name, width, fused) for name in sorted(wanted))])


def _one_by_one(name: str, width: int) -> str:
    """`each_<name>`: the C library's function on every lane."""
    w, count = Writer(width), LIBRARY[name]
    result = "poison"
    for lane in range(width):
        parts = [w.new(f"extractelement {w.vector} %x{k}, i32 {lane}") for k in range(count)]
        value = w.new(f"call double @{name}({', '.join(f'double {p}' for p in parts)})")
        result = w.new(f"insertelement {w.vector} {result}, double {value}, i32 {lane}")
    return _function(w, f"each_{name}", count, w.vector, result)


def _define(name: str, width: int, fused: bool) -> str:
    """`lanes_<name>`: the formula where every lane is in its range, else `each_<name>`."""
    w, count = Writer(width), 1 if name == "sincos" else LIBRARY[name]
    result_type = f"{{{w.vector}, {w.vector}}}" if name == "sincos" else w.vector
    if fused and name in FORMULAS:
        bad, formula = FORMULAS[name]
        outside = w.new(f"bitcast {w.mask_type} {bad(w)} to i{width}")
        any_outside = w.new(f"icmp ne i{width} {outside}, 0")
        w.do(f"br i1 {any_outside}, label %outside, label %inside")
        w.label("inside")
        w.do(f"ret {result_type} {formula(w)}")
        w.label("outside")
    return _function(w, f"lanes_{name}", count, result_type, _library_result(w, name, count))


def _library_result(w: Writer, name: str, count: int) -> str:
    args = ", ".join(f"{w.vector} %x{k}" for k in range(count))
    if name != "sincos":
        return w.new(f"call {w.vector} @each_{name}({args})")
    return _pair(w, *(w.new(f"call {w.vector} @each_{part}({args})") for part in ("sin", "cos")))


def _pair(w: Writer, first: str, second: str) -> str:
    pair = f"{{{w.vector}, {w.vector}}}"
    half = w.new(f"insertvalue {pair} poison, {w.vector} {first}, 0")
    return w.new(f"insertvalue {pair} {half}, {w.vector} {second}, 1")


def _function(w: Writer, name: str, count: int, result_type: str, result: str) -> str:
    args = ", ".join(f"{w.vector} %x{k}" for k in range(count))
    return f"define internal {result_type} @{name}({args}) {PURE} {{\n{w.body()}\n  ret {result_type} {result}\n}}\n"


def _beyond(limit: float) -> Callable[[Writer], str]:
    """Mask of |x| > limit or NaN."""
    return lambda w: w.compare("ugt", w.intrinsic("fabs", "%x0"), w.splat(limit))


def _nowhere(w: Writer) -> str:
    """Mask of no lane: the formula holds everywhere."""
    return f"<{', '.join(['i1 false'] * w.width)}>"


def _quarter_turns(w: Writer) -> tuple[str, str, str]:
    """Take x as n pi/2 + r with |r| <= pi/4; return n (integers), sin r and cos r."""
    n = w.intrinsic("rint", w.mul("%x0", w.splat(1.0 / HALF_PI[0])))
    r = "%x0"
    for part in HALF_PI:
        r = w.fma(n, w.splat(-part), r)
    z = w.mul(r, r)
    sine = w.fma(w.mul(r, z), w.horner(z, SIN), r)
    cosine = w.fma(z, w.fma(z, w.horner(z, COS), w.splat(-0.5)), w.splat(1.0))
    return w.new(f"fptosi {w.vector} {n} to <{w.width} x i32>"), sine, cosine


def _sincos(w: Writer) -> str:
    """Exchange and negate sin r and cos r by n mod 4."""
    turns, sine, cosine = _quarter_turns(w)
    odd = _bit(w, turns, 1)
    after = w.new(f"add <{w.width} x i32> {turns}, {_integers(w, 32, 1)}")
    return _pair(
        w,
        _negate_where(w, _bit(w, turns, 2), w.select(odd, cosine, sine)),
        _negate_where(w, _bit(w, after, 2), w.select(odd, sine, cosine)),
    )


def _tan(w: Writer) -> str:
    """Return tan r, or -1/tan r for odd n."""
    turns, sine, cosine = _quarter_turns(w)
    odd = _bit(w, turns, 1)
    return w.div(_negate_where(w, odd, w.select(odd, cosine, sine)), w.select(odd, sine, cosine))


def _bit(w: Writer, integers: str, bit: int) -> str:
    """Mask of the lanes whose integer has this bit."""
    part = w.new(f"and <{w.width} x i32> {integers}, {_integers(w, 32, bit)}")
    return w.new(f"icmp ne <{w.width} x i32> {part}, zeroinitializer")


def _integers(w: Writer, bits: int, value: int) -> str:
    return f"<{', '.join([f'i{bits} {value}'] * w.width)}>"


def _negate_where(w: Writer, mask: str, value: str) -> str:
    return w.select(mask, w.neg(value), value)


def _small_arc(w: Writer) -> tuple[str, str]:
    """Return the mask of |x| <= 1/2, and asin u = u + u R(u^2) of u = |x| there and sqrt((1 - |x|)/2) elsewhere."""
    size = w.intrinsic("fabs", "%x0")
    small = w.compare("ole", size, w.splat(0.5))
    half = w.mul(w.sub(w.splat(1.0), size), w.splat(0.5))
    z = w.select(small, w.mul(size, size), half)
    u = w.select(small, size, w.intrinsic("sqrt", half))
    ratio = w.div(w.mul(z, w.horner(z, ASIN_P)), w.horner(z, ASIN_Q))
    return small, w.fma(u, ratio, u)


def _asin(w: Writer) -> str:
    """Above 1/2: asin x = pi/2 - 2 asin sqrt((1 - x)/2)."""
    small, arc = _small_arc(w)
    near_one = w.sub(w.splat(HALF_PI[0]), w.fma(w.splat(2.0), arc, w.splat(-HALF_PI[1])))
    return w.intrinsic("copysign", w.select(small, arc, near_one), "%x0")


def _acos(w: Writer) -> str:
    """Return pi/2 - asin x; near x = 1: 2 asin sqrt((1 - x)/2), near -1: pi minus that."""
    small, arc = _small_arc(w)
    signed = w.intrinsic("copysign", arc, "%x0")
    middle = w.sub(w.splat(HALF_PI[0]), w.sub(signed, w.splat(HALF_PI[1])))
    twice = w.mul(arc, w.splat(2.0))
    far = w.sub(w.splat(2.0 * HALF_PI[0]), w.sub(twice, w.splat(2.0 * HALF_PI[1])))
    negative = w.compare("olt", "%x0", w.splat(0.0))
    return w.select(small, middle, w.select(negative, far, twice))


def _first_quadrant(w: Writer, a: str, b: str) -> str:
    """Return atan(a/b) for a, b >= 0, by turning (b, a) to within 22.5 degrees of the axis; one division."""
    steep = w.compare("ogt", a, w.mul(b, w.splat(1.0 + math.sqrt(2.0))))
    middle = w.compare("ogt", a, w.mul(b, w.splat(math.sqrt(2.0) - 1.0)))
    over = w.select(steep, w.neg(b), w.select(middle, w.sub(a, b), a))
    under = w.select(steep, a, w.select(middle, w.add(a, b), b))
    t = w.div(over, under)
    high, low = (
        w.select(steep, w.splat(part), w.select(middle, w.splat(0.5 * part), w.splat(0.0))) for part in HALF_PI[:2]
    )
    z = w.mul(t, t)
    return w.add(high, w.add(w.fma(w.neg(w.mul(t, z)), w.horner(z, ATAN), low), t))


def _atan(w: Writer) -> str:
    return w.intrinsic("copysign", _first_quadrant(w, w.intrinsic("fabs", "%x0"), w.splat(1.0)), "%x0")


def _atan2(w: Writer) -> str:
    """Return the first quadrant's angle, pi minus it for negative x, with the sign of y."""
    angle = _first_quadrant(w, w.intrinsic("fabs", "%x0"), w.intrinsic("fabs", "%x1"))
    behind = w.sub(w.splat(2.0 * HALF_PI[0]), w.sub(angle, w.splat(2.0 * HALF_PI[1])))
    left = w.compare("olt", "%x1", w.splat(0.0))
    return w.intrinsic("copysign", w.select(left, behind, angle), "%x0")


def _atan2_outside(w: Writer) -> str:
    """Mask of |y| + |x| that is zero, tiny, huge or NaN."""
    size = w.add(w.intrinsic("fabs", "%x0"), w.intrinsic("fabs", "%x1"))
    return w.logic("or", w.compare("ult", size, w.splat(1e-280)), w.compare("ugt", size, w.splat(1e280)))


def _exp(w: Writer) -> str:
    """With x = n ln 2 + r: Taylor's series of exp r to r^13, times 2^n."""
    n = w.intrinsic("rint", w.mul("%x0", w.splat(1.0 / math.log(2.0))))
    r = w.fma(n, w.splat(-LN_2[1]), w.fma(n, w.splat(-LN_2[0]), "%x0"))
    whole = w.new(f"fptosi {w.vector} {n} to <{w.width} x i32>")
    wide = w.new(f"sext <{w.width} x i32> {whole} to <{w.width} x i64>")
    biased = w.new(f"add <{w.width} x i64> {wide}, {_integers(w, 64, 1023)}")
    bits = w.new(f"shl <{w.width} x i64> {biased}, {_integers(w, 64, 52)}")
    return w.mul(w.horner(r, EXP), w.new(f"bitcast <{w.width} x i64> {bits} to {w.vector}"))


def _log(w: Writer) -> str:
    """With x = 2^k (1 + f), 1 + f in [sqrt(1/2), sqrt(2)], s = f/(2 + f): log(1 + f) = 2 atanh s."""
    integers = f"<{w.width} x i64>"
    bits = w.new(f"bitcast {w.vector} %x0 to {integers}")
    above = w.new(f"sub {integers} {bits}, {_integers(w, 64, ROOT_HALF_BITS)}")
    exponent = w.new(f"ashr {integers} {above}, {_integers(w, 64, 52)}")
    shifted = w.new(f"shl {integers} {exponent}, {_integers(w, 64, 52)}")
    mantissa = w.new(f"bitcast {integers} {w.new(f'sub {integers} {bits}, {shifted}')} to {w.vector}")
    k = w.new(f"sitofp <{w.width} x i32> {w.new(f'trunc {integers} {exponent} to <{w.width} x i32>')} to {w.vector}")
    f = w.sub(mantissa, w.splat(1.0))
    s = w.div(f, w.add(f, w.splat(2.0)))
    z = w.mul(s, s)
    half_square = w.mul(w.mul(f, f), w.splat(0.5))
    series = w.mul(z, w.horner(z, LOG))
    correction = w.fma(k, w.splat(LN_2[1]), w.mul(s, w.add(half_square, series)))
    return w.sub(w.mul(k, w.splat(LN_2[0])), w.sub(w.sub(half_square, correction), f))


def _log_outside(w: Writer) -> str:
    """Mask of x that is not positive, tiny, huge or NaN."""
    return w.logic("or", w.compare("ult", "%x0", w.splat(1e-300)), w.compare("ugt", "%x0", w.splat(1e300)))


FORMULAS: dict[str, tuple[Callable[[Writer], str], Callable[[Writer], str]]] = {
    "sincos": (_beyond(1e6), _sincos),
    "tan": (_beyond(1e6), _tan),
    "asin": (_nowhere, _asin),
    "acos": (_nowhere, _acos),
    "atan": (_beyond(1e280), _atan),
    "atan2": (_atan2_outside, _atan2),
    "exp": (_beyond(700.0), _exp),
    "log": (_log_outside, _log),
}
"""The mask of the arguments outside the formula's range, and the formula."""
