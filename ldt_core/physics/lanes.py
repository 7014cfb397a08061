"""Eight numbers that the processor computes at once, as one number of compiled code.

`LANES` is a type of numba's: eight float64 in one register. Compiled code that is written for
floats (`integrate._rates`, an effect's law) is compiled for it as it stands, where it takes no
decision by a value. Each operation is the one of floats, lane by lane and without any rearranging,
so a lane's bits depend neither on its place nor on what is beside it, and are those of a float.

Sine, cosine, exponential and hyperbolic tangent are polynomials, since those of the C library take
one number at a time: exact to 2e-16 as these are, but not always the same last bit.
"""

from __future__ import annotations

import math
import operator
from typing import Any

from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.core.imputils import lower_builtin
from numba.core.typeconv import Conversion
from numba.core.typing.templates import ConcreteTemplate, infer_global, signature
from numba.extending import intrinsic, lower_cast, models, register_model

WIDTH = 8  # float64 in the widest registers, of 512 bits; narrower ones take two or four
BYTES_OF_LANES = 8 * WIDTH

# Of Cody and Waite: pi / 2 in parts of 33 bits, so that products with 20 bits are exact (fdlibm).
HALF_PI = (1.57079632673412561417, 6.07710050630396597660e-11, 2.02226624879595063154e-21)
LARGEST_ANGLE = 2.0**20  # rad; beyond, lanes are taken one by one
LN2 = (6.93147180369123816490e-01, 1.90821492927058770002e-10)  # the first with 33 bits (fdlibm)
MOST_EXPONENT, LEAST_EXPONENT = 709.0, -708.0  # of e, near the ends of the normal numbers
SATURATED = 20.0  # tanh is 1 to rounding beyond


class Lanes(types.Type):  # type: ignore[misc] # numba has no types
    """Eight float64."""

    def __init__(self) -> None:
        # Known by it in caches of machine code: another one where what lanes compute changes.
        super().__init__(name=f"Lanes{WIDTH}b")

    def can_convert_from(self, _typingctx: Any, other: Any) -> Any:
        """Every number is eight of it."""
        number = isinstance(other, (types.Float, types.Integer))
        return Conversion.safe if number else None

    def unify(self, _typingctx: Any, other: Any) -> Any:
        """A variable that is once a number and once lanes is lanes."""
        return self if isinstance(other, (types.Float, types.Integer)) else None


LANES = Lanes()
VECTOR = ir.VectorType(ir.DoubleType(), WIDTH)


@register_model(Lanes)
class LanesModel(models.PrimitiveModel):  # type: ignore[misc]
    """As the compiler holds them."""

    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, VECTOR)


def _splat(builder: Any, number: Any) -> Any:
    one = builder.insert_element(ir.Constant(VECTOR, ir.Undefined), number, ir.IntType(32)(0))
    zeros = ir.Constant(ir.VectorType(ir.IntType(32), WIDTH), [0] * WIDTH)
    return builder.shuffle_vector(one, one, zeros)


@lower_cast(types.Float, LANES)
@lower_cast(types.Integer, LANES)
def _from_number(context: Any, builder: Any, kind: Any, _to: Any, value: Any) -> Any:
    return _splat(builder, context.cast(builder, value, kind, types.float64))


def _operation(function: Any, lowered: Any, operands: int) -> None:
    class Typed(ConcreteTemplate):  # type: ignore[misc]
        cases = (signature(LANES, *[LANES] * operands),)

    infer_global(function)(Typed)

    @lower_builtin(function, *[LANES] * operands)
    def _(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        return lowered(builder, *args)


def _llvm(name: str) -> Any:
    def call(builder: Any, value: Any) -> Any:
        kind = ir.FunctionType(value.type, [value.type])
        full = name + (f".v{WIDTH}f64" if value.type == VECTOR else ".f64")
        return builder.call(cgutils.get_or_insert_function(builder.module, kind, full), [value])

    return call


for _name, _method in (("add", "fadd"), ("sub", "fsub"), ("mul", "fmul"), ("truediv", "fdiv")):
    for _function in (getattr(operator, _name), getattr(operator, f"i{_name}")):
        _operation(_function, lambda b, x, y, method=_method: getattr(b, method)(x, y), 2)
_operation(operator.neg, lambda b, x: b.fneg(x), 1)
_operation(operator.pos, lambda _, x: x, 1)
for _function in (abs, math.fabs):
    _operation(_function, _llvm("llvm.fabs"), 1)
_operation(math.sqrt, _llvm("llvm.sqrt"), 1)


@intrinsic
def whole(_typing, x):
    """The largest whole number that is not above, of each lane or of a float."""

    def lower(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        return _llvm("llvm.floor")(builder, args[0])

    return x(x), lower


@intrinsic
def where_less(_typing, a, b, yes, no):
    """`yes` where a < b, else `no`, also where either is not a number; lanes or floats."""

    def lower(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        return builder.select(builder.fcmp_ordered("<", args[0], args[1]), args[2], args[3])

    kind = LANES if LANES in (a, b, yes, no) else types.float64
    return kind(kind, kind, kind, kind), lower


_operation(max, lambda builder, a, b: builder.select(builder.fcmp_ordered("<", a, b), b, a), 2)
_operation(min, lambda builder, a, b: builder.select(builder.fcmp_ordered("<", b, a), b, a), 2)


@intrinsic
def any_less(_typing, a, b):
    """Whether a < b in any lane."""

    def lower(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        mask = builder.bitcast(builder.fcmp_ordered("<", *args), ir.IntType(WIDTH))
        return builder.icmp_unsigned("!=", mask, ir.IntType(WIDTH)(0))

    return types.boolean(LANES, LANES), lower


@intrinsic
def power_of_two(_typing, n):
    """2**n of whole numbers from -1022 to 1023."""

    def lower(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        bits = ir.VectorType(ir.IntType(64), WIDTH)
        biased = builder.add(builder.fptosi(args[0], bits), ir.Constant(bits, [1023] * WIDTH))
        return builder.bitcast(builder.shl(biased, ir.Constant(bits, [52] * WIDTH)), VECTOR)

    return LANES(LANES), lower


@intrinsic
def lanes_of(_typing, number):
    """Eight times the same number."""
    return LANES(types.float64), lambda _c, builder, _s, args: _splat(builder, args[0])


@intrinsic
def lane(_typing, x, i):
    """The number in lane i."""
    return types.float64(LANES, types.int64), lambda _c, b, _s, args: b.extract_element(*args)


@intrinsic
def with_lane(_typing, x, i, number):
    """The same with another number in lane i."""

    def lower(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        return builder.insert_element(args[0], args[2], args[1])

    return LANES(LANES, types.int64, types.float64), lower


def _place(context: Any, builder: Any, kind: Any, array: Any, i: Any) -> Any:
    data = context.make_array(kind)(context, builder, array).data
    here = builder.gep(data, [builder.mul(i, ir.IntType(64)(WIDTH))])
    return builder.bitcast(here, VECTOR.as_pointer())


@intrinsic
def load(_typing, array, i):
    """Lanes i of an array of eights, C-contiguous."""

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.load(_place(context, builder, sig.args[0], *args), align=8)

    return LANES(array, types.int64), lower


@intrinsic
def store(_typing, array, i, x):
    """Write lanes i of an array of eights."""

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        builder.store(args[2], _place(context, builder, sig.args[0], *args[:2]), align=8)
        return context.get_dummy_value()

    return types.none(array, types.int64, LANES), lower


# The functions of `math`, for lanes. A value that is no number stays none.


def _written(*kinds: Any) -> Any:
    """A decorator: what a function of `math` is for lanes."""

    def register(function: Any) -> Any:
        def decorate(body: Any) -> Any:
            class Typed(ConcreteTemplate):  # type: ignore[misc]
                cases = (signature(LANES, *kinds),)
                unsafe_casting = False  # numba would take an exponent of 0.5 for 0

            infer_global(function)(Typed)

            @lower_builtin(function, *kinds)
            def _(context: Any, builder: Any, sig: Any, args: Any) -> Any:
                return context.compile_internal(builder, body, sig, args)

            return body

        return decorate

    return register


@njit
def sine_and_cosine(x):  # pragma: no cover - compiled
    """Of lanes or of a float, up to LARGEST_ANGLE."""
    n = whole(x * (2 / math.pi) + 0.5)
    r = ((x - n * HALF_PI[0]) - n * HALF_PI[1]) - n * HALF_PI[2]
    q = r * r
    # Polynomials of fdlibm's k_sin.c and k_cos.c, for |r| <= pi / 4.
    s = -2.50507602534068634195e-08 + q * 1.58969099521155010221e-10
    s = -1.98412698298579493134e-04 + q * (2.75573137070700676789e-06 + q * s)
    s = r + r * q * (-1.66666666666666324348e-01 + q * (8.33333333332248946124e-03 + q * s))
    o = 2.08757232129817482790e-09 - q * 1.13596475577881948265e-11
    o = 2.48015872894767294178e-05 + q * (-2.75573143513906633035e-07 + q * o)
    o = 4.16666666666666019037e-02 + q * (-1.38888888888741095749e-03 + q * o)
    o = 1.0 - (0.5 * q - q * q * o)
    quarter = n - 4.0 * whole(0.25 * n)  # 0, 1, 2 or 3
    odd = quarter - 2.0 * whole(0.5 * quarter)
    sine, cosine = where_less(odd, 0.5, s, o), where_less(odd, 0.5, o, s)
    sine = where_less(quarter, 1.5, sine, -sine)
    between = abs(quarter - 1.5)  # the cosine is negative in quarters 1 and 2
    return sine, where_less(between, 1.0, -cosine, cosine)


@_written(LANES)(math.sin)
def _sine(x):  # pragma: no cover - compiled
    found = sine_and_cosine(x)[0]
    if any_less(LARGEST_ANGLE, abs(x)):
        for i in range(WIDTH):
            if abs(lane(x, i)) > LARGEST_ANGLE:
                found = with_lane(found, i, math.sin(lane(x, i)))
    return found


@_written(LANES)(math.cos)
def _cosine(x):  # pragma: no cover - compiled
    found = sine_and_cosine(x)[1]
    if any_less(LARGEST_ANGLE, abs(x)):
        for i in range(WIDTH):
            if abs(lane(x, i)) > LARGEST_ANGLE:
                found = with_lane(found, i, math.cos(lane(x, i)))
    return found


@njit
def _powers(x):  # pragma: no cover - compiled
    """2**n and exp(r) - 1, where x = n log 2 + r, |r| <= log 2 / 2."""
    n = whole(x * (1 / math.log(2)) + 0.5)
    r = (x - n * LN2[0]) - n * LN2[1]
    q = r * r
    even = 1 / 479001600.0 * q + 1 / 3628800.0
    even = 0.5 + q * (1 / 24.0 + q * (1 / 720.0 + q * (1 / 40320.0 + q * even)))
    odd = 1 / 6227020800.0 * q + 1 / 39916800.0
    odd = 1 / 6.0 + q * (1 / 120.0 + q * (1 / 5040.0 + q * (1 / 362880.0 + q * odd)))
    return power_of_two(n), r + q * (even + r * odd)


@_written(LANES)(math.exp)
def _exponential(x):  # pragma: no cover - compiled
    held = where_less(x, LEAST_EXPONENT, LEAST_EXPONENT, x)
    held = where_less(MOST_EXPONENT, held, MOST_EXPONENT, held)
    power, rest = _powers(held)
    found = where_less(x, LEAST_EXPONENT, 0.0, power + power * rest)
    return where_less(MOST_EXPONENT, x, math.inf, found)


@_written(LANES)(math.tanh)
def _tangent(x):  # pragma: no cover - compiled
    size = abs(x)
    if not any_less(size, SATURATED):  # dry friction of a shaft that turns: what follows gives 1
        return where_less(x, 0.0, -1.0, where_less(0.0, x, 1.0, x))
    size = where_less(SATURATED, size, SATURATED, size)
    power, rest = _powers(2.0 * size)
    grown = power * rest + (power - 1.0)
    found = grown / (grown + 2.0)
    return where_less(x, 0.0, -found, found)


@_written(LANES, types.int64)(operator.pow)
def _power(x, n):  # pragma: no cover - compiled
    result = lanes_of(1.0)
    left = abs(n)
    while left > 0:
        if left & 1:
            result = result * x
        x = x * x
        left >>= 1
    return 1.0 / result if n < 0 else result


@_written(LANES, types.float64)(operator.pow)
def _root(x, exponent):  # pragma: no cover - compiled
    found = x
    for i in range(WIDTH):
        found = with_lane(found, i, lane(x, i) ** exponent)
    return found
