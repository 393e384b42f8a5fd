"""Checks of importers and exporters: damaged files are refused, and files are read and written reproducibly."""

import warnings
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from evac.base.errors import BuildingError, PluginError, ResultError, RunWarning, counted
from evac.building.importer import Importer
from evac.building.surface.surfacemesh import checked
from evac.case.case import Case
from evac.conformance.failures import CheckError, require, scene, with_remedy
from evac.export.exporter import Exporter, export
from evac.simulation.assembly import make_building, make_importers, read_surface
from evac.simulation.running import run
from evac.trajectory.trajectory import read_trajectory

#: Contents of files that no importer can read.
GARBAGE = (b"\n", b"\x00\xff\xfe\x80" * 16, b"0 1 2\nthis is no building\n")


def check_damaged_files(importer: Importer) -> None:
    """Check that damaged files are refused with ValueError."""
    with TemporaryDirectory() as place:
        for path, content in [(Path(place, f"damaged{end}"), text) for end in importer.suffixes for text in GARBAGE]:
            path.write_bytes(content)
            with scene(f"a damaged file {path.name} with the content {content!r}"):
                try:
                    mesh = checked(path, read_surface(importer, path))
                except BuildingError:
                    continue
                wrong = f"it is read as a surface of {counted(len(mesh.triangles), 'triangle')}"
                raise CheckError(f"{wrong}; raise ValueError for files that are not of this format")


def check_surface(importer: Importer, case: Case, ticks: int) -> None:
    """Check that the file of a case is read twice to the same surface, from which a building can be made."""
    with scene(case.title):
        used, path = make_importers(case), case.mesh
        if path is None or used[0].name != importer.name:
            what = f"read by {used[0].name!r}" if used else "not read from a file"
            raise CheckError(f"the building of the case is {what}; give a case that uses {importer.name!r}")
    with scene(f"{case.title}, the file {path.name}"):
        one, other = (checked(path, read_surface(make_importers(case)[0], path)) for _ in range(2))
        pairs = {"points": (one.points, other.points), "cells": (one.triangles, other.triangles)}
        for what in ("cell_tags", "edge_tags"):
            first, second = getattr(one, what), getattr(other, what)
            pairs |= {f"{what} {tag!r}": (first.get(tag, ()), second.get(tag, ())) for tag in first | second}
        for what, (first, second) in pairs.items():
            told = f"two readings of the file differ in {what}; keep no state between them"
            require(np.array_equal(first, second), told)
        make_building(case)


def check_exports(exporter: Exporter, case: Case, ticks: int) -> None:
    """Check that an exporter writes only to its path, returns the files, can overwrite them, and is reproducible.

    It exports a run of some ticks with at least three frames, twice, and then a run without frames, which it may refuse
    with `ResultError`.
    """
    with TemporaryDirectory() as made, TemporaryDirectory() as place:
        with scene(case.title), warnings.catch_warnings():
            warnings.simplefilter("ignore", RunWarning)  # of a case, not of the exporter
            tick = case.simulation.tick
            lengths = {"simulation.duration": ticks * tick, "output.every": max(1, ticks // 4) * tick}
            run(case.change(lengths | {"output.animation": False, "output.picture": False}), Path(made, "result"))
            trajectory = read_trajectory(Path(made, "result"))
        before, found, path = trajectory.path.read_bytes(), [], Path(place, f"export{exporter.suffix}")
        for again in ("", ", exported again to the same place"):
            with scene(f"a run of some ticks{again}"):
                export(trajectory, exporter, path)
                files = sorted(file for file in Path(place).rglob("*") if file.is_file())
                strays = [file.name for file in files if file != path and path not in file.parents]
                require(not strays, f"writes {', '.join(strays)} outside `path`; write to `path` only")
                found.append([(file, file.read_bytes()) for file in files])
                told = "the two exports differ; do not write the current time or random numbers"
                require(found[0] == found[-1], told)
                require(trajectory.path.read_bytes() == before, "the trajectory file has changed; only read it")
        with scene("a run without frames"):
            try:
                export(replace(trajectory, time=trajectory.time[:0], rows=()), exporter, path)
            except ResultError:
                return
            except PluginError as error:
                raise with_remedy(error, "write a file without rows, or raise ResultError") from error.__cause__
