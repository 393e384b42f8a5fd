"""Declared parameters of plugins, with unit, range and default, checked once; and types of arguments of functions."""

import difflib
import math
import reprlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from numbers import Integral, Real
from os import PathLike
from types import NoneType
from typing import Any, ClassVar, get_args

from evac.base.errors import PluginError, ScenarioError, escaped, text_of

#: Greatest absolute value of a parameter: far beyond any quantity in SI units, and exact as a whole number.
GREATEST = 1e15


def did_you_mean(word: str, known: list[str] | tuple[str, ...]) -> str:
    """Return a hint for an unknown name: the closest known one, or all of them."""
    close = difflib.get_close_matches(word, list(known), n=1, cutoff=0.5)
    if close:
        return f"did you mean {close[0]!r}?"
    return "known: " + (escaped(", ".join(sorted(known))) or "none")


@dataclass(frozen=True)
class Parameter:
    """One keyword of a plugin, declared as a class attribute.

    Parameters
    ----------
    default : object
        Value used if the case does not set it. Its type is the required type; an int is accepted for a float. That of
        a tuple of words is a list of words, each of `choices` if there are any, which becomes a tuple without
        repetitions; that of a dictionary is a table.
    doc : str
        One sentence, shown by ``evac plugins`` and in the reference.
    unit : str
        SI unit, empty for a dimensionless number or a word.
    minimum, maximum : float
        Closed bounds of a number; ``above`` is an open lower bound. Without bounds, numbers must lie within
        `GREATEST` of zero: state bounds beyond which memory or time run out, or the model overflows.
    choices : tuple of str
        The allowed words, or those of a list.
    infinite : bool
        Whether infinity is allowed.
    distribution : bool
        Whether it is a distribution, given as a number or a table, whose values must satisfy the bounds; `check`
        then returns an ``evac.base.distributions.Distribution``.
    """

    default: Any
    doc: str
    unit: str = ""
    minimum: float | None = None
    above: float | None = None
    maximum: float | None = None
    choices: tuple[str, ...] = ()
    infinite: bool = False
    distribution: bool = False

    @property
    def range(self) -> str:
        """Description of the allowed values: the choices, or the bounds; empty if there are none."""
        if self.choices:
            return ", ".join(self.choices)
        low = (
            f"> {self.above:g}"
            if self.above is not None
            else f">= {self.minimum:g}"
            if self.minimum is not None
            else ""
        )
        high = f"<= {self.maximum:g}" if self.maximum is not None else ""
        return ", ".join(part for part in (low, high, "or inf" if self.infinite else "") if part)

    def __get__(self, instance: Any, owner: Any = None) -> Any:
        """Return the declaration, on the class; the attribute of an instance takes precedence."""
        return self

    def check(self, key: str, value: Any) -> Any:
        """Return `value` in the declared type, or raise PluginError naming `key` and the range."""
        if self.distribution:
            return self._check_distribution(key, value)
        if isinstance(self.default, bool) or self.default is None:
            if isinstance(self.default, bool) and not isinstance(value, bool):
                raise PluginError(f"{key}: expected true or false, got {reprlib.repr(value)}")
            return value
        if isinstance(self.default, str):
            if type(value) is int and not self.choices:
                return str(value)  # as the name of a layer
            if not isinstance(value, str):
                raise PluginError(f"{key}: expected a word, got {reprlib.repr(value)}")
            return self._check_word(key, value)
        if isinstance(self.default, tuple) and all(isinstance(word, str) for word in self.default):
            if not isinstance(value, list | tuple) or not all(isinstance(word, str) for word in value):
                raise PluginError(f"{key}: must be a list of words, got {reprlib.repr(value)}")
            return tuple(dict.fromkeys(self._check_word(key, word) for word in value))
        if isinstance(self.default, Mapping) and not isinstance(value, Mapping):
            raise PluginError(f"{key}: must be a table, got {reprlib.repr(value)}")
        if isinstance(self.default, (int, float)):
            return self._check_number(key, value)
        return value

    def _check_word(self, key: str, word: str) -> str:
        if self.choices and word not in self.choices:
            raise PluginError(f"{key}: unknown value {reprlib.repr(word)}; {did_you_mean(word, self.choices)}")
        return word

    def _check_number(self, key: str, value: Any) -> float | int:
        whole = isinstance(self.default, int)
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise PluginError(f"{key}: expected {'a whole number' if whole else 'a number'}, got {reprlib.repr(value)}")
        if value != value or (abs(value) == math.inf and (whole or not self.infinite)):
            raise PluginError(f"{key}: must be finite, got {reprlib.repr(value)}")
        if GREATEST < abs(value) < math.inf:
            raise PluginError(f"{key}: must lie within {GREATEST:g} of zero, got {reprlib.repr(value)}")
        if whole and value != int(value):
            raise PluginError(f"{key}: expected a whole number, got {reprlib.repr(value)}")
        unit = f" {self.unit}" if self.unit else ""
        if self.minimum is not None and value < self.minimum:
            raise PluginError(f"{key}: must be at least {self.minimum}{unit}, got {reprlib.repr(value)}")
        if self.above is not None and value <= self.above:
            raise PluginError(f"{key}: must be greater than {self.above}{unit}, got {reprlib.repr(value)}")
        if self.maximum is not None and value > self.maximum:
            raise PluginError(f"{key}: must be at most {self.maximum}{unit}, got {reprlib.repr(value)}")
        return int(value) if whole else float(value)

    def _check_distribution(self, key: str, value: Any) -> Any:
        from evac.base.distributions import parse

        try:
            return parse(value, key, minimum=self.minimum, above=self.above, maximum=self.maximum)
        except ScenarioError as error:
            raise PluginError(str(error)) from error


class Configurable:
    """Base of every plugin class: a name, and keyword-only parameters declared as `Parameter`.

    >>> class Spring(Configurable):
    ...     name = "spring"
    ...     stiffness = Parameter(1.2e5, "contact stiffness k (eq. 3)", unit="kg/s2", above=0)
    >>> Spring(stiffness=2e5).stiffness
    200000.0
    """

    name: ClassVar[str]

    def __init__(self, **values: Any) -> None:
        declared = self.declared()
        for key in values:
            if key not in declared:
                raise PluginError(
                    f"{self.name}.{key}: {self.name!r} has no such parameter; {did_you_mean(key, list(declared))}"
                )
        for key, parameter in declared.items():
            value = values.get(key, parameter.default)
            setattr(self, key, parameter.check(f"{self.name}.{key}", value))

    @classmethod
    def declared(cls) -> Mapping[str, Parameter]:
        """Return the parameters of the class and its bases, by name, in order of declaration."""
        parameters: dict[str, Parameter] = {}
        for base in reversed(cls.__mro__):
            parameters.update({key: value for key, value in vars(base).items() if isinstance(value, Parameter)})
        return parameters

    def values(self) -> dict[str, Any]:
        """Return the values of the parameters by name."""
        return {key: getattr(self, key) for key in self.declared()}


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

PATH: Any = str | PathLike  #: The types of paths.


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
