"""Operations on numbers that several threads read and write, and the rest of a thread that waits."""

from typing import Any

from evac.jit import Intrinsic


def _raise_to(array: Any, k: int, value: int) -> int:
    before, array[k] = array[k], max(array[k], value)
    return int(before < value)


def _compile_claim(builder: Any, place: Any, value: Any) -> Any:
    before = builder.atomic_rmw("max", place, value, "seq_cst")
    return builder.zext(builder.icmp_signed("<", before, value), value.type)


def _compile_release(builder: Any, place: Any, value: Any) -> Any:
    builder.store_atomic(value, place, "release", 8)
    return value


def _compile_pause(builder: Any) -> Any:
    from llvmlite import ir

    number, triple = ir.IntType(32), builder.module.triple
    if triple.startswith(("x86", "i686")):
        kind = ir.FunctionType(ir.VoidType(), [])
        builder.call(builder.module.declare_intrinsic("llvm.x86.sse2.pause", (), kind), [])
    elif triple.startswith(("aarch64", "arm64")):
        kind = ir.FunctionType(ir.VoidType(), [number])
        builder.call(builder.module.declare_intrinsic("llvm.aarch64.hint", (), kind), [number(1)])
    return ir.IntType(64)(0)


#: Read and write number k of an array that another thread writes and reads: what it wrote before is seen after.
acquire = Intrinsic(
    "acquire", lambda array, k: array[k], lambda builder, place: builder.load_atomic(place, "acquire", 8)
)
release = Intrinsic("release", lambda array, k, value: array.__setitem__(k, value), _compile_release)

#: Raise number k of an array to a value; return 1, or 0 if it has that value already because another thread was faster.
claim = Intrinsic("claim", _raise_to, _compile_claim)

#: Let the processor rest for a moment in a loop that waits for another thread.
pause = Intrinsic("pause", lambda: 0, _compile_pause)
