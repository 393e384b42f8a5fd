"""Lanes against numpy: four numbers at a time are rounded as one is."""

import os
import subprocess
import sys
from fractions import Fraction

import numpy as np
import pytest

from evac.jit import kernel
from evac.lanes import fused_lanes, gather, greatest, larger, load, magnitude, scatter, spread, store, total

RANDOM = np.random.default_rng(3)


@kernel
def apply_all(a, b, c, out):
    x, y, z = load(a, 2), load(b, 0), load(c, 1)
    store(out, 0, x + y)
    store(out, 4, x - y)
    store(out, 8, x * y)
    store(out, 12, -x)
    store(out, 16, fused_lanes(x, y, z))
    store(out, 20, larger(x, y))
    store(out, 24, magnitude(x))
    store(out, 28, spread(a[0]))
    return total(x), greatest(x)


@kernel
def turn_pairs(pairs, places, at):
    x, y = gather(pairs, places, at)
    scatter(pairs, places, at, -y, x)


def test_arithmetic_is_that_of_single_numbers():
    a, b, c = (RANDOM.normal(0.0, 1.0, 8) for _ in range(3))
    out = np.full(40, np.nan)
    summed, most = apply_all(a, b, c, out)
    x, y = a[2:6], b[:4]
    expected = [x + y, x - y, x * y, -x, out[16:20], np.maximum(x, y), np.abs(x), np.full(4, a[0])]  # fused: below
    np.testing.assert_array_equal(out[:32].reshape(8, 4), expected)
    assert np.isnan(out[32:]).all()
    assert summed == (x[0] + x[1]) + (x[2] + x[3])
    assert most == x.max()


def test_lanes_are_summed_in_pairs():
    a = np.zeros(8)
    a[2:6] = 2.0**60, 1.0, -(2.0**60), 1.0  # the ones are lost in the pairs
    assert apply_all(a, a, a, np.zeros(40))[0] == 0.0


def test_fused_lanes_are_rounded_once():
    a = 1.0 + RANDOM.uniform(0.0, 1e-8, 8)
    b, c = -a, np.ones(8)
    out = np.zeros(40)
    apply_all(a, b, c, out)
    exact = [float(Fraction(p) * Fraction(q) + 1) for p, q in zip(a[2:6], b[:4], strict=True)]
    np.testing.assert_array_equal(out[16:20], exact)
    assert not np.array_equal(out[16:20], a[2:6] * b[:4] + 1.0)


@pytest.mark.parametrize("at", [0, 4])
def test_pairs_go_back_to_where_they_came_from(at):
    pairs = RANDOM.normal(0.0, 1.0, (9, 2))
    bodies = RANDOM.permutation(9)[:8]
    expected = pairs.copy()
    for body in bodies[at : at + 4]:
        expected[body] = -pairs[body, 1], pairs[body, 0]
    flat = pairs.ravel().copy()
    turn_pairs(flat, (2 * bodies).astype(np.uint32), at)
    np.testing.assert_array_equal(flat.reshape(9, 2), expected)


def test_twins_without_compilation():
    """The tests of this module in an interpreter that compiles nothing, but for the one rounding."""
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-n", "0", __file__, "-k", "arithmetic or pairs"],
        env=os.environ | {"NUMBA_DISABLE_JIT": "1"},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stdout
    assert "4 passed" in done.stdout
