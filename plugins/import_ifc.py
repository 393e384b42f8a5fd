"""Importer of IFC files (extra evac[ifc]): spaces, slabs, walls, columns, doors and stairs by their geometry."""

import os
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from evac.base.parameters import Parameter
from evac.building.importer import Importer, optional_library
from evac.building.model.findings import Finding

if TYPE_CHECKING:
    from evac.building.plan.plan import Plan
    from evac.building.recover.bodies import Body

#: Classes of IFC 2x3, 4 and 4.3 whose shapes are used, and their kinds of bodies.
CLASSES = {
    "IfcSpace": "space",
    "IfcSlab": "slab",
    "IfcRoof": "roof",
    "IfcWall": "wall",
    "IfcWallStandardCase": "wall",
    "IfcWallElementedCase": "wall",
    "IfcCurtainWall": "wall",
    "IfcPlate": "wall",
    "IfcColumn": "column",
    "IfcColumnStandardCase": "column",
    "IfcOpeningElement": "opening",
    "IfcOpeningStandardCase": "opening",
    "IfcDoor": "door",
    "IfcDoorStandardCase": "door",
    "IfcWindow": "window",
    "IfcWindowStandardCase": "window",
    "IfcStair": "stair",
    "IfcStairFlight": "stair",
    "IfcFurnishingElement": "furniture",
    "IfcFurniture": "furniture",
    "IfcSystemFurnitureElement": "furniture",
    "IfcSanitaryTerminal": "furniture",
    "IfcFlowTerminal": "furniture",
}
#: Classes that people walk on and that are not supported.
NOT_READ = ("IfcRamp", "IfcRampFlight", "IfcTransportElement")
#: The whole and its parts of a relation.
AGGREGATES = re.compile(rb"=\s*IFCRELAGGREGATES\s*\([^;]*?#(\d+)\s*,\s*\(([#\d,\s]*)\)\s*\)\s*;")
#: The opening and the door or window of a relation; names between quotes cannot hold a reference at the end.
FILLS = re.compile(rb"=\s*IFCRELFILLSELEMENT\s*\([^;]*?#(\d+)\s*,\s*#(\d+)\s*\)\s*;")
#: Longest name that is used unchanged.
LONGEST = 30
#: Largest coordinate of an undamaged file [m].
FARTHEST = 1e8


class IfcImporter(Importer):
    """IFC (.ifc), 2x3 and later: floors of spaces and slabs, doors, exits and stairs by their geometry."""

    name = "ifc"
    suffixes = (".ifc",)

    ground = Parameter("auto", "floors from spaces, or slabs if there are none", choices=("auto", "spaces", "slabs"))
    exits = Parameter("ground", "storeys on which doors to the outside are exits", choices=("ground", "all", "none"))
    ground_z = Parameter(0.0, "height of the ground storey, the nearest one with outer doors", unit="m")
    step = Parameter(0.2, "ground whose heights differ by at most this is one floor", unit="m", minimum=0.0)
    gap = Parameter(0.01, "gaps between spaces up to this width are closed", unit="m", minimum=0.0)
    furniture = Parameter(False, "whether furniture is an obstacle")
    cut_slabs = Parameter(False, "whether slabs that block a stair are cut")

    def read(self, path: Path) -> "Plan":
        """Read the bodies; raise ValueError if the file is not IFC."""
        from evac.building.recover.bodies import Rules, plan_of_bodies

        findings: list[Finding] = []
        optional_library(path, "ifclite_geom", "ifc")
        content = path.read_bytes()
        elements, shapes = _read(content, findings)
        storeys = {
            number: (_text(element["name"]) or f"storey {number}", float(element["placement"][14]))
            for number, element in elements.items()
            if element["ifc_type"] == "IfcBuildingStorey" and element.get("placement")
        }
        names = {part: storeys[whole][0] for part, whole in _parts(content).items() if whole in storeys}
        bodies = _bodies(elements, shapes, names, _fillings(content), findings)
        rules = Rules(**self.values())
        return plan_of_bodies(path, bodies, list(storeys.values()), rules, findings)


def _read(content: bytes, findings: list[Finding]) -> tuple[Mapping[int, Any], Mapping[int, Any]]:
    """Return the entities and the shapes of a file, by number; messages of the library become warnings."""
    import ifclite_geom

    if not content.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"ISO-10303-21"):
        raise ValueError("not an IFC file: it does not start with ISO-10303-21; export it as IFC in STEP format")
    if b"END-ISO-10303-21" not in content[-1000:]:
        raise ValueError(f"truncated after {len(content)} bytes: END-ISO-10303-21 is missing; export the file again")
    said: list[str] = []
    try:
        with _standard_error(said):
            elements, shapes = _shapes(ifclite_geom, content)
    except BaseException as error:
        # A panic of the library is not a subclass of Exception.
        if isinstance(error, KeyboardInterrupt | SystemExit | MemoryError):
            raise
        raise ValueError(f"the file is damaged or has unsupported content: {error}") from error
    if not elements:
        raise ValueError("the file contains no building element")
    findings += [Finding("warning", f"message of ifclite-geom: {line}") for line in dict.fromkeys(said)]
    return elements, shapes


def _shapes(library: Any, content: bytes) -> tuple[Mapping[int, Any], Mapping[int, Any]]:
    """Return the entities of a file, and the shapes of entities whose classes are used."""
    elements = library.entity_data(content, placements=True, type_properties=False, attributes=True)["entities"]
    wanted = {number for number, one in elements.items() if one["ifc_type"] in CLASSES}
    return elements, library.geometry_data_buffers(content, ids=wanted)["elements"] if wanted else {}


@contextmanager
def _standard_error(said: list[str]) -> Iterator[None]:
    """Collect the lines that compiled code writes to the standard error of the process."""
    import tempfile

    try:
        kept = os.dup(2)
    except OSError:  # it is closed
        yield
        return
    with tempfile.TemporaryFile() as file:
        os.dup2(file.fileno(), 2)
        try:
            yield
        finally:
            os.dup2(kept, 2)
            os.close(kept)
            file.seek(0)
            said += [line.strip() for line in file.read().decode("utf-8", "replace").splitlines() if line.strip()]


def _fillings(content: bytes) -> dict[int, int]:
    """Return the number of the opening that each door or window fills, by its number."""
    return {int(filling): int(opening) for opening, filling in FILLS.findall(content)}


def _parts(content: bytes) -> dict[int, int]:
    """Return the number of the whole that each part belongs to, such as the storey of a space, by its number."""
    found = [(int(whole), re.findall(rb"#(\d+)", parts)) for whole, parts in AGGREGATES.findall(content)]
    return {int(part): whole for whole, parts in found for part in parts}


def _bodies(
    elements: Mapping[int, Any],
    shapes: Mapping[int, Any],
    storeys: Mapping[int, str],
    fills: Mapping[int, int],
    findings: list[Finding],
) -> "list[Body]":
    """Return the bodies of a file, sorted by number; add a finding for each element without a shape or left out."""
    from evac.building.recover.bodies import Body

    bodies = []
    count: dict[str, int] = {}
    for number in sorted(elements):
        element = elements[number]
        kind = _kind(element)
        shape = shapes.get(number)
        if element["ifc_type"] in NOT_READ:
            count[element["ifc_type"]] = count.get(element["ifc_type"], 0) + 1
        if kind is None:
            continue
        if shape is None:
            if element["has_geometry"]:
                text = f"{element['ifc_type']} #{number} {_text(element['name'])!r}: its shape cannot be read"
                findings.append(Finding("left out", text))
            continue
        points = np.frombuffer(shape["vertices"], dtype=np.float64).reshape(-1, 3)
        triangles = np.frombuffer(shape["faces"], dtype=np.uint32).reshape(-1, 3).astype(np.int64)
        if not len(triangles) or not np.isfinite(points).all() or np.abs(points).max() > FARTHEST:
            text = f"{element['ifc_type']} #{number} {_text(element['name'])!r}: its shape is empty or not finite"
            findings.append(Finding("left out", text))
            continue
        storey, opening = storeys.get(number, ""), fills.get(number, -1)
        bodies.append(Body(kind, _label(number, element), points, triangles, number, storey, opening))
    for name, many in count.items():
        findings.append(Finding("left out", f"{many} {name}: ramps, lifts and escalators are not supported"))
    return bodies


def _kind(element: Mapping[str, Any]) -> str | None:
    """Return the kind of body of an element; None if it is not used."""
    kind = CLASSES.get(element["ifc_type"])
    if kind == "slab":
        predefined = _attribute(element, "PredefinedType")
        name = _text(element["name"]).lower() + _text(element["object_type"]).lower()
        if predefined == "ROOF" or (predefined in ("", "NOTDEFINED", "USERDEFINED") and "roof" in name):
            return "roof"
        if predefined == "LANDING":
            return "landing"
    return kind


def _label(number: int, element: Mapping[str, Any]) -> str:
    """Return the name of a body, with the long name of a space; or class and tag if the name is too long."""
    name = _text(element["name"])
    if element["ifc_type"] == "IfcSpace":
        name = f"{name} {_attribute(element, 'LongName')}".strip()
    if name and len(name) <= LONGEST:
        return name
    tag = _attribute(element, "Tag") or f"#{number}"
    return f"{element['ifc_type'].removeprefix('Ifc').lower()} {tag}"


def _attribute(element: Mapping[str, Any], name: str) -> str:
    """Return an attribute of an element as text; empty if it is missing."""
    found = [one["value"] for one in element["attributes"] or () if one["name"] == name]
    return _text(found[0]) if found else ""


def _text(value: Any) -> str:
    return "" if value is None else " ".join(str(value).split())


evac_interface = 3
