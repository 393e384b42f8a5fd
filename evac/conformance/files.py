"""Checks of importers and exporters: damaged files are refused, and files are read and written reproducibly."""

import tempfile
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np

from evac.base.errors import BuildingError, PluginError, ResultError, RunWarning, counted, text_of
from evac.building.importer import Importer
from evac.building.surface.surfacemesh import checked
from evac.case.case import Case
from evac.conformance.failures import CheckError, require, scene
from evac.export.exporter import Exporter, export
from evac.simulation.assembly import make_building, make_importers, read_surface
from evac.simulation.running import run
from evac.trajectory.trajectory import Trajectory, read_trajectory

#: Contents of files that no importer can read.
GARBAGE = (b"\n", b"\x00\xff\xfe\x80" * 16, b"0 1 2\nthis is no building\n")


def check_damaged_files(importer: Importer) -> None:
    """Check that damaged files are refused with ValueError."""
    with tempfile.TemporaryDirectory() as place:
        for path, content in [(Path(place, f"damaged{end}"), text) for end in importer.suffixes for text in GARBAGE]:
            path.write_bytes(content)
            with scene(f"a damaged file {path.name} with the content {content!r}"):
                try:
                    mesh = checked(path, read_surface(importer, path))
                except BuildingError:
                    continue
                wrong = f"it is read as a surface of {counted(len(mesh.triangles), 'triangle')}"
                raise CheckError(wrong, "raise ValueError for files that are not of this format")


def check_surface(case: Case, name: str) -> None:
    """Check that the file of a case is read twice to the same surface, from which a building can be made."""
    with scene(case.title):
        used, path = make_importers(case), case.mesh
        if path is None or used[0].name != name:
            what = f"read by {used[0].name!r}" if used else "not read from a file"
            raise CheckError(f"the building of the case is {what}", f"give a case that uses {name!r}")
    with scene(f"{case.title}, the file {path.name}"):
        one, other = (checked(path, read_surface(make_importers(case)[0], path)) for _ in range(2))
        pairs = {"points": (one.points, other.points), "cells": (one.triangles, other.triangles)}
        for what in ("cell_tags", "edge_tags"):
            first, second = getattr(one, what), getattr(other, what)
            pairs |= {f"{what} {tag!r}": (first.get(tag, ()), second.get(tag, ())) for tag in first | second}
        for what, (first, second) in pairs.items():
            wrong = f"two readings of the file differ in {what}"
            require(np.array_equal(first, second), wrong, "keep no state between them")
        make_building(case)


def check_case(case: Case, ticks: int, folder: Path) -> Trajectory:
    """Check that a case can be run for some ticks; return its trajectory, with at least three frames."""
    tick = case.simulation.tick
    changes = {"simulation.duration": ticks * tick, "output.every": max(1, ticks // 4) * tick}
    with scene(case.title), warnings.catch_warnings():
        warnings.simplefilter("ignore", RunWarning)  # of a case, not of the exporter
        run(case.change(changes | {"output.animation": False, "output.picture": False}), folder / "result")
        return read_trajectory(folder / "result")


def check_files(exporter: Exporter, trajectory: Trajectory) -> None:
    """Check that an exporter writes only to its path, returns the files, can overwrite them, and is reproducible."""
    before, found = trajectory.path.read_bytes(), []
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder, f"export{exporter.suffix}")
        for again in ("", ", exported again to the same place"):
            with scene(f"a run of some ticks{again}"):
                export(trajectory, exporter, place)
                files = sorted(path for path in place.parent.rglob("*") if path.is_file())
                strays = [path.name for path in files if path != place and place not in path.parents]
                require(not strays, f"writes {', '.join(strays)} outside `path`", "write to `path` only")
                found.append([(path, path.read_bytes()) for path in files])
                remedy = "do not write the current time or random numbers"
                require(found[0] == found[-1], "the two exports differ", remedy)
                require(trajectory.path.read_bytes() == before, "the trajectory file has changed", "only read it")


def check_without_frames(exporter: Exporter, trajectory: Trajectory) -> None:
    """Check that a run without frames is written, or refused with `ResultError`."""
    empty = replace(trajectory, time=trajectory.time[:0], rows=())
    with tempfile.TemporaryDirectory() as folder, scene("a run without frames"):
        try:
            export(empty, exporter, Path(folder, f"export{exporter.suffix}"))
        except ResultError:
            return
        except PluginError as error:
            wrong, _, _ = text_of(error).rpartition("; ")
            raise CheckError(wrong, "write a file without rows, or raise ResultError") from error.__cause__
