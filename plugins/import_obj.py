"""Importer of Wavefront OBJ files: vertices, polygons and the names of their groups.

Other libraries are not suitable: meshio fails on the texture indices (``vt``) that most exporters write; trimesh drops
the names of groups and divides non-convex polygons into fans, which cover additional ground.
"""

import fnmatch
import itertools
from pathlib import Path

import numpy as np

from evac.base.parameters import Parameter, did_you_mean
from evac.building.importer import Importer
from evac.building.model.findings import Finding
from evac.building.surface.surfacemesh import SurfaceMesh

#: Kinds of groups and the tags of their faces; ``ignore`` drops the faces.
KINDS = {"exit": "exit", "stair": "stair", "room": "area", "floor": "floor", "obstacle": "obstacle", "ignore": ""}
#: Kinds that are recognised by words in the name of a group, in the order of precedence.
WORDS = ("exit", "stair", "room", "floor")


class ObjImporter(Importer):
    """The vertices, faces, lines and groups (``v``, ``f``, ``l``, ``g``, ``o``) of Wavefront OBJ files.

    The kind of a group follows from `exit`, `stair`, `room` or `floor` in its name, or from `names`. Texture and normal
    indices (``f 1/2/3``) and all other lines are ignored; negative indices count from the last vertex read.
    """

    name = "obj"
    suffixes = (".obj",)

    names = Parameter(
        None,
        "kinds of groups, as a table of patterns to exit, stair, room, floor, obstacle, ignore or \"\": "
        'names = { "Treppe*" = "stair" }',
    )  # fmt: skip

    def read(self, path: Path) -> SurfaceMesh:
        """Read vertices, polygons and groups; raise ValueError, naming the line, if a line is invalid."""
        kinds = self._table()
        points: list[list[float]] = []
        faces: list[list[int]] = []
        edges: list[list[int]] = []
        groups, face_group, edge_group = [""], list[int](), list[int]()
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
                    faces.append(_rows(rest, len(points), 3))
                    face_group.append(len(groups) - 1)
                elif word == "l":
                    chain = _rows(rest, len(points), 2)
                    edges += [[a, b] for a, b in itertools.pairwise(chain)]
                    edge_group += [len(groups) - 1] * (len(chain) - 1)
                elif word in ("g", "o"):
                    groups.append(" ".join(rest))
            except ValueError as error:
                raise ValueError(f"line {number}: {line.strip()!r}: {error}") from error
        tags = [_tag(name, kinds) for name in groups]
        kept = [row for row, group in enumerate(face_group) if tags[group] != "ignore"]
        own = np.array([face_group[row] for row in kept], dtype=np.int64)
        cell_tags, edge_tags, findings = {}, {}, []
        for tag in sorted({tags[group] for group in face_group} - {"", "ignore"}):
            cell_tags[tag] = np.isin(own, [group for group in range(len(tags)) if tags[group] == tag])
            findings.append(Finding("found", f"group of {int(cell_tags[tag].sum())} faces: {tag}"))
        for tag in sorted({tags[group] for group in edge_group if tags[group].startswith("exit:")}):
            edge_tags[tag] = [edge for edge, group in zip(edges, edge_group, strict=True) if tags[group] == tag]
            findings.append(Finding("found", f"group of {len(edge_tags[tag])} lines: {tag}"))
        if len(kept) < len(faces):
            names = sorted({groups[group] for group in face_group if tags[group] == "ignore"})
            findings.append(
                Finding("left out", f"{len(faces) - len(kept)} faces of the groups {', '.join(names)} (names)")
            )
        return SurfaceMesh(points, [faces[row] for row in kept], cell_tags, edge_tags, findings)

    def _table(self) -> dict[str, str]:
        """Return the checked table of name patterns and kinds."""
        given = self.names or {}
        if not isinstance(given, dict):
            raise ValueError(f'names: must be a table such as {{ "Treppe*" = "stair" }}, not {given!r}')
        for pattern, kind in given.items():
            if kind not in ("", *KINDS):
                raise ValueError(f"names: {pattern!r}: unknown kind {kind!r}; {did_you_mean(str(kind), list(KINDS))}")
        return given


def _rows(corners: list[str], n_points: int, least: int) -> list[int]:
    """Return the rows of the vertices of a face or a line."""
    numbers = [int(corner.partition("/")[0]) for corner in corners]
    what = "a face" if least == 3 else "a line"
    if 0 in numbers or min(numbers, default=1) < -n_points:
        raise ValueError(f"{what} refers to a vertex that does not exist; indices count from 1, or from -1 backwards")
    if len(numbers) < least:
        raise ValueError(f"{what} has only {len(numbers)} corners, not at least {least}")
    return [number - 1 if number > 0 else n_points + number for number in numbers]


def _tag(group: str, kinds: dict[str, str]) -> str:
    """Return the tag of a group, ``"ignore"``, or an empty string."""
    for pattern, kind in kinds.items():
        if fnmatch.fnmatchcase(group.lower(), pattern.lower()):
            return kind if kind in ("", "ignore") else f"{KINDS[kind]}:{group}"
    found = next((word for word in WORDS if word in group.lower()), "")
    return f"{KINDS[found]}:{group}" if found else ""
