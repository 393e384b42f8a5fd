"""The processor that kernels are compiled for."""

from dataclasses import dataclass
from typing import Any, Self

from llvmlite import binding as llvm

#: Kernels in a wheel are compiled for this level of x86-64: AVX2 and fused multiplication, but not AVX-512.
GENERIC = "x86-64-v3"


@dataclass(frozen=True)
class Processor:
    """Name and features of a processor as LLVM knows them, and the system's triple."""

    triple: str
    name: str
    features: str

    @classmethod
    def host(cls) -> Self:
        """Return this machine's."""
        return cls(llvm.get_process_triple(), llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten())

    def options(self) -> dict[str, Any]:
        """Return the options of a target machine whose code is loaded into this process."""
        relocation = "static" if self.triple.startswith("x86") else "default"
        return {
            "cpu": self.name,
            "features": self.features,
            "reloc": relocation,
            "codemodel": "jitdefault",
            "jit": True,
        }
