"""Entities and shapes of the products of an IFC file, read by a library in a process of its own, within time limits.

The only module that knows the library. If the shape of a product takes too long or ends the process, only this product
is left out. Limits are those of computing time, which does not depend on other programs that run on the machine.
"""

import math
import signal
import time
from collections.abc import Callable, Collection, Sequence
from concurrent.futures import BrokenExecutor
from dataclasses import dataclass, field
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np

from evac.base.arrays import FloatArray, IndexArray
from evac.base.progress import shown_by

if TYPE_CHECKING:
    from evac.base.processes import Pool

#: The library, which the extra evac[ifc] installs.
LIBRARY = "ifclite_geom"
#: Number of parts in which products are read, and of products tried together after those of a part have failed.
PARTS, BATCH = 8, 64
#: Time for the start of a process, which has the file to read [s].
START = 60.0
#: Most times its computing time that a call may last; Windows measures no computing time of a process.
PATIENCE = 30.0 if hasattr(signal, "setitimer") else 1.0
#: What is read of an entity.
KEYS = ("ifc_type", "name", "object_type", "has_geometry", "placement", "attributes")
#: The class whose property sets, with those of its types, are read too.
TRANSPORT = "IfcTransportElement"

#: Points (v, 3) [m] and triangles (t, 3).
Shape = tuple[FloatArray, IndexArray]


@dataclass
class Products:
    """Content of a file, by the number of the entity."""

    entities: dict[int, dict[str, Any]]  # by number, with the values of `KEYS`, and property sets of `TRANSPORT`
    shapes: dict[int, Shape] = field(default_factory=dict)
    late: dict[int, str] = field(default_factory=dict)  # why products have no shape that should have one


def read_products(content: bytes, classes: Collection[str], each: float, total: float) -> Products:
    """Read a file.

    `classes`: classes whose shapes are read; `each`, `total`: limits of the computing time for one product and for all
    of them [s].
    """
    reader = _Reader(content)
    try:
        entities = reader.ask(_entities, (), total)
        if isinstance(entities, str):
            raise ValueError(f"its entities cannot be read: {entities}")
        found = Products(entities)
        wanted = [number for number, one in entities.items() if one["ifc_type"] in classes and one["has_geometry"]]
        size = math.ceil(len(wanted) / PARTS)
        todo = [wanted[k : k + size] for k in range(0, len(wanted), size or 1)]
        while todo:
            group = todo.pop(0)
            limit = min(each, total - reader.used)
            made = reader.ask(_shapes, (group,), limit) if limit > 0.0 else "no time was left"
            if not isinstance(made, str):
                found.shapes |= made
            elif len(group) == 1 or limit <= 0.0:
                found.late |= dict.fromkeys(group, made)
            else:
                size = BATCH if len(group) > BATCH else 1
                todo = [group[k : k + size] for k in range(0, len(group), size)] + todo
            for show in shown_by[-1:]:
                show("reading shapes", len(wanted) - sum(map(len, todo)), len(wanted))
        return found
    finally:
        reader.close()


class _Reader:
    """A process that has the content of a file; another one takes its place after it has been ended."""

    def __init__(self, content: bytes) -> None:
        self._content = content
        self._pool: Pool | None = None
        self.used = 0.0  # computing time [s]

    def ask(self, function: Callable[..., Any], arguments: tuple[Any, ...], limit: float) -> Any:
        """Return the result of a call, or a text that says why there is none."""
        try:
            if self._pool is None:
                from evac.base.processes import Pool

                self._pool = Pool(1, _keep, (self._content,), is_quiet=True)
                self._pool.submit(_ready).result(timeout=START)  # is not counted
            answer = self._pool.submit(_answer, function, arguments, limit)
            result, used = answer.result(timeout=PATIENCE * limit)
        except (TimeoutError, BrokenExecutor):
            self.close()
            self.used += limit
            return f"it takes more than {limit:.0f} s of computing, or ends the library"
        self.used += used
        return result

    def close(self) -> None:
        """End the process."""
        if self._pool is not None:
            self._pool.kill()
        self._pool = None


# Worker process

_content = b""


def _keep(content: bytes) -> None:
    global _content
    _content = content


def _ready() -> None:
    """Answer as soon as the process has the content."""


def _answer(function: Callable[..., Any], arguments: tuple[Any, ...], limit: float) -> tuple[Any, float]:
    """Return the result of a function, or the text of its error, and the time used [s].

    The process ends if it computes for longer than `limit` [s].
    """
    before, has_timer = time.process_time(), hasattr(signal, "setitimer")
    if has_timer:
        signal.setitimer(signal.ITIMER_PROF, limit)
    try:
        result = function(*arguments)
    except BaseException as error:  # a panic of the library is not a subclass of Exception
        result = str(error)
    if has_timer:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
    return result, time.process_time() - before


def _entities() -> dict[int, dict[str, Any]]:
    """Return the entities of the file."""
    read = import_module(LIBRARY).entity_data(_content, placements=True, type_properties=True, attributes=True)
    keys = {TRANSPORT: (*KEYS, "property_sets")}
    return {n: {key: one[key] for key in keys.get(one["ifc_type"], KEYS)} for n, one in read["entities"].items()}


def _shapes(numbers: Sequence[int]) -> dict[int, Shape]:
    """Return the shapes of some products."""
    made = import_module(LIBRARY).geometry_data_buffers(_content, ids=set(numbers))["elements"]
    return {
        number: (
            np.frombuffer(one["vertices"], np.float64).reshape(-1, 3),
            np.frombuffer(one["faces"], np.uint32).reshape(-1, 3).astype(np.int64),
        )
        for number, one in made.items()
    }
