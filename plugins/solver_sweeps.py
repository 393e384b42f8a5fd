"""Gauss-Seidel sweeps for the contact problem, without and with Nesterov's momentum.

The momentum is restarted when it points uphill (O'Donoghue and Candes, 2015). For a chain of n contacts, sweeps with
momentum need O(n) iterations, plain sweeps O(n^2).
"""

import math

from evac.jit import fused, inner, kernel
from evac.physics.contact.blocks import on_all_blocks
from evac.physics.contact.rows import (
    BIAS,
    CAUTION,
    LIKELY,
    evaluate,
    law,
    momentum_after,
    push_row,
    residual_of,
    row_energy,
    row_residual,
    sweep_up,
)
from evac.physics.contact.solver import Solver
from evac.physics.state import Problem

#: Relative increase of the energy above which it is not a rounding error.
RISE = 1e-10

#: Sweeps between two evaluations of the energy. If the energy increases twice within `SOON` sweeps, momentum is
#: reduced even with symmetric sweeps.
WATCH, SOON = 16, 64

#: Phases of `accelerated_sweeps`; it begins with the first four.
COMPARE, EVALUATE, KEEP, RESTORE, ON, BACK = range(6)

#: Columns of ``Problem.sums``: slope along the last step, largest change or residual [m/s], energy [J].
SLOPE, CHANGE, ENERGY = range(3)


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
    for phase in range(COMPARE, ON):
        _make(rows, phase)
    rows.residual = _greatest(rows)
    accepted = _total(rows, ENERGY)
    momentum, most, likely = 1.0, 1.0, LIKELY
    rows.share = 0.0
    back = False
    evaluated, risen = 0, -SOON
    iteration = 0
    while rows.residual > tolerance and iteration < limit:
        _make(rows, ON)
        iteration += 1
        uphill, change = _total(rows, SLOPE), _greatest(rows)
        if back and iteration < limit:
            _make(rows, BACK)
            iteration += 1
            uphill += _total(rows, SLOPE)
            change = _greatest(rows)
        if iteration >= evaluated + WATCH or iteration >= limit:
            evaluated = iteration
            _make(rows, EVALUATE)
            now = _total(rows, ENERGY)
            if now <= accepted + RISE * max(abs(accepted), abs(now)):
                accepted = now
                _make(rows, KEEP)
            else:
                _make(rows, RESTORE)
                if back and iteration - risen <= SOON:
                    most *= 0.5
                back = True
                risen = iteration
                uphill = 1.0
        if likely * change <= tolerance or iteration >= limit:
            _make(rows, COMPARE)
            rows.residual = _greatest(rows)
            likely = CAUTION * rows.residual / change if change > 0.0 else likely
        momentum, share = momentum_after(momentum if uphill <= 0.0 else 1.0)
        rows.share = min(share, most)
    return iteration


@inner
def _make(rows, phase):
    """Make a phase on all blocks, and on the rows between blocks behind them, or before them if it sweeps back."""
    if phase == BACK:
        make_phase(rows, phase, rows.blocks)
    on_all_blocks(rows, phase)
    if phase != BACK:
        make_phase(rows, phase, rows.blocks)


@inner
def _total(rows, what):
    """Return the sum over the blocks of what a phase has found."""
    total = 0.0
    for block in range(rows.blocks + 1):
        total += rows.sums[block, what]
    return total


@inner
def _greatest(rows):
    """Return the largest change or residual of the rows of all blocks [m/s]."""
    greatest = 0.0
    for block in range(rows.blocks + 1):
        greatest = max(greatest, rows.sums[block, CHANGE])
    return greatest


@kernel
def make_phase(rows: Problem, phase: int, block: int) -> int:
    """Make a phase of the solver on a block."""
    sums = rows.sums
    first, last = rows.first_row[block], rows.first_row[block + 1]
    low, high = rows.first_body[block], rows.first_body[block + 1]
    if phase == ON:
        _extrapolate(rows, low, high)
        sums[block, SLOPE], sums[block, CHANGE] = _sweep_on(rows, rows.share, first, last)
    elif phase == BACK:
        sums[block, SLOPE], sums[block, CHANGE] = _sweep_back(rows, first, last)
    elif phase == RESTORE:
        _restore(rows, first, last, low, high)
    elif phase == COMPARE:
        sums[block, CHANGE] = residual_of(rows, first, last)
    elif phase == EVALUATE:
        sums[block, ENERGY] = _energy(rows, first, last, low, high)
    elif phase == KEEP:
        _keep(rows, first, last, low, high)
    return 0


@inner
def _extrapolate(rows, low, high):
    """Extrapolate the velocities of some bodies by `share` of their last step; `image_a` has the previous ones."""
    for i in range(low, high):
        for k in range(2):
            now = rows.velocity[i, k]
            rows.velocity[i, k] = now + rows.share * (now - rows.image_a[i, k])
            rows.image_a[i, k] = now


@inner
def _sweep_on(rows, share, first, last):
    """Sweep up from extrapolated percussions; `work_a` has the previous ones.

    Returns the slope along the last step and the largest change of a row [m/s].
    """
    rigid = rows.rigid == 1
    uphill, greatest = 0.0, 0.0
    for r in range(first, last):
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
def _sweep_back(rows, first, last):
    """Sweep down after a sweep up; return its part of the slope along the last step, and its largest change [m/s]."""
    rigid = rows.rigid == 1
    uphill, greatest = 0.0, 0.0
    for r in range(last - 1, first - 1, -1):
        x = rows.percussion[r]
        change = law(rows, r, x, rigid)
        push_row(rows.velocity, rows.body[r], rows.other[r], rows.data, r, change)
        new = x + change
        rows.percussion[r] = new
        uphill = fused(x - new, new - rows.work_a[r], uphill)
        greatest = max(greatest, abs(change) * rows.scale[r])
    return uphill, greatest


@inner
def _keep(rows, first, last, low, high):
    """Save percussions and velocities in `work_b` and `image_b`."""
    for r in range(first, last):
        rows.work_b[r] = rows.percussion[r]
    for i in range(low, high):
        for k in range(2):
            rows.image_b[i, k] = rows.velocity[i, k]


@inner
def _restore(rows, first, last, low, high):
    """Restore the saved percussions and velocities, without momentum."""
    for r in range(first, last):
        rows.percussion[r] = rows.work_b[r]
        rows.work_a[r] = rows.work_b[r]
    for i in range(low, high):
        for k in range(2):
            rows.velocity[i, k] = rows.image_b[i, k]
            rows.image_a[i, k] = rows.image_b[i, k]


@inner
def _energy(rows, first, last, low, high):
    """Return the energy that the solution minimises: kinetic energy plus the energies of the rows [J]."""
    found = 0.0
    for i in range(low, high):
        found += rows.velocity[i, 0] ** 2 + rows.velocity[i, 1] ** 2
    found *= 0.5
    rigid = rows.rigid == 1  # see `law`
    for r in range(first, last):
        found += rows.data[r, BIAS] * rows.percussion[r] if rigid else row_energy(rows, r, rows.percussion[r])
    return found


class GaussSeidel(Solver):
    """Projected Gauss-Seidel sweeps over the contacts, outwards from the exit."""

    name = "gauss_seidel"
    solve = gauss_seidel


class AcceleratedSweeps(Solver):
    """Gauss-Seidel sweeps with Nesterov's momentum, symmetric if these diverge; the default."""

    name = "accelerated_sweeps"
    solve = accelerated_sweeps
    make_phase = make_phase
