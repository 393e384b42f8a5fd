"""What a law keeps of each contact from one sub-step to the next, as wide as `ContactModel.memory` declares.

Within a tick it is kept by body and key, in the order of contacts; between two ticks, in which bodies change places,
and in checkpoints by person. A contact that is open at the end of a sub-step is forgotten. Loaded only for models that
declare a memory.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from evac.base.arrays import FloatArray
from evac.jit import AddressCall, inner, kernel, row
from evac.physics.state import State
from evac.physics.status import OK

#: Call `recall` or `retain` at its address.
call_memory = AddressCall([State], (int,))


@inner
def mark_start(kept):
    """Note what is kept at the start of a step, so that the step can be undone."""
    kept.half_before = kept.half
    kept.number_before = kept.number


@inner
def slot_of(kept, slot, i, key):
    """Return the first slot from `slot` on, in the half in use, that is not before that of body i and key."""
    last = kept.half * kept.size + kept.number
    while slot < last and (kept.body[slot] < i or (kept.body[slot] == i and kept.key[slot] < key)):
        slot += 1
    return slot


@inner
def holds(kept, slot, i, key):
    """Return whether the slot that `slot_of` returned is that of body i and key."""
    return slot < kept.half * kept.size + kept.number and kept.body[slot] == i and kept.key[slot] == key


@kernel
def recall(state: State) -> int:
    """Set the memory of the contacts that were found; zero where bodies do not overlap, and for new contacts."""
    contacts, kept = state.contacts, state.memory
    slot = kept.half * kept.size
    for c in range(contacts.number):
        slot = slot_of(kept, slot, contacts.body[c], contacts.key[c])
        is_known = contacts.gap[c] < 0.0 and holds(kept, slot, contacts.body[c], contacts.key[c])
        for k in range(contacts.memory.shape[1]):
            contacts.memory[c, k] = kept.value[slot, k] if is_known else 0.0
    return OK


@kernel
def retain(state: State) -> int:
    """Keep the memory of the contacts of this sub-step, except zeros, in the half without that of the step's start."""
    contacts, kept = state.contacts, state.memory
    kept.half = 1 - kept.half_before
    slot = kept.half * kept.size
    for c in range(contacts.number):
        kept.body[slot] = contacts.body[c]
        kept.key[slot] = contacts.key[c]
        is_zero = True
        for k in range(contacts.memory.shape[1]):
            kept.value[slot, k] = contacts.memory[c, k]
            is_zero = is_zero and contacts.memory[c, k] == 0.0
        if not is_zero:
            slot += 1
    kept.number = slot - kept.half * kept.size
    return OK


@inner
def new_memory(contacts):
    """Return the memory of a contact that begins, for a trial, in the row behind those of contacts."""
    last = contacts.memory.shape[0] - 1
    for k in range(contacts.memory.shape[1]):
        contacts.memory[last, k] = 0.0
    return row(contacts.memory, last)


@inner
def tried_memory(contacts, c):
    """Return a copy of the memory of contact c for a trial, in the row behind those of contacts."""
    last = contacts.memory.shape[0] - 1
    for k in range(contacts.memory.shape[1]):
        contacts.memory[last, k] = contacts.memory[c, k]
    return row(contacts.memory, last)


def memory_by_person(state: State) -> dict[str, NDArray[Any]]:
    """Return the `pairs` (m, 2) whose contact is remembered, and their `numbers` (m, width), between two ticks.

    A pair is two persons, the lower one first, or a person and a wall less the number of walls; pairs are sorted.
    """
    kept = state.memory
    here = slice(kept.half * kept.size, kept.half * kept.size + kept.number)
    pairs = np.column_stack([kept.body[here], kept.key[here]]).astype(np.int64)
    return dict(zip(("pairs", "numbers"), _renumbered(pairs, kept.value[here], state.bodies.row), strict=True))


def remember_by_person(state: State, pairs: NDArray[np.int64], numbers: FloatArray) -> None:
    """Set the memory at the start of a tick from what `memory_by_person` returned; who has left is forgotten."""
    bodies, kept = state.bodies, state.memory
    body = np.full(len(bodies.row), -1)
    body[bodies.row[: bodies.inside]] = np.arange(bodies.inside)
    pairs, numbers = _renumbered(pairs, numbers, body)
    kept.half, kept.number = 0, len(pairs)
    kept.body[: len(pairs)], kept.key[: len(pairs)] = pairs.T
    kept.value[: len(pairs)] = numbers


def _renumbered(
    pairs: NDArray[np.int64], value: FloatArray, number: NDArray[np.integer]
) -> tuple[NDArray[np.int64], FloatArray]:
    """Return sorted pairs with other numbers of people, the lower first, without those whose number is -1."""
    first, is_wall = number[pairs[:, 0]], pairs[:, 1] < 0
    second = np.where(is_wall, pairs[:, 1], number[np.maximum(pairs[:, 1], 0)])
    here = (first >= 0) & (is_wall | (second >= 0))
    pair, value = np.column_stack([first, second])[here].astype(np.int64), value[here]
    turned = (pair[:, 1] >= 0) & (pair[:, 1] < pair[:, 0])
    pair[turned] = pair[turned, ::-1]
    order = np.lexsort((pair[:, 1], pair[:, 0]))
    return pair[order], value[order]
