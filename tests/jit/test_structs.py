"""Memory shared with kernels: where each attribute is, what is refused, and what replacing an array does."""

import copy
import ctypes
import pickle
from typing import ClassVar

import numpy as np
import pytest

from evac.jit import FloatGrid, Floats, Ints, Pairs, Struct, kernel


class Inner(Struct):
    """A struct within another one."""

    weight: float
    count: int


class Outer(Struct):
    """Every kind of attribute."""

    limit: ClassVar[int] = 7
    step: float
    place: Pairs
    number: int
    own: Inner
    grid: FloatGrid
    flag: bool
    row: Ints


class Wider(Outer):
    """More of the same."""

    last: Floats


def outer(**changes):
    values = {
        "step": 0.25,
        "place": np.arange(6.0).reshape(3, 2),
        "number": -3,
        "own": Inner(weight=1.5, count=4),
        "grid": np.arange(8.0).reshape(2, 4),
        "flag": True,
        "row": np.arange(5, dtype=np.int32),
    }
    return Outer(**(values | changes))


def words_of(struct, count):
    """Return the memory of a struct as whole numbers and as numbers with a fraction."""
    words = np.ctypeslib.as_array((ctypes.c_int64 * count).from_address(struct.memory_address))
    return words, words.view(np.float64)


def test_numbers_addresses_and_extents_are_in_words_of_eight_bytes():
    struct = outer()
    assert Outer.words == {"step": 0, "place": 1, "number": 4, "own": 5, "grid": 6, "flag": 9, "row": 10}
    words, numbers = words_of(struct, 12)
    assert numbers[0] == 0.25
    assert words[1:5].tolist() == [struct.place.ctypes.data, 3, 2, -3]
    assert words[5] == struct.own.memory_address
    assert words[6:9].tolist() == [struct.grid.ctypes.data, 2, 4]
    assert words[9:].tolist() == [1, struct.row.ctypes.data, 5]


def test_a_subclass_begins_as_its_base():
    assert dict(list(Wider.words.items())[:-1]) == Outer.words
    assert Wider.words["last"] == 12
    assert list(Wider.kinds) == [*Outer.kinds, "last"]


def test_numbers_are_read_and_written_in_memory():
    struct = outer()
    words, numbers = words_of(struct, 12)
    struct.step, struct.number, struct.flag, struct.own.weight = 0.5, 2**40, False, -1.0
    assert (numbers[0], words[4], words[9]) == (0.5, 2**40, 0)
    words[4], numbers[0] = 9, 0.125
    assert (struct.number, struct.step, struct.own.weight) == (9, 0.125, -1.0)
    assert isinstance(struct.number, int)
    assert isinstance(struct.step, float)


@kernel
def sum_of(struct: Outer) -> float:
    total = struct.step + struct.number + struct.own.weight * struct.own.count
    for i in range(struct.place.shape[0]):
        total += struct.place[i, 0] * struct.place[i, 1]
    for i in range(len(struct.row)):
        total += struct.row[i]
    for i in range(struct.grid.shape[0]):
        for k in range(struct.grid.shape[1]):
            total += struct.grid[i, k]
    return total


@kernel
def write(struct: Outer) -> None:
    struct.number += 1
    struct.flag = 0
    struct.own.weight = 0.5 * struct.step
    struct.place[1, 1] = 100.0
    struct.row[0] = struct.number


def expected(struct):
    return (
        struct.step
        + struct.number
        + struct.own.weight * struct.own.count
        + float(struct.place.prod(axis=1).sum())
        + int(struct.row.sum())
        + float(struct.grid.sum())
    )


def test_kernels_read_what_python_wrote_and_python_what_kernels_wrote():
    struct = outer()
    assert sum_of(struct) == expected(struct)
    write(struct)
    assert (struct.number, struct.flag, struct.own.weight) == (-2, 0, 0.125)
    assert (struct.place[1, 1], struct.row[0]) == (100.0, -2)


def test_a_replaced_array_or_struct_is_what_kernels_read_from_then_on():
    struct = outer()
    struct.row = np.full(1000, 2, np.int32)
    struct.grid = np.ones((7, 3))
    struct.own = Inner(weight=10.0, count=10)
    assert sum_of(struct) == expected(struct)
    assert struct.row.sum() == 2000


def test_a_copy_shares_arrays_but_not_numbers():
    struct = outer()
    twin = struct.replace(number=5)
    assert (struct.number, twin.number) == (-3, 5)
    assert twin.place is struct.place
    assert twin.own is struct.own
    assert twin.values() == struct.values() | {"number": 5}
    assert twin.memory_address != struct.memory_address


@pytest.mark.parametrize("copied", [lambda struct: pickle.loads(pickle.dumps(struct)), copy.deepcopy])
def test_structs_go_through_pickle_and_deep_copies(copied):
    struct = outer()
    twin = copied(struct)
    assert type(twin) is Outer
    assert (twin.step, twin.number, twin.own.weight) == (0.25, -3, 1.5)
    np.testing.assert_array_equal(twin.place, struct.place)
    write(twin)
    assert (struct.number, twin.number, struct.place[1, 1], twin.place[1, 1]) == (-3, -2, 3.0, 100.0)


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("place", np.zeros((3, 3)), r"Outer\.place: .* float64 of shape \(n, 2\)"),
        ("place", np.zeros(3), r"Outer\.place: .*shape \(3,\)"),
        ("place", np.zeros((2, 3)).T, r"Outer\.place: .*contiguous: False"),
        ("place", np.zeros((3, 2), np.float32), r"Outer\.place: .* float32"),
        ("row", np.zeros(3, np.int64), r"Outer\.row: .* int32 of shape \(n\).* int64"),
        ("row", [1, 2], r"Outer\.row: .* list"),
        ("grid", np.zeros((4, 6))[:, ::2], r"Outer\.grid: .*contiguous: False"),
    ],
)  # fmt: skip
def test_arrays_that_kernels_cannot_read_are_refused_by_name(name, value, words):
    with pytest.raises(TypeError, match=words):
        outer(**{name: value})
    struct = outer()
    before = sum_of(struct)
    with pytest.raises(TypeError, match=words):
        setattr(struct, name, value)
    assert sum_of(struct) == before
