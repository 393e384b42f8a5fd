"""Entities and shapes of the products of an IFC file, read by a library in a process of its own, within time limits.

The only module that knows the libraries. A product whose shape takes too long or ends the process costs itself alone.
Limits are those of computing time, which other programs that run on the machine do not take.
"""

import os
import re
import signal
import tempfile
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from concurrent.futures import BrokenExecutor
from dataclasses import dataclass, field
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np

from evac.base.arrays import FloatArray, IndexArray

if TYPE_CHECKING:
    from evac.base.processes import Pool

#: The libraries, and the extras of evac that install them.
LIBRARIES = {"ifclite_geom": "ifc", "ifcopenshell": "ifcopenshell"}
#: Number of products that are tried together after all of them together have failed.
BATCH = 64
#: Time for the start of a process, which has the file to read [s].
START = 60.0
#: Most times its computing time that a call may last; Windows measures no computing time of a process.
PATIENCE = 30.0 if hasattr(signal, "setitimer") else 1.0
#: Lines of entities other than units, whose dimensions are derived.
DERIVED = re.compile(r"(?m)^#(?!.*IFCSIUNIT).*$")

#: Points (v, 3) [m] and triangles (t, 3).
Shape = tuple[FloatArray, IndexArray]


@dataclass
class Products:
    """Content of a file, by the number of the entity."""

    # By number: a dictionary with ifc_type, name, object_type, has_geometry, placement and attributes
    entities: dict[int, dict[str, Any]]
    shapes: dict[int, Shape] = field(default_factory=dict)
    late: dict[int, str] = field(default_factory=dict)  # why products have no shape that should have one
    said: list[str] = field(default_factory=list)  # what the library wrote


def read_products(content: bytes, classes: Collection[str], library: str, each: float, total: float) -> Products:
    """Read a file.

    `classes`: classes whose shapes are read; `library`: one of `LIBRARIES`; `each`, `total`: limits of the computing
    time for one product and for all of them [s].
    """
    reader = _Reader(content, library)
    try:
        said: list[str] = []
        entities = reader.ask(_entities, (library,), total, said)
        if isinstance(entities, str):
            raise ValueError(f"its entities cannot be read by {library}: {entities}")
        found = Products(entities, said=said)
        wanted = [number for number, one in entities.items() if one["ifc_type"] in classes and one["has_geometry"]]
        todo = [wanted] if wanted else []
        while todo:
            group = todo.pop(0)
            limit = min(each, total - reader.used)
            made = reader.ask(_shapes, (library, group), limit, said) if limit > 0.0 else "no time was left"
            if not isinstance(made, str):
                found.shapes |= made
            elif len(group) == 1 or limit <= 0.0:
                found.late |= dict.fromkeys(group, made)
            else:
                size = BATCH if len(group) > BATCH else 1
                todo = [group[k : k + size] for k in range(0, len(group), size)] + todo
        return found
    finally:
        reader.close()


class _Reader:
    """A process that has the content of a file; another one takes its place after it has been ended."""

    def __init__(self, content: bytes, library: str) -> None:
        self._arguments = content, library
        self._pool: Pool | None = None
        self.used = 0.0  # computing time [s]

    def ask(self, function: Callable[..., Any], arguments: tuple[Any, ...], limit: float, said: list[str]) -> Any:
        """Return the result of a call, or why there is none; add what the library writes to `said`."""
        try:
            if self._pool is None:
                from evac.base.processes import Pool

                self._pool = Pool(1, _load, self._arguments, is_quiet=True)
                self._pool.submit(_ready).result(timeout=START)  # is not counted
            answer = self._pool.submit(_answer, function, arguments, limit)
            result, lines, used = answer.result(timeout=PATIENCE * limit)
        except (TimeoutError, BrokenExecutor):
            self.close()
            self.used += limit
            return f"it takes more than {limit:.0f} s of computing, or ends the library"
        self.used += used
        said += [line for line in lines if line not in said]
        return result

    def close(self) -> None:
        """End the process."""
        if self._pool is not None:
            self._pool.kill()
        self._pool = None


# Worker process

_loaded: Any = None


def _load(content: bytes, library: str) -> None:
    """Keep the content of the file, as the library takes it."""
    global _loaded
    _loaded = content
    if library == "ifcopenshell":
        # An asterisk stands for a derived value; ifcopenshell refuses it where no value is derived.
        text = DERIVED.sub(lambda line: line[0].replace("*", "$"), content.decode("utf-8", "replace"))
        _loaded = import_module("ifcopenshell").file.from_string(text)


def _ready() -> None:
    """Answer as soon as the process has the content."""


def _answer(function: Callable[..., Any], arguments: tuple[Any, ...], limit: float) -> tuple[Any, list[str], float]:
    """Return the result of a function, or the text of its error, the lines of compiled code, and the time used [s].

    The process ends if it computes for longer than `limit` [s].
    """
    before, has_timer = time.process_time(), hasattr(signal, "setitimer")
    if has_timer:
        signal.setitimer(signal.ITIMER_PROF, limit)
    kept = os.dup(2)
    with tempfile.TemporaryFile() as file:
        os.dup2(file.fileno(), 2)
        try:
            result = function(*arguments)
        except BaseException as error:  # a panic of the library is not a subclass of Exception
            result = str(error)
        os.dup2(kept, 2)
        os.close(kept)
        file.seek(0)
        lines = file.read().decode("utf-8", "replace").splitlines()
    if has_timer:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
    return result, [line.strip() for line in lines if line.strip()], time.process_time() - before


def _entities(library: str) -> dict[int, dict[str, Any]]:
    """Return the entities of the file."""
    if library == "ifcopenshell":
        return {one.id(): _entity(one) for one in _loaded.by_type("IfcObject")}
    read = import_module("ifclite_geom").entity_data(_loaded, placements=True, type_properties=False, attributes=True)
    keys = ("ifc_type", "name", "object_type", "has_geometry", "placement", "attributes")
    return {number: {key: one[key] for key in keys} for number, one in read["entities"].items()}


def _entity(one: Any) -> dict[str, Any]:
    """Return an entity of ifcopenshell as ifclite-geom does."""
    placement = None
    if one.is_a("IfcBuildingStorey") and one.ObjectPlacement is not None:
        matrix = np.array(import_module("ifcopenshell.util.placement").get_local_placement(one.ObjectPlacement))
        matrix[:3, 3] *= import_module("ifcopenshell.util.unit").calculate_unit_scale(_loaded)
        placement = matrix.T.ravel().tolist()
    names = ("LongName", "PredefinedType", "Tag")
    return {
        "ifc_type": one.is_a(),
        "name": one.Name,
        "object_type": one.ObjectType,
        "has_geometry": getattr(one, "Representation", None) is not None,
        "placement": placement,
        "attributes": [{"name": name, "value": getattr(one, name)} for name in names if getattr(one, name, None)],
    }


def _shapes(library: str, numbers: Sequence[int]) -> dict[int, Shape]:
    """Return the shapes of some products."""
    if library == "ifcopenshell":
        return {number: shape for number in numbers if (shape := _opened(number)) is not None}
    made: Mapping[int, Any] = import_module(library).geometry_data_buffers(_loaded, ids=set(numbers))["elements"]
    return {
        number: (
            np.frombuffer(one["vertices"], np.float64).reshape(-1, 3),
            np.frombuffer(one["faces"], np.uint32).reshape(-1, 3).astype(np.int64),
        )
        for number, one in made.items()
    }


def _opened(number: int) -> Shape | None:
    """Return the shape of a product by ifcopenshell; None if it has none that can be read."""
    library: Any = import_module("ifcopenshell.geom")
    settings = library.settings()
    settings.set("use-world-coords", True)
    try:
        geometry = library.create_shape(settings, _loaded.by_id(number)).geometry
    except RuntimeError:
        return None
    return np.reshape(geometry.verts, (-1, 3)), np.reshape(geometry.faces, (-1, 3)).astype(np.int64)
