"""Sixteen numbers at once: a compiled vector type, so that what is written is what the processor does.

A compiler turns loops into vector instructions only where it can prove that no array overlaps another. Here
nothing has to be proved: ``load`` takes a row of ``LANES`` numbers out of an array, ``+ - *`` and ``least``
work on all of them, ``store`` puts them back. Products that are added may be fused, all lanes alike: each
gives the same bits whatever is beside it. For compiled code only.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.core.cgutils import create_struct_proxy
from numba.core.typing.templates import AbstractTemplate, infer_global
from numba.extending import intrinsic, lower_builtin, models, register_model

LANES = 16
"""Numbers in a vector; a processor that has room for fewer takes them in parts."""

_VECTOR = ir.VectorType(ir.DoubleType(), LANES)
_ALIGNMENT = 8  # of the arrays [bytes]


class Vector(types.Type):
    """The type of a vector in compiled code."""

    def __init__(self) -> None:
        super().__init__(name=f"Float64x{LANES}")


VECTOR = Vector()


@register_model(Vector)
class _Model(models.PrimitiveModel):
    def __init__(self, manager: Any, of_type: Any) -> None:
        super().__init__(manager, of_type, _VECTOR)


def _row(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    """Return the pointer to a row of an array that is C-contiguous."""
    proxy = create_struct_proxy(signature.args[0])(context, builder, value=arguments[0])
    offset = builder.mul(arguments[1], ir.Constant(arguments[1].type, LANES))
    return builder.bitcast(builder.gep(proxy.data, [offset]), _VECTOR.as_pointer())


def _widened(builder: Any, value: Any) -> Any:
    """Return a vector of equal numbers for a single one."""
    if value.type == _VECTOR:
        return value
    alone = builder.insert_element(ir.Constant(_VECTOR, ir.Undefined), value, ir.IntType(32)(0))
    first = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
    return builder.shuffle_vector(alone, ir.Constant(_VECTOR, ir.Undefined), first)


@intrinsic
def load(_: Any, array: Any, _row_number: Any) -> Any:
    """Return row ``row`` of a contiguous array whose rows have LANES numbers."""

    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.load(_row(context, builder, signature, arguments), align=_ALIGNMENT)

    return VECTOR(array, types.intp), code


@intrinsic
def store(_: Any, array: Any, _row_number: Any, _vector: Any) -> Any:
    """Write a row of a contiguous array whose rows have LANES numbers."""

    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        builder.store(arguments[2], _row(context, builder, signature, arguments), align=_ALIGNMENT)
        return context.get_dummy_value()

    return types.void(array, types.intp, VECTOR), code


@intrinsic
def least(_: Any, _a: Any, _b: Any) -> Any:
    """Return the lesser of each two numbers, the second where one is NaN."""

    def code(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        a, b = arguments
        return builder.select(builder.fcmp_ordered("<", a, b), a, b)

    return VECTOR(VECTOR, VECTOR), code


@intrinsic
def strays(_: Any, _vector: Any, _low: Any, _high: Any) -> Any:
    """Return whether any of the numbers is below one or above the other, and finite."""

    def code(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        vector, low, high = (_widened(builder, each) for each in arguments)
        outside = builder.or_(builder.fcmp_ordered("<", vector, low), builder.fcmp_ordered(">", vector, high))
        finite = builder.fcmp_ordered("<", vector, ir.Constant(_VECTOR, [float("inf")] * LANES))
        mask = builder.bitcast(builder.and_(outside, finite), ir.IntType(LANES))
        return builder.icmp_unsigned("!=", mask, ir.Constant(mask.type, 0))

    return types.boolean(VECTOR, types.float64, types.float64), code


class _Arithmetic(AbstractTemplate):  # type: ignore[misc]
    """A vector and a vector, or a vector and a number, make a vector."""

    def generic(self, arguments: Any, _keywords: Any) -> Any:
        if VECTOR not in arguments:
            return None
        return VECTOR(*(each if each is VECTOR else types.float64 for each in arguments))


def _arithmetic(symbol: Callable[..., Any], instruction: str) -> None:
    def code(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        a, b = (_widened(builder, each) for each in arguments)
        return getattr(builder, instruction)(a, b, flags=("contract",))

    infer_global(symbol)(type("_Of" + instruction, (_Arithmetic,), {}))
    for pair in ((Vector, Vector), (Vector, types.Float), (types.Float, Vector)):
        lower_builtin(symbol, *pair)(code)


_arithmetic(operator.add, "fadd")
_arithmetic(operator.sub, "fsub")
_arithmetic(operator.mul, "fmul")
