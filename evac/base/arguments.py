"""Types of the arguments of public functions: a wrong one is told with the name of the argument."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from numbers import Integral, Real
from os import PathLike
from types import NoneType
from typing import Any, get_args

from evac.base.errors import ScenarioError, text_of

#: How messages name types; those of other classes are their names.
WORDS: Mapping[Any, str] = {
    str: "a text",
    PathLike: "a path",
    bool: "True or False",
    Integral: "a whole number",
    Real: "a number",
    Callable: "a function",
    Mapping: "a dictionary",
    Iterable: "a list",
    Sequence: "a list",
    NoneType: "None",
}

#: The types of paths.
PATH: Any = str | PathLike


def check_types(**given: tuple[Any, Any]) -> None:
    """Check arguments, each given with its type or a union of types; texts are no lists, and True is no number."""
    for name, (value, kind) in given.items():
        kinds = get_args(kind) or (kind,)
        if (
            not isinstance(value, kind)
            or (isinstance(value, bool) and bool not in kinds)
            or (isinstance(value, str | bytes) and str not in kinds)
        ):
            words = " or ".join(WORDS.get(one, f"an evac.{one.__name__}") for one in kinds)
            raise ScenarioError(f"{name} is {text_of(repr(value))} of type {type(value).__name__}; give {words}")
