"""Failures of checks, all of one form: ``plugin: check, what is examined: what is wrong; remedy``.

A check calls `require` within a block of `examining` or `scene`, and is called by `run_check`. Exceptions that the
plugin raises become failures too.
"""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Any, TypeVar

import numpy as np

from evac.base.errors import EvacError, PluginError, in_one_line, place_of, text_of

Found = TypeVar("Found")

#: Remedy for exceptions that state none.
REMEDY = "correct the plugin"


class CheckError(PluginError):
    """A check has failed: what is wrong, by how much, and what to change; `place` is what was examined."""

    def __init__(self, wrong: str, remedy: str) -> None:
        super().__init__(f"{wrong}; {remedy}")
        self.wrong, self.remedy, self.place = wrong, remedy, ""


def require(holds: bool | np.bool_, wrong: str, remedy: str) -> None:
    """Raise a `CheckError` if something does not hold."""
    if not holds:
        raise CheckError(wrong, remedy)


@contextmanager
def examining(what: str, remedy: str = REMEDY) -> Iterator[None]:
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


def run_check(plugin: Any, check: Callable[..., Found], *arguments: Any) -> Found:
    """Run a check of a plugin class and return its result.

    Raises
    ------
    PluginError
        The check failed: names plugin, check, what was examined, file, line, and the remedy. Its cause is the exception
        that the plugin raised, if there is one.
    """
    try:
        with examining("the class"):
            return check(*arguments)
    except CheckError as failure:
        name, place = getattr(plugin, "name", None), place_of(plugin)
        if not (isinstance(name, str) and name):
            name = getattr(plugin, "__name__", repr(plugin))
        where = "" if ", line " in failure.wrong or place == "no file" else f" ({place})"
        what = f"{name}: {check.__name__}, {failure.place}"
        raise PluginError(f"{what}: {failure.wrong}{where}; {failure.remedy}") from failure.__cause__


def _failure_of(error: BaseException, remedy: str) -> CheckError:
    """Return the failure for an exception, with the exception that the plugin raised as its cause."""
    if not isinstance(error, EvacError):
        failure = CheckError(f"raises {in_one_line(error)} ({place_of(error)})", remedy)
        failure.__cause__ = error
        return failure
    text = text_of(error.args[0]) if isinstance(error, PluginError) else text_of(error)  # no advice to check it
    wrong, _, stated = text.rpartition("; ")
    failure = CheckError(wrong, stated) if wrong else CheckError(stated, remedy)
    failure.__cause__ = error.__cause__ or error
    return failure
