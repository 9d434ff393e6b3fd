"""Transcendental functions on vectors, as LLVM functions `lanes_<name>` in the kernel's module.

A library of vector functions may be missing. Therefore sin, cos, asin, atan2, exp and log, which the kernels contain,
are written out as an argument reduction and a polynomial with the coefficients of Sun's fdlibm. They equal the C
library to a few units in the last place. These formulas need fused multiply-add. For arguments outside the valid range
(huge, infinite, NaN, zero denominators), and for all other functions, each lane calls the C library.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from llvmlite import ir

from worm3d.machine.writer import BOOL, DOUBLE, INDEX, INT, Writer

LIBRARY = (
    *("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "exp", "log", "log1p", "expm1", "pow", "hypot"),
    *("sinh", "cosh", "tanh", "asinh", "acosh", "atanh", "erf", "fmod", "remainder"),
)
"""Functions of the C library that a kernel may call."""

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
"""pi/2 as a sum of rounded terms."""
LN_2 = (6.93147180369123816490e-01, 1.90821492927058770002e-10)
"""ln 2 as a sum. The first term has trailing zero bits, so that its products with exponents are exact."""
LANES_PREFIX = "lanes_"
PURE = ("noinline", "nounwind", "willreturn", "memory(none)")
"""Attributes of these functions. Inlined functions would cut the one long block of a kernel into many blocks."""


def library(w: Writer, name: str, *args: Any) -> Any:
    """Call a function of `LIBRARY` on vectors."""
    return w.call(f"{LANES_PREFIX}{name}", w.vector, *args)


def sincos(w: Writer, x: Any) -> tuple[Any, Any]:
    """Return sine and cosine. Both are computed together, since derivatives always need both."""
    both = w.call(f"{LANES_PREFIX}sincos", ir.LiteralStructType([w.vector, w.vector]), x)
    return w.once("extract_value", both, 0), w.once("extract_value", both, 1)


def define_all(unit: Any, width: int, fused: bool) -> None:
    """Write the functions `lanes_<name>` that a module calls. If not `fused`, each lane calls the C library."""
    for function in [each for each in unit.functions if each.name.startswith(LANES_PREFIX)]:
        name = function.name.removeprefix(LANES_PREFIX)
        w = _begun(function, width)
        if fused and name in FORMULAS:
            bad, formula = FORMULAS[name]
            inside, outside = (function.append_basic_block(each) for each in ("inside", "outside"))
            mask = w.once("bitcast", bad(w, *function.args), ir.IntType(width))
            w.do("cbranch", w.once("icmp_signed", "!=", mask, ir.Constant(ir.IntType(width), 0)), outside, inside)
            w.begin(inside)
            w.do("ret", formula(w, *function.args))
            w.begin(outside)
        parts = [_of_each(w, part, function.args) for part in (("sin", "cos") if name == "sincos" else (name,))]
        w.builder.ret(_pair(w, *parts) if name == "sincos" else parts[0])


def _begun(function: Any, width: int) -> Writer:
    function.linkage = "internal"
    for attribute in PURE:
        set.add(function.attributes, attribute)  # set.add avoids llvmlite's check, which does not know all attributes
    return Writer(ir.IRBuilder(function.append_basic_block()), width)


def _of_each(w: Writer, name: str, args: Any) -> Any:
    """Call `each_<name>`, which applies a function of the C library to every lane, after writing it if needed."""
    value = w.call(f"each_{name}", w.vector, *args)
    function = w.builder.module.get_global(f"each_{name}")
    if function.is_declaration:
        own = _begun(function, w.width)
        result = ir.Constant(w.vector, ir.Undefined)
        for lane in range(w.width):
            of_lane = own.call(name, DOUBLE, *(own.lane(arg, lane) for arg in function.args))
            result = own.once("insert_element", result, of_lane, ir.Constant(INDEX, lane))
        own.builder.ret(result)
    return value


def _pair(w: Writer, first: Any, second: Any) -> Any:
    empty = ir.Constant(ir.LiteralStructType([w.vector, w.vector]), ir.Undefined)
    return w.once("insert_value", w.once("insert_value", empty, first, 0), second, 1)


def _beyond(limit: float) -> Callable[..., Any]:
    """Return a function that returns the mask of the lanes where |x| > limit or x is NaN."""
    return lambda w, x: w.compare("ugt", w.size(x), w.splat(limit))


def _nowhere(w: Writer, _x: Any) -> Any:
    """Return an empty mask, for a formula that holds for all arguments."""
    return w.splat(False, BOOL)


def _sincos(w: Writer, x: Any) -> Any:
    """Return sin x and cos x from x = n pi/2 + r, |r| <= pi/4; n mod 4 decides exchange and signs of sin r, cos r."""
    n = w.intrinsic("rint", w.mul(x, w.splat(1.0 / HALF_PI[0])))
    r = x
    for part in HALF_PI:
        r = w.fma(n, w.splat(-part), r)
    z = w.mul(r, r)
    sine = w.fma(w.mul(r, z), w.horner(z, SIN), r)
    cosine = w.fma(z, w.fma(z, w.horner(z, COS), w.splat(-0.5)), w.splat(1.0))
    turns = w.once("fptosi", n, ir.VectorType(INDEX, w.width))
    odd = _bit(w, turns, 1)
    after = w.once("add", turns, w.splat(1, INDEX))
    return _pair(
        w,
        _negate_where(w, _bit(w, turns, 2), w.select(odd, cosine, sine)),
        _negate_where(w, _bit(w, after, 2), w.select(odd, sine, cosine)),
    )


def _bit(w: Writer, integers: Any, bit: int) -> Any:
    """Return the mask of the lanes whose integer has bit `bit`."""
    return w.once("icmp_signed", "!=", w.once("and_", integers, w.splat(bit, INDEX)), w.splat(0, INDEX))


def _negate_where(w: Writer, mask: Any, value: Any) -> Any:
    return w.select(mask, w.neg(value), value)


def _asin(w: Writer, x: Any) -> Any:
    """Return asin x; asin u = u + u R(u^2) of u = |x| up to 1/2; above: asin x = pi/2 - 2 asin sqrt((1 - x)/2)."""
    size = w.size(x)
    small = w.compare("ole", size, w.splat(0.5))
    half = w.mul(w.sub(w.splat(1.0), size), w.splat(0.5))
    z = w.select(small, w.mul(size, size), half)
    u = w.select(small, size, w.intrinsic("sqrt", half))
    ratio = w.div(w.mul(z, w.horner(z, ASIN_P)), w.horner(z, ASIN_Q))
    arc = w.fma(u, ratio, u)
    near_one = w.sub(w.splat(HALF_PI[0]), w.fma(w.splat(2.0), arc, w.splat(-HALF_PI[1])))
    return w.intrinsic("copysign", w.select(small, arc, near_one), x)


def _first_quadrant(w: Writer, a: Any, b: Any) -> Any:
    """Return atan(a/b) for a, b >= 0. (b, a) is first turned to within 22.5 degrees of the axis; one division."""
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


def _atan2(w: Writer, y: Any, x: Any) -> Any:
    """Return the angle of (|x|, |y|), or pi minus this angle for negative x, with the sign of y."""
    angle = _first_quadrant(w, w.size(y), w.size(x))
    behind = w.sub(w.splat(2.0 * HALF_PI[0]), w.sub(angle, w.splat(2.0 * HALF_PI[1])))
    left = w.compare("olt", x, w.splat(0.0))
    return w.intrinsic("copysign", w.select(left, behind, angle), y)


def _atan2_outside(w: Writer, y: Any, x: Any) -> Any:
    """Return the mask of the lanes where |y| + |x| is zero, tiny, huge or NaN."""
    size = w.add(w.size(y), w.size(x))
    return w.once("or_", w.compare("ult", size, w.splat(1e-280)), w.compare("ugt", size, w.splat(1e280)))


def _exp(w: Writer, x: Any) -> Any:
    """Return exp x as 2^n exp r with x = n ln 2 + r. exp r is Taylor's series up to r^13."""
    n = w.intrinsic("rint", w.mul(x, w.splat(1.0 / math.log(2.0))))
    r = w.fma(n, w.splat(-LN_2[1]), w.fma(n, w.splat(-LN_2[0]), x))
    whole = w.once("sext", w.once("fptosi", n, ir.VectorType(INDEX, w.width)), ir.VectorType(INT, w.width))
    bits = w.once("shl", w.once("add", whole, w.splat(1023, INT)), w.splat(52, INT))
    return w.mul(w.horner(r, EXP), w.once("bitcast", bits, w.vector))


def _log(w: Writer, x: Any) -> Any:
    """Return log x as k ln 2 + 2 atanh s with x = 2^k (1 + f), 1 + f in [sqrt(1/2), sqrt(2)], s = f/(2 + f)."""
    integers = ir.VectorType(INT, w.width)
    bits = w.once("bitcast", x, integers)
    above = w.once("sub", bits, w.splat(0x3FE6A09E667F3BCD, INT))  # the bits of sqrt(1/2)
    exponent = w.once("ashr", above, w.splat(52, INT))
    shifted = w.once("shl", exponent, w.splat(52, INT))
    mantissa = w.once("bitcast", w.once("sub", bits, shifted), w.vector)
    k = w.once("sitofp", w.once("trunc", exponent, ir.VectorType(INDEX, w.width)), w.vector)
    f = w.sub(mantissa, w.splat(1.0))
    s = w.div(f, w.add(f, w.splat(2.0)))
    z = w.mul(s, s)
    half_square = w.mul(w.mul(f, f), w.splat(0.5))
    series = w.mul(z, w.horner(z, LOG))
    correction = w.fma(k, w.splat(LN_2[1]), w.mul(s, w.add(half_square, series)))
    return w.sub(w.mul(k, w.splat(LN_2[0])), w.sub(w.sub(half_square, correction), f))


def _log_outside(w: Writer, x: Any) -> Any:
    """Return the mask of the lanes where x is not positive, tiny, huge or NaN."""
    return w.once("or_", w.compare("ult", x, w.splat(1e-300)), w.compare("ugt", x, w.splat(1e300)))


FORMULAS: dict[str, tuple[Callable[..., Any], Callable[..., Any]]] = {
    "sincos": (_beyond(1e6), _sincos),
    "asin": (_nowhere, _asin),
    "atan2": (_atan2_outside, _atan2),
    "exp": (_beyond(700.0), _exp),
    "log": (_log_outside, _log),
}
"""For each function, the mask of the arguments outside the valid range of the formula, and the formula."""
