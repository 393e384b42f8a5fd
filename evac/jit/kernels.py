"""Kernels: Python functions that run as machine code, compiled once and cached on disk.

`kernel` declares an entry, which Python calls and whose annotations are its signature; `inner` declares a function that
only kernels call. Numba is imported, and an entry compiled, when the entry is first called and its code is not on disk.
If the environment variable NUMBA_DISABLE_JIT is set, kernels run as plain Python functions.

A kernel receives one pointer for each `Struct`, regardless of the number of arrays in it. The address and the shape of
an array are words in the memory of the struct; Python replaces an array, for example to enlarge it, by assignment to
the attribute.
"""

import ctypes
import os
from collections.abc import Callable, Sequence
from functools import cached_property
from types import ModuleType
from typing import Annotated, Any, ClassVar, NamedTuple, Self, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

from evac.base.errors import PluginError, fault, text_of


class Array(NamedTuple):
    """Type of an array in a struct or of an argument: the type of its elements, and its fixed extents."""

    dtype: str
    shape: tuple[int | None, ...]


Floats = Annotated[NDArray[np.float64], Array("float64", (None,))]
Pairs = Annotated[NDArray[np.float64], Array("float64", (None, 2))]
Triples = Annotated[NDArray[np.float64], Array("float64", (None, 3))]
Quads = Annotated[NDArray[np.float64], Array("float64", (None, 4))]
FloatGrid = Annotated[NDArray[np.float64], Array("float64", (None, None))]
Ints = Annotated[NDArray[np.int32], Array("int32", (None,))]
IntPairs = Annotated[NDArray[np.int32], Array("int32", (None, 2))]
IntGrid = Annotated[NDArray[np.int32], Array("int32", (None, None))]
Longs = Annotated[NDArray[np.int64], Array("int64", (None,))]
Indices = Annotated[NDArray[np.uint32], Array("uint32", (None,))]
Bytes = Annotated[NDArray[np.uint8], Array("uint8", (None,))]
ByteGrid = Annotated[NDArray[np.uint8], Array("uint8", (None, None))]

#: Kind of an argument of a kernel or an attribute of a struct: an array, "int64", "float64", or a struct.
ArgumentKind = Array | str | type["Struct"]


def kind_of(hint: Any) -> ArgumentKind:
    """Return the kind of values of an annotated type."""
    if get_origin(hint) is Annotated:
        for note in get_args(hint)[1:]:
            if isinstance(note, Array):
                return note
    if hint is float:
        return "float64"
    if hint is int or hint is bool:
        return "int64"
    if isinstance(hint, type) and issubclass(hint, Struct):
        return hint
    raise TypeError(f"kernels do not support {hint}; use int, float, bool, a Struct or an array type of evac.jit")


def words_of(kind: ArgumentKind) -> int:
    """Return the number of words of 8 bytes that a value needs in a struct."""
    return 1 + len(kind.shape) if isinstance(kind, Array) else 1


def describe(kind: ArgumentKind) -> str:
    """Return a text that identifies the memory layout of a kind, including nested structs."""
    if isinstance(kind, Array):
        return f"{kind.dtype}{list(kind.shape)}"
    if isinstance(kind, str):
        return kind
    return f"{kind.__name__}({', '.join(f'{name}: {describe(inner)}' for name, inner in kind.kinds.items())})"


def check_array(array: Any, kind: Array, name: str) -> None:
    """Check that kernels can read a value as an array of a kind."""
    if not isinstance(array, np.ndarray):
        raise TypeError(f"{name}: must be an array, not {type(array).__name__}")
    fits = array.ndim == len(kind.shape)
    for extent, given in zip(kind.shape, array.shape, strict=False):  # faster than a generator
        fits &= extent is None or extent == given
    if array.dtype != kind.dtype or not fits or not array.flags.c_contiguous:
        wanted = ", ".join("n" if extent is None else str(extent) for extent in kind.shape)
        raise TypeError(
            f"{name}: must be an array of {kind.dtype} of shape ({wanted}) and C-contiguous, not of {array.dtype} of"
            f" shape {array.shape} (contiguous: {array.flags.c_contiguous})"
        )


class _NumberField:
    """A number in the memory of a struct."""

    def __init__(self, word: int, dtype: str) -> None:
        self.word, self.dtype = word, dtype

    def __get__(self, struct: "Struct | None", owner: type | None = None) -> Any:
        if struct is None:
            return self
        return (struct._floats if self.dtype == "float64" else struct._words).item(self.word)

    def __set__(self, struct: "Struct", value: float) -> None:
        (struct._floats if self.dtype == "float64" else struct._words)[self.word] = value


class _ArrayField:
    """An array whose address and shape are in the memory of a struct; the instance holds the array itself."""

    def __init__(self, word: int, kind: Array, name: str) -> None:
        self.word, self.kind, self.name = word, kind, name

    def __set__(self, struct: "Struct", array: Any) -> None:
        check_array(array, self.kind, f"{type(struct).__name__}.{self.name}")
        struct.__dict__[self.name] = array
        struct._words[self.word] = array.ctypes.data
        struct._words[self.word + 1 : self.word + 1 + array.ndim] = array.shape


class _StructField:
    """A struct whose address is in the memory of another one."""

    def __init__(self, word: int, name: str) -> None:
        self.word, self.name = word, name

    def __set__(self, struct: "Struct", inner: "Struct") -> None:
        struct.__dict__[self.name] = inner
        struct._words[self.word] = inner.memory_address


class Struct:
    """Base class of structs that kernels take by reference; subclasses annotate attributes, given by keyword.

    Kernels ignore the ``writeable`` flag of NumPy arrays.
    """

    kinds: ClassVar[dict[str, ArgumentKind]] = {}  # of the attributes, in order
    words: ClassVar[dict[str, int]] = {}  # the first one of each attribute
    memory_address = 0  # of an instance
    _size: ClassVar[int] = 0

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        cls.kinds, cls.words, word = {}, {}, 0
        for name, hint in get_type_hints(cls, include_extras=True).items():
            if name.startswith("_") or get_origin(hint) is ClassVar:
                continue
            if hasattr(Struct, name):
                raise TypeError(f"{cls.__name__}.{name}: this name is reserved in structs; choose another one")
            kind = kind_of(hint)
            cls.kinds[name], cls.words[name] = kind, word
            field: Any
            if isinstance(kind, Array):
                field = _ArrayField(word, kind, name)
            elif isinstance(kind, str):
                field = _NumberField(word, kind)
            else:
                field = _StructField(word, name)
            setattr(cls, name, field)
            word += words_of(kind)
        cls._size = word

    def __init__(self, **values: Any) -> None:
        if values.keys() != self.kinds.keys():
            wrong = sorted(values.keys() ^ self.kinds.keys())
            raise TypeError(f"{type(self).__name__}: missing or unknown attributes: {', '.join(wrong)}")
        self._words = np.zeros(self._size, np.int64)
        self._floats = self._words.view(np.float64)
        self.memory_address = self._as_parameter_ = int(self._words.ctypes.data)  # what ctypes passes
        for name, value in values.items():
            setattr(self, name, value)

    def values(self) -> dict[str, Any]:
        """Return the attributes by name."""
        return {name: getattr(self, name) for name in self.kinds}

    def replace(self, **changes: Any) -> Self:
        """Return a struct with some attributes changed; unchanged arrays are shared."""
        return type(self)(**(self.values() | changes))

    def __reduce__(self) -> Any:
        return _rebuilt, (type(self), self.values())  # copy.deepcopy copies the arguments

    def __repr__(self) -> str:
        return f"{type(self).__name__}({', '.join(self.kinds)})"


def _rebuilt(struct: type[Struct], values: dict[str, Any]) -> Struct:
    return struct(**values)


#: Whether kernels run as Python functions, for debugging.
INTERPRETED = os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0")

#: Names and kinds of the arguments, and kinds of the returned numbers.
Signature = tuple[tuple[tuple[str, ArgumentKind], ...], tuple[str, ...]]

_C_TYPES: dict[str, Any] = {"int64": ctypes.c_int64, "float64": ctypes.c_double}

#: The types that ctypes passes as numbers of a kind; structs have the attribute that it passes.
_PASSED: dict[ArgumentKind, Any] = {"int64": int, "float64": (float, int)}


#: Name of the function that machine code calls with the label of a kernel that has raised an exception.
NOTE_RAISED = "evac_note_raised"

_raised: list[str] = []


#: Records a kernel that has raised an exception, until the call from Python returns.
note_raised = ctypes.CFUNCTYPE(None, ctypes.c_char_p)(lambda label: _raised.append(label.decode()))


class Kernel:
    """A function that kernels can call; if `is_inlined`, its code takes the place of every call."""

    def __init__(self, function: Callable[..., Any], is_inlined: bool = False) -> None:
        self.function, self.is_inlined = function, is_inlined
        self.__name__, self.__doc__, self.__module__ = function.__name__, function.__doc__, function.__module__
        self.__wrapped__ = function

    @cached_property
    def label(self) -> str:
        """Qualified name of the kernel with its module."""
        return f"{self.__module__}.{self.function.__qualname__}"

    @property
    def title(self) -> str:
        """Name of the kernel for messages, without its module."""
        return str(self.function.__name__)

    def __call__(self, *arguments: Any) -> Any:
        """Run the Python function."""
        return self.function(*arguments)

    def __repr__(self) -> str:
        return f"<kernel {self.label}>"


class Entry(Kernel):
    """A kernel with a declared signature, which has its own machine code and address.

    The signature is given by the annotations, or by the `AddressCall` that it is made for.
    """

    def __init__(self, function: Callable[..., Any], like: "AddressCall | None" = None) -> None:
        super().__init__(function)
        self._signature: Signature | None = None
        if like is not None:
            code = function.__code__
            names = code.co_varnames[: code.co_argcount]
            if len(names) != len(like.kinds):
                raise TypeError(
                    f"kernel {self.title} takes {len(names)} arguments, {', '.join(names) or 'none'}; it must take"
                    f" {len(like.kinds)}"
                )
            self._signature = tuple(zip(names, like.kinds, strict=True)), like.returns
        self._call: Callable[..., Any] | None = None
        self._address = 0
        self._accepted = set[tuple[type, ...]]()  # types of arguments that need no check and that ctypes passes

    @property
    def signature(self) -> Signature:
        """Names and kinds of the arguments, and kinds of the returned numbers."""
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
                raise TypeError(f"kernel {self.title}: {missing} has no type annotation; add one") from None
            except TypeError as wrong:
                raise TypeError(f"kernel {self.title}: {wrong}") from None
            numbers = tuple(kind for kind in returned if isinstance(kind, str))
            if numbers != returned:
                raise TypeError(f"kernel {self.title}: it must return int, float, bool, a tuple of them or None")
            self._signature = arguments, numbers
        return self._signature

    @property
    def address(self) -> int:
        """Address of the machine code, which is loaded or compiled if necessary."""
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
        """Use the machine code at an address for calls."""
        kinds, returned = self.signature
        if len(returned) <= 1:  # entries with several results are only called by kernels
            result = _C_TYPES[returned[0]] if returned else None
            types = [
                _C_TYPES.get(kind, ctypes.c_int64) if isinstance(kind, str) else ctypes.c_int64 for _, kind in kinds
            ]
            self._call = ctypes.CFUNCTYPE(result, *types)(address)
        self._address = address

    def __call__(self, *arguments: Any) -> Any:
        """Run the kernel."""
        types = tuple(map(type, arguments))
        if types in self._accepted:
            assert self._call is not None
            returned = self._call(*arguments)
        elif INTERPRETED or (self._call is None and len(self.signature[1]) > 1):
            return self.function(*arguments)
        else:
            returned = self._call_checked(arguments)
            kinds = self.signature[0]
            if all(issubclass(given, _PASSED.get(kind, Struct)) for (_, kind), given in zip(kinds, types, strict=True)):
                self._accepted.add(types)
        if _raised:
            label = _raised[0]
            _raised.clear()
            raise PluginError(
                f"kernel {label}: a function that it calls raised an exception; set NUMBA_DISABLE_JIT=1 to see it which"
            )
        return returned

    def _call_checked(self, arguments: tuple[Any, ...]) -> Any:
        """Check the arguments and call the machine code, which is loaded if necessary."""
        if self._call is None:
            _ = self.address
        assert self._call is not None
        assert self._signature is not None
        kinds, _ = self._signature
        if len(kinds) != len(arguments):
            raise TypeError(f"kernel {self.label} takes {len(kinds)} arguments, but {len(arguments)} were given")
        kept: list[Any] = []  # keeps headers alive until the call returns
        passed: list[float] = []
        for (name, kind), value in zip(kinds, arguments, strict=True):
            if isinstance(kind, type):
                if not isinstance(value, kind):
                    raise TypeError(f"{self.label}: {name}: must be a {kind.__name__}, not {type(value).__name__}")
                passed.append(value.memory_address)
            elif isinstance(kind, str):
                passed.append(float(value) if kind == "float64" else int(value))
            else:
                check_array(value, kind, f"{self.label}: {name}")
                header = (ctypes.c_int64 * (1 + value.ndim))(value.ctypes.data, *value.shape)
                kept.append(header)
                passed.append(ctypes.addressof(header))
        return self._call(*passed)


#: Python functions by the numbers that represent their addresses if nothing is compiled.
_interpreted: dict[int, Callable[..., Any]] = {}


class Callback:
    """A Python function that kernels call at an address, slower than a kernel; of structs, it gets the address.

    An exception that it raises is kept as `error`; the kernel then gets zero.
    """

    def __init__(self, function: Callable[..., int], like: "AddressCall") -> None:
        self.error: BaseException | None = None

        def call(*given: Any) -> int:
            try:
                return int(function(*given))
            except BaseException as error:
                self.error = error
                return 0

        if INTERPRETED:
            self.address = id(self)
            _interpreted[self.address] = call
        else:
            types = [_C_TYPES.get(str(kind), ctypes.c_int64) for kind in like.kinds]
            self._call = ctypes.CFUNCTYPE(_C_TYPES[like.returns[0]], *types)(call)
            self.address = int(ctypes.cast(self._call, ctypes.c_void_p).value or 0)


class Intrinsic:
    """An operation that is compiled to special instructions; `twin` is its Python implementation."""

    def __init__(self, name: str, twin: Callable[..., Any]) -> None:
        self.name, self.twin = name, twin

    def __call__(self, *arguments: Any) -> Any:
        """Run the Python implementation."""
        return self.twin(*arguments)


class AddressCall:
    """A call of machine code at an address, its first argument, by which kernels call exchangeable parts."""

    def __init__(self, arguments: Sequence[Any], returns: tuple[Any, ...]) -> None:
        self.kinds = tuple(kind_of(hint) for hint in arguments)
        self.returns = tuple(str(kind_of(hint)) for hint in returns)

    def check(self, entry: Any, what: str, plugin: Any) -> None:
        """Check that an entry has this signature; for a plugin class and the name `what`."""
        got = f"the {type(entry).__name__} {getattr(entry, '__name__', entry)}"
        if isinstance(entry, Entry):
            try:
                named, returned = entry.signature
            except TypeError as wrong:
                raise fault(what, text_of(wrong), f"declare a kernel {self}", entry) from None
            kinds = tuple(kind for _, kind in named)
            if (kinds, returned) == (self.kinds, self.returns):
                return
            got = f"{entry.title}{_described(kinds, returned)}"
        remedy = "decorate it with a decorator of evac.jit for this purpose"
        raise fault(what, f"must be a kernel {self}, not {got}", remedy, entry if callable(entry) else plugin)

    def __str__(self) -> str:
        return _described(self.kinds, self.returns)

    def __call__(self, address: int, *arguments: Any) -> Any:
        """Call the Python function of a kernel, if nothing is compiled."""
        return _interpreted[int(address)](*arguments)


def kernel(function: Callable[..., Any]) -> Any:
    """Declare a module-level function as a kernel that Python can call; its annotations are its signature.

    Arguments are int, float, bool, a `Struct` or an array type of `evac.jit`; the result is int, float, bool or None.
    """
    return Entry(function)


def inner(function: Callable[..., Any]) -> Any:
    """Declare a module-level function as a function that kernels can call; it needs no annotations."""
    return Kernel(function)


def inlined(function: Callable[..., Any]) -> Any:
    """Declare a function like `inner` that is small and called in loops: its code takes the place of every call."""
    return Kernel(function, is_inlined=True)


def entries_of(module: ModuleType) -> list[Entry]:
    """Return the entries defined in a module and its classes."""
    holders = [module, *(value for value in vars(module).values() if isinstance(value, type))]
    entries = [value for holder in holders for value in vars(holder).values() if isinstance(value, Entry)]
    return [entry for entry in dict.fromkeys(entries) if entry.__module__ == module.__name__]


def _described(kinds: Sequence[ArgumentKind], returned: Sequence[str]) -> str:
    """Return a signature for messages."""
    names = [kind.__name__ if isinstance(kind, type) else describe(kind) for kind in kinds]
    return f"({', '.join(names)}) -> ({', '.join(returned)})"
