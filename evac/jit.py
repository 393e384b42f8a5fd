"""Compilation of kernels: one decorator, cached on disk, keyed by the sources.

numba's own cache looks only at the file of the function that is called, so a plugin's cached loop
does not notice an edit in a core kernel it calls. The cache folder is therefore named by a digest
of the module of the kernel, of every module that it imports in turn, of the bundles that kernels take, and
of the flags that change its machine code.
"""

import ast
import hashlib
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numba
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

#: Signature of a pair force: (gap, nx, ny, ex, ey, parameters) -> (fx, fy); see ``evac.physics.force``.
PAIR_FORCE_SIGNATURE = types.UniTuple(types.float64, 2)(
    types.float64, types.float64, types.float64, types.float64, types.float64, types.float64[::1]
)

_CORE = Path(__file__).parent

#: Sources of the core with this word hold bundles. Kernels need not import the modules of what they are called with.
_BUNDLES = b"NamedTuple"

_digests: dict[Path, str] = {}
_imported: dict[Path, tuple[Path, ...]] = {}


def cache_root() -> Path:
    """Folder that holds the compiled kernels: ``EVAC_CACHE_DIR``, or the user's cache folder."""
    chosen = os.environ.get("EVAC_CACHE_DIR")
    if chosen:
        return Path(chosen)
    base = os.environ.get("XDG_CACHE_HOME") or os.environ.get("LOCALAPPDATA")
    return (Path(base) if base else Path.home() / ".cache") / "evac"


def _digest(module: Path) -> str:
    """Digest of the sources that the kernels of a module are compiled from, numba's version and flags."""
    if module not in _digests:
        digest = hashlib.sha256(f"{numba.__version__} {numba.config.BOUNDSCHECK}".encode())
        for source in sorted(_sources(module)):
            digest.update(source.read_bytes())
        _digests[module] = digest.hexdigest()[:16]
    return _digests[module]


def _sources(module: Path) -> set[Path]:
    """Return a module, this one, those that they import in turn at their top, and those of the bundles."""
    bundles = {file for file in _CORE.rglob("*.py") if _BUNDLES in file.read_bytes()}
    found: set[Path] = set()
    waiting = {module, _CORE / "jit.py"}
    while waiting:
        file = waiting.pop()
        found.add(file)
        if file not in _imported:
            _imported[file] = tuple(_imports(file))
        waiting.update(set(_imported[file]) - found)
    return found | bundles


def _imports(file: Path) -> Iterator[Path]:
    """Yield the sources of the core, and of the package or folder of `file`, that it imports at its top."""
    for statement in ast.parse(file.read_bytes()).body:
        if isinstance(statement, ast.Import):
            names = [alias.name for alias in statement.names]
        elif isinstance(statement, ast.ImportFrom) and statement.level:
            folder = file.parents[statement.level - 1].joinpath(*(statement.module or "").split("."))
            yield from filter(Path.is_file, (folder / f"{alias.name}.py" for alias in statement.names))
            yield from filter(Path.is_file, (folder.with_suffix(".py"),))
            continue
        elif isinstance(statement, ast.ImportFrom):
            module = str(statement.module)
            names = [module, *(f"{module}.{alias.name}" for alias in statement.names)]
        else:
            continue
        for name in names:
            top, *rest = name.split(".")
            known = None if top in sys.stdlib_module_names else getattr(sys.modules.get(top), "__file__", None)
            root = _CORE if top == _CORE.name else Path(known) if known else None
            if root is None or not (root == _CORE or file.is_relative_to(root.parent)):
                continue
            source = (root if root == _CORE or root.name != "__init__.py" else root.parent).joinpath(*rest)
            yield from filter(Path.is_file, (source.with_suffix(".py"), source / "__init__.py"))


def _cached(compile_function: Callable[..., Any], function: Callable[..., Any]) -> Any:
    """Apply a numba decorator while the cache folder of `function`'s sources is set.

    The module has a part in it: one file can be loaded under two names (as a plugin file, and imported),
    and what numba keeps can be read back only under the name it was compiled with.
    """
    before = numba.config.CACHE_DIR
    digest = _digest(Path(function.__code__.co_filename))
    numba.config.CACHE_DIR = str(cache_root() / digest / function.__module__)
    try:
        return compile_function(function)
    finally:
        numba.config.CACHE_DIR = before


def kernel(function: Callable[..., Any]) -> Any:
    """Compile a module-level function for the step loop (cached, without the interpreter lock)."""
    return _cached(numba.njit(cache=True, nogil=True, error_model="numpy"), function)


def inner(function: Callable[..., Any]) -> Any:
    """Compile a function that only kernels call: without the wrapper that Python would need.

    Wrappers that unpack whole bundles take a third of the time of compilation.
    """
    return _cached(
        numba.njit(
            cache=True,
            nogil=True,
            error_model="numpy",
            no_cpython_wrapper=True,
            no_cfunc_wrapper=True,
            _nrt=False,
        ),
        function,
    )


#: Compiled pair forces by the address of their machine code, for runs with NUMBA_DISABLE_JIT.
_pair_forces: dict[int, Any] = {}


def pair_force(function: Callable[..., Any]) -> Any:
    """Compile a force between two people to the one signature that the step loop can call.

    Parameters
    ----------
    function : callable
        ``force(gap, nx, ny, ex, ey, parameters) -> (fx, fy)``: the force [N] on person i from person
        j, with the gap D_ij [m], the unit vector (nx, ny) from j to i, the desired direction
        (ex, ey) of i and the force's own parameters, a float64 array.

    Returns
    -------
    numba CFunc
        Callable from Python; its ``address`` is what kernels call.
    """
    compiled = _cached(numba.cfunc(PAIR_FORCE_SIGNATURE, cache=True, error_model="numpy"), function)
    _pair_forces[compiled.address] = compiled
    return compiled


@intrinsic
def _call_address(typing_context, address, gap, nx, ny, ex, ey, parameters):  # type: ignore[no-untyped-def]
    """Call machine code at an address; passing functions as arguments would cost 25 us each at every call."""
    numbers = [types.float64] * 5
    signature = PAIR_FORCE_SIGNATURE.return_type(types.int64, *numbers, types.float64[::1])

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        result = context.get_value_type(signature.return_type)
        kinds = [context.get_value_type(kind) for kind in signature.args[1:]]
        pointer = builder.inttoptr(arguments[0], ir.FunctionType(result, kinds).as_pointer())
        return builder.call(pointer, arguments[1:])

    return signature, generate


@intrinsic
def _fused(typing_context, a, b, c):  # type: ignore[no-untyped-def]
    """Multiply and add in one instruction."""

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        return builder.fma(*arguments)

    return types.float64(types.float64, types.float64, types.float64), generate


if numba.config.DISABLE_JIT:

    def fused(a, b, c):  # type: ignore[no-untyped-def]
        """Return a b + c."""
        return a * b + c

    def call_pair_force(address, gap, nx, ny, ex, ey, parameters):  # type: ignore[no-untyped-def]
        """Call the pair force at an address: (fx, fy) [N]."""
        return _pair_forces[int(address)](gap, nx, ny, ex, ey, parameters)

else:

    @inner
    def fused(a, b, c):  # type: ignore[no-untyped-def]
        """Return a b + c, rounded once: the same bits on every processor, in half the latency of two instructions."""
        return _fused(a, b, c)

    @inner
    def call_pair_force(address, gap, nx, ny, ex, ey, parameters):  # type: ignore[no-untyped-def]
        """Call the pair force at an address: (fx, fy) [N]."""
        return _call_address(address, gap, nx, ny, ex, ey, parameters)
