"""Importer of IFC files (extra evac[ifc]): spaces, slabs, walls, columns, doors, stairs and lifts by their geometry."""

import math
import re
from collections import Counter
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from evac.base.defaults import FARTHEST
from evac.base.parameters import Parameter
from evac.building.importer import Importer, optional_library
from evac.building.model.findings import Finding
from evac.building.recover.products import LIBRARY, read_products

if TYPE_CHECKING:
    from evac.building.plan.plan import Plan
    from evac.building.recover.bodies import Body
    from evac.building.recover.products import Products

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
    "IfcRamp": "stair",
    "IfcRampFlight": "stair",
    "IfcFurnishingElement": "furniture",
    "IfcFurniture": "furniture",
    "IfcSystemFurnitureElement": "furniture",
    "IfcSanitaryTerminal": "furniture",
    "IfcFlowTerminal": "furniture",
    "IfcTransportElement": "lift",
}
#: Kinds of bodies without which a building is incomplete.
NEEDED = ("space", "slab", "door", "stair", "landing")
#: Elements whose class does not say what they are; least area of those that are slabs by their shape [m2], and their
#: greatest thickness [m].
PROXY, LEAST_SLAB, THICKEST_SLAB = "IfcBuildingElementProxy", 4.0, 0.6
#: Why elements of other classes are left out.
UNUSED = {"IfcTransportElement": "it is no lift; let stairs move", PROXY: "their class tells nothing"}
#: The whole and its parts of a relation.
AGGREGATES = re.compile(rb"=\s*IFCRELAGGREGATES\s*\([^;]*?#(\d+)\s*,\s*\(([#\d,\s]*)\)\s*\)\s*;")
#: The opening and the door or window of a relation; names between quotes cannot hold a reference at the end.
FILLS = re.compile(rb"=\s*IFCRELFILLSELEMENT\s*\([^;]*?#(\d+)\s*,\s*#(\d+)\s*\)\s*;")
#: The direction of true north in plan, of the model's context.
CONTEXT = re.compile(rb"=\s*IFCGEOMETRICREPRESENTATIONCONTEXT\s*\([^;]*,\s*#(\d+)\s*\)\s*;")
DIRECTION = rb"#%d\s*=\s*IFCDIRECTION\s*\(\s*\(\s*([^,;]+),\s*([^,;)]+)"
#: A file whose unit of mass is the gram. Attributes of IFC 2x3 and properties of later versions that tell how many
#: people and what mass a lift carries.
GRAMS = re.compile(rb"=\s*IFCSIUNIT\s*\(\s*\*\s*,\s*\.MASSUNIT\.\s*,\s*\$\s*,\s*\.GRAM\.")
CAPACITY, LOAD = ("CapacityByNumber", "CapacityPeople"), ("CapacityByWeight", "CapacityWeight")
#: Names of spaces that enclose stairs.
STAIRWELL = re.compile("stair|trepp|escal|scala")
#: Longest name that is used unchanged.
LONGEST = 30


class IfcImporter(Importer):
    """IFC (.ifc), 2x3 and later: floors of spaces and slabs, doors, exits, stairs and lifts by their geometry."""

    name = "ifc"
    suffixes = (".ifc",)

    ground = Parameter("auto", "floors from spaces, or slabs if there are none", choices=("auto", "spaces", "slabs"))
    exits = Parameter("ground", "storeys on which doors to the outside are exits", choices=("ground", "all", "none"))
    ground_z = Parameter(0.0, "height of the ground storey, the nearest one with outer doors", unit="m")
    step = Parameter(0.2, "ground whose heights differ by at most this is one floor", unit="m", minimum=0.0)
    gap = Parameter(0.01, "gaps between spaces up to this width are closed", unit="m", minimum=0.0)
    furniture = Parameter(False, "whether furniture is an obstacle")
    cut_slabs = Parameter(False, "whether slabs that block a stair are cut")
    proxies = Parameter(False, "whether proxies that have the shape of slabs are slabs")
    time = Parameter(60.0, "shapes that are not made within this computing time are left out", unit="s", minimum=1.0)
    product_time = Parameter(10.0, "a shape that takes more computing time is left out", unit="s", minimum=1.0)

    def read(self, path: Path) -> "Plan":
        """Read the bodies; raise ValueError if the file is not IFC."""
        from evac.building.recover.bodies import Rules, plan_of_bodies

        findings: list[Finding] = []
        optional_library(path, LIBRARY, "ifc")
        content = _content(path)
        read = read_products(content, {*CLASSES, PROXY}, float(self.product_time), float(self.time))
        if not read.entities:
            raise ValueError("the file contains no building element; choose another file")
        elements = read.entities
        storeys = {
            number: (_text(element["name"]) or f"storey {number}", float(element["placement"][14]))
            for number, element in elements.items()
            if element["ifc_type"] == "IfcBuildingStorey" and element.get("placement")
        }
        names = {part: storeys[whole][0] for part, whole in _parts(content).items() if whole in storeys}
        fillings = {int(filling): int(opening) for opening, filling in FILLS.findall(content)}
        bodies = _bodies(read, names, fillings, 0.001 if GRAMS.search(content) else 1.0, findings)
        proxies = _proxies(read, {body.kind for body in bodies}, bool(self.proxies), findings)
        bodies += proxies if self.proxies else []
        own = {key: self.values()[key] for key in Rules.__annotations__}
        rules = Rules(**own)
        plan = plan_of_bodies(path, bodies, list(storeys.values()), rules, findings)
        plan.north = _north(content)
        return plan


def _content(path: Path) -> bytes:
    """Return the text of a file that is whole."""
    content = path.read_bytes()
    if not content.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"ISO-10303-21"):
        raise ValueError("not an IFC file: it does not start with ISO-10303-21; export it as IFC in STEP format")
    if b"END-ISO-10303-21" not in content[-1000:]:
        raise ValueError(f"truncated after {len(content)} bytes: END-ISO-10303-21 is missing; export the file again")
    return content


def _north(content: bytes) -> float | None:
    """Return the direction of true north, counterclockwise from y [degrees], if the file tells it."""
    for context in CONTEXT.findall(content):
        if given := re.search(DIRECTION % int(context), content):
            x, y = map(float, given.groups())
            return round(float(np.degrees(np.arctan2(-x, y))), 6) + 0.0
    return None


def _parts(content: bytes) -> dict[int, int]:
    """Return the number of the whole that each part belongs to, such as the storey of a space, by its number."""
    found = [(int(whole), re.findall(rb"#(\d+)", parts)) for whole, parts in AGGREGATES.findall(content)]
    return {int(part): whole for whole, parts in found for part in parts}


def _bodies(
    read: "Products", storeys: Mapping[int, str], fills: Mapping[int, int], mass: float, findings: list[Finding]
) -> "list[Body]":
    """Return the bodies of a file, sorted by number; add a finding for each element without a shape or left out.

    `mass` is the unit of mass of the file [kg].
    """
    from evac.building.recover.bodies import Body

    bodies = []
    count = Counter(_kind(one) or one["ifc_type"] for one in read.entities.values() if one["has_geometry"])
    for name, many in sorted(count.items()):
        if name in {*CLASSES.values(), "landing"}:
            findings.append(Finding("found", f"{many} {name}", element=name, number=many))
        else:
            why = UNUSED.get(name, "people walk neither on nor around them")
            findings.append(Finding("left out", f"{many} {name}: {why}", element=name, number=many))
    uses = {number: _use(one) for number, one in read.entities.items() if _kind(one) == "space"}
    begun = Counter(use.partition(" ")[0] for use in uses.values())
    for number in sorted(read.entities):
        element = read.entities[number]
        kind = _kind(element)
        shape = read.shapes.get(number)
        if kind is None or not element["has_geometry"]:
            continue
        points, triangles = shape or (np.empty((0, 3)), np.empty((0, 3), dtype=np.int64))
        if not len(triangles) or not np.isfinite(points).all() or np.abs(points).max() > FARTHEST:
            why = f": {read.late[number]}" if number in read.late else ""
            why = f"its shape cannot be read{why}" if shape is None else "its shape is empty or not finite"
            text = f"{element['ifc_type']} #{number} {_text(element['name'])!r}: {why}"
            is_needed = number in read.late or kind in NEEDED
            findings.append(Finding("missing" if is_needed else "left out", text, element=kind))
            continue
        storey, opening = storeys.get(number, ""), fills.get(number, -1)
        use = uses.get(number, "")  # rooms whose names begin alike, such as with "office", have one use
        use = use.partition(" ")[0] if begun[use.partition(" ")[0]] > 1 else use
        stated = (int(_stated(element, CAPACITY)), _stated(element, LOAD) * mass) if kind == "lift" else ()
        bodies.append(Body(kind, _label(number, element), points, triangles, number, storey, opening, use, *stated))
    return bodies


def _proxies(read: "Products", kinds: set[str], are_slabs: bool, findings: list[Finding]) -> "list[Body]":
    """Return the proxies that are slabs by their shape; add a finding for each of them."""
    from evac.building.recover.bodies import Body

    bodies = []
    for number, (points, triangles) in sorted(read.shapes.items()):
        element = read.entities[number]
        if element["ifc_type"] == PROXY and len(triangles) and np.isfinite(points).all():
            body = Body("slab", _label(number, element), points, triangles, number)
            area, z = max(((plan.area, z) for plan, z in body.tops), default=(0.0, 0.0))
            if area > LEAST_SLAB and body.z_max - body.z_min < THICKEST_SLAB:
                bodies.append(body)
                text = f"{body.name!r}, a proxy, has the shape of a slab of {area:.1f} m2 at z = {z:.2f} m"
                text += "" if are_slabs else "; read it with proxies = true"
                kind = "assumed" if are_slabs else "warning" if kinds & {"slab", "space"} else "missing"
                findings.append(Finding(kind, text, None, (*body.place, z)))
    return bodies


def _kind(element: Mapping[str, Any]) -> str | None:
    """Return the kind of body of an element; None if it is not used."""
    kind = CLASSES.get(element["ifc_type"])
    if kind == "lift":
        what = [_attribute(element, name) for name in ("PredefinedType", "OperationType")]  # of IFC 2x3
        return kind if "ELEVATOR" in what else None
    if kind == "slab":
        predefined = _attribute(element, "PredefinedType")
        name = _text(element["name"]).lower() + _text(element["object_type"]).lower()
        if predefined == "ROOF" or (predefined in ("", "NOTDEFINED", "USERDEFINED") and "roof" in name):
            return "roof"
        if predefined == "LANDING":
            return "landing"
    return kind


def _stated(element: Mapping[str, Any], names: tuple[str, str]) -> float:
    """Return a positive number that a file states of a lift, as one of its attributes or properties; 0 if none."""
    stated = [*(element["attributes"] or ()), *(own for one in element["property_sets"] for own in one["properties"])]
    for value in (one["value"] for one in stated if one["name"] in names):
        with suppress(TypeError, ValueError):
            if 0.0 < float(value) < math.inf:
                return float(value)
    return 0.0


def _label(number: int, element: Mapping[str, Any]) -> str:
    """Return the name of a body, with the long name of a space; or class and tag if the name is too long."""
    name = _text(element["name"])
    if element["ifc_type"] == "IfcSpace":
        name = f"{name} {_attribute(element, 'LongName')}".strip()
    if name and len(name) <= LONGEST:
        return name
    tag = _attribute(element, "Tag") or f"#{number}"
    return f"{element['ifc_type'].removeprefix('Ifc').lower()} {tag}"


def _use(element: Mapping[str, Any]) -> str:
    """Return the use of a space: the words of its long name, or of its name; nobody starts in stairwells."""
    words = re.findall(r"[^\W\d_]{3,}", _attribute(element, "LongName") or _text(element["name"]))
    use = " ".join(words).lower() or "room"
    return "stair" if STAIRWELL.search(use) else use


def _attribute(element: Mapping[str, Any], name: str) -> str:
    """Return an attribute of an element as text; empty if it is missing."""
    found = [one["value"] for one in element["attributes"] or () if one["name"] == name]
    return _text(found[0]) if found else ""


def _text(value: Any) -> str:
    return "" if value is None else " ".join(str(value).split())
