"""Loading of entries: object code is read from disk, or compiled in this process or in several, and then loaded.

Every kernel is stored as soon as it is finished, so that an interrupted process loses only its current kernel. Several
worker processes, each of which imports numba, compile what would take longer in one.
"""

import ctypes
import importlib.util
import os
import sys
import threading
import warnings
from collections.abc import Callable, Generator, Iterable, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Future, wait
from contextlib import ExitStack, chdir, closing, suppress
from dataclasses import dataclass
from functools import lru_cache
from importlib.metadata import version
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

from llvmlite import binding as llvm

from evac.base.errors import CacheWarning, EvacError, PluginError
from evac.jit.kernels import INTERPRETED, NOTE_RAISED, Entry, entries_of, note_raised
from evac.jit.store import Store, digest_of, kernels_in, user_store

#: Least version of numba, and the least that is too new: the compiler builds on the inside of those between them.
NUMBA = (0, 62), (0, 69)


def cores() -> int:
    """Return the number of processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@dataclass(frozen=True)
class Processor:
    """Name and features of a processor in LLVM terms, and the target triple of the system."""

    triple: str
    name: str
    features: str

    def options(self) -> dict[str, Any]:
        """Return the options of the LLVM target machine for code that is loaded into this process."""
        relocation = "static" if self.triple.startswith("x86") else "default"
        where = {"reloc": relocation, "codemodel": "jitdefault", "jit": True}
        return {"cpu": self.name, "features": self.features, **where}


@lru_cache
def host() -> Processor:
    """Return this machine's processor."""
    return Processor(llvm.get_process_triple(), llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten())


Compiling = Callable[[int, int], None]  #: Called with the number of finished kernels and the total number.

#: Cost model in units of about 70 us: front end per byte of byte code of a function, once per process; optimisation per
#: byte of byte code of an entry with all its callees; start of a process.
_FRONT, _BACK, _START = 3, 1, 15_000

_TOLD_EVERY = 1.0  #: Longest time between reports of progress [s].


class Compilation(NamedTuple):
    """A kernel to be compiled."""

    entry: Entry
    digest: str

    @property
    def symbol(self) -> str:
        """Name of the kernel in its object code."""
        return f"evac_{self.digest}"

    @property
    def file_name(self) -> str:
        """Prefix of the names of the kernel's files."""
        return self.entry.label.replace("<", "").replace(">", "")


_lock = threading.RLock()

_addresses: dict[str, int] = {}


@lru_cache(maxsize=1)
def _engine() -> Any:
    """Return the LLVM engine that loads object code."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    llvm.add_symbol(NOTE_RAISED, ctypes.cast(note_raised, ctypes.c_void_p).value)
    target = llvm.Target.from_triple(llvm.get_process_triple())
    return llvm.create_mcjit_compiler(llvm.parse_assembly(""), target.create_target_machine(jit=True))


def addresses_of(entries: Iterable[Entry], progress: Compiling | None = None) -> None:
    """Load the machine code of entries; compile entries that are not on disk."""
    if INTERPRETED:
        return
    with _lock:
        store, missing = user_store(), list[Compilation]()
        twins: list[Compilation] = []  # entries with the same code as one that is compiled
        for entry in dict.fromkeys(entries):
            if entry.is_ready:
                continue
            task = Compilation(entry, digest_of(entry, f"{host()}"))
            code = store.read(task.file_name, task.digest) if store else None
            if code is not None:
                _load(task, code)
            else:
                is_twin = task.digest in (other.digest for other in missing)
                (twins if is_twin else missing).append(task)
        if missing:
            _compile_missing(missing, store, progress)
        for task in twins:
            task.entry.bind(_addresses[task.symbol])


def _compile_missing(missing: list[Compilation], store: Store | None, progress: Compiling | None) -> None:
    """Compile kernels into a store, and load them."""
    if store is None:
        warnings.warn(
            "compiled kernels cannot be cached because there is no home folder; set EVAC_CACHE_DIR to a folder",
            CacheWarning,
            stacklevel=2,
        )
    with closing(compile_tasks(missing, store, progress)) as compiled:
        for task, code in compiled:
            _load(task, code)


def _load(task: Compilation, code: bytes) -> None:
    """Load object code and bind the entry to it; for entries with the same code, the first one is loaded."""
    if task.symbol not in _addresses:
        engine = _engine()
        engine.add_object_file(llvm.ObjectFileRef.from_data(code))
        engine.finalize_object()
        _addresses[task.symbol] = engine.get_function_address(task.symbol)
    task.entry.bind(_addresses[task.symbol])


def compile_tasks(
    tasks: Sequence[Compilation], store: Store | None, progress: Compiling | None = None
) -> Generator[tuple[Compilation, bytes], None, None]:
    """Compile kernels, in the estimated optimal number of processes, and yield each with its object code."""
    left = dict.fromkeys(tasks)

    def tell() -> None:
        if progress:
            progress(len(tasks) - len(left), len(tasks))

    tell()
    importable = [task for task in tasks if _source(task.entry)]
    *shares, own = divide(importable, min(cores(), len(importable)))
    with ExitStack() as ending:
        elsewhere = _start_elsewhere(shares, store, ending)
        here, rest = (_compiled(some, store) for some in (own, left))
        for task, code in chain(here, _gather(elsewhere, store, tell), rest):
            del left[task]
            yield task, code
            tell()


def divide(tasks: Sequence[Compilation], most: int) -> list[list[Compilation]]:
    """Divide kernels among processes to minimise the total time; the last process is this one."""
    sizes = {task: {k: len(k.function.__code__.co_code) for k in kernels_in(task.entry)} for task in tasks}
    ordered = sorted(tasks, key=lambda task: sum(sizes[task].values()), reverse=True)
    best: list[list[Compilation]] = [ordered]
    least = None
    for number in range(1, most + 1):
        shares: list[list[Compilation]] = [[] for _ in range(number)]
        lowered: list[set[Any]] = [set() for _ in range(number)]
        spent = [_START] * (number - 1) + [0]
        for task in ordered:
            size = sizes[task]
            added = [
                _FRONT * sum(size[k] for k in size.keys() - known) + _BACK * sum(size.values()) for known in lowered
            ]
            first = min(range(number), key=lambda k: spent[k] + added[k])
            shares[first].insert(0, task)
            lowered[first] |= size.keys()
            spent[first] += added[first]
        if least is None or max(spent) < 0.8 * least:
            best, least = shares, max(spent)
    return best


def _source(entry: Entry) -> str | None:
    """Return the file of a kernel's module for import in another process; None if impossible, as for scripts."""
    file = getattr(sys.modules.get(entry.__module__), "__file__", None)
    return str(Path(file).absolute()) if file and entry.__module__ != "__main__" else None


def _compiled(tasks: Iterable[Compilation], store: Store | None) -> Generator[tuple[Compilation, bytes], None, None]:
    """Compile the kernels that there are when the first is asked for, and yield each with its object code."""
    for task in list(tasks):
        code, problem = _compile_here(task, store)
        if problem:
            _warn(store, problem)
        yield task, code


def _compile_here(task: Compilation, store: Store | None) -> tuple[bytes, str]:
    """Compile and store a kernel; return its object code, and the reason if it could not be stored."""
    found = version("numba")
    if not NUMBA[0] <= tuple(map(int, found.split(".")[:2])) < NUMBA[1]:
        least, above = (".".join(map(str, numbers)) for numbers in NUMBA)
        raise EvacError(f'numba {found} cannot compile the kernels of evac; run: pip install "numba>={least},<{above}"')
    with chdir(Path(__file__).parent):  # numba reads settings from a file of the current folder
        from evac.jit.compiler import compile_entry

    code = compile_entry(task.entry, task.symbol)
    if store is not None:
        try:
            store.write(task.file_name, task.digest, code)
        except OSError as error:
            return code, error.strerror or str(error)
    return code, ""


def _warn(store: Store | None, problem: str) -> None:
    if store is not None:
        store.warn("access", f"{store.folder}: kernels cannot be stored ({problem}); the next run compiles them again")


def _start_elsewhere(
    shares: Sequence[Sequence[Compilation]], store: Store | None, ending: ExitStack
) -> dict[Future[tuple[bytes, str]], Compilation]:
    """Start the compilation of each share in a worker process, which `ending` ends; fewer if none can be started."""
    from evac.base.processes import Pool

    folder = store.folder if store else None
    futures: dict[Future[tuple[bytes, str]], Compilation] = {}
    with suppress(OSError, BrokenExecutor):
        for share in shares:
            pool = ending.enter_context(Pool(1, is_quiet=True))
            for task in share:
                where = task.entry.__module__, _source(task.entry) or "", task.entry.label, task.digest
                futures[pool.submit(_compile_there, where, folder)] = task
    return futures


def _gather(
    futures: dict[Future[tuple[bytes, str]], Compilation], store: Store | None, tell: Callable[[], None]
) -> Generator[tuple[Compilation, bytes], None, None]:
    """Yield the kernels that worker processes compile; failed kernels and those of processes that died are omitted."""
    while futures:
        done, _ = wait(futures, _TOLD_EVERY, FIRST_COMPLETED)
        for future in done:
            task, error = futures.pop(future), future.exception()
            if isinstance(error, PluginError):
                raise error
            if error is None:
                code, problem = future.result()
                if problem:
                    _warn(store, problem)
                yield task, code
        if not done:
            tell()


# Worker process


def _compile_there(where: tuple[str, str, str, str], folder: Path | None) -> tuple[bytes, str]:
    """Compile and store the kernel of a module, file, label and digest; see `_compile_here`."""
    entry = _find(*where)
    return _compile_here(Compilation(entry, where[-1]), Store(folder) if folder else None)


def _find(module: str, file: str, label: str, digest: str) -> Entry:
    """Import a module as in the parent process, and return its kernel with the given digest."""
    if module not in sys.modules:
        spec = importlib.util.find_spec(module)
        if spec is not None and spec.origin is not None and Path(spec.origin).absolute() == Path(file):
            importlib.import_module(module)
        else:  # a plugin given as a file
            spec = importlib.util.spec_from_file_location(module, file)
            assert spec is not None
            assert spec.loader is not None
            sys.modules[module] = importlib.util.module_from_spec(spec)
            spec.loader.exec_module(sys.modules[module])
    for entry in entries_of(sys.modules[module]):
        if entry.label == label and digest_of(entry, f"{host()}") == digest:
            return entry
    raise LookupError(f"{label}: differs in this process")
