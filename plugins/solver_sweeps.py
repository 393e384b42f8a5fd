"""Gauss-Seidel sweeps for the contact problem, without and with Nesterov's momentum.

The momentum is restarted when it points uphill (O'Donoghue and Candes, 2015). For a chain of n contacts, sweeps with
momentum need O(n) iterations, plain sweeps O(n^2).
"""

import math

from evac.jit import fused, inner, kernel
from evac.physics.contact.rows import (
    BIAS,
    LIKELY,
    Solver,
    copy_solution,
    evaluate,
    law,
    momentum_after,
    push_row,
    row_energy,
    row_residual,
    sweep_up,
)
from evac.physics.state import Problem

RISE = 1e-10  #: Relative increase of the energy above which it is not a rounding error.

#: Sweeps between two evaluations of the energy. If the energy increases twice within `SOON` sweeps, momentum is
#: reduced even with symmetric sweeps.
WATCH, SOON = 16, 64


@kernel
def gauss_seidel(rows: Problem, tolerance: float, limit: int) -> int:
    """Projected Gauss-Seidel in the order of the rows; return the number of iterations."""
    rows.residual, likely = row_residual(rows), LIKELY
    iteration = 0
    while rows.residual > tolerance and iteration < limit:
        change = sweep_up(rows)
        iteration += 1
        likely = evaluate(rows, change, likely, tolerance if iteration < limit else math.inf)
    return iteration


@kernel
def accelerated_sweeps(rows: Problem, tolerance: float, limit: int) -> int:
    """Gauss-Seidel sweeps with Nesterov's momentum and restarts; return the number of iterations.

    Every sweep starts from percussions and velocities extrapolated from the last two sweeps, and the momentum is
    restarted when it points uphill. No bound of a step length is needed, but sweeps in one direction with momentum need
    not decrease the energy: for bodies in regular rows, they may oscillate with increasing amplitude. If the energy has
    increased between two evaluations, the solver returns to the state at the previous one and uses symmetric sweeps
    from then on. A symmetric sweep is a step in a metric in which momentum does decrease the energy, but it costs two
    sweeps. If the energy soon increases again, the upper limit of the extrapolation factor is halved; in the limit of
    zero, these are plain sweeps, which never increase the energy.
    """
    rows.residual, accepted = row_residual(rows), energy_of(rows)
    copy_solution(rows, rows.percussion, rows.velocity, rows.work_a, rows.image_a)
    copy_solution(rows, rows.percussion, rows.velocity, rows.work_b, rows.image_b)
    momentum, most, share, likely = 1.0, 1.0, 0.0, LIKELY
    back = False
    evaluated, risen = 0, -SOON
    iteration = 0
    while rows.residual > tolerance and iteration < limit:
        uphill, change = sweep_on(rows, share)
        iteration += 1
        if back and iteration < limit:
            slope, change = sweep_back(rows)
            iteration += 1
            uphill += slope
        if iteration >= evaluated + WATCH or iteration >= limit:
            evaluated = iteration
            now = energy_of(rows)
            if now <= accepted + RISE * max(abs(accepted), abs(now)):
                accepted = now
                copy_solution(rows, rows.percussion, rows.velocity, rows.work_b, rows.image_b)
            else:
                copy_solution(rows, rows.work_b, rows.image_b, rows.percussion, rows.velocity)
                copy_solution(rows, rows.work_b, rows.image_b, rows.work_a, rows.image_a)
                if back and iteration - risen <= SOON:
                    most *= 0.5
                back = True
                risen = iteration
                uphill = 1.0
        likely = evaluate(rows, change, likely, tolerance if iteration < limit else math.inf)
        momentum, share = momentum_after(momentum if uphill <= 0.0 else 1.0)
        share = min(share, most)
    return iteration


@inner
def sweep_on(rows, share):
    """Sweep up from percussions and velocities extrapolated by `share` of their last step.

    Returns the slope along the last step and the largest change of a row [m/s]; `work_a` and `image_a` have percussions
    and velocities before.
    """
    for i in range(rows.bodies):
        for k in range(2):
            now = rows.velocity[i, k]
            rows.velocity[i, k] = now + share * (now - rows.image_a[i, k])
            rows.image_a[i, k] = now
    rigid = rows.rigid == 1
    uphill, greatest = 0.0, 0.0
    for r in range(rows.size):
        old = rows.percussion[r]
        start = fused(share, old - rows.work_a[r], old)
        change = law(rows, r, start, rigid)
        push_row(rows.velocity, rows.body[r], rows.other[r], rows.data, r, change)
        rows.work_a[r] = old
        rows.percussion[r] = start + change
        uphill = fused(-change, start + change - old, uphill)
        greatest = max(greatest, abs(change) * rows.scale[r])
    return uphill, greatest


@inner
def sweep_back(rows):
    """Sweep down after a sweep up; return its part of the slope along the last step, and its largest change [m/s]."""
    rigid = rows.rigid == 1
    uphill, greatest = 0.0, 0.0
    for r in range(rows.size - 1, -1, -1):
        x = rows.percussion[r]
        change = law(rows, r, x, rigid)
        push_row(rows.velocity, rows.body[r], rows.other[r], rows.data, r, change)
        new = x + change
        rows.percussion[r] = new
        uphill = fused(x - new, new - rows.work_a[r], uphill)
        greatest = max(greatest, abs(change) * rows.scale[r])
    return uphill, greatest


@inner
def energy_of(rows):
    """Return the energy that the solution minimises: kinetic energy plus the energies of the rows [J]."""
    energy = 0.0
    for i in range(rows.bodies):
        energy += rows.velocity[i, 0] ** 2 + rows.velocity[i, 1] ** 2
    energy *= 0.5
    rigid = rows.rigid == 1  # see `law`
    for r in range(rows.size):
        energy += rows.data[r, BIAS] * rows.percussion[r] if rigid else row_energy(rows, r, rows.percussion[r])
    return energy


class GaussSeidel(Solver):
    """Projected Gauss-Seidel sweeps over the contacts, outwards from the exit."""

    name = "gauss_seidel"
    solve = gauss_seidel


class AcceleratedSweeps(Solver):
    """Gauss-Seidel sweeps with Nesterov's momentum, symmetric if these diverge; the default."""

    name = "accelerated_sweeps"
    solve = accelerated_sweeps
