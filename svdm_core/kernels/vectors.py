"""Vectors of fixed length for numba kernels: what LLVM calls <16 x float>.

numba leaves it to LLVM to find vector instructions, and for rows of sixteen disparities it often finds none.
These types spell them out; LLVM splits them up where the processor's registers are shorter. Kernels take the
`pointer` of a contiguous array, `load(pointer, index)`, compute with + - * ^ and the functions below, and
`store(pointer, index, vector)`; indices are not checked. Pointers also go to small functions called in the loop,
which arrays must not: numba counts their references at each call. Products and sums are rounded one by one, so every
processor gives the same bits.
"""
from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic, models, overload, register_model

# Lanes of a vector by the type of its elements: one AVX-512 register, or two for 64 bits.
_LANES = {types.uint8: 16, types.float32: 16, types.int16: 16, types.int32: 16, types.uint64: 16, types.uint16: 32}


def _intrinsic(generator: Callable[..., Any]) -> Any:
    """numba's decorator, typed: what it makes is called without the typing context."""
    return intrinsic(generator)


class Vector(types.Type):
    """numba's type of a vector: `lanes` numbers of the type `element`."""

    def __init__(self, element: Any, lanes: int) -> None:
        self.element, self.lanes = element, lanes
        super().__init__(name=f'Vector({element}, {lanes})')

    @property
    def is_float(self) -> bool:
        return self.element in types.real_domain

    def as_llvm(self) -> ir.VectorType:
        return ir.VectorType(ir.FloatType() if self.is_float else ir.IntType(self.element.bitwidth), self.lanes)


@register_model(Vector)
class _VectorModel(models.PrimitiveModel):
    def __init__(self, manager: Any, vector: Vector) -> None:
        super().__init__(manager, vector, vector.as_llvm())


@_intrinsic
def pointer(_: Any, array: Any) -> Any:
    """Where the elements of `array` begin; may be indexed.

    Only of arrays that are arguments of the kernel: numba frees a local array behind its last use, and does not
    count the pointer as one.
    """
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return context.make_array(signature.args[0])(context, builder, arguments[0]).data

    return types.CPointer(array.dtype)(array), generate


@_intrinsic
def load(_: Any, elements: Any, index: Any) -> Any:
    """The elements from `index` on."""
    vector = Vector(elements.dtype, _LANES[elements.dtype])

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        address = _address(context, builder, signature.args[1], arguments[:2], vector)
        return builder.load(address, align=vector.element.bitwidth // 8)

    return vector(elements, index), generate


@_intrinsic
def store(_: Any, elements: Any, index: Any, vector: Any) -> Any:
    """Write `vector` to the elements from `index` on."""
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        address = _address(context, builder, signature.args[1], arguments[:2], vector)
        builder.store(arguments[2], address, align=vector.element.bitwidth // 8)
        return context.get_dummy_value()

    return types.void(elements, index, vector), generate


def _address(context: Any, builder: Any, kind: Any, values: Any, vector: Vector) -> Any:
    index = context.cast(builder, values[1], kind, types.intp)
    return builder.bitcast(builder.gep(values[0], [index]), vector.as_llvm().as_pointer())


@_intrinsic
def splat(_: Any, value: Any) -> Any:
    """A vector of one number, repeated."""
    vector = Vector(value, _LANES[value])

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return _splat(builder, arguments[0], vector.as_llvm())

    return vector(value), generate


def _splat(builder: Any, value: Any, kind: ir.VectorType) -> Any:
    nothing = ir.Constant(kind, ir.Undefined)
    first = builder.insert_element(nothing, value, ir.Constant(ir.IntType(32), 0))
    lanes = ir.Constant(ir.VectorType(ir.IntType(32), kind.count), [0] * kind.count)
    return builder.shuffle_vector(first, nothing, lanes)


def _overload_operator(symbol: Any, on_floats: str, on_integers: str) -> None:
    """Let kernels write `a + b`: `on_floats` and `on_integers` name llvmlite's instructions."""
    @_intrinsic
    def lanewise(_: Any, a: Any, b: Any) -> Any:
        instruction = on_floats if a.is_float else on_integers

        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            return getattr(builder, instruction)(*arguments)

        return a(a, b), generate

    @overload(symbol)
    def _(a, b):  # type: ignore[no-untyped-def]  # numba compares the signature with that of the lambda
        return (lambda a, b: lanewise(a, b)) if isinstance(a, Vector) and a == b else None


_overload_operator(operator.add, 'fadd', 'add')
_overload_operator(operator.sub, 'fsub', 'sub')
_overload_operator(operator.mul, 'fmul', 'mul')
_overload_operator(operator.xor, '', 'xor')
_overload_operator(operator.or_, '', 'or_')


@_intrinsic
def minimum(_: Any, a: Any, b: Any) -> Any:
    """The smaller of each two lanes."""
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        if a.is_float:
            less = builder.fcmp_ordered('<', *arguments)
        else:
            less = (builder.icmp_signed if a.element.signed else builder.icmp_unsigned)('<', *arguments)
        return builder.select(less, *arguments)

    return a(a, b), generate


@_intrinsic
def absolute(_: Any, a: Any) -> Any:
    """|a| of floats."""
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return _call(builder, 'llvm.fabs', a.as_llvm(), a.as_llvm(), f'v{a.lanes}f32', arguments)

    return a(a), generate


@_intrinsic
def count_ones(_: Any, a: Any) -> Any:
    """Bits set in each lane."""
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return _call(builder, 'llvm.ctpop', a.as_llvm(), a.as_llvm(), f'v{a.lanes}i{a.element.bitwidth}', arguments)

    return a(a), generate


@_intrinsic
def to_float(_: Any, a: Any) -> Any:
    """Integers below 2^31 as float32."""
    vector = Vector(types.float32, a.lanes)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        whole = ir.VectorType(ir.IntType(32), a.lanes)
        value = arguments[0]
        if a.element.bitwidth < 32:
            value = (builder.sext if a.element.signed else builder.zext)(value, whole)
        elif a.element.bitwidth > 32:
            value = builder.trunc(value, whole)
        return builder.sitofp(value, vector.as_llvm())

    return vector(a), generate


@_intrinsic
def where_equal(_: Any, a: Any, b: Any, then: Any, otherwise: Any) -> Any:
    """`then` in the lanes in which the integers a and b are equal, else `otherwise`."""
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.select(builder.icmp_signed('==', *arguments[:2]), *arguments[2:])

    return then(a, b, then, otherwise), generate


@_intrinsic
def smallest(_: Any, a: Any) -> Any:
    """(bits, lane) of the smallest of float32 >= 0: int32 bits, which order like the floats; the first of equals."""
    result = types.UniTuple(types.int32, 2)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        bits = builder.bitcast(arguments[0], ir.VectorType(ir.IntType(32), a.lanes))
        smallest = _least(builder, bits, 'smin')
        return context.make_tuple(builder, result, [smallest, _first_equal(builder, bits, smallest)])

    return result(a), generate


@_intrinsic
def lane_sum(_: Any, a: Any) -> Any:
    """The sum of all lanes of floats, in an order that the processor may choose."""
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        kind = ir.FunctionType(ir.FloatType(), [ir.FloatType(), a.as_llvm()])
        add = cgutils.get_or_insert_function(builder.module, kind, f'llvm.vector.reduce.fadd.v{a.lanes}f32')
        return builder.call(add, [ir.Constant(ir.FloatType(), 0.0), arguments[0]], fastmath=('reassoc',))

    return a.element(a), generate


def _least(builder: Any, vector: Any, order: str) -> Any:
    kind = vector.type
    suffix = f'v{kind.count}i{kind.element.width}'
    return _call(builder, f'llvm.vector.reduce.{order}', kind.element, kind, suffix, [vector])


def _first_equal(builder: Any, vector: Any, value: Any) -> Any:
    equal = builder.icmp_signed('==', vector, _splat(builder, value, vector.type))
    mask = builder.zext(builder.bitcast(equal, ir.IntType(vector.type.count)), ir.IntType(64))
    end = ir.Constant(ir.IntType(64), 1 << vector.type.count)  # found where nothing is
    lane = builder.cttz(builder.or_(mask, end), ir.Constant(ir.IntType(1), 1))
    return builder.trunc(lane, ir.IntType(32))


def _call(builder: Any, name: str, returned: Any, taken: Any, suffix: str, arguments: Any) -> Any:
    function = cgutils.get_or_insert_function(builder.module, ir.FunctionType(returned, [taken]), f'{name}.{suffix}')
    return builder.call(function, arguments)
