"""Gradient methods for the contact problem: the Uzawa algorithm of the paper, and Nesterov's accelerated gradient."""

import math

from evac.jit import inner, kernel
from evac.physics.contact.rows import (
    AX,
    AY,
    BEFORE,
    BIAS,
    BOUND,
    BX,
    BY,
    LIKELY,
    SPRING,
    Solver,
    evaluate,
    momentum_after,
    push_row,
    renew_velocity,
    row_residual,
    row_velocity,
)
from evac.physics.state import Problem


@inner
def gradient_step(rows, r, w, x, rate):
    """Return the projected step of length `rate` along the multiplier of row r (appendix 2 of the paper)."""
    new = x - rate * (w + rows.data[r, BIAS])
    spring = rows.elastic[r, SPRING]
    if spring > 0.0:
        new = max(new, (x - rate * (w + rows.elastic[r, BEFORE])) / (1.0 + rate * (1.0 - spring) / spring))
    return max(new, rows.elastic[r, BOUND])


@kernel
def uzawa(rows: Problem, tolerance: float, limit: int) -> int:
    """The solver of the paper (appendix 2): projected gradient on the multipliers with a fixed step, 0.95 of its bound.

    rho = 0.95 * 2 alpha / |C|^2 with the smallest mass alpha; h^2 rho of NSM1, whose rows are h G, is the same
    step on percussions. Returns the number of iterations.
    """
    greatest = 0.0
    for i in range(rows.bodies):
        greatest = max(greatest, rows.inverse_root[i])
    rate = 1.9 / (greatest * greatest * constraint_norm(rows))
    rows.residual, likely = row_residual(rows), LIKELY
    iteration = 0
    while rows.residual > tolerance and iteration < limit:
        change = 0.0
        for r in range(rows.size):
            old, scale = rows.percussion[r], rows.scale[r]
            w = row_velocity(rows.velocity, rows.body[r], rows.other[r], rows.data, r, 0.0)
            rows.percussion[r] = gradient_step(rows, r, w, old, rate * scale * scale)
            change = max(change, abs(rows.percussion[r] - old) * scale)
        renew_velocity(rows)
        iteration += 1
        likely = evaluate(rows, change, likely, tolerance if iteration < limit else math.inf)
    return iteration


@inner
def constraint_norm(rows):
    """Return lambda_max(G^T G) by power iteration, accurate to 1 %: |C|^2 in the bound of the paper."""
    for r in range(rows.size):
        rows.work_a[r] = 1.0 + 0.5 * math.sin(float(r))
    value = 0.0
    for _ in range(60):
        for i in range(rows.ends):
            rows.image_a[i, 0] = 0.0
            rows.image_a[i, 1] = 0.0
        square = 0.0
        for r in range(rows.size):
            square += rows.work_a[r] ** 2
        norm = math.sqrt(square)
        for r in range(rows.size):
            push_row(rows.image_a, rows.body[r], rows.other[r], rows.data, r, rows.work_a[r] * rows.scale[r] / norm)
        square = 0.0
        for i in range(rows.bodies):
            for k in range(2):
                rows.image_a[i, k] /= rows.inverse_root[i]  # rows have A = n / sqrt(omega m), the bound needs n
                square += rows.image_a[i, k] ** 2
                rows.image_a[i, k] /= rows.inverse_root[i]
        done = abs(square - value) <= 1e-3 * square
        value = square
        if done:
            break
        for r in range(rows.size):
            rows.work_a[r] = rows.scale[r] * row_velocity(rows.image_a, rows.body[r], rows.other[r], rows.data, r, 0.0)
    return value


@kernel
def accelerated_gradient(rows: Problem, tolerance: float, limit: int) -> int:
    """Nesterov's accelerated projected gradient with diagonal scaling and restarts; return the number of iterations.

    The step of a row is the inverse of the sum of its row of G M^-1 G^T, bounded by the numbers of rows of its
    bodies, so that the scaled gradient step never overshoots. The momentum is restarted when it points uphill.
    """
    _set_rates(rows)
    momentum, change = 1.0, math.inf
    for r in range(rows.size):
        rows.work_b[r] = rows.percussion[r]
    rows.residual, likely = row_residual(rows), LIKELY
    iteration = 0
    while rows.residual > tolerance and iteration < limit:
        following, share = momentum_after(momentum)
        iteration += 1
        near = likely * change <= tolerance or iteration == limit
        uphill, change = _gradient_pass(rows, 0.0 if near else share)
        momentum = following if uphill <= 0.0 else 1.0
        if near:
            likely = evaluate(rows, change, likely, math.inf)
            if rows.residual > tolerance and iteration < limit:
                for r in range(rows.size):
                    rows.percussion[r] += share * (rows.percussion[r] - rows.work_d[r])
                renew_velocity(rows)
    return iteration


@inner
def _gradient_pass(rows, share):
    """Make a gradient step of all rows, extrapolate by `share` of the step, and recompute velocities.

    Returns the slope along the last step and the largest step [m/s]. `work_b` has the percussions after the step,
    `work_c` the step lengths, `work_d` the percussions after the previous step.
    """
    data, image = rows.data, rows.image_a
    for i in range(rows.ends):
        image[i, 0] = rows.free[i, 0]
        image[i, 1] = rows.free[i, 1]
    uphill, change = 0.0, 0.0
    for r in range(rows.size):
        i, j = rows.body[r], rows.other[r]
        x = rows.percussion[r]
        new = gradient_step(rows, r, row_velocity(rows.velocity, i, j, data, r, 0.0), x, rows.work_c[r])
        step = new - rows.work_b[r]
        uphill += (x - new) * step / rows.work_c[r]
        change = max(change, abs(new - x) * rows.scale[r])
        rows.work_d[r] = rows.work_b[r]
        rows.work_b[r] = new
        new += share * step
        rows.percussion[r] = new
        push_row(image, i, j, data, r, new)
    for i in range(rows.bodies):
        rows.velocity[i, 0] = image[i, 0]
        rows.velocity[i, 1] = image[i, 1]
    return uphill, change


@inner
def _set_rates(rows):
    """Set `work_c` to the step length of each row."""
    for i in range(rows.ends):
        rows.image_a[i, 0] = 0.0
    for r in range(rows.size):
        rows.image_a[rows.body[r], 0] += 1.0
        rows.image_a[rows.other[r], 0] += 1.0
    for r in range(rows.size):
        own = (rows.data[r, AX] ** 2 + rows.data[r, AY] ** 2) * rows.image_a[rows.body[r], 0]
        others = (rows.data[r, BX] ** 2 + rows.data[r, BY] ** 2) * rows.image_a[rows.other[r], 0]
        rows.work_c[r] = 1.0 / (own + others)


class Uzawa(Solver):
    """The solver of the paper: projected gradient with a fixed step, 0.95 of the largest stable one."""

    name = "uzawa"
    solve = uzawa


class AcceleratedGradient(Solver):
    """Projected gradient with an individual step length for each percussion and Nesterov's momentum."""

    name = "accelerated_gradient"
    solve = accelerated_gradient
