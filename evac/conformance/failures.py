"""Failures of checks, all of one form: ``plugin: check, what is examined: what is wrong; remedy``.

A check calls `require` within a block of `examining` or `scene`, and is called by `run_check`.
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


def require(holds: bool | np.bool_, failure: str) -> None:
    """Raise a `CheckError` with a text, what is wrong and the remedy, if something does not hold."""
    if not holds:
        raise CheckError(failure)


def require_close(first: ArrayLike, second: ArrayLike, tolerance: float, failure: str) -> None:
    """Raise a `CheckError` if arrays are not finite, or further apart than a tolerance; the text has a field for it."""
    apart = float(np.abs(np.subtract(first, second)).max())
    require(apart <= tolerance, failure.format(apart))


@contextmanager
def examining(what: str, remedy: str = "correct the plugin") -> Iterator[None]:
    """Name what is examined in failures, the innermost block first, and turn exceptions without a remedy into such."""
    try:
        yield
    except (KeyboardInterrupt, GeneratorExit):
        raise
    except BaseException as error:
        failure, cause = error, error.__cause__
        if not isinstance(failure, CheckError):
            is_own = isinstance(error, EvacError)  # its text without the advice to check the plugin
            text = text_of(Exception.__str__(error)) if is_own else f"raises {in_one_line(error)} ({place_of(error)})"
            failure = CheckError(text if is_own and "; " in text else f"{text}; {remedy}")
            cause = (is_own and cause) or error
        failure.place = failure.place or what
        raise failure from cause


def scene(title: str) -> AbstractContextManager[None]:
    """Name the scene in failures, as `examining`."""
    return examining(f"scene '{title}'")


def run_check(plugin: Any, check: Callable[..., Any], *arguments: Any, advice: str = "") -> Any:
    """Run a check of a plugin class and return its result; the cause of a failure is the exception of the plugin.

    The advice follows the remedy if there was an exception.
    """
    try:
        with examining("the class"):
            return check(*arguments)
    except CheckError as failure:
        names, place = [getattr(plugin, key, None) for key in ("name", "__name__")], place_of(plugin)
        name = next((name for name in names if isinstance(name, str) and name), repr(plugin))
        wrong, _, remedy = failure.args[0].rpartition("; ")
        where = "" if ", line " in wrong or place == "no file" else f" ({place})"
        what = f"{name}: {check.__name__}, {failure.place}"
        advice = advice if failure.__cause__ else ""
        raise PluginError(f"{what}: {wrong}{where}; {remedy}{advice}") from failure.__cause__
