"""Checks of importers: damaged files are refused, and reading is reproducible."""

import tempfile
from pathlib import Path

import numpy as np

from evac.base.errors import BuildingError, counted
from evac.building.importer import Importer
from evac.building.surface.surfacemesh import checked
from evac.case.case import Case
from evac.conformance.failures import CheckError, scene
from evac.simulation.assembly import make_building, make_importers, read_surface

#: Contents of files that no importer can read.
GARBAGE = (b"\n", b"\x00\xff\xfe\x80" * 16, b"0 1 2\nthis is no building\n")


def check_damaged_files(importer: Importer) -> None:
    """Check that damaged files are refused with ValueError."""
    with tempfile.TemporaryDirectory() as place:
        for suffix in importer.suffixes:
            for content in GARBAGE:
                path = Path(place, f"damaged{suffix}")
                path.write_bytes(content)
                with scene(f"a damaged file {path.name} with the content {content!r}"):
                    try:
                        mesh = checked(path, read_surface(importer, path))
                    except BuildingError:
                        continue
                    raise CheckError(
                        f"it is read as a surface of {counted(len(mesh.triangles), 'triangle')}",
                        "raise ValueError for files that are not of this format",
                    )


def check_surface(case: Case, name: str) -> None:
    """Check that the file of a case is read twice to the same surface, from which a building can be made."""
    with scene(case.title):
        used = make_importers(case)
        if case.mesh is None or used[0].name != name:
            what = f"read by {used[0].name!r}" if used else "not read from a file"
            raise CheckError(f"the building of the case is {what}", f"give a case that uses {name!r}")
    with scene(f"{case.title}, the file {case.mesh.name}"):
        one, other = (checked(case.mesh, read_surface(make_importers(case)[0], case.mesh)) for _ in range(2))
        for what, first, second in (
            ("points", one.points, other.points),
            ("cells", one.triangles, other.triangles),
            *(("cell_tags", one.cell_tags.get(tag), mask) for tag, mask in other.cell_tags.items()),
            *(("edge_tags", one.edge_tags.get(tag), pairs) for tag, pairs in other.edge_tags.items()),
        ):
            if first is None or not np.array_equal(first, second):
                raise CheckError(f"two readings of the file differ in {what}", "keep no state between them")
        make_building(case)
