"""Object code on disk: one file for each kernel and digest, with a checksum.

The checksum detects damage, not manipulation: anyone who can write a file here can execute code in the process that
loads it. Therefore, the folder is created for its owner only, and nothing is loaded from a folder that others can
write to.

Digests are of everything that a kernel is compiled from, not of comments and documentation: byte code, constants and
layouts of structs of all functions that an entry reaches, the versions of Python, numba and llvmlite, options of numba,
and the processor. Object code with this key is loaded without numba.
"""

import errno
import hashlib
import os
import stat
import sys
import tempfile
import warnings
from contextlib import suppress
from dataclasses import dataclass
from enum import EnumType
from functools import cache, lru_cache
from importlib.metadata import version
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np

from evac.base.errors import CacheWarning
from evac.jit.kernels import AddressCall, Entry, Intrinsic, Kernel, describe

#: Source files of the compiler, which are part of every digest.
_COMPILER = ("compiler.py", "instructions.py", "kernels.py", "loading.py")


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


_MAGIC = b"evac kernel 1\n"  #: First bytes of a file.


def cache_root() -> Path | None:
    """Return the cache folder: ``EVAC_CACHE_DIR``, or that of the user; None if there is no home folder."""
    chosen = os.environ.get("EVAC_CACHE_DIR")
    if chosen:
        return Path(chosen).absolute()
    for name in ("XDG_CACHE_HOME", "LOCALAPPDATA"):
        base = Path(os.environ.get(name, ""))
        if base.is_absolute():
            return base / "evac"
    with suppress(RuntimeError):
        home = Path.home()
        # An empty HOME would mean the current folder, which may belong to anyone.
        return home / ".cache" / "evac" if home.is_absolute() else None
    return None


def user_store() -> "Store | None":
    """Return the store of this user; None if there is no home folder."""
    root = cache_root()
    return Store(root / "kernels") if root else None


#: Warnings that have been issued.
_warned: set[tuple[Path, str]] = set()


@dataclass(frozen=True)
class Store:
    """A folder of object code."""

    folder: Path

    def path(self, name: str, digest: str) -> Path:
        """Return the path of the object code of a kernel."""
        return self.folder / f"{name}-{digest}.kernel"

    def read(self, name: str, digest: str) -> bytes | None:
        """Return object code, or None if there is none; a damaged file is removed, with one warning."""
        path = self.path(name, digest)
        try:
            if exposure(self.folder):
                return None  # the compiled code cannot be stored either, which causes a warning
            problem = exposure(path)
            content = b"" if problem else path.read_bytes()
        except (FileNotFoundError, NotADirectoryError):
            return None
        except OSError as error:
            self.warn("access", f"{path}: cannot be read ({error.strerror}); such kernels are compiled again")
            return None
        start = len(_MAGIC) + 32
        code = content[start:]
        if content[:start] == _MAGIC + _checksum(digest, code):
            return code
        with suppress(OSError):
            path.unlink()
        problem = problem or "is damaged"
        self.warn("damaged", f"{path}: {problem}; such kernels are compiled again")
        return None

    def write(self, name: str, digest: str, code: bytes) -> None:
        """Store object code."""
        self.folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        problem = exposure(self.folder)
        if problem:
            raise PermissionError(errno.EPERM, problem)
        handle, temporary = tempfile.mkstemp(dir=self.folder, suffix=".part")
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(_MAGIC + _checksum(digest, code) + code)
            os.replace(temporary, self.path(name, digest))
        except BaseException:
            with suppress(OSError):
                os.unlink(temporary)
            raise

    def entries(self) -> list[Path]:
        """Return the files of all kernels; none if the folder cannot be read."""
        return sorted(self._files("*.kernel"))

    def _files(self, pattern: str) -> list[Path]:
        try:
            return list(self.folder.glob(pattern))
        except OSError:
            return []

    def warn(self, what: str, message: str) -> None:
        """Issue a warning about the folder, once for each kind of problem."""
        if (self.folder, what) not in _warned:
            _warned.add((self.folder, what))
            warnings.warn(message, CacheWarning, stacklevel=3)

    def clear(self) -> None:
        """Remove all kernels, and what interrupted processes have left of them; other files are kept."""
        for path in [*self.entries(), *self._files("*.part")]:
            with suppress(OSError):
                path.unlink()
        with suppress(OSError):
            self.folder.rmdir()


def exposure(path: Path) -> str:
    """Return why other users, except root, could have written a folder or file; empty if they could not."""
    if not hasattr(os, "geteuid"):
        return ""
    status = path.stat()
    if status.st_uid not in (os.geteuid(), 0):
        return f"belongs to another user (number {status.st_uid})"
    if status.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        return f"can be written by others (mode {stat.S_IMODE(status.st_mode):o}); run chmod go-w {path}"
    if not (stat.S_ISDIR(status.st_mode) or stat.S_ISREG(status.st_mode)):
        return "is not a regular file"
    return ""


def _checksum(digest: str, code: bytes) -> bytes:
    return hashlib.sha256(digest.encode() + code).digest()
