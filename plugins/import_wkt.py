"""Importer of WKT files: polygons of one storey, as written by JuPedSim, PostGIS, QGIS and shapely."""

from collections import Counter
from pathlib import Path

import shapely

from evac.base.errors import counted
from evac.base.parameters import Parameter
from evac.building.geometry import place_of
from evac.building.importer import Importer
from evac.building.plan.outlines import from_wkt, geometries
from evac.building.plan.plan import Plan


class WktImporter(Importer):
    """Well-known text (.wkt): polygons and collections of polygons, nested or overlapping, are the floor of one storey.

    Holes are obstacles. The format has no exits and areas.
    """

    name = "wkt"
    suffixes = (".wkt",)

    storey = Parameter("floor", "name of the storey")
    z = Parameter(0.0, "height of the storey's floor", unit="m")
    unit = Parameter(1.0, "metres per unit of the coordinates", unit="m", above=0.0)
    wall = Parameter(0.0, "thickness of walls between polygons that touch; 0 joins them", unit="m", minimum=0.0)

    def read(self, path: Path) -> Plan:
        """Read the geometries; raise ValueError if the text is not WKT."""
        text = path.read_text(encoding="utf-8-sig", errors="replace").strip()
        if "\0" in text:
            raise ValueError("the text is not UTF-8; save it as UTF-8")
        shapes = shapely.transform(shapely.GeometryCollection(_geometries(text)), lambda xy: self.unit * xy)
        plan, parts = Plan(path), [one for one in geometries(shapes) if not one.is_empty]
        for kind, number in sorted(Counter(one.geom_type for one in parts).items()):
            plan.note("found", counted(number, kind), self.storey, element=kind, number=number)
            if kind != "Polygon":
                first = place_of(next(one for one in parts if one.geom_type == kind))
                text = f"{counted(number, kind)}, the first one here: ground is polygons"
                plan.note("left out", text, self.storey, first, element=kind, number=number)
        plan.storey(self.storey, [one for one in parts if one.geom_type == "Polygon"], self.z, wall=self.wall)
        return plan


def _geometries(text: str) -> list[shapely.Geometry]:
    """Return the geometries of a text: one geometry, which may have several lines, or one per line."""
    try:
        return [from_wkt(" ".join(text.split()))]
    except ValueError as error:
        first = error
    geometries = []
    lines = [line.strip().rstrip(";") for line in text.splitlines()]
    for number, line in enumerate(lines, start=1):
        if line and not line.startswith("#"):
            try:
                geometries.append(from_wkt(line.partition(";")[2] if line.startswith("SRID=") else line))
            except ValueError as error:
                raise ValueError(f"line {number}: {error}" if len(lines) > 1 else str(first)) from error
    return geometries
