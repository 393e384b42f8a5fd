"""Loading of entries: object code is read from disk, compiled if it is missing, and loaded into the process."""

import ctypes
import threading
import warnings
from collections.abc import Iterable
from contextlib import closing
from functools import lru_cache
from pathlib import Path
from typing import Any

from llvmlite import binding as llvm

from evac.base.errors import CacheWarning
from evac.jit.digest import digest_of
from evac.jit.kernels import INTERPRETED, NOTE_RAISED, Entry, note_raised
from evac.jit.processor import Processor, generic, host, missing_features
from evac.jit.store import Store, user_store
from evac.jit.workers import Compilation, Compiling, compile_tasks

#: Kernels in the wheel, compiled for the generic processor.
SHIPPED = Store(Path(__file__).parents[1] / "kernels", is_shipped=True)

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
            elif not _load_shipped(entry):
                is_twin = task.digest in (other.digest for other in missing)
                (twins if is_twin else missing).append(task)
        if missing:
            compile_missing(missing, host(), store, progress)
        for task in twins:
            task.entry.bind(_addresses[task.symbol])


def compile_missing(
    missing: list[Compilation], processor: Processor, store: Store | None, progress: Compiling | None = None
) -> None:
    """Compile kernels into a store, load them, and remove old files."""
    if store is None:
        warnings.warn(
            "compiled kernels cannot be cached because there is no home folder; set EVAC_CACHE_DIR to a folder",
            CacheWarning,
            stacklevel=2,
        )
    with closing(compile_tasks(missing, processor, store, progress)) as compiled:
        for task, code in compiled:
            if processor == host():
                _load(task, code)
    if store is not None:
        store.prune()


def _load_shipped(entry: Entry) -> bool:
    """Load a kernel of the wheel, if it contains one that this machine can run."""
    if not SHIPPED.folder.is_dir() or missing_features():
        return False
    task = Compilation(entry, digest_of(entry, f"{generic()}"))
    code = SHIPPED.read(task.file_name, task.digest)
    if code is not None:
        _load(task, code)
    return code is not None


def _load(task: Compilation, code: bytes) -> None:
    """Load object code and bind the entry to it; for entries with the same code, the first one is loaded."""
    if task.symbol not in _addresses:
        engine = _engine()
        engine.add_object_file(llvm.ObjectFileRef.from_data(code))
        engine.finalize_object()
        _addresses[task.symbol] = engine.get_function_address(task.symbol)
    task.entry.bind(_addresses[task.symbol])
