"""Machine code: what it needs from the process that loads it, and whom it takes its functions from."""

import importlib
import math
import pkgutil
import re
import struct
import sys

import numba
import numpy as np
import pytest

import evac
import evac_plugins
from evac.base.errors import PluginError
from evac.jit import AddressCall, Entry, FloatGrid, Floats, Struct, inner, kernel, row
from evac.jit.compiler import compile_entry
from evac.jit.kernels import NOTE_RAISED
from evac.jit.loading import Compilation, addresses_of, host
from evac.jit.store import digest_of, user_store

#: Functions of libm, of the C library that compilers take for granted, and of evac; nothing of numba's or Python's.
ALLOWED = {
    NOTE_RAISED,
    *("exp", "expm1", "log", "pow", "sqrt", "hypot", "sin", "cos", "tan", "atan2", "floor", "fmod"),
    *("memcpy", "memmove", "memset"),
}


def needed_by(code):
    """Return the names that 64-bit ELF object code leaves to be found elsewhere."""
    assert code[:6] == b"\x7fELF\x02\x01"
    (start,), (size, number) = struct.unpack_from("<Q", code, 0x28), struct.unpack_from("<HH", code, 0x3A)
    sections = [struct.unpack_from("<IIQQQQIIQQ", code, start + k * size) for k in range(number)]
    found = set()
    for _, kind, _, _, offset, length, link, _, _, entry in sections:
        if kind != 2:  # no symbol table
            continue
        names = sections[link][4]
        for at in range(offset, offset + length, entry):
            name, _, _, section = struct.unpack_from("<IBBH", code, at)
            if name and section == 0:
                found.add(code[names + name : code.index(b"\0", names + name)].decode())
    return found


def codes_of(entries):
    """Return the object code of entries by their labels, from the store as far as it is there."""
    addresses_of(entries)
    codes, store = {}, user_store()
    for entry in entries:
        task = Compilation(entry, digest_of(entry, f"{host()}"))
        kept = store.read(task.file_name, task.digest) if store else None
        codes[entry.label] = kept or compile_entry(entry, task.symbol)
    return codes


def shipped_entries():
    for package in (evac, evac_plugins):
        for module in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            if not module.name.startswith("evac.__main__"):
                importlib.import_module(module.name)
    modules = [module for name, module in sys.modules.items() if name.partition(".")[0] in ("evac", "evac_plugins")]
    found = {value.label: value for module in modules for value in vars(module).values() if isinstance(value, Entry)}
    return [found[label] for label in sorted(found)]


@pytest.mark.skipif(sys.platform != "linux", reason="object code of other systems is no ELF")
def test_machine_code_needs_nothing_of_numba_or_python():
    entries = shipped_entries()
    labels = {entry.label for entry in entries}
    assert {"evac.physics.stepping.advance", "evac_plugins.contact_dem.spring"} < labels
    needed = {label: needed_by(code) - ALLOWED for label, code in codes_of(entries).items()}
    assert {label: names for label, names in needed.items() if names} == {}


@inner
def shared(x):
    return math.exp(x) + 1.0


@kernel
def first(x: float) -> float:
    return shared(x)


@kernel
def second(x: float) -> float:
    return 2.0 * shared(x)


@pytest.mark.skipif(sys.platform != "linux", reason="object code of other systems is no ELF")
def test_functions_of_kernels_are_within_their_own_code():
    for entry in (first, second):
        assert needed_by(compile_entry(entry, "evac_test")) == {"exp"}
    assert (first(0.0), second(0.0)) == (2.0, 4.0)


class Counter(Struct):
    """What a part counts in."""

    calls: int


call_part = AddressCall([Counter, Floats], (int,))


@kernel
def part(counter: Counter, values: Floats) -> int:
    counter.calls += 1
    values[0] *= 2.0
    return counter.calls


@kernel
def call_twice(address: int, counter: Counter, values: Floats) -> int:
    return call_part(address, counter, values) + call_part(address, counter, values)


def test_a_part_called_by_its_address_shares_structs_and_arrays():
    counter, values = Counter(calls=10), np.array([1.5])
    assert call_twice(part.address, counter, values) == 11 + 12
    assert (counter.calls, values[0]) == (12, 6.0)


call_line = AddressCall([Floats], (float,))


@kernel
def ten_times_first(line: Floats) -> float:
    return 10.0 * line[0]


@kernel
def read_rows(grid: FloatGrid, address: int, found: Floats) -> None:
    before = row(grid, 0)
    for i in range(grid.shape[0]):
        line = row(grid, i)
        found[i] = call_line(address, line) + line[1] + len(line) + before[0]
        before = line


def test_a_row_is_its_own_whatever_else_reads_it():
    """A kernel may keep a row while it takes another one, read it, and pass it on."""
    grid, found = np.arange(1.0, 13.0).reshape(4, 3), np.empty(4)
    read_rows(grid, ten_times_first.address, found)
    np.testing.assert_array_equal(found, 10.0 * grid[:, 0] + grid[:, 1] + 3 + grid[[0, 0, 1, 2], 0])


@numba.jit
def root_of(x):
    if x < 0.0:
        raise ValueError("negative")
    return math.sqrt(x)


@kernel
def root(x: float) -> float:
    return root_of(x) + 1.0


call_root = AddressCall([float], (float,))


@kernel
def root_at(address: int, x: float) -> float:
    return call_root(address, x)


def test_an_exception_in_a_function_of_numba_is_reported():
    assert (root(4.0), root_at(root.address, 4.0)) == (3.0, 3.0)
    for call in (lambda: root(-1.0), lambda: root_at(root.address, -1.0)):
        with pytest.raises(PluginError, match=r"test_compiler\.root:"):
            call()
    assert root(4.0) == 3.0


@kernel
def fraction(x: float) -> int:
    return x + 0.5


@kernel
def nothing(x: float) -> float:
    if x > 0.5:
        pass


@kernel
def pair(x: float) -> float:
    return x, x


@pytest.mark.parametrize("entry", [fraction, nothing, pair], ids=["fraction", "nothing", "pair"])
def test_a_kernel_returns_what_it_declares(entry):
    with pytest.raises(PluginError, match=rf"kernel {entry.__name__}: returns .*test_compiler\.py, line \d+\); return"):
        entry(1.0)


@kernel
def misspelt(x: float) -> float:
    y = 2.0 * x
    return hyppot(x, y)  # noqa: F821


@kernel
def raising(x: float) -> float:
    if x > 0.0:
        raise ValueError("positive")
    return x


def plain(x):
    return 2.0 * x


@kernel
def calling(x: float) -> float:
    y = plain(x)
    return y


@kernel
def unlike(x: float) -> float:
    if x > 0.0:
        return x
    return x, x


@kernel
def allocating(x: float) -> float:
    y = x
    return np.zeros(3)[0] + y


@kernel
def texting(x: float) -> float:
    y = str(x)
    return len(y)


@pytest.mark.parametrize(
    ("entry", "line", "reason", "remedy"),
    [
        (misspelt, 3, "hyppot", "correct the name"),
        (raising, 3, "raise", "kernels raise no exceptions"),
        (calling, 2, "plain", "decorate the functions that it calls with evac.jit.inner"),
        (unlike, 0, "Can't unify", "return the same numbers in every case"),
        (allocating, 3, "", "use only numbers, tuples, structs, arrays and math"),
        (texting, 3, "", "use only numbers, tuples, structs, arrays and math"),
    ],
    ids=lambda value: getattr(value, "__name__", None),
)
def test_a_kernel_that_cannot_be_compiled_is_named_with_its_line_and_the_remedy(entry, line, reason, remedy):
    first = entry.function.__code__.co_firstlineno
    with pytest.raises(PluginError, match=rf"kernel {entry.__name__}: cannot be compiled: .*{reason}") as caught:
        entry(1.0)
    told, place = re.search(r"\(([^()]*test_compiler\.py, line (\d+))\); (.*)", str(caught.value)).group(1, 2)
    assert f"{told}); {remedy}" in str(caught.value)
    assert int(place) == first + line
