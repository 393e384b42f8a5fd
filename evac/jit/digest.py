"""Digests of everything that a kernel is compiled from; changes of comments and documentation do not affect them.

These are byte code, constants and layouts of structs of all functions that an entry reaches, the versions of Python,
numba and llvmlite, options of numba, and the processor. Object code with this key is loaded without numba.
"""

import hashlib
import os
import sys
from enum import EnumType
from functools import cache, lru_cache
from importlib.metadata import version
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np

from evac.jit.kernels import AddressCall, Entry, Intrinsic, Kernel
from evac.jit.structs import describe

#: Source files of the compiler, which are part of every digest.
_COMPILER = ("compiler.py", "instructions.py", "loading.py", "structs.py")


#: Environment variables of numba that do not change the code of a kernel.
_HARMLESS = {"NUMBA_DISABLE_JIT", "NUMBA_NUM_THREADS", "NUMBA_THREADING_LAYER", "NUMBA_CACHE_DIR"}


def _options() -> str:
    """Return the options of numba that are not the default ones, each behind a comma."""
    set_here = sorted((name, value) for name, value in os.environ.items() if name.startswith("NUMBA_"))
    return "".join(f", {name}={value}" for name, value in set_here if name not in _HARMLESS)


@lru_cache
def versions() -> str:
    """Return the versions of Python, numba, llvmlite and the compiler in this package, and the options of numba."""
    own = hashlib.sha256()
    for name in _COMPILER:
        own.update((Path(__file__).parent / name).read_bytes())
    python = ".".join(map(str, sys.version_info[:2]))
    return f"python {python}, numba {version('numba')}, llvmlite {version('llvmlite')}, {own.hexdigest()}{_options()}"


def digest_of(entry: Entry, processor: str) -> str:
    """Return the digest (20 hexadecimal digits) of everything that an entry is compiled from, for a processor."""
    kinds, returned = entry.signature
    signature = "; ".join(describe(kind) for _, kind in kinds)
    digest = hashlib.sha256(f"{versions()}\n{processor}\n{signature} -> {returned}\n".encode())
    for kernel in kernels_in(entry):
        digest.update(_parts_of(kernel)[0])
    return digest.hexdigest()[:20]


def kernels_in(entry: Entry) -> list[Kernel]:
    """Return an entry and all kernels that it calls, directly or indirectly, in a deterministic order."""
    kernels: dict[int, Kernel] = {}
    waiting: list[Kernel] = [entry]
    while waiting:
        kernel = waiting.pop()
        if id(kernel) not in kernels:
            kernels[id(kernel)] = kernel
            waiting.extend(_parts_of(kernel)[1])
    return list(kernels.values())


@cache
def _parts_of(kernel: Kernel) -> tuple[bytes, tuple[Kernel, ...]]:
    """Return a text representation of a function with its constants and globals, and the kernels that it refers to."""
    function = kernel.function
    lines, called = [f"{kernel.label} {kernel.is_inlined}", *_code_lines(function)], []
    for name, value in _globals_of(function):
        if isinstance(value, Kernel):
            called.append(value)
            lines.append(f"{name} = {value.label}")
        elif isinstance(value, AddressCall):
            lines.append(f"{name} = {[describe(kind) for kind in value.kinds]} -> {value.returns}")
        elif isinstance(value, Intrinsic):
            lines.append(f"{name} = {value.name}")
        elif not isinstance(value, ModuleType):
            lines.append(f"{name} = {_text_of(value)}")
    return "\n".join(lines).encode(), tuple(called)


def _text_of(value: Any, above: tuple[Any, ...] = ()) -> str:
    """Return a text of a constant or function that is the same in every process; `above` contains its referrers."""
    function = getattr(value, "py_func", value)  # the Python function of a numba dispatcher
    if isinstance(function, FunctionType):
        above = (*above, value)
        others = [pair for pair in _globals_of(function) if not any(pair[1] is referrer for referrer in above)]
        named = [f"{name} = {_text_of(other, above)}" for name, other in others]
        options = getattr(value, "targetoptions", {})
        return f"{function.__qualname__}: {_code_lines(function)} with {named}, {options}"
    if isinstance(value, np.ndarray):
        return f"{value.dtype}{value.shape} {value.tobytes().hex()}"
    if isinstance(value, EnumType):
        return f"{value.__qualname__}: {dict(value.__members__)}"
    if hasattr(value, "__qualname__"):
        return f"{value.__module__}.{value.__qualname__}"
    return repr(value)


def _codes_of(function: Any) -> list[CodeType]:
    """Return the code objects of a function and of its nested functions, such as comprehensions."""
    codes = [function.__code__]
    for code in codes:
        codes += [item for item in code.co_consts if isinstance(item, CodeType)]
    return codes


def _code_lines(function: Any) -> list[str]:
    """Return a text of the code of a function, without its docstring and line numbers."""
    lines = [repr(function.__defaults__)]
    for code in _codes_of(function):
        constants = [
            repr(item) for item in code.co_consts if not isinstance(item, CodeType) and item != function.__doc__
        ]
        lines += [code.co_code.hex(), ",".join(constants), ",".join(code.co_names), ",".join(code.co_varnames)]
    return lines


def _globals_of(function: Any) -> list[tuple[str, Any]]:
    """Return the values that a function refers to: closure variables, globals, and attributes of modules."""
    cells = zip(function.__code__.co_freevars, function.__closure__ or (), strict=True)
    values: list[tuple[str, Any]] = [(name, cell.cell_contents) for name, cell in cells]
    names = [name for code in _codes_of(function) for name in code.co_names]
    for name in names:
        if name not in function.__globals__:
            continue
        values += _values_of(name, function.__globals__[name], names)
    return values


def _values_of(name: str, value: Any, names: list[str]) -> list[tuple[str, Any]]:
    """Return a global; for a module, return the attributes that a function may read in it and in its submodules."""
    values = [(name, value)]
    if isinstance(value, ModuleType) and hasattr(value, "__file__") and value.__name__ != "math":
        for inner in dict.fromkeys(names):
            if hasattr(value, inner):
                others = [other for other in names if other != inner]
                values += _values_of(f"{name}.{inner}", getattr(value, inner), others)
    return values
