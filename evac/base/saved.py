"""Arrays of a checkpoint: those of plugins, and checks with which each owner takes its own by kind, shape and range."""

import reprlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from evac.base.errors import PluginError, ResultError, plugin_code

#: Default bounds: numbers must be finite.
FINITE = float(np.finfo(np.float64).max)


class SavedError(ResultError):
    """An array of a checkpoint is missing, or is not what its owner saves."""


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

    Examples
    --------
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


def copies_of(arrays: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Return copies of the arrays of a part of a run, which `take` or `checked` takes back."""
    return {name: np.array(array) for name, array in arrays.items()}


def checked(
    state: Mapping[str, NDArray[Any]], arrays: Mapping[str, NDArray[Any]], bounds: Mapping[str, tuple[Any, ...]]
) -> dict[str, NDArray[Any]]:
    """Return saved arrays that have the kinds and shapes of those of a part of a run; errors as `taken`.

    The bounds are, by name, the arguments of `taken` behind the shape; without them numbers must be finite.
    """
    return {name: taken(state, name, array.dtype, array.shape, *bounds.get(name, ())) for name, array in arrays.items()}


def take(
    state: Mapping[str, NDArray[Any]], arrays: Mapping[str, NDArray[Any]], bounds: Mapping[str, tuple[Any, ...]]
) -> None:
    """Write saved arrays into those of a part of a run, after all of them have been `checked`."""
    for name, values in checked(state, arrays, bounds).items():
        arrays[name][...] = values


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
