"""Vectors as wide as the search range: up to 1024 lanes of 8 or 16 bits, cut into pieces that registers can hold.

How many lanes there are is part of numba's types, so a kernel is compiled for each width: it takes `lanes`, a tuple
of `lanes_for`, whose length counts the lanes in units of UNIT. What goes with it is in `vectors`: pointers, and the
rule that indices are not checked. Lanes wrap around in + - *; nothing here depends on the processor but its speed.
"""
from __future__ import annotations

import itertools
import operator
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic, models, overload, register_model

UNIT = 16
"""Lanes that one element of a `lanes` tuple stands for."""

_PIECES = (64, 32, 16)
"""Lanes that LLVM sees in one vector, the most first: one AVX-512 register of bytes. It splits powers of two well, and
nothing else."""

_STEPS = ((96, 32), (1024, 64))
"""(largest, step): search ranges up to `largest` are filled up to a multiple of `step` disparities. Longer vectors in
pieces of 32 take LLVM minutes."""

Lanes = tuple[int, ...]


def lanes_for(num_disparities: int) -> Lanes:
    """The tuple that stands for the narrowest vectors that hold a search range of 1 to 1024 disparities."""
    step = next(step for largest, step in _STEPS if num_disparities <= largest)
    return (0,) * (-(-num_disparities // step) * step // UNIT)


def width_of(lanes: Lanes) -> int:
    """The number of lanes; for Python, where kernels write `UNIT * len(lanes)`."""
    return UNIT * len(lanes)


class Wide(types.Type):
    """numba's type of a wide vector: `lanes` numbers of the integer type `element`, in equal pieces."""

    def __init__(self, element: Any, lanes: int) -> None:
        self.element, self.lanes = element, lanes
        self.piece = next(size for size in _PIECES if lanes % size == 0)
        self.pieces = lanes // self.piece
        super().__init__(name=f'Wide({element}, {lanes})')

    def piece_type(self) -> ir.VectorType:
        return ir.VectorType(ir.IntType(self.element.bitwidth), self.piece)

    def as_llvm(self) -> Any:
        return ir.ArrayType(self.piece_type(), self.pieces)


@register_model(Wide)
class _WideModel(models.PrimitiveModel):
    def __init__(self, manager: Any, wide: Wide) -> None:
        super().__init__(manager, wide, wide.as_llvm())


def wide_intrinsic(generator: Callable[..., Any]) -> Any:
    """numba's decorator, typed. Numbers written in the kernel arrive as literals."""
    return intrinsic(prefer_literal=True)(generator)


def _width(lanes: Any) -> int:
    return UNIT * int(lanes.count)


def split(builder: Any, value: Any, wide: Wide) -> list[Any]:
    return [builder.extract_value(value, k) for k in range(wide.pieces)]


def join(builder: Any, pieces: list[Any], wide: Wide) -> Any:
    whole = ir.Constant(wide.as_llvm(), ir.Undefined)
    for k, piece in enumerate(pieces):
        whole = builder.insert_value(whole, piece, k)
    return whole


def _constant(wide: Wide, value: int) -> ir.Constant:
    return ir.Constant(wide.piece_type(), [value] * wide.piece)


def _places(wide: Wide, elements: Any, index: Any, context: Any, builder: Any, kind: Any) -> list[Any]:
    """Addresses of the pieces in memory, from `index` on."""
    start = context.cast(builder, index, kind, types.intp)
    offsets = (ir.Constant(ir.IntType(64), k * wide.piece) for k in range(wide.pieces))
    to = wide.piece_type().as_pointer()
    return [builder.bitcast(builder.gep(elements, [builder.add(start, offset)]), to) for offset in offsets]


def loaded(context: Any, builder: Any, elements: Any, start: Any, offset: int, wide: Wide) -> Any:
    """In an intrinsic: the first piece of a vector from elements[start + offset] on."""
    at = builder.add(start, ir.Constant(ir.IntType(64), offset))
    return builder.load(_places(wide, elements, at, context, builder, types.intp)[0], align=1)


@wide_intrinsic
def load_wide(_: Any, elements: Any, index: Any, lanes: Any) -> Any:
    """The elements from `index` on."""
    wide = Wide(elements.dtype, _width(lanes))

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        places = _places(wide, arguments[0], arguments[1], context, builder, signature.args[1])
        return join(builder, [builder.load(place, align=1) for place in places], wide)

    return wide(elements, index, lanes), generate


@wide_intrinsic
def store_wide(_: Any, elements: Any, index: Any, value: Any) -> Any:
    """Write `value` to the elements from `index` on."""
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        places = _places(value, arguments[0], arguments[1], context, builder, signature.args[1])
        for place, piece in zip(places, split(builder, arguments[2], value), strict=True):
            builder.store(piece, place, align=1)
        return context.get_dummy_value()

    return types.void(elements, index, value), generate


@wide_intrinsic
def splat_wide(_: Any, value: Any, lanes: Any) -> Any:
    """One number in all lanes."""
    wide = Wide(types.unliteral(value), _width(lanes))

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return join(builder, [repeat(builder, arguments[0], wide)] * wide.pieces, wide)

    return wide(value, lanes), generate


def repeat(builder: Any, value: Any, wide: Wide) -> Any:
    nothing = ir.Constant(wide.piece_type(), ir.Undefined)
    first = builder.insert_element(nothing, value, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(first, nothing, ir.Constant(ir.VectorType(ir.IntType(32), wide.piece),
                                                              [0] * wide.piece))


def _lanewise(meaning: str, instruction: Callable[[Any, Wide, Any, Any], Any]) -> Any:
    """An intrinsic f(a, b) of two vectors of one type, piece by piece."""
    @wide_intrinsic
    def lanewise(_: Any, a: Any, b: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            pairs = zip(*(split(builder, value, a) for value in arguments), strict=True)
            return join(builder, [instruction(builder, a, *pair) for pair in pairs], a)

        return a(a, b), generate

    lanewise.__doc__ = meaning
    return lanewise


def _called(name: str) -> Callable[[Any, Wide, Any, Any], Any]:
    def call(builder: Any, wide: Wide, a: Any, b: Any) -> Any:
        kind = wide.piece_type()
        full = f'llvm.{name}.v{wide.piece}i{wide.element.bitwidth}'
        return builder.call(cgutils.get_or_insert_function(builder.module, ir.FunctionType(kind, [kind, kind]), full),
                            [a, b])
    return call


least_of, most_of = _called('umin'), _called('umax')
add_saturated = _lanewise('a + b of unsigned lanes, at most what a lane holds.', _called('uadd.sat'))
subtract_saturated = _lanewise('a - b of unsigned lanes, at least 0.', _called('usub.sat'))
minimum_wide = _lanewise('The smaller of each two unsigned lanes.', _called('umin'))
maximum_wide = _lanewise('The larger of each two unsigned lanes.', _called('umax'))
subtract_signed = _lanewise('a - b of signed lanes, at the nearest number that a lane holds.', _called('ssub.sat'))


def _rounded_mean(builder: Any, wide: Wide, a: Any, b: Any) -> Any:
    double = ir.VectorType(ir.IntType(2 * wide.element.bitwidth), wide.piece)
    one = ir.Constant(double, [1] * wide.piece)
    total = builder.add(builder.add(builder.zext(a, double), builder.zext(b, double)), one)
    return builder.trunc(builder.lshr(total, one), wide.piece_type())


average = _lanewise('(a + b + 1) / 2 of unsigned lanes, rounded down.', _rounded_mean)



def _overload_operator(symbol: Any, instruction: str) -> None:
    lanewise = _lanewise(instruction, lambda builder, _, a, b: getattr(builder, instruction)(a, b))

    @overload(symbol)
    def _(a, b):  # type: ignore[no-untyped-def]  # numba compares the signature with that of the lambda
        return (lambda a, b: lanewise(a, b)) if isinstance(a, Wide) and a == b else None


for _symbol, _instruction in ((operator.add, 'add'), (operator.sub, 'sub'), (operator.mul, 'mul'),
                              (operator.or_, 'or_'), (operator.and_, 'and_')):
    _overload_operator(_symbol, _instruction)


def _shifted(meaning: str, instruction: str) -> Any:
    """An intrinsic f(a, bits); bits is written in the kernel."""
    @wide_intrinsic
    def shifted(_: Any, a: Any, bits: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            count = _constant(a, bits.literal_value)
            return join(builder, [getattr(builder, instruction)(piece, count)
                                  for piece in split(builder, arguments[0], a)], a)

        return a(a, bits), generate

    shifted.__doc__ = meaning
    return shifted


shift_right = _shifted('Unsigned lanes divided by 2^bits.', 'lshr')
shift_right_signed = _shifted('Signed lanes divided by 2^bits, rounded down.', 'ashr')


@wide_intrinsic
def as_signed(_: Any, a: Any) -> Any:
    """The bits of uint16 as int16."""
    return Wide(types.int16, a.lanes)(a), lambda context, builder, signature, arguments: arguments[0]


@wide_intrinsic
def magnitude(_: Any, a: Any) -> Any:
    """|a| of int16, as uint16."""
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        pieces = []
        for piece in split(builder, arguments[0], a):
            nothing = ir.Constant(piece.type, [0] * a.piece)
            negative = builder.icmp_signed('<', piece, nothing)
            pieces.append(builder.select(negative, builder.sub(nothing, piece), piece))
        return join(builder, pieces, a)

    return Wide(types.uint16, a.lanes)(a), generate


@wide_intrinsic
def widen(_: Any, a: Any) -> Any:
    """uint8 as uint16."""
    wide = Wide(types.uint16, a.lanes)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        pieces = split(builder, arguments[0], a)
        return join(builder, [builder.zext(piece, wide.piece_type()) for piece in pieces], wide)

    return wide(a), generate


@wide_intrinsic
def narrow_wide(_: Any, a: Any) -> Any:
    """uint16 below 256 as uint8."""
    wide = Wide(types.uint8, a.lanes)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        pieces = split(builder, arguments[0], a)
        return join(builder, [builder.trunc(piece, wide.piece_type()) for piece in pieces], wide)

    return wide(a), generate


@wide_intrinsic
def absolute_difference(_: Any, a: Any, b: Any) -> Any:
    """|a - b| of int16 lanes, as uint16: exact, however far apart they are."""
    wide = Wide(types.uint16, a.lanes)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        pieces = []
        for x, y in zip(*(split(builder, value, a) for value in arguments), strict=True):
            less = builder.icmp_signed('<', x, y)
            pieces.append(builder.sub(builder.select(less, y, x), builder.select(less, x, y)))
        return join(builder, pieces, wide)

    return wide(a, b), generate


def _neighbours(meaning: str, below: bool) -> Any:
    """An intrinsic f(a): each lane takes its neighbour's value, the lane at the end the largest number there is."""
    @wide_intrinsic
    def neighbours(_: Any, a: Any) -> Any:
        indices = [a.piece - 1 + k if below else 1 + k for k in range(a.piece)]

        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            largest = _constant(a, (1 << a.element.bitwidth) - 1)
            pieces = split(builder, arguments[0], a)
            joined = [largest, *pieces] if below else [*pieces, largest]
            mask = ir.Constant(ir.VectorType(ir.IntType(32), a.piece), indices)
            return join(builder, [builder.shuffle_vector(*pair, mask)
                                   for pair in itertools.pairwise(joined)], a)

        return a(a), generate

    neighbours.__doc__ = meaning
    return neighbours


lanes_below = _neighbours('Lane k takes lane k - 1; lane 0 the largest number.', True)
lanes_above = _neighbours('Lane k takes lane k + 1; the last lane the largest number.', False)


def _reduce(builder: Any, name: str, vector: Any) -> Any:
    kind = vector.type
    full = f'llvm.vector.reduce.{name}.v{kind.count}i{kind.element.width}'
    function = cgutils.get_or_insert_function(builder.module, ir.FunctionType(kind.element, [kind]), full)
    return builder.call(function, [vector])


@wide_intrinsic
def least_wide(_: Any, a: Any) -> Any:
    """The smallest of unsigned lanes."""
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        pieces = split(builder, arguments[0], a)
        smallest = pieces[0]
        for piece in pieces[1:]:
            smallest = _called('umin')(builder, a, smallest, piece)
        return _reduce(builder, 'umin', smallest)

    return a.element(a), generate


@wide_intrinsic
def sum_wide(_: Any, a: Any) -> Any:
    """The sum of unsigned lanes, uint32."""
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        double = ir.VectorType(ir.IntType(32), a.piece)
        pieces = [builder.zext(piece, double) for piece in split(builder, arguments[0], a)]
        total = pieces[0]
        for piece in pieces[1:]:
            total = builder.add(total, piece)
        return _reduce(builder, 'add', total)

    return types.uint32(a), generate


@wide_intrinsic
def first_equal_wide(_: Any, a: Any, value: Any) -> Any:
    """The first lane that equals `value`, int32; there must be one."""
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        wanted, first = repeat(builder, arguments[1], a), ir.Constant(ir.IntType(32), 0)
        pieces = split(builder, arguments[0], a)
        for k in range(a.pieces - 1, -1, -1):
            mask = builder.bitcast(builder.icmp_unsigned('==', pieces[k], wanted), ir.IntType(a.piece))
            lane = builder.cttz(mask, ir.Constant(ir.IntType(1), 0))
            if a.piece != 32:
                lane = (builder.trunc if a.piece > 32 else builder.zext)(lane, ir.IntType(32))
            here = builder.add(lane, ir.Constant(ir.IntType(32), k * a.piece))
            none = builder.icmp_unsigned('==', mask, ir.Constant(mask.type, 0))
            first = builder.select(none, first, here)
        return first

    return types.int32(a, value), generate


def _where(meaning: str, condition: str) -> Any:
    """An intrinsic f(a, b, then): `then` in the lanes in which a and b meet the condition, else 0."""
    @wide_intrinsic
    def where(_: Any, a: Any, b: Any, then: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            zero = _constant(then, 0)
            compare = builder.icmp_signed if a.element.signed else builder.icmp_unsigned
            pieces = zip(*(split(builder, value, kind) for value, kind in zip(arguments, (a, b, then), strict=True)),
                         strict=True)
            return join(builder, [builder.select(compare(condition, x, y), value, zero)
                                   for x, y, value in pieces], then)

        return then(a, b, then), generate

    where.__doc__ = meaning
    return where


where_less = _where('f(a, b, then): `then` in the lanes in which a < b, else 0.', '<')
where_at_most = _where('f(a, b, then): `then` in the lanes in which a <= b, else 0.', '<=')
where_equal_wide = _where('f(a, b, then): `then` in the lanes in which a == b, else 0.', '==')
