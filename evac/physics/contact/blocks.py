"""Division of the contact problem into blocks, which can be worked on at the same time.

The rows of a block belong to bodies that are in no row of another block. The rows between blocks, whose two bodies are
in different blocks, follow behind all of them; few are, since bodies are in the order of travel time. The division
depends on the problem alone, so that results do not depend on the number of threads.

Block b has the rows from ``Problem.first_row[b]`` and the bodies from ``Problem.first_body[b]`` to the next; the rows
between blocks are a last block without bodies. Each block has a wall of its own: threads that write to the same
velocity slow each other down.
"""

from evac.jit import AddressCall, inner, kernel
from evac.physics.state import Problem

#: Largest number of blocks.
BLOCKS = 4

#: Rows from which a problem has two blocks, and from which it has `BLOCKS`: with more blocks, a solver needs some more
#: iterations.
ROWS_OF_TWO, ROWS_OF_MOST = 4096, 65536

#: Distance of the walls of blocks in the arrays of bodies: a cache line.
WALL = 4

#: Entries of arrays of bodies behind the bodies.
WALLS = WALL * (BLOCKS - 1) + 1

#: Distance in packed rows of consecutive unknowns.
APART = 8

#: Make a phase of the solver on all blocks, and on one block; the results are not used.
call_on_blocks = AddressCall([Problem, int], (int,))
call_on_block = AddressCall([Problem, int, int], (int,))


@inner
def on_all_blocks(rows, phase):
    """Make a phase of the solver on all blocks, with all threads of the run, and wait for them."""
    call_on_blocks(rows.on_blocks, rows, phase)


@kernel
def make_on_blocks(rows: Problem, phase: int) -> int:
    """Make a phase of the solver on all blocks with one thread."""
    for block in range(rows.blocks):
        call_on_block(rows.make_phase, rows, phase, block)
    return 0


@inner
def divide(problem, contacts, tangential):
    """Divide the rows of the contacts into blocks of about as many contacts each."""
    n, number = problem.bodies, contacts.number
    problem.blocks = 1
    if problem.size >= ROWS_OF_TWO:
        problem.blocks = BLOCKS if problem.size >= ROWS_OF_MOST else 2
    problem.ends = n + WALL * (problem.blocks - 1) + 1
    problem.first_body[0] = 0
    for b in range(1, problem.blocks):
        problem.first_body[b] = max(contacts.body[number * b // problem.blocks], problem.first_body[b - 1])
    problem.first_body[problem.blocks] = n
    problem.first_body[problem.blocks + 1] = n
    for b in range(problem.blocks + 1):
        problem.taken[b] = 0
    if problem.blocks > 1:
        for c in range(number):
            rows = 2 if contacts.sticky[c] and tangential > 0.0 else 1
            problem.taken[block_of_contact(problem, contacts, c)] += rows
    else:
        problem.taken[0] = problem.size
    used = 0
    for b in range(problem.blocks + 1):
        problem.first_row[b] = used
        used += problem.taken[b]
        problem.taken[b] = 0
    problem.first_row[problem.blocks + 1] = used


@inner
def block_of_body(problem, i):
    """Return the block of body i."""
    b = 0
    while i >= problem.first_body[b + 1]:
        b += 1
    return b


@inner
def block_of_contact(problem, contacts, c):
    """Return the block of contact c; the number of blocks if its bodies are in different ones."""
    own, j = block_of_body(problem, contacts.body[c]), contacts.other[c]
    if j >= 0 and (j < problem.first_body[own] or j >= problem.first_body[own + 1]):
        return problem.blocks
    return own


@inner
def next_row(problem, block):
    """Return the row of the next unknown of a block."""
    k = problem.taken[block]
    problem.taken[block] = k + 1
    first = problem.first_row[block]
    return first + interleaved(k, problem.first_row[block + 1] - first)


@inner
def interleaved(k, rows):
    """Return the row of the k-th unknown of some: in each full part, consecutive unknowns are `APART` rows apart.

    Unknowns of a body are consecutive; in a sweep over adjacent rows, each would wait for the velocity just written.
    """
    within = k % (APART * APART)
    part = k - within
    if part + APART * APART > rows:
        return k
    return part + APART * (within % APART) + within // APART
