"""Processors that kernels are compiled for."""

import os
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from llvmlite import binding as llvm

#: Level of x86-64 that kernels in a wheel are compiled for: AVX2 and fused multiply-add, but not AVX-512.
GENERIC = "x86-64-v3"

#: Features of processors of that level beyond the baseline, and features that imply them, by their LLVM names.
_GENERIC_FEATURES = "avx2 bmi bmi2 cx16 f16c fma lzcnt movbe popcnt sahf sse4.2 xsave"


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


def generic() -> Processor:
    """Return the processor of the kernels in a wheel: x86-64-v3, or the baseline of other architectures."""
    triple = llvm.get_process_triple()
    return Processor(triple, GENERIC if triple.startswith("x86_64") else "generic", "")


@lru_cache
def missing_features() -> tuple[str, ...]:
    """Return the features of the generic processor that this machine does not have."""
    if generic().name != GENERIC:
        return ()
    has = llvm.get_host_cpu_features()
    return tuple(feature for feature in _GENERIC_FEATURES.split() if not has.get(feature))
