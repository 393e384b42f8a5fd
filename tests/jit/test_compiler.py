"""Machine code: what it needs from the process that loads it, and whom it takes its functions from."""

import importlib
import math
import pkgutil
import struct
import sys

import numpy as np
import pytest

import evac
import evac_plugins
from evac.jit import AddressCall, Entry, Floats, Struct, inner, kernel
from evac.jit.compiler import compile_entry
from evac.jit.digest import digest_of
from evac.jit.loading import addresses_of
from evac.jit.processor import host
from evac.jit.store import user_store
from evac.jit.workers import Task

#: Functions of libm, and of the C library that compilers take for granted; nothing of numba's own or of Python's.
ALLOWED = {
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
        task = Task(entry, digest_of(entry, f"{host()}"))
        kept = store.read(task.file_name, task.digest) if store else None
        codes[entry.label] = kept or compile_entry(entry, task.symbol, host())
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
def test_machine_code_needs_nothing_but_libm():
    entries = shipped_entries()
    labels = {entry.label for entry in entries}
    assert {"evac.physics.driver.advance", "evac_plugins.contact_dem.spring"} < labels
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
        assert needed_by(compile_entry(entry, "evac_test", host())) == {"exp"}
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
