"""Import of building files to a folder with a case: surface, preliminary people, picture and report."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np

from evac.base.errors import BuildingError, EvacError, ScenarioError
from evac.base.parameters import did_you_mean
from evac.building.model.building import Building
from evac.building.model.findings import KINDS, Finding
from evac.building.options import BuildingOptions, SurfaceOptions
from evac.building.plan.plan import Plan
from evac.building.surface.build import building_of, clean
from evac.building.surface.meshfile import tagged_surface, write_surface
from evac.building.surface.surfacemesh import SurfaceMesh
from evac.contract.registry import Registry
from evac.importing.casefile import case_text, check_folder
from evac.importing.completeness import missing_parts
from evac.importing.openings import Opening, find_openings
from evac.importing.report import report_text
from evac.importing.rooms import Room, fill, find_rooms
from evac.simulation.assembly import draw_plan, read_file, read_surface

if TYPE_CHECKING:
    from evac.building.importer import Importer

#: Default density of people in rooms [1/m2].
DENSITY = 0.1
#: Greatest density that can be asked for [1/m2]; what rooms can hold is less.
MOST_DENSITY = 100.0
#: Default height between the storeys of consecutive files [m].
STOREY_HEIGHT = 3.0
#: Names of the files in the folder.
CASE, MESH, PICTURE, REPORT = "case.toml", "building.msh", "levels.png", "report.md"


@dataclass(frozen=True)
class Imported:
    """The result of an import."""

    files: tuple[Path, ...]
    folder: Path  # folder with levels.png and report.md, and with case.toml and building.msh if the import is accepted
    building: Building
    findings: tuple[Finding, ...]  # findings of the importer, on the building and on the case, the worst first
    openings: tuple[Opening, ...]  # possible exits
    rooms: tuple[Room, ...]  # rooms in which people start
    options: dict[str, Any]  # values of all options of the importers and the building
    missing: tuple[str, ...]  # what the building lacks, the worst first, see `missing_parts`
    fault: str  # why the case cannot be run yet; empty if it can
    is_accepted: bool  # whether there is a case: nothing is missing, or this was allowed


def import_building(
    files: Sequence[str | Path],
    folder: str | Path,
    *,
    exits: Sequence[int] = (),
    people: int | None = None,
    density: float | None = None,
    z: Sequence[float] | None = None,
    options: Mapping[str, Any] | None = None,
    partial: bool = False,
    registry: Registry | None = None,
) -> Imported:
    """Create a case from building files: one file, or one for each storey, from the lowest up.

    If a storey or more than 2 % of the ground has no way out, or a stair could not be used, only the report and the
    picture are written, unless `partial` is true.

    Parameters
    ----------
    files : sequence of path
    folder : path
        New, empty, or that of an earlier import whose case has not been changed.
    exits : sequence of int
        Numbers of the openings that become exits.
    people : int, optional
        Number of people, distributed over the rooms in proportion to their floor areas.
    density : float, optional
        People per square metre, if `people` is not given; 0.1 by default.
    z : sequence of float, optional
        Heights of the storeys of several files [m]; 3 m from one to the next by default.
    options : mapping
        Parameters of the importers, and keys of ``[building]`` that control how a mesh is read.
    partial : bool
        Whether a case is written for a building that lacks something; every run of it has a quality warning.
    registry : Registry, optional
        Registry whose importers read the files; by default the built-in and the installed ones.

    Returns
    -------
    Imported

    Raises
    ------
    BuildingError
        A file cannot be read, or its content is not a valid building.
    ScenarioError
        An option or the number of an exit is not known, or the folder contains something else.
    """
    if density is not None and not 0.0 <= density <= MOST_DENSITY:
        raise ScenarioError(f"density: must be between 0 and {MOST_DENSITY:g} people per square metre, not {density!r}")
    registry = registry or Registry()
    paths, place = tuple(Path(file) for file in files), Path(folder)
    check_folder(place, CASE, REPORT)
    importers, own, values = _options(paths, dict(options or {}), registry)
    mesh, notes = _surface(paths, importers, z, registry)
    surface = clean(mesh, paths[0], own)
    building = building_of(surface, paths[0], need_exit=False)
    with _drafted(place) as draft:
        write_surface(tagged_surface(surface, building), draft / MESH)
        # The other options have been applied to building.msh.
        kept = own.model_dump(include={"flat_angle", "walkable_angle", "treads"}, exclude_defaults=True)
        (importer,), _, _ = _options([draft / MESH], {}, registry)
        surface = clean(read_surface(importer, draft / MESH, registry), draft / MESH, SurfaceOptions(**kept))
        written = building_of(surface, draft / MESH, need_exit=False)
        openings = find_openings(written, [(name, own.scale * np.asarray(ends)) for name, ends in mesh.openings])
        chosen = [opening.exit(written) for opening in _chosen(exits, openings)]
        if chosen:
            added = BuildingOptions.model_validate({"exits": chosen})
            written = building_of(surface, draft / MESH, added, need_exit=False)
        findings = [*notes, *building.findings]
        findings += [one for one in written.findings if one not in findings]
        if people is None and density is None:
            text = f"{DENSITY:g} people per square metre in every room (--density, --people)"
            findings.append(Finding("assumed", text))
        rooms, assumed = fill(written, find_rooms(written), people, DENSITY if density is None else density)
        findings = sorted([*findings, *assumed], key=lambda one: KINDS.index(one.kind))
        written = replace(written, source=place / MESH)
        missing = missing_parts(written, findings)
        made = Imported(
            paths,
            place,
            written,
            findings=tuple(findings),
            openings=tuple(openings),
            rooms=tuple(rooms),
            options=values,
            missing=missing,
            fault="",
            is_accepted=partial or not missing,
        )
        # Names of files need not be UTF-8.
        text = case_text(made, chosen, kept | ({"missing": list(missing)} if missing else {}))
        (draft / CASE).write_text(text, encoding="utf-8", errors="replace")
        if not made.is_accepted:
            made = replace(made, fault="the building is incomplete")
        else:
            made = replace(made, fault=_fault(draft, place, registry) if written.exits else "there is no exit")
        text = report_text(made, draft / CASE)
        (draft / REPORT).write_text(text, encoding="utf-8", errors="replace")
        _draw(made, draft, are_named=bool(mesh.openings))
        _publish(draft, place, (PICTURE, REPORT, *((MESH, CASE) if made.is_accepted else ())))
    return made


@contextmanager
def _drafted(folder: Path) -> Iterator[Path]:
    """Yield a temporary folder beside a folder, which an error leaves as it was.

    Raises
    ------
    ScenarioError
        The folder cannot be written.
    """
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with TemporaryDirectory(prefix=".evac-import-", dir=folder.parent, ignore_cleanup_errors=True) as draft:
            yield Path(draft)
    except OSError as error:
        raise ScenarioError(f"{folder}: cannot be written: {error.strerror}; choose another folder (--out)") from error


def _publish(draft: Path, folder: Path, names: Sequence[str]) -> None:
    """Move the files of an import to its folder, and remove those of an earlier import that it does not have."""
    folder.mkdir(exist_ok=True)
    for name in (MESH, PICTURE, CASE, REPORT):
        if name in names:
            (draft / name).replace(folder / name)
        else:
            (folder / name).unlink(missing_ok=True)


def _options(
    paths: Sequence[Path], given: dict[str, Any], registry: Registry
) -> "tuple[list[Importer], SurfaceOptions, dict[str, Any]]":
    """Return the importer of each file, the options of the building, and the values of all options."""
    classes = [registry.importer_for(path) for path in paths]
    declared = {name: one for cls in classes for name, one in cls.declared().items()}
    names = [*declared, *SurfaceOptions.model_fields]
    for key in given:
        if key not in names:
            raise ScenarioError(f"option {key!r}: unknown; {did_you_mean(key, names)} (of {', '.join(names)})")
    own = {key: value for key, value in given.items() if key in SurfaceOptions.model_fields}
    options = SurfaceOptions.read(own, ScenarioError, "option ")
    importers = [cls(**{key: given[key] for key in given if key in cls.declared()}) for cls in classes]
    values = {key: value for importer in importers for key, value in importer.values().items()}
    return importers, options, values | options.model_dump()


def _surface(
    paths: Sequence[Path], importers: "Sequence[Importer]", z: Sequence[float] | None, registry: Registry
) -> tuple[SurfaceMesh, list[Finding]]:
    """Return the surface of one file, or of several files as storeys, and the assumptions made."""
    if len(paths) == 1:
        if z is not None:
            raise ScenarioError("z: heights can be given only for several files, one for each storey; remove them")
        read = read_file(importers[0], paths[0])
        return (draw_plan(read, registry) if isinstance(read, Plan) else read), []
    heights = [STOREY_HEIGHT * k for k in range(len(paths))] if z is None else list(z)
    if len(heights) != len(paths):
        raise ScenarioError(f"z: {len(heights)} heights for {len(paths)} files; give one for each file")
    plan, notes = Plan(paths[0].parent), []
    for path, importer, height in zip(paths, importers, heights, strict=True):
        read = read_file(importer, path)
        if not isinstance(read, Plan):
            raise BuildingError(f"{path}: is a mesh; with several files, each must be the plan of one storey")
        plan.storey(path.stem, file=path, z=height)
        plan.take(path.stem, read)
        if z is None:
            text = f"z = {height:g} m, {STOREY_HEIGHT:g} m from one file to the next (--z)"
            notes.append(Finding("assumed", text, path.stem))
    return plan.surface(), notes


def _chosen(numbers: Sequence[int], openings: Sequence[Opening]) -> list[Opening]:
    """Return the openings of some numbers."""
    for number in numbers:
        if not 1 <= number <= len(openings):
            raise ScenarioError(f"exit {number}: no opening has this number; choose from 1 to {len(openings)}")
    return [openings[number - 1] for number in sorted(set(numbers))]


def _fault(draft: Path, folder: Path, registry: Registry) -> str:
    """Return why the case in a draft of a folder cannot be run; empty if it can."""
    from evac.case.loading import load_case
    from evac.simulation.simulation import Simulation

    try:
        Simulation(load_case(draft, registry=registry), will_run=False)
    except EvacError as error:
        return str(error).replace(str(draft.resolve()), str(folder))
    return ""


def _draw(made: Imported, folder: Path, *, are_named: bool) -> None:
    """Draw every level, with numbered openings if the file names them, or there is no exit."""
    from evac.importing.report import MOST_OPENINGS
    from evac.pictures.annotated import Mark, draw_levels

    offered = () if made.building.exits and not are_named else made.openings[:MOST_OPENINGS]
    marks = [Mark(f"{one.number}: {one.width:.2f} m", one.level, one.segment) for one in offered]
    draw_levels(made.building, folder / PICTURE, made.findings, marks, ", ".join(one.name for one in made.files))
