"""Importer of Wavefront OBJ files: vertices and polygons, nothing else.

meshio's reader fails on the texture indices (``vt``) that most exporters write.
"""

from collections.abc import Sequence
from pathlib import Path

from evac.building.importer import Importer
from evac.building.surfacemesh import SurfaceMesh
from evac.hookspecs import hookimpl


class ObjImporter(Importer):
    """The ``v`` and ``f`` lines of Wavefront OBJ files.

    Texture and normal indices (``f 1/2/3``) and every other line are passed over; negative indices count from the last
    vertex read.
    """

    name = "obj"
    suffixes = (".obj",)

    def read(self, path: Path) -> SurfaceMesh:
        """Read vertices and polygons; raise ValueError that names the line if one cannot be read."""
        points: list[list[float]] = []
        faces: list[list[int]] = []
        text = path.read_text(encoding="utf-8-sig", errors="replace").replace("\\\n", " ")
        if "\0" in text:
            raise ValueError("the text is not UTF-8; save it as UTF-8")
        for number, line in enumerate(text.splitlines(), start=1):
            word, *rest = line.partition("#")[0].split() or [""]
            try:
                if word == "v":
                    x, y, z = rest[:3]
                    points.append([float(x), float(y), float(z)])
                elif word == "f":
                    faces.append(_face([int(corner.partition("/")[0]) for corner in rest], len(points)))
            except ValueError as error:
                raise ValueError(f"line {number}: {line.strip()!r}: {error}") from error
        return SurfaceMesh(points, faces)


def _face(corners: list[int], n_points: int) -> list[int]:
    """Return the rows of a face's vertices."""
    if 0 in corners or min(corners, default=1) < -n_points:
        raise ValueError("a face counts its vertices from 1, or backwards from -1, the last one above it")
    if len(corners) < 3:
        raise ValueError(f"a face has only {len(corners)} corners")
    return [corner - 1 if corner > 0 else n_points + corner for corner in corners]


evac_interface = 2


@hookimpl
def evac_importers() -> Sequence[type[Importer]]:
    """Return the importer."""
    return [ObjImporter]
