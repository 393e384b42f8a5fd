"""Kernels: Python functions that run as machine code, compiled once and kept on disk.

`kernel` declares an entry, which Python calls and whose annotations are its signature; `inner` a function that only
kernels call. Nothing is compiled, and numba is not imported, before an entry is called whose code is not on disk.
With the environment variable NUMBA_DISABLE_JIT set, kernels run as the Python functions that they are.
"""

import ctypes
import os
from collections.abc import Callable, Sequence
from types import ModuleType
from typing import Any, get_args, get_origin, get_type_hints

from evac.errors import PluginError
from evac.jit.layout import Array, Kind, Struct, check_array, describe, kind_of

#: Run kernels as Python functions, to look into them.
INTERPRETED = os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0")

#: Arguments by name and kind, and the kinds of the numbers returned.
Signature = tuple[tuple[tuple[str, Kind], ...], tuple[str, ...]]

_C_TYPES: dict[str, Any] = {"int64": ctypes.c_int64, "float64": ctypes.c_double}


#: Name of the function that machine code calls with the label of a kernel in which an exception has been raised.
NOTE_RAISED = "evac_note_raised"

_raised: list[str] = []


def _note_raised(label: bytes) -> None:
    """Remember a kernel in which an exception has been raised, until the call from Python has returned."""
    _raised.append(label.decode())


#: The same, as machine code calls it.
note_raised = ctypes.CFUNCTYPE(None, ctypes.c_char_p)(_note_raised)


class Kernel:
    """A function that kernels can call.

    Attributes
    ----------
    function : callable
        The Python function.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        self.function = function
        self.__name__, self.__doc__, self.__module__ = function.__name__, function.__doc__, function.__module__
        self.__wrapped__ = function

    @property
    def label(self) -> str:
        """Name of the kernel with its module."""
        return f"{self.__module__}.{self.function.__qualname__}"

    def __call__(self, *arguments: Any) -> Any:
        """Run the Python function."""
        return self.function(*arguments)

    def __repr__(self) -> str:
        return f"<kernel {self.label}>"


class Entry(Kernel):
    """A kernel with a declared signature: it has machine code and an address of its own.

    The signature is that of the annotations, or of the calls of an address that it is made for.

    Raises
    ------
    TypeError
        If the function lacks annotations or has others than kernels know.
    """

    def __init__(self, function: Callable[..., Any], like: "AddressCall | None" = None) -> None:
        super().__init__(function)
        self._signature: Signature | None = None
        if like is not None:
            code = function.__code__
            names = code.co_varnames[: code.co_argcount]
            if len(names) != len(like.kinds):
                raise TypeError(f"kernel {self.label} takes {len(names)} arguments; it must take {len(like.kinds)}")
            self._signature = tuple(zip(names, like.kinds, strict=True)), like.returns
        self._call: Callable[..., Any] | None = None
        self._address = 0

    @property
    def signature(self) -> Signature:
        """Names and kinds of the arguments, and the kinds of the numbers returned."""
        if self._signature is None:
            hints = get_type_hints(self.function, include_extras=True)
            code = self.function.__code__
            names = code.co_varnames[: code.co_argcount]
            try:
                result = hints.pop("return")
                arguments = tuple((name, kind_of(hints[name])) for name in names)
                parts = get_args(result) if get_origin(result) is tuple else [result]
                returned = () if result is type(None) else tuple(map(kind_of, parts))
            except KeyError as missing:
                raise TypeError(f"kernel {self.label}: {missing} has no annotation") from None
            except TypeError as wrong:
                raise TypeError(f"kernel {self.label}: {wrong}") from None
            numbers = tuple(kind for kind in returned if isinstance(kind, str))
            if numbers != returned:
                raise TypeError(f"kernel {self.label}: it can return int, float, bool, a tuple of them or None")
            self._signature = arguments, numbers
        return self._signature

    @property
    def address(self) -> int:
        """Address of the machine code, which is loaded or compiled if need be."""
        if not self._address:
            if INTERPRETED:
                self._address = id(self)
                _interpreted[self._address] = self.function
            else:
                from evac.jit.loading import addresses_of  # imports llvmlite

                addresses_of([self])
        return self._address

    @property
    def is_ready(self) -> bool:
        """Whether the machine code has been loaded."""
        return bool(self._address)

    def bind(self, address: int) -> None:
        """Let calls go to the machine code at an address."""
        kinds, returned = self.signature
        if len(returned) <= 1:  # only kernels call what returns several numbers
            result = _C_TYPES[returned[0]] if returned else None
            types = [
                _C_TYPES.get(kind, ctypes.c_int64) if isinstance(kind, str) else ctypes.c_int64 for _, kind in kinds
            ]
            self._call = ctypes.CFUNCTYPE(result, *types)(address)
        self._address = address

    def __call__(self, *arguments: Any) -> Any:
        """Run the kernel.

        Raises
        ------
        TypeError
            If an argument does not fit the signature.
        PluginError
            If a function under ``numba.njit`` has raised an exception, in this kernel or in one that it calls.
        """
        if INTERPRETED or len(self.signature[1]) > 1:
            return self.function(*arguments)
        if self._call is None:
            _ = self.address
        assert self._call is not None
        kinds, _ = self.signature
        if len(kinds) != len(arguments):
            raise TypeError(f"kernel {self.label} takes {len(kinds)} arguments, {len(arguments)} given")
        kept: list[Any] = []  # headers live until the call returns
        passed: list[float] = []
        for (name, kind), value in zip(kinds, arguments, strict=True):
            if isinstance(kind, Array):
                check_array(value, kind, f"{self.label}: {name}")
                header = (ctypes.c_int64 * (1 + value.ndim))(value.ctypes.data, *value.shape)
                kept.append(header)
                passed.append(ctypes.addressof(header))
            elif isinstance(kind, str):
                passed.append(float(value) if kind == "float64" else int(value))
            else:
                if not isinstance(value, kind):
                    raise TypeError(f"{self.label}: {name}: {type(value).__name__}, not {kind.__name__}")
                passed.append(value.memory_address)
        found = self._call(*passed)
        if _raised:
            label = _raised[0]
            _raised.clear()
            raise PluginError(
                f"kernel {label}: a function that it calls has raised an exception; run with NUMBA_DISABLE_JIT=1 to see"
                " which"
            )
        return found


#: Python functions by what stands for their addresses where nothing is compiled.
_interpreted: dict[int, Callable[..., Any]] = {}


class Intrinsic:
    """An operation that kernels compile to instructions of their own, see `evac.jit.instructions`.

    Attributes
    ----------
    name : str
    twin : callable
        What it does, in Python.
    """

    def __init__(self, name: str, twin: Callable[..., Any]) -> None:
        self.name, self.twin = name, twin

    def __call__(self, *arguments: Any) -> Any:
        """Do it in Python."""
        return self.twin(*arguments)


class AddressCall:
    """A call of machine code at an address, with one signature: what makes a part of a kernel exchangeable.

    Called with the address first.

    Parameters
    ----------
    arguments : sequence of types
        As entries annotate them.
    returns : tuple of types
        One number, or several as pair forces return.
    """

    def __init__(self, arguments: Sequence[Any], returns: tuple[Any, ...]) -> None:
        self.kinds = tuple(kind_of(hint) for hint in arguments)
        self.returns = tuple(str(kind_of(hint)) for hint in returns)

    def check(self, entry: Any, what: str) -> None:
        """Refuse what cannot be called so; `what` is its name in the message.

        Raises
        ------
        PluginError
            If it is no kernel that Python can call, or takes or returns something else.
        """
        if isinstance(entry, Entry):
            kinds, returned = entry.signature
            if tuple(kind for _, kind in kinds) == self.kinds and returned == self.returns:
                return
        raise PluginError(f"{what} must be a kernel {self}, made by a decorator of evac.jit")

    def __str__(self) -> str:
        names = [kind.__name__ if isinstance(kind, type) else describe(kind) for kind in self.kinds]
        return f"({', '.join(names)}) -> ({', '.join(self.returns)})"

    def __call__(self, address: int, *arguments: Any) -> Any:
        """Call a kernel that is not compiled."""
        return _interpreted[int(address)](*arguments)


def kernel(function: Callable[..., Any]) -> Any:
    """Make a kernel that Python can call of a module-level function whose annotations are its signature.

    Arguments are int, float, bool, a `Struct` or an array type of `evac.jit`; it returns int, float, bool or None.
    """
    return Entry(function)


def inner(function: Callable[..., Any]) -> Any:
    """Make a function that kernels can call of a module-level function; it needs no annotations."""
    return Kernel(function)


def entries_of(module: ModuleType) -> list[Entry]:
    """Return the entries that a module and its classes define."""
    holders = [module, *(value for value in vars(module).values() if isinstance(value, type))]
    found = [value for holder in holders for value in vars(holder).values() if isinstance(value, Entry)]
    return [entry for entry in dict.fromkeys(found) if entry.__module__ == module.__name__]


def structs_of(kind: Kind) -> set[type[Struct]]:
    """Return the structs that a value of a kind holds or is."""
    if isinstance(kind, Array | str):
        return set()
    return {kind}.union(*(structs_of(inner_kind) for inner_kind in kind.kinds.values()))
