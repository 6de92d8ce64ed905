"""Wide vectors where LLVM must be told which instruction to take: the same numbers everywhere, sooner on some."""
from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba.core import cgutils

from .wide import Wide, join, repeat, split, wide_intrinsic

_NIBBLE_DISTANCES = [(a ^ b).bit_count() for a in range(16) for b in range(16)]


@wide_intrinsic
def multiply_high(_: Any, a: Any, b: Any) -> Any:
    """The upper half of the products of unsigned lanes."""
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        listed = a.element.bitwidth == 16 and 'avx2' in _processor(context)
        product = _high_product_avx2 if listed else _high_product
        pairs = zip(*(split(builder, value, a) for value in arguments), strict=True)
        return join(builder, [product(builder, *pair) for pair in pairs], a)

    return a(a, b), generate


def _high_product(builder: Any, a: Any, b: Any) -> Any:
    bits = a.type.element.width
    double = ir.VectorType(ir.IntType(2 * bits), a.type.count)
    product = builder.mul(builder.zext(a, double), builder.zext(b, double))
    return builder.trunc(builder.lshr(product, ir.Constant(double, [bits] * a.type.count)), a.type)


def _high_product_avx2(builder: Any, a: Any, b: Any) -> Any:
    """The instruction by name: LLVM makes 32-bit products, ten times slower, of several multiplications in a row."""
    register = ir.VectorType(ir.IntType(16), 16)
    multiply = cgutils.get_or_insert_function(builder.module, ir.FunctionType(register, [register, register]),
                                              'llvm.x86.avx2.pmulhu.w')
    parts = [builder.call(multiply, [_lanes_of(builder, value, start, 16) for value in (a, b)])
             for start in range(0, a.type.count, 16)]
    while len(parts) > 1:
        parts = [_joined(builder, *pair) for pair in zip(parts[::2], parts[1::2], strict=True)]
    return parts[0]


def _lanes_of(builder: Any, vector: Any, start: int, count: int) -> Any:
    """Lanes start .. start + count - 1 of a vector."""
    lanes = ir.Constant(ir.VectorType(ir.IntType(32), count), [*range(start, start + count)])
    return builder.shuffle_vector(vector, ir.Constant(vector.type, ir.Undefined), lanes)


def _joined(builder: Any, low: Any, high: Any) -> Any:
    """Two vectors behind each other."""
    count = 2 * low.type.count
    return builder.shuffle_vector(low, high, ir.Constant(ir.VectorType(ir.IntType(32), count), [*range(count)]))


@wide_intrinsic
def differing_bits(_: Any, own: Any, nibbles: Any) -> Any:
    """How many of four bits of each lane differ from those of the number `own`; both uint8 below 16."""
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        pieces = split(builder, arguments[1], nibbles)
        if nibbles.piece >= 32 and 'avx2' in _processor(context):
            table = _nibble_table(builder, arguments[0])
            found = [_look_up(builder, table, piece) for piece in pieces]
        else:
            wanted = repeat(builder, arguments[0], nibbles)
            found = [_bits_set(builder, nibbles, builder.xor(piece, wanted)) for piece in pieces]
        return join(builder, found, nibbles)

    return nibbles(own, nibbles), generate


def _processor(context: Any) -> str:
    """Name and features of the processor that is compiled for."""
    _, name, features = context.codegen().magic_tuple()
    return f'{name} {features}'.replace('-avx2', '')


def _bits_set(builder: Any, wide: Wide, piece: Any) -> Any:
    kind = wide.piece_type()
    function = cgutils.get_or_insert_function(builder.module, ir.FunctionType(kind, [kind]),
                                              f'llvm.ctpop.v{wide.piece}i8')
    return builder.call(function, [piece])


def _nibble_table(builder: Any, own: Any) -> Any:
    """<32 x i8>: the distances of `own` from 0 to 15, twice."""
    name, kind = 'svdm.nibble.distances', ir.ArrayType(ir.IntType(8), 256)
    table = builder.module.globals.get(name)
    if table is None:
        table = ir.GlobalVariable(builder.module, kind, name)
        table.linkage, table.global_constant, table.align = 'internal', True, 16
        table.initializer = ir.Constant(kind, _NIBBLE_DISTANCES)
    start = builder.shl(builder.zext(own, ir.IntType(64)), ir.Constant(ir.IntType(64), 4))
    row = ir.VectorType(ir.IntType(8), 16)
    place = builder.bitcast(builder.gep(table, [ir.Constant(ir.IntType(64), 0), start]), row.as_pointer())
    twice = ir.Constant(ir.VectorType(ir.IntType(32), 32), [*range(16), *range(16)])
    return builder.shuffle_vector(builder.load(place, align=16), ir.Constant(row, ir.Undefined), twice)


def _look_up(builder: Any, table: Any, indices: Any) -> Any:
    """AVX2's shuffle of bytes as a table of 16 entries."""
    half = ir.VectorType(ir.IntType(8), 32)
    shuffle = cgutils.get_or_insert_function(builder.module, ir.FunctionType(half, [half, half]),
                                              'llvm.x86.avx2.pshuf.b')
    parts = [builder.call(shuffle, [table, _lanes_of(builder, indices, start, 32)])
             for start in range(0, indices.type.count, 32)]
    return parts[0] if len(parts) == 1 else _joined(builder, *parts)
