"""Importer of OFF files: vertices and polygons.

meshio reads triangles only; trimesh reads truncated files without an error, and divides non-convex polygons into fans.
"""

import re
from pathlib import Path

from evac.building.importer import Importer
from evac.building.surface.surfacemesh import SurfaceMesh


class OffImporter(Importer):
    """OFF files (also COFF, NOFF, STOFF: values after x, y, z are ignored)."""

    name = "off"
    suffixes = (".off",)

    def read(self, path: Path) -> SurfaceMesh:
        """Read vertices and polygons; raise ValueError if the header, a count or a line is wrong."""
        text = path.read_text(encoding="utf-8-sig").splitlines()
        lines = [(number, line.partition("#")[0].split()) for number, line in enumerate(text, start=1)]
        lines = [(number, words) for number, words in lines if words]
        if not lines or not re.fullmatch(r"(ST)?C?N?OFF", lines[0][1][0]):
            raise ValueError("the first word must be OFF")
        number, first = lines[0]
        (_, counts), *rest = [(number, first[1:]), *lines[1:]] if len(first) > 1 else lines[1:] or [(number, [])]
        if len(counts) < 2:
            raise ValueError("the numbers of vertices and faces are missing")
        n_points, n_faces = int(counts[0]), int(counts[1])
        if len(rest) != n_points + n_faces:
            raise ValueError(f"{n_points} vertices and {n_faces} faces are declared, but {len(rest)} lines follow")
        points, faces = [], []
        for index, (number, words) in enumerate(rest):
            try:
                if index < n_points:
                    x, y, z = words[:3]
                    points.append([float(x), float(y), float(z)])
                else:
                    corners = [int(corner) for corner in words[1 : 1 + int(words[0])]]
                    if len(corners) != int(words[0]):
                        raise ValueError(f"{words[0]} corners are declared, but {len(corners)} follow")
                    if len(corners) < 3:
                        raise ValueError(f"a face has only {len(corners)} corners, not at least 3")
                    faces.append(corners)
            except ValueError as error:
                raise ValueError(f"line {number}: {text[number - 1].strip()!r}: {error}") from error
        return SurfaceMesh(points, faces)
