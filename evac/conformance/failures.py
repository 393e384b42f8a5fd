"""Failures of checks, all of one form: ``plugin: check, what is examined: what is wrong; remedy``.

A check calls `require` within a block of `examining` or `scene`, and is called by `run_check`. Exceptions that the
plugin raises become failures too.
"""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from evac.base.errors import EvacError, PluginError, in_one_line, place_of, text_of


class CheckError(PluginError):
    """A check has failed: what is wrong, by how much, and after a semicolon what to change; `place` was examined."""

    place = ""


def require(holds: bool | np.bool_, told: str) -> None:
    """Raise a `CheckError` with a text, what is wrong and the remedy, if something does not hold."""
    if not holds:
        raise CheckError(told)


def require_close(first: ArrayLike, second: ArrayLike, tolerance: float, told: str) -> None:
    """Raise a `CheckError` if arrays are not finite, or further apart than a tolerance; `told` has a field for it."""
    apart = float(np.abs(np.subtract(first, second)).max())
    require(apart <= tolerance, told.format(apart))


@contextmanager
def examining(what: str, remedy: str = "correct the plugin") -> Iterator[None]:
    """Name what is examined in failures, and turn other exceptions into failures; the innermost block counts.

    The remedy is that of exceptions that state none.
    """
    try:
        yield
    except (KeyboardInterrupt, GeneratorExit):
        raise
    except BaseException as error:
        failure = error if isinstance(error, CheckError) else _failure_of(error, remedy)
        failure.place = failure.place or what
        raise failure from failure.__cause__


def scene(title: str) -> AbstractContextManager[None]:
    """Name the scene in failures, as `examining`."""
    return examining(f"scene '{title}'")


def run_check(plugin: Any, check: Callable[..., Any], *arguments: Any) -> Any:
    """Run a check of a plugin class and return its result.

    The `PluginError` of a failed check names plugin, check, what was examined, file, line, and the remedy. Its cause is
    the exception that the plugin raised, if there is one.
    """
    try:
        with examining("the class"):
            return check(*arguments)
    except CheckError as failure:
        name, place = getattr(plugin, "name", None), place_of(plugin)
        if not (isinstance(name, str) and name):
            name = getattr(plugin, "__name__", repr(plugin))
        wrong, _, remedy = failure.args[0].rpartition("; ")
        where = "" if ", line " in wrong or place == "no file" else f" ({place})"
        told = f"{name}: {check.__name__}, {failure.place}: {wrong}{where}; {remedy}"
        raise PluginError(told) from failure.__cause__


def _failure_of(error: BaseException, remedy: str) -> CheckError:
    """Return the failure for an exception, with the exception that the plugin raised as its cause."""
    if not isinstance(error, EvacError):
        failure, cause = CheckError(f"raises {in_one_line(error)} ({place_of(error)}); {remedy}"), error
    else:
        text = text_of(error.args[0]) if isinstance(error, PluginError) else text_of(error)  # no advice to check it
        failure, cause = CheckError(text if "; " in text else f"{text}; {remedy}"), error.__cause__ or error
    failure.__cause__ = cause
    return failure


def with_remedy(error: EvacError, remedy: str) -> CheckError:
    """Return the failure for an error with another remedy than the stated one."""
    return CheckError(f"{text_of(error).rpartition('; ')[0]}; {remedy}")
