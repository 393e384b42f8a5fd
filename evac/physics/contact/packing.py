"""The numbers that compiled functions of plugins read, checked before they are compiled."""

import ast
import inspect
import math
import reprlib
import textwrap
from collections.abc import Iterator, Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from evac.base.arrays import FloatArray
from evac.base.errors import EvacError, fault, in_one_line
from evac.jit import Entry, call_person_force
from evac.physics.force import Force
from evac.physics.state import Forces


def packed_row(plugin: Any, what: str) -> FloatArray:
    """Return the packed parameters (p,) of a force or a contact model, as its functions read them."""
    remedy = "define packed(), which returns the numbers that the function reads in a float64 array"
    packed: FloatArray = _called(plugin, "packed", what, remedy)
    is_row = isinstance(packed, np.ndarray) and packed.dtype == np.float64 and packed.ndim == 1
    if not (is_row and np.isfinite(packed).all()):
        kind = f" of {packed.dtype}" if isinstance(packed, np.ndarray) else ""
        got = f"packed() returns {reprlib.repr(packed)}{kind}"
        raise fault(what, got, "return finite numbers in a float64 array with one axis", plugin, "packed")
    return packed


def check_indices(entry: Entry, length: int, what: str, argument: int = -1, source: str = "packed() returns") -> None:
    """Check the indices written as numbers in a function, by default those of its parameters; kernels do not check."""
    code = entry.function.__code__
    name = code.co_varnames[code.co_argcount + argument]
    for index, line in _indices(entry, name):
        if not 0 <= index < length:
            numbers = f"{source} {length} numbers" if length != 1 else f"{source} one number"
            wrong, place = f"{entry.title} reads {name}[{index}], but {numbers}", (code.co_filename, line)
            raise fault(what, wrong, "correct the index", place)


def _indices(entry: Entry, name: str) -> Iterator[tuple[int, int]]:
    """Yield constant indices of an argument of a function, each with its line; none without its source."""
    with suppress(OSError, TypeError, SyntaxError):
        lines, first = inspect.getsourcelines(entry.function)
        for node in ast.walk(ast.parse(textwrap.dedent("".join(lines)))):
            if isinstance(node, ast.Subscript) and isinstance(node.value, ast.Name) and node.value.id == name:
                with suppress(ValueError):
                    if isinstance(index := ast.literal_eval(node.slice), int):
                        yield index, first + node.lineno - 1


def cutoff_of(force: Force) -> float:
    """Return the cut-off [m] of a force."""
    what, remedy = f"force {force.name!r}", "return a distance [m], finite and not negative"
    cutoff = _called(force, "cutoff", what, remedy)
    if not (isinstance(cutoff, (int, float, np.number)) and math.isfinite(cutoff) and cutoff >= 0.0):
        raise fault(what, f"cutoff() returns {reprlib.repr(cutoff)}", remedy, force, "cutoff")
    return float(cutoff)


def _called(plugin: Any, method: str, what: str, remedy: str) -> Any:
    """Return the result of a method; its exceptions are mistakes of the plugin."""
    try:
        return getattr(plugin, method)()
    except (EvacError, KeyboardInterrupt, GeneratorExit):
        raise
    except BaseException as error:
        raise fault(what, f"{method}() raises {in_one_line(error)}", remedy, plugin, method) from error


def is_of_person(pair: Any) -> bool:
    """Return whether a force between two people takes the velocity, the mass and more of the person."""
    return isinstance(pair, Entry) and len(pair.signature[0]) == len(call_person_force.kinds)


def pack_forces(forces: Sequence[Force]) -> Forces:
    """Pack the cut-offs and parameters of forces; shorter parameter rows are padded with zeros."""
    rows = [packed_row(force, f"force {force.name!r}") for force in forces]
    parameters = np.zeros((len(rows), max(map(len, rows), default=1)))
    for k, row in enumerate(rows):
        parameters[k, : len(row)] = row
    cutoff = np.array([cutoff_of(force) for force in forces], dtype=np.float64)
    return Forces(
        number=len(rows),
        address=np.zeros(len(rows), dtype=np.int64),
        cutoff=cutoff,
        parameters=parameters,
        of_person=np.array([is_of_person(force.pair) for force in forces], dtype=np.uint8),
        farthest=float(cutoff.max(initial=0.0)),
        spare_waiting=0,
    )
