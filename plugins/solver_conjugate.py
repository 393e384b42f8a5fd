"""Solvers of the contact problem by conjugate sweeps, and by conjugate gradients on faces.

Conjugate sweeps identify the active rows, which have a positive percussion; they form the face. Once a symmetric sweep
does not change it, the problem on the face is solved by conjugate gradients, preconditioned by a symmetric Gauss-Seidel
sweep on the face, until a percussion leaves its branch of the local law. Then the face is identified again. On a face,
the problem is linear, so conjugate gradients need few iterations; the sweeps in between restore the local laws.
"""

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
    copy_solution,
    evaluate,
    push_row,
    row_residual,
    row_velocity,
    sweep_down,
    sweep_up,
)
from evac.physics.state import Problem

SHIFT, SOFTNESS, COMPLIANCE = 4, 5, 6  #: Columns of ``Problem.face_data`` after A and B.
OFF, RIGID, ELASTIC = 0, 1, 2  #: Branches of the local law.
FLAT = 1e-12  #: A direction has no curvature if its curvature is less than this share of the diagonal part.
LONGEST_FACE = 500  #: Maximum number of conjugate gradient iterations on one face before it is identified again.


@kernel
def conjugate_sweeps(rows: Problem, tolerance: float, limit: int) -> int:
    """Nonlinear conjugate gradients (Fletcher-Reeves, restarted) around a symmetric Gauss-Seidel sweep.

    One iteration sweeps the rows forwards and backwards, and then makes a step along the conjugate
    direction of the sweeps (the nonsmooth nonlinear conjugate gradient method of Silcowitz-Hansen,
    Niebe and Erleben, 2010). Sweeps are in the order of travel time, along the force chains. The residual is always
    evaluated after a sweep. Returns the number of iterations.
    """
    return _conjugate(rows, tolerance, limit, False)


@inner
def clear_direction(rows):
    """Clear the conjugate direction and its velocity image."""
    for r in range(rows.size):
        rows.work_b[r] = 0.0
    for i in range(rows.ends):
        rows.image_b[i, 0] = 0.0
        rows.image_b[i, 1] = 0.0


@inner
def conjugate_step(rows, before):
    """Update the conjugate direction after a sweep and step along the old one; return the squared sweep."""
    now = 0.0
    for r in range(rows.size):
        now += (rows.percussion[r] - rows.work_a[r]) ** 2
    beta = now / before if before > 0.0 else 0.0
    if beta > 1.0:
        beta = 0.0
    for r in range(rows.size):
        step = beta * rows.work_b[r]
        rows.work_b[r] = step + rows.percussion[r] - rows.work_a[r]
        rows.percussion[r] += step
    for i in range(rows.bodies):
        for k in range(2):
            step = beta * rows.image_b[i, k]
            rows.image_b[i, k] = step + rows.velocity[i, k] - rows.image_a[i, k]
            rows.velocity[i, k] += step
    return now


@kernel
def conjugate_faces(rows: Problem, tolerance: float, limit: int) -> int:
    """Solve by conjugate sweeps and by conjugate gradients on faces; return the number of iterations."""
    for r in range(rows.size):
        rows.branch[r] = OFF
    return _conjugate(rows, tolerance, limit, True)


@inner
def _conjugate(rows, tolerance, limit, uses_faces):
    clear_direction(rows)
    before, iteration = 0.0, 0
    rows.residual, likely = row_residual(rows), LIKELY
    while rows.residual > tolerance and iteration < limit:
        copy_solution(rows, rows.percussion, rows.velocity, rows.work_a, rows.image_a)
        sweep_up(rows)
        change = sweep_down(rows)
        iteration += 1
        is_new = not uses_faces or mark_branches(rows) > 0
        likely = evaluate(rows, change, likely, tolerance if iteration < limit else math.inf)
        if rows.residual <= tolerance or iteration >= limit:
            break
        if is_new:
            before = conjugate_step(rows, before)
        else:
            made, rows.residual = descend_on_face(rows, tolerance, min(limit - iteration, LONGEST_FACE))
            iteration += made
            clear_direction(rows)
            before = 0.0
    return iteration


@inner
def branch_of(rows, r):
    """Return the branch of the local law for the percussion of row r."""
    elastic = rows.elastic
    if elastic[r, BOUND] < 0.0:
        return ELASTIC
    if rows.percussion[r] <= 0.0:
        return OFF
    # Elastic below P = (b - w-) K_N / 2, where the separation velocity is still above -b.
    limit = elastic[r, SPRING] * (rows.data[r, BIAS] - elastic[r, BEFORE])
    if rows.percussion[r] * (1.0 - elastic[r, SPRING]) < limit:
        return ELASTIC
    return RIGID


@inner
def mark_branches(rows):
    """Store the branch of every row; return the number of changes."""
    changed = 0
    for r in range(rows.size):
        branch = branch_of(rows, r)
        if branch != rows.branch[r]:
            rows.branch[r] = branch
            changed += 1
    return changed


@inner
def pack_face(rows):
    """Copy the active rows to the arrays of the face; return their number.

    The equation of an elastic row is w + w- + (2/K_N) P = 0, that of a rigid row is w + b = 0; both have the form
    w + shift + compliance x = 0, with the diagonal 1 + compliance.
    """
    held = 0
    for r in range(rows.size):
        branch = rows.branch[r]
        if branch == OFF:
            continue
        rows.face[held] = r
        rows.face_body[held] = rows.body[r]
        rows.face_other[held] = rows.other[r]
        for k in (AX, AY, BX, BY):
            rows.face_data[held, k] = rows.data[r, k]
        rows.face_data[held, SHIFT] = rows.data[r, BIAS] if branch == RIGID else rows.elastic[r, BEFORE]
        softness = 1.0 if branch == RIGID else rows.elastic[r, SPRING]
        rows.face_data[held, SOFTNESS] = softness
        rows.face_data[held, COMPLIANCE] = (1.0 - softness) / softness
        held += 1
    return held


@inner
def precondition(rows, held):
    """Apply a symmetric Gauss-Seidel sweep to W z = -g on the face, from z = 0; return -g.z.

    `work_a` has the gradient g, `work_c` z, `image_c` the velocity image of z.
    """
    data, image = rows.face_data, rows.image_c
    for i in range(rows.ends):
        image[i, 0] = 0.0
        image[i, 1] = 0.0
    for k in range(held):
        i, j = rows.face_body[k], rows.face_other[k]
        w = row_velocity(image, i, j, data, k, 0.0)
        z = -(rows.work_a[k] + w) * data[k, SOFTNESS]
        rows.work_c[k] = z
        push_row(image, i, j, data, k, z)
    total = 0.0
    for k in range(held - 1, -1, -1):
        i, j = rows.face_body[k], rows.face_other[k]
        w = row_velocity(image, i, j, data, k, 0.0)
        z = -(rows.work_a[k] + w + data[k, COMPLIANCE] * rows.work_c[k]) * data[k, SOFTNESS]
        rows.work_c[k] += z
        total -= rows.work_a[k] * rows.work_c[k]
        push_row(image, i, j, data, k, z)
    return total


@inner
def _slope(rows, k):
    """Return the gradient in row k of the face."""
    data = rows.face_data
    w = row_velocity(rows.velocity, rows.face_body[k], rows.face_other[k], data, k, data[k, SHIFT])
    return w + data[k, COMPLIANCE] * rows.percussion[rows.face[k]]


@inner
def _gradient(rows, held):
    """Set `work_a` to the gradient on the face; return its largest entry [m/s]."""
    worst = 0.0
    for k in range(held):
        g = _slope(rows, k)
        rows.work_a[k] = g
        worst = max(worst, abs(g) * rows.scale[rows.face[k]])
    return worst


@inner
def descend_on_face(rows, tolerance, limit):
    """Descend on the face until it is solved or left; return (iterations, residual of all rows).

    Percussions that become negative are set to zero, all at once, if the energy still decreases; otherwise, the step
    ends where the first of them is zero. Thus all percussions remain admissible, and the energy on the face never
    increases.
    """
    held = pack_face(rows)
    before = 0.0
    made = 0
    while made < limit and _gradient(rows, held) > 0.5 * tolerance:
        steepness = precondition(rows, held)
        beta = steepness / before if made > 0 else 0.0
        before = steepness
        made += 1
        length = _step_length(rows, held, beta, steepness)
        if length <= 0.0:
            break
        left = _step(rows, held, length)
        if left > 0:
            if _put_back(rows, held) > 0.5 * length * steepness:
                _step_to_the_edge(rows, held, length)
            break
    return made, row_residual(rows)


@inner
def _step_length(rows, held, beta, steepness):
    """Update the direction `work_d` and its `image_d`; return the exact step length along it, 0 without descent."""
    # A direction without curvature (opposed percussions) has no step length; the problem may have no solution.
    curvature = 0.0
    length = 0.0
    for k in range(held):
        rows.work_d[k] = rows.work_c[k] + (beta * rows.work_d[k] if beta != 0.0 else 0.0)
        curvature += rows.face_data[k, COMPLIANCE] * rows.work_d[k] ** 2
        length += rows.work_d[k] ** 2 / rows.face_data[k, SOFTNESS]
    for i in range(rows.bodies):
        for k in range(2):
            rows.image_d[i, k] = rows.image_c[i, k] + (beta * rows.image_d[i, k] if beta != 0.0 else 0.0)
        curvature += rows.image_d[i, 0] ** 2 + rows.image_d[i, 1] ** 2
    return steepness / curvature if curvature > FLAT * length else 0.0


@inner
def _step(rows, held, length):
    """Step along the direction; return the number of percussions that left their branch."""
    left = 0
    for i in range(rows.bodies):
        rows.velocity[i, 0] += length * rows.image_d[i, 0]
        rows.velocity[i, 1] += length * rows.image_d[i, 1]
    for k in range(held):
        r = rows.face[k]
        rows.percussion[r] += length * rows.work_d[k]
        if branch_of(rows, r) != rows.branch[r]:
            left += 1
    return left


@inner
def _put_back(rows, held):
    """Set negative percussions of the face to zero, with the changes in `work_b`; return the increase of energy [J]."""
    rise = 0.0
    for k in range(held):
        r = rows.face[k]
        push = max(-rows.percussion[r], 0.0) if rows.elastic[r, BOUND] == 0.0 else 0.0
        rows.work_b[k] = push
        if push > 0.0:
            rise += push * (_slope(rows, k) + 0.5 * push / rows.face_data[k, SOFTNESS])
            push_row(rows.velocity, rows.body[r], rows.other[r], rows.data, r, push)
            rows.percussion[r] = 0.0
    return rise


@inner
def _step_to_the_edge(rows, held, length):
    """Undo `_put_back`, and shorten the step such that the first percussion to become negative is zero."""
    share = 1.0
    for k in range(held):
        push = rows.work_b[k]
        if push > 0.0:
            r = rows.face[k]
            push_row(rows.velocity, rows.body[r], rows.other[r], rows.data, r, -push)
            rows.percussion[r] = -push
            share = min(share, 1.0 + push / (length * rows.work_d[k]))
    back = (1.0 - max(share, 0.0)) * length
    for i in range(rows.bodies):
        rows.velocity[i, 0] -= back * rows.image_d[i, 0]
        rows.velocity[i, 1] -= back * rows.image_d[i, 1]
    for k in range(held):
        r = rows.face[k]
        rows.percussion[r] -= back * rows.work_d[k]
        if rows.work_b[k] > 0.0:
            rows.percussion[r] = max(rows.percussion[r], 0.0)


class ConjugateSweeps(Solver):
    """Nonlinear conjugate gradients around symmetric Gauss-Seidel sweeps."""

    name = "conjugate_sweeps"
    solve = conjugate_sweeps


class ConjugateFaces(Solver):
    """Conjugate sweeps, with conjugate gradients on the current set of active contacts."""

    name = "conjugate_faces"
    solve = conjugate_faces
    stronger = "conjugate_sweeps"
