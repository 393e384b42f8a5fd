"""From entries to addresses: read object code from disk, compile what is missing, load it into the process."""

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any

from llvmlite import binding as llvm

from evac.jit.digest import digest_of
from evac.jit.kernels import INTERPRETED, Entry
from evac.jit.processor import Processor
from evac.jit.store import Store, cache_root


@lru_cache(maxsize=1)
def _engine() -> Any:
    """Return what loads object code."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    target = llvm.Target.from_triple(llvm.get_process_triple())
    return llvm.create_mcjit_compiler(llvm.parse_assembly(""), target.create_target_machine(jit=True))


@lru_cache(maxsize=1)
def _stores() -> list[Store]:
    root = cache_root()
    return [Store(root / "kernels")] if root else []


def file_name(entry: Entry) -> str:
    """Return how the files of a kernel begin."""
    return entry.label.replace("<", "").replace(">", "")


def load(entry: Entry, symbol: str, code: bytes) -> None:
    """Load object code and let the entry call it."""
    engine = _engine()
    engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    entry.bind(engine.get_function_address(symbol))


def addresses_of(entries: Sequence[Entry], progress: Callable[[int, int], None] | None = None) -> None:
    """Load the machine code of entries, and compile what is not on disk; where nothing is compiled, do nothing."""
    if INTERPRETED:
        return
    processor = Processor.host()
    missing = []
    for entry in entries:
        if entry.is_ready:
            continue
        digest = digest_of(entry, f"{processor}")
        symbol = f"evac_{digest}"
        code = None
        for store in _stores():
            code = store.read(file_name(entry), digest)
        if code is None:
            missing.append((entry, digest, symbol))
        else:
            load(entry, symbol, code)
    for k, (entry, digest, symbol) in enumerate(missing):
        if progress:
            progress(k, len(missing))
        from evac.jit.compiler import compile_entry  # imports numba

        code = compile_entry(entry, symbol)
        for store in _stores()[:1]:
            store.write(file_name(entry), digest, code)
        load(entry, symbol, code)
