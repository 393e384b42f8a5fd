"""Kernels from Python's side: signatures, what calls refuse, and the same numbers with and without compilation."""

import json
import math
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from evac.base.errors import PluginError
from evac.jit import (
    AddressCall,
    FloatGrid,
    Floats,
    Ints,
    Pairs,
    Struct,
    fused,
    inlined,
    inner,
    kernel,
    row,
)


class Scales(Struct):
    """Numbers that kernels change."""

    factor: float
    calls: int


@inner
def smallest(values):
    found = math.inf
    for i in range(len(values)):
        found = min(found, values[i], abs(values[i]) + 1.0)
    return found


@inner
def halves(x):
    return 0.5 * x, x // 2


@kernel
def mixed(values: Floats, pairs: Pairs, counts: Ints, grid: FloatGrid, scales: Scales, n: int, x: float) -> float:
    """Everything that kernels can use, in one."""
    scales.calls += 1
    total = fused(x, scales.factor, smallest(values))
    for i in range(n - 1, -1, -1):
        half, whole = halves(pairs[i, 0])
        if not math.isfinite(half) or i == 2:
            continue
        total += max(half, whole, -1.0) + math.exp(-(pairs[i, 1] ** 2)) + math.hypot(pairs[i, 0], 3.0)
        counts[i] = int(total) % 7
        pairs[i, 1] = total if total > 0.0 else -total
    while total > 1.0:
        total /= scales.factor
    line = row(grid, 1)
    for k in range(grid.shape[1]):
        total += line[k] * math.sqrt(abs(math.sin(float(k)))) + math.atan2(total, 1.0)
        line[k] = total
    return total + (n << 2) + (counts[0] & 1)


@kernel
def is_above(x: float, limit: float) -> bool:
    return x > limit


@kernel
def add_one(counts: Ints) -> None:
    for i in range(counts.shape[0]):
        counts[i] += 1


call_two = AddressCall([float, Scales], (float,))


@kernel
def times(x: float, scales: Scales) -> float:
    return x * scales.factor


@kernel
def plus(x: float, scales: Scales) -> float:
    return x + scales.factor


@kernel
def call_at(address: int, x: float, scales: Scales) -> float:
    return call_two(address, x, scales)


def outcome():
    """Return what the kernels of this module compute, as numbers."""
    random = np.random.default_rng(5)
    values, pairs, grid = random.normal(size=9), random.normal(0.0, 2.0, (6, 2)), random.normal(size=(3, 5))
    counts, scales = np.arange(6, dtype=np.int32), Scales(factor=1.75, calls=0)
    pairs[4, 0] = np.inf
    found = [mixed(values, pairs, counts, grid, scales, 6, 0.3), float(is_above(2.0, 1.0)), float(is_above(1.0, 1.0))]
    found += [call_at(which.address, 3.0, scales) for which in (times, plus)]
    add_one(counts)
    return [*found, scales.factor, float(scales.calls), *pairs.ravel(), *grid.ravel(), *counts.astype(float)]


def test_kernels_compute_what_their_python_functions_do():
    """In an interpreter that compiles nothing; to the last bit but for what is rounded once, and for libm."""
    done = subprocess.run(
        [sys.executable, "-c", "import json; from tests.jit.test_kernels import outcome; print(json.dumps(outcome()))"],
        env=os.environ | {"NUMBA_DISABLE_JIT": "1", "PYTHONPATH": str(Path(__file__).parents[2])},
        capture_output=True,
        text=True,
        check=True,
        timeout=300,
    )
    np.testing.assert_allclose(outcome(), json.loads(done.stdout), rtol=1e-14, atol=1e-15)


@pytest.mark.parametrize("wrong", [(2.0,), (2.0, 3.0), (2.0, None), (2.0, np.zeros(2)), ("2", Scales)])
def test_a_call_is_refused_also_after_calls_with_the_same_kernel(wrong):
    scales = Scales(factor=1.5, calls=0)
    for _ in range(2):  # the second call knows the types
        assert [times(x, scales) for x in (2.0, 2, np.float64(2.0), np.int64(2), True)] == [3.0] * 4 + [1.5]
        with pytest.raises((TypeError, ValueError)):
            times(*wrong)


def test_a_fused_product_is_rounded_once():
    # 1 - 2^-60 has no double of its own: a product rounded by itself is 1, and the sum zero.
    assert fuse(1.0 + 2.0**-30, 1.0 - 2.0**-30, -1.0) == -(2.0**-60)
    assert fuse(3.0, 4.0, 5.0) == 17.0


@kernel
def fuse(a: float, b: float, c: float) -> float:
    return fused(a, b, c)


@kernel
def extremes(a: float, b: float, found: Floats) -> None:
    found[0], found[1] = min(a, b), max(a, b)


@pytest.mark.parametrize(("a", "b"), [(1.0, 2.0), (math.nan, 1.0), (1.0, math.nan), (0.0, -0.0), (-math.inf, math.nan)])
def test_min_and_max_are_those_of_python(a, b):
    found = np.zeros(2)
    extremes(a, b, found)
    np.testing.assert_array_equal(found, [min(a, b), max(a, b)])
    np.testing.assert_array_equal(np.signbit(found), np.signbit([min(a, b), max(a, b)]))


def test_whole_numbers_are_passed_for_numbers_and_the_other_way_round():
    assert fuse(3, 4, 5) == 17.0
    assert is_above(np.float64(2.0), np.int32(1)) == 1


# Signatures


def test_a_signature_is_that_of_the_annotations():
    arguments, returned = mixed.signature
    assert [name for name, _ in arguments] == ["values", "pairs", "counts", "grid", "scales", "n", "x"]
    assert [kind for _, kind in arguments][4:] == [Scales, "int64", "float64"]
    assert returned == ("float64",)
    assert is_above.signature[1] == ("int64",)
    assert add_one.signature[1] == ()


def test_what_an_address_is_called_with_is_what_the_kernel_takes():
    call_two.check(times, "times", None)
    for odd in (add_one, smallest, fuse, None, math.sin):
        with pytest.raises(PluginError, match=r"^part: must be a kernel \(float64, Scales\) -> \(float64\)"):
            call_two.check(odd, "part", None)


@inlined
def triple(x):
    return 3.0 * x


@kernel
def six_and_nine_times(x: float) -> float:
    return triple(2.0 * x) + triple(3.0 * x)


def test_inlined_functions_take_the_place_of_their_calls():
    assert six_and_nine_times(2.0) == 30.0
