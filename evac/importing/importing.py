"""Import of building files to a folder with a case: surface, preliminary people, picture and report."""

import shutil
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
from evac.building.plan.plantable import SECTIONS, plan_of, read_table, table_of
from evac.building.plan.redrawing import plan_of_building
from evac.building.surface.build import building_of, clean
from evac.building.surface.meshfile import tagged_surface, write_surface
from evac.building.surface.surfacemesh import SurfaceMesh
from evac.contract.registry import Registry
from evac.folder.digests import digest_of_file
from evac.importing.casefile import case_text, check_folder
from evac.importing.completeness import with_missing
from evac.importing.edits import comments_of, plan_text, with_edits, with_former_names
from evac.importing.openings import Opening, find_openings
from evac.importing.report import report_text
from evac.importing.rooms import Room, fill, find_rooms
from evac.simulation.assembly import read_file, read_storeys, read_surface

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
PLAN, ORIGIN = "building.plan.toml", "imported.plan.toml"


@dataclass(frozen=True)
class Imported:
    """The result of an import."""

    files: tuple[Path, ...]
    folder: Path  # folder with the plan, levels.png and report.md, and with case.toml if the import is accepted
    building: Building
    findings: tuple[Finding, ...]  # findings of the importer, on the building and on the case, the worst first
    openings: tuple[Opening, ...]  # possible exits
    rooms: tuple[Room, ...]  # rooms in which people start
    options: dict[str, Any]  # values of all options of the importers and the building
    missing: tuple[str, ...]  # what the building lacks, the worst first, see `with_missing`
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
    spacing: float | None = None,
    partial: bool = False,
    registry: Registry | None = None,
) -> Imported:
    """Create a case from building files: one file, or one for each storey, from the lowest up.

    If a storey or more than 2 % of the ground has no way out, or a stair could not be used, only the plan, the report
    and the picture are written, unless `partial` is true. What users have changed in the plan and in case.toml of an
    earlier import to the same folder is kept.

    Parameters
    ----------
    files : sequence of path
    folder : path
        New, empty, or that of an earlier import.
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
    spacing : float, optional
        Spacing of the grids of directions [m], for buildings whose grids would not fit into memory at the default.
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
    edited = check_folder(place, CASE, REPORT)
    importers, own, values = _options(paths, dict(options or {}), registry)
    read, findings = _read(paths, importers, z, registry)
    with _drafted(place) as draft:
        building = _Draft(draft, read, paths[0], own, registry)
        openings = find_openings(building.written, building.openings)
        chosen = [opening.exit() for opening in _chosen(exits, openings)]
        building.add(chosen, place)
        written = building.written
        findings += building.findings
        if people is None and density is None:
            text = f"{DENSITY:g} people per square metre in every room (--density, --people)"
            findings.append(Finding("assumed", text))
        if edited:
            findings.append(Finding("assumed", f"{CASE} has been changed since it was written, and is kept"))
            if chosen and building.name == MESH:
                ways = ", ".join(repr(one["name"]) for one in chosen)
                findings.append(Finding("warning", f"{ways}: not among the exits in {CASE}, which is kept; add them"))
        rooms, assumed = fill(written, find_rooms(written), people, DENSITY if density is None else density)
        findings = sorted(with_missing(written, [*findings, *assumed]), key=lambda one: KINDS.index(one.kind))
        written = replace(written, source=place / building.name)
        missing = tuple(str(one) for one in findings if one.kind == "missing")
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
        if edited:
            shutil.copyfile(place / CASE, draft / CASE)
        else:
            # Names of files need not be UTF-8.
            keys = {"mesh": building.name} | building.kept | ({"missing": list(missing)} if missing else {})
            text = case_text(made, [] if building.name == PLAN else chosen, keys, spacing)
            (draft / CASE).write_text(text, encoding="utf-8", errors="replace")
        if not made.is_accepted:
            made = replace(made, fault="the building is incomplete")
        else:
            made = replace(made, fault=_fault(draft, place, registry) if written.exits else "there is no exit")
        digest = edited or (digest_of_file(draft / CASE)[:16] if made.is_accepted else "none")
        text = report_text(made, digest)
        (draft / REPORT).write_text(text, encoding="utf-8", errors="replace")
        _draw(made, draft, are_named=bool(building.openings))
        produced = (PICTURE, REPORT, *((PLAN, ORIGIN) if building.name == PLAN else ()))
        _publish(draft, place, (*produced, *((building.name, CASE) if made.is_accepted else ())), keep=bool(edited))
    return made


class _Draft:
    """The building of an import in a draft of its folder, as a plan that users can edit, or as a mesh.

    Attributes
    ----------
    name : str
        Name of its file.
    kept : dict
        Keys of ``[building]`` of the case.
    written : Building
        The building as a case reads it.
    openings : list of (level, (4,) array [m])
        Openings that the file names.
    findings : list of Finding
        Those of the importer and on the building.
    """

    def __init__(
        self, folder: Path, read: SurfaceMesh | Plan, source: Path, own: SurfaceOptions, registry: Registry
    ) -> None:
        self._folder, self._registry = folder, registry
        keys = {"flat_angle", "walkable_angle", "treads"}
        plan = read if isinstance(read, Plan) and own.scale == 1.0 and own.up == "z" else None
        self._proposed: list[tuple[Finding, dict[str, Any]]] = []
        self.findings: list[Finding] = []
        self.openings: list[tuple[str, Any]] = []
        if plan is not None:
            keys |= {"weld"}
            self._told = list(plan.findings)
            self._proposed = plan.proposals
        else:
            mesh = read.surface() if isinstance(read, Plan) else read
            surface = clean(mesh, source, own)
            building = building_of(surface, source, need_exit=False)
            self._told = list(building.findings)
            self.openings = [(name, own.scale * np.asarray(ends)) for name, ends in mesh.openings]
            try:
                plan = plan_of_building(building)
            except ValueError as error:
                self._told.append(Finding("assumed", f"there is no plan to edit, since {error}"))
                write_surface(tagged_surface(surface, building), folder / MESH)
        # The other options have been applied to the file.
        self.kept = own.model_dump(include=keys, exclude_defaults=True)
        self.table = None if plan is None else table_of(plan)
        self.name = MESH if plan is None else PLAN
        self._build(comments=self._proposals())

    def add(self, exits: Sequence[Mapping[str, Any]], folder: Path) -> None:
        """Add exits [name, segment, level], and the edits that a user has made to the plan of an earlier import."""
        is_edited = _is_edited(folder)
        if self.table is None:
            if is_edited:
                text = "has been changed, and these files have no plan in which that could be kept"
                raise ScenarioError(f"{folder / PLAN}: {text}; choose another folder (--out)")
            self._build({"exits": exits})
            return
        storeys = {one["name"] for one in self.table["storeys"]}
        for way in exits:
            level = way["level"] if way["level"] in storeys else way["level"].rpartition(" (")[0]
            more = {"name": way["name"], "storey": level, "segment": way["segment"]}
            self.table["exits"] = [*self.table.get("exits", []), more]
        if (folder / ORIGIN).exists():
            self.table = with_former_names(self.table, _table_in(folder / ORIGIN))
        (self._folder / ORIGIN).write_text(plan_text(self.table, self._proposals()), encoding="utf-8", errors="replace")
        comments = self._proposals()
        if is_edited:
            places = (self._folder / ORIGIN, folder / ORIGIN, folder / PLAN)
            imported, former, edited = (_table_in(place) for place in places)
            for file in (Path(str(storey["file"])) for storey in edited.get("storeys", ()) if "file" in storey):
                if (folder / file).is_file() and not file.is_absolute() and ".." not in file.parts:
                    (self._folder / file).parent.mkdir(parents=True, exist_ok=True)
                    shutil.copyfile(folder / file, self._folder / file)
            self.table, dropped, told = with_edits(
                imported, former, edited, lambda own: self._check(own, folder / PLAN)
            )
            seen, known = (comments_of((folder / name).read_text(encoding="utf-8-sig")) for name in (PLAN, ORIGIN))
            own = {one["name"] for one in self.table.get("stairs", ())}
            done = [finding for finding, given in self._proposed if given["name"] in own]
            self._proposed = [one for one in self._proposed if one[0] not in done]
            self._told = [one for one in self._told if one not in done]
            comments = [*self._proposals(), *(line for line in seen if line not in known), *dropped]
            self._told += told
        is_new = plan_text(self.table, comments) != (self._folder / PLAN).read_text(encoding="utf-8")
        if is_new or self._told != self.findings[: len(self._told)]:
            self._build(comments=comments)

    def _proposals(self) -> list[str]:
        """Return the lines of the plan that add what an importer has seen and left out."""
        return plan_text({"stairs": [given for _, given in self._proposed]}, head="").splitlines()[1:]

    def _check(self, table: Mapping[str, Any], source: Path) -> None:
        plan = read_storeys(plan_of(table, source, self._folder), self._registry)
        plan.building(need_exit=False, **self.kept)

    def _build(self, more: Mapping[str, Any] | None = None, comments: Sequence[str] = ()) -> None:
        """Write the plan if there is one, and read the building as a case does."""
        file = self._folder / self.name
        if self.table is not None:
            file.write_text(plan_text(self.table, comments), encoding="utf-8", errors="replace")
        (importer,), _, _ = _options([file], {}, self._registry)
        mesh = read_surface(importer, file, self._registry)
        surface = clean(mesh, file, SurfaceOptions(**self.kept))
        self.written = building_of(surface, file, BuildingOptions.model_validate(more or {}), need_exit=False)
        self.openings = self.openings or [(name, np.asarray(ends)) for name, ends in mesh.openings]
        self.findings = [*self._told, *(one for one in self.written.findings if one not in self._told)]


@contextmanager
def _drafted(folder: Path) -> Iterator[Path]:
    """Yield a temporary folder beside a folder, which an error leaves as it was."""
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with TemporaryDirectory(prefix=".evac-import-", dir=folder.parent, ignore_cleanup_errors=True) as draft:
            yield Path(draft)
    except OSError as error:
        raise ScenarioError(f"{folder}: cannot be written: {error.strerror}; choose another folder (--out)") from error


def _is_edited(folder: Path) -> bool:
    """Return whether the plan of an earlier import has been changed."""
    plan, origin = folder / PLAN, folder / ORIGIN
    if plan.exists() and not origin.exists():
        text = f"is missing, so that the edits of {PLAN} cannot be found"
        raise ScenarioError(f"{origin}: {text}; restore it, or remove {PLAN} to import without its edits")
    return plan.exists() and plan.read_bytes() != origin.read_bytes()


def _table_in(file: Path) -> dict[str, Any]:
    """Return the table of a plan file, whose sections are lists of tables."""
    try:
        table = read_table(file)
        for section in SECTIONS:
            items = table.get(section, [])
            if not isinstance(items, list) or not all(isinstance(item, dict) for item in items):
                raise ValueError(f"{section} must be a list of tables: [[{section}]]")
        return table
    except ValueError as error:
        raise BuildingError(f"{file}: {error}; correct it, or remove it to import without its edits") from error


def _publish(draft: Path, folder: Path, names: Sequence[str], *, keep: bool) -> None:
    """Move the files of an import to its folder, and remove those of an earlier import that it does not have.

    A case.toml that is to be kept stays.
    """
    folder.mkdir(exist_ok=True)
    for name in (MESH, PLAN, ORIGIN, PICTURE, CASE, REPORT):
        if keep and name == CASE:
            continue
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


def _read(
    paths: Sequence[Path], importers: "Sequence[Importer]", z: Sequence[float] | None, registry: Registry
) -> tuple[SurfaceMesh | Plan, list[Finding]]:
    """Return the content of one file, or of several files as storeys, and the assumptions made."""
    if len(paths) == 1:
        if z is not None:
            raise ScenarioError("z: heights can be given only for several files, one for each storey; remove them")
        read = read_file(importers[0], paths[0])
        return (read_storeys(read, registry) if isinstance(read, Plan) else read), []
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
    return plan, notes


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
    index = {level.name: level.index for level in made.building.levels}
    marks = [
        Mark(f"{one.number}: {one.width:.2f} m", index[one.level], one.segment) for one in offered if one.level in index
    ]
    draw_levels(made.building, folder / PICTURE, made.findings, marks, ", ".join(one.name for one in made.files))
