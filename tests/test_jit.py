"""Compilation: what kernels are built from."""

from evac.jit import fused, kernel


@kernel
def fused_from_outside(a, b, c):
    return fused(a, b, c)


def test_a_fused_product_is_rounded_once():
    # 1 - 2^-60 has no double of its own: a product rounded by itself is 1, and the sum zero.
    assert fused_from_outside(1.0 + 2.0**-30, 1.0 - 2.0**-30, -1.0) == -(2.0**-60)
    assert fused_from_outside(3.0, 4.0, 5.0) == 17.0
