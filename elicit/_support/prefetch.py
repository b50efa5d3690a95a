"""A hint to the processor that a row of an array will be read soon, for compiled loops.

A loop that reads rows in no order waits for memory at each of them, if the array is larger than the
processor's caches. With the hint, a row is on its way while earlier ones are worked on. It changes
no number.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic, overload


def prefetch(array: Any, row: Any) -> None:
    """Hint that ``array[row]`` will be read soon.

    ``row`` must not be negative. Interpreted code does nothing.
    """


@overload(prefetch)
def _compiled_prefetch(array: Any, row: Any) -> Any:
    def hint(array: Any, row: Any) -> None:
        _hint(array, row)

    return hint


def _row_fetched(typing: Any, array: Any, row: Any) -> Any:
    """Fetch the first and the last number of a row.

    A short row lies on at most two cache lines, so all of it is fetched.
    """
    tools: Any = cgutils  # numba's types are not known in all versions

    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        kind, number = signature.args
        made = context.make_array(kind)(context, builder, arguments[0])
        index = context.cast(builder, arguments[1], number, types.intp)
        strides = tools.unpack_tuple(builder, made.strides, kind.ndim)
        bytes_of, whole = ir.IntType(8).as_pointer(), ir.IntType(32)
        start = builder.bitcast(made.data, bytes_of)
        first = builder.gep(start, [builder.mul(index, strides[0])])
        called = ir.FunctionType(ir.VoidType(), [bytes_of, whole, whole, whole])
        fetch = tools.get_or_insert_function(builder.module, called, "llvm.prefetch.p0i8")
        to_read_and_keep_as_data = [ir.Constant(whole, number) for number in (0, 3, 1)]
        builder.call(fetch, [first, *to_read_and_keep_as_data])
        if kind.ndim > 1:
            width = context.get_abi_sizeof(context.get_value_type(kind.dtype))
            to_last = builder.sub(strides[0], ir.Constant(strides[0].type, width))
            builder.call(fetch, [builder.gep(first, [to_last]), *to_read_and_keep_as_data])
        return context.get_dummy_value()

    return types.void(array, row), code


_hint: Any = intrinsic(_row_fetched)
