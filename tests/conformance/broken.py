"""How the tests describe a broken plugin, and the failure that it must cause."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple


class Broken(NamedTuple):
    """A broken plugin.

    Attributes
    ----------
    cls : type
    check : str
        Name of the check that must fail.
    examined : str
        Regular expression of the beginning of what the check examined.
    words : str
        Regular expression found in the rest of the message.
    raises : type, optional
        Class of the exception that the plugin raises itself.
    values : mapping, optional
        Parameters given to `check_plugin`.
    """

    cls: Any
    check: str
    examined: str
    words: str
    raises: type[BaseException] | None = None
    values: Mapping[str, Any] = MappingProxyType({})


def raising(self, *given, **named):
    """Fail, in place of any method."""
    raise KeyError("partner")


def odd(base, **attributes):
    """Return a class that derives from another one and has other attributes."""
    return type("Odd", (base,), {"name": "odd", "__doc__": "Odd.", "__module__": __name__, **attributes})
