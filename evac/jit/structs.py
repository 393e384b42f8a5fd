"""Memory shared by Python and kernels: structs of numbers and array headers, passed by reference.

A kernel receives one pointer for each struct, regardless of the number of arrays in it. The address and the shape of an
array are words in the memory of the struct; Python replaces an array, for example to enlarge it, by assignment to the
attribute.
"""

from typing import Annotated, Any, ClassVar, NamedTuple, Self, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray


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
Kind = Array | str | type["Struct"]


def kind_of(hint: Any) -> Kind:
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


def words_of(kind: Kind) -> int:
    """Return the number of words of 8 bytes that a value needs in a struct."""
    return 1 + len(kind.shape) if isinstance(kind, Array) else 1


def describe(kind: Kind) -> str:
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

    kinds: ClassVar[dict[str, Kind]] = {}  # of the attributes, in order
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
        self.memory_address = int(self._words.ctypes.data)
        for name, value in values.items():
            setattr(self, name, value)

    def values(self) -> dict[str, Any]:
        """Return the attributes by name."""
        return {name: getattr(self, name) for name in self.kinds}

    def replace(self, **changes: Any) -> Self:
        """Return a struct with some attributes changed; unchanged arrays are shared."""
        return type(self)(**(self.values() | changes))

    def __reduce__(self) -> Any:
        return _rebuilt, (type(self), self.values())

    def __repr__(self) -> str:
        return f"{type(self).__name__}({', '.join(self.kinds)})"


def _rebuilt(struct: type[Struct], values: dict[str, Any]) -> Struct:
    return struct(**values)
