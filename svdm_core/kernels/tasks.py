"""Tasks that all threads draw from: which thread does which is chance, what comes out is not."""
from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.core.typing.templates import signature as signature_of
from numba.extending import intrinsic
from numba.np.arrayobj import make_array, populate_array
from numba.np.ufunc import parallel

_CACHE_LINE = 64  # bytes
_INT64, _BYTES = ir.IntType(64), ir.IntType(8).as_pointer()
_POINTERS = _BYTES.as_pointer()
_LOOP = ir.FunctionType(ir.VoidType(), [_POINTERS, _INT64.as_pointer(), _INT64.as_pointer(), _BYTES])
_PARALLEL_FOR = ir.FunctionType(ir.VoidType(), [_BYTES] * 5 + [_INT64] * 3)


@intrinsic
def _share(_: Any, body: Any, counter: Any, end: Any, arenas: Any, arguments: Any) -> Any:
    arena = types.Array(arenas.dtype, 1, 'C')
    own = signature_of(types.none, types.int64, arena, *arguments.types)
    parallel._launch_threads()  # which makes numba_parallel_for known
    generate = _Generator(body.dispatcher, own).generate
    return types.none(body, counter, types.int64, arenas, arguments), generate


share: Any = _share
"""share(body, counter, end, arenas, arguments), in kernels: body(task, arena, *arguments) for each task from counter[0]
to end - 1. As many workers as `arenas` has rows draw them, each with its row as scratch; they run on as many threads as
numba.set_num_threads says, which must have been called: it starts them. counter: int64 (1).

numba.prange would do the same, but takes seconds to compile each loop.
"""


class _Generator:
    """Makes the code of one `share`.

    numba's threads run a generalised ufunc, loop(arguments, dimensions, steps, data), over dimensions[0] elements, of
    which `arguments` point to the first, `steps` bytes apart. Here an element is a worker: the first argument is its
    number itself, the second points to the structure that holds what they share.
    """

    def __init__(self, body: Any, own: Any) -> None:
        """body: dispatcher of the kernel; own: its signature."""
        self._body, self._own = body, own

    def generate(self, context: Any, builder: Any, signature: Any, values: Any) -> Any:
        """Pack the structure, have the threads started on it, wait."""
        _, counter, end, arenas, arguments = values
        _, self._counter_type, _, self._arenas_type, self._arguments_type = signature.args
        workers = builder.extract_value(make_array(self._arenas_type)(context, builder, arenas).shape, 0)
        lent = _lent(context, builder, self._arguments_type, arguments)
        shared = cgutils.alloca_once_value(
            builder, cgutils.pack_struct(builder, [counter, end, arenas, lent, _INT64(0)]))
        loop = self._loop(context, builder.module, shared.type)
        firsts = _pair(builder, _BYTES(None), builder.bitcast(shared, _BYTES))
        steps = _pair(builder, _INT64(1), _INT64(0))
        pointers = [loop, firsts, cgutils.alloca_once_value(builder, workers), steps]
        start = cgutils.get_or_insert_function(builder.module, _PARALLEL_FOR, 'numba_parallel_for')
        number = cgutils.get_or_insert_function(builder.module, ir.FunctionType(_INT64, []), 'get_num_threads')
        builder.call(start, [*(builder.bitcast(pointer, _BYTES) for pointer in pointers), _BYTES(None),
                             _INT64(0), _INT64(2), builder.call(number, [])])
        failed = builder.load(cgutils.gep_inbounds(builder, shared, 0, 4))
        with cgutils.if_unlikely(builder, cgutils.is_not_null(builder, failed)):
            context.call_conv.return_user_exc(builder, RuntimeError, ('a kernel failed in one of its threads',))
        return context.get_dummy_value()

    def _loop(self, context: Any, module: Any, shared_type: Any) -> Any:
        function = ir.Function(module, _LOOP, module.get_unique_name('svdm_workers'))
        function.linkage = 'internal'
        builder = ir.IRBuilder(function.append_basic_block('entry'))
        arguments, dimensions, _, _ = function.args
        first = builder.ptrtoint(builder.load(arguments), _INT64)
        shared = builder.bitcast(builder.load(builder.gep(arguments, [_INT64(1)])), shared_type)
        with cgutils.for_range(builder, builder.load(dimensions)) as each:
            self._work(context, builder, shared, builder.add(first, each.index))
        builder.ret_void()
        return function

    def _work(self, context: Any, builder: Any, shared: Any, worker: Any) -> None:
        """Draw tasks until there are none."""
        counter, end, arenas, arguments, _ = cgutils.unpack_tuple(builder, builder.load(shared))
        arena = self._arena(context, builder, arenas, worker)
        own = [arena, *(builder.extract_value(arguments, n) for n in range(len(self._arguments_type)))]
        next_task = make_array(self._counter_type)(context, builder, counter).data
        again, found, done = (builder.append_basic_block(name) for name in ('again', 'found', 'done'))
        builder.branch(again)
        builder.position_at_end(again)
        task = builder.atomic_rmw('add', next_task, _INT64(1), 'monotonic')
        builder.cbranch(builder.icmp_signed('<', task, end), found, done)
        builder.position_at_end(found)
        self._call(context, builder, shared, [task, *own])
        builder.branch(again)
        builder.position_at_end(done)

    def _arena(self, context: Any, builder: Any, arenas: Any, worker: Any) -> Any:
        """A row of `arenas`, as an array."""
        whole = make_array(self._arenas_type)(context, builder, arenas)
        _, size = cgutils.unpack_tuple(builder, whole.shape)
        place = builder.gep(whole.data, [builder.mul(worker, size)])
        row = make_array(self._own.args[1])(context, builder)
        populate_array(row, data=place, shape=[size], strides=[whole.itemsize], itemsize=whole.itemsize, meminfo=None)
        return row._getvalue()

    def _call(self, context: Any, builder: Any, shared: Any, values: Any) -> None:
        compiled = self._body.get_compile_result(self._own)
        context.active_code_library.add_linking_library(compiled.library)
        status, _ = context.call_internal_no_propagate(builder, compiled.fndesc, self._own, values)
        with cgutils.if_unlikely(builder, status.is_error):
            builder.store(_INT64(1), cgutils.gep_inbounds(builder, shared, 0, 4))


def _lent(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    """A value whose arrays do not count references, which threads would do on one and the same place in memory."""
    if isinstance(kind, types.Array):
        array = make_array(kind)(context, builder, value)
        array.meminfo, array.parent = _BYTES(None), _BYTES(None)
        return array._getvalue()
    if isinstance(kind, types.BaseTuple):
        members: Any = kind
        for number, member in enumerate(members):
            lent = _lent(context, builder, member, builder.extract_value(value, number))
            value = builder.insert_value(value, lent, number)
    return value


def _pair(builder: Any, first: Any, second: Any) -> Any:
    """Where two values stand one after the other."""
    place = cgutils.alloca_once(builder, first.type, 2)
    builder.store(first, place)
    builder.store(second, builder.gep(place, [_INT64(1)]))
    return place


def do_tasks(run: Callable[..., None], tasks: int, *arguments: Any, scratch: int = 0) -> None:
    """Call `run(counter, end, arenas, *arguments)`, a kernel that shares them; scratch: bytes that a task takes."""
    run(np.zeros(1, np.int64), tasks, np.zeros((numba.get_num_threads(), whole_lines(scratch)), np.uint8), *arguments)


def whole_lines(size: int) -> int:
    """`size` in bytes, rounded up so that what comes behind it begins with a cache line."""
    return -(-size // _CACHE_LINE) * _CACHE_LINE
