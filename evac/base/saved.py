"""State of a run for checkpoints: each part declares the arrays that it saves, which are checked when read."""

import reprlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from operator import attrgetter
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from evac.base.errors import PluginError, ResultError, plugin_code

FINITE = float(np.finfo(np.float64).max)  #: Default bounds: numbers must be finite.

State = Mapping[str, NDArray[Any]]


class SavedError(ResultError):
    """An array of a checkpoint is missing, or is not what its owner saves."""


class Saved:
    """A part of a run, which declares the attributes that a checkpoint saves.

    `saved` names attributes, also attributes of these, in the order in which they are restored: numbers, arrays, other
    parts, and dictionaries and structs of these. Arrays are written in place, but those that `growing` names, or items
    of its names, may have another length and are replaced. Attributes that are None are left out.
    """

    saved: tuple[str, ...] = ()
    growing: tuple[str, ...] = ()

    def state(self) -> dict[str, NDArray[Any]]:
        """Return copies of what is saved."""
        state: dict[str, NDArray[Any]] = {}
        for name in self.saved:
            state |= _arrays_of(name.lstrip("_"), attrgetter(name)(self))
        return state

    def restore(self, state: dict[str, NDArray[Any]]) -> None:
        """Restore what `state` returned; `SavedError` if it is something else."""
        for name in self.saved:
            *owners, attribute = name.split(".")
            owner = attrgetter(".".join(owners))(self) if owners else self
            value = getattr(owner, attribute)
            new = _restored(state, name.lstrip("_"), value, self, name)
            if new is not value:
                setattr(owner, attribute, new)


def _items(value: Any) -> Mapping[Any, Any] | None:
    """Return the items of a mapping or a struct."""
    if isinstance(value, Mapping):
        return value
    return value.values() if hasattr(value, "values") else None


def _arrays_of(key: str, value: Any) -> dict[str, NDArray[Any]]:
    """Return copies of the arrays of an attribute by name."""
    if value is None:
        return {}
    if isinstance(value, Saved):
        return {f"{key}.{name}": array for name, array in value.state().items()}
    items = _items(value)
    if items is None:
        return {key: np.array(value)}
    return {name: array for item, part in items.items() for name, array in _arrays_of(f"{key}.{item}", part).items()}


def _restored(state: State, key: str, value: Any, owner: Saved, name: str) -> Any:
    """Restore an attribute in place and return it, or return what takes its place."""
    if isinstance(value, Saved):
        with part_of(state, f"{key}.") as own:
            value.restore(own)
    elif (items := _items(value)) is not None:
        for item, part in items.items():
            new = _restored(state, f"{key}.{item}", part, owner, name)
            if new is not part:
                value[item] = new
    elif value is not None:
        array, grows = np.asarray(value), name in owner.growing
        shape = (None, *array.shape[1:]) if grows else array.shape
        saved = taken(state, key, array.dtype, shape, -np.inf, np.inf, nan=True)
        if not isinstance(value, np.ndarray):
            return type(value)(saved[()])
        if grows:
            return saved
        value[...] = saved
    return value


def taken(
    state: Mapping[str, NDArray[Any]],
    name: str,
    kind: DTypeLike,
    shape: tuple[int | None, ...],
    least: Any = -FINITE,
    most: Any = FINITE,
    nan: bool = False,
) -> NDArray[Any]:
    """Return a copy of a saved array, after checking it.

    Owners of a state call this in their ``restore``, so that no kernel reads an index, a shape or a number that a run
    cannot have.

    >>> taken({"route": np.array([0, 1], np.int32)}, "route", np.int32, (2,), 0, 1)
    array([0, 1], dtype=int32)
    """
    if name not in state:
        raise SavedError(f"{name}: the array is missing")
    array = state[name]
    fits = array.ndim == len(shape) and all(n in (None, m) for n, m in zip(shape, array.shape, strict=True))
    if array.dtype != np.dtype(kind) or not fits:
        raise SavedError(
            f"{name}: expected {np.dtype(kind)} of shape {shape}, got {array.dtype} of shape {array.shape}"
        )
    with np.errstate(invalid="ignore"):
        right = (array >= least) & (array <= most)
    if nan:
        right |= np.isnan(array)
    if not right.all():
        raise SavedError(f"{name}: {array[~right].flat[0]} is out of range")
    return array.copy()


@contextmanager
def part_of(state: Mapping[str, NDArray[Any]], prefix: str) -> Iterator[dict[str, NDArray[Any]]]:
    """Give the arrays whose names have a prefix, without it; errors of `taken` within name it."""
    try:
        yield {name[len(prefix) :]: array for name, array in state.items() if name.startswith(prefix)}
    except SavedError as error:
        raise SavedError(f"{prefix}{error}") from error


def state_of(plugin: Any, what: str, prefix: str) -> dict[str, NDArray[Any]]:
    """Return copies of the arrays that `state` of a plugin returns."""
    with plugin_code(f"{what}: state", plugin):
        state = plugin.state()
    if not isinstance(state, dict):
        raise PluginError(f"{what}: state() returns {reprlib.repr(state)}; return a dict of arrays")
    for key, value in state.items():
        if not isinstance(value, np.ndarray | np.generic):
            raise PluginError(
                f"{what}: state() returns {reprlib.repr(value)} for {key!r}; return arrays, np.array(...) makes one"
            )
    return {f"{prefix}{key}": np.array(value) for key, value in state.items()}
