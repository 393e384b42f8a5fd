"""Import of building files to a folder with a case: plan or surface, preliminary people, picture and report."""

import math
import os
import re
import shutil
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely

from evac.base.defaults import SPACING
from evac.base.errors import BuildingError, EvacError, ScenarioError, usable_path
from evac.base.parameters import PATH, check_types, did_you_mean
from evac.base.progress import shown_by
from evac.building.model.building import Building
from evac.building.model.findings import FINDING_KINDS, Finding
from evac.building.options import BuildingOptions, SurfaceOptions
from evac.building.plan.plan import Plan
from evac.building.plan.plantable import plan_of_building, plan_text, table_of
from evac.building.surface.build import building_of, clean
from evac.building.surface.resolution import Axis, likely_frame
from evac.building.surface.surface import tagged_surface, write_surface
from evac.building.surface.surfacemesh import SurfaceMesh, checked
from evac.contract.hooks import BASES
from evac.contract.registry import Registry
from evac.directions.build import find_classes, least_spacing
from evac.folder.files import RUNNING, digest_of_file, mark, read_manifest
from evac.folder.resultfolder import is_empty, locked
from evac.importing.documents import MOST_OPENINGS, PLAN_HEAD, case_text, report_text
from evac.importing.rooms import Opening, Room, fill, find_openings, find_rooms, with_missing
from evac.people.starts import held_by, load_table
from evac.simulation.assembly import read_file, read_storeys

if TYPE_CHECKING:
    from evac.building.importer import Importer

#: Default density of people in rooms [1/m2].
DENSITY = 0.1
#: Greatest density that can be asked for [1/m2]; what rooms can hold is less.
MOST_DENSITY = 100.0
#: Default height between the storeys of consecutive files [m].
STOREY_HEIGHT = 3.0
#: Narrowest and widest people of a new case [m], and the number of routes from which their classes are counted.
WIDTHS, ROUTES = (0.4, 0.5), 4
#: Spacings of the directions with which a case is tried, in those of the case.
COARSE = 2.0, 1.0
#: Names of the files in the folder.
CASE, MESH, PICTURE, REPORT = "case.toml", "building.msh", "levels.png", "report.md"
PLAN = "building.plan.toml"
#: Lines of report.md that show whether a file has been changed since the import.
DIGEST = re.compile(r"(case\.toml|building\.plan\.toml) as written: ([0-9a-f]{16}|none)")


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
    basis: str = "measured",
    registry: Registry | None = None,
) -> Imported:
    """Create a case from building files: one file, or one for each storey, from the lowest up.

    If a storey or more than 2 % of the ground has no way out, or a stair could not be used, only the plan, the report
    and the picture are written, unless `partial` is true. A plan or case.toml of an earlier import to the same folder
    that has been changed is kept; with such a plan, the files are not read again.

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
        Spacing of the grids of directions [m]; by default 0.1 m, or as much as wide buildings need to fit into memory.
    partial : bool
        Whether a case is written for a building that lacks something; every run of it has a quality warning.
    basis : "measured" or "regulation"
        How people walk: as in experiments, or with the flows that standard tests prescribe.
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
    check_types(
        files=(files, Sequence), folder=(folder, PATH), exits=(exits, Sequence), registry=(registry, Registry | None)
    )
    if density is not None and not 0.0 <= density <= MOST_DENSITY:
        raise ScenarioError(f"density: must be between 0 and {MOST_DENSITY:g} people per square metre, not {density!r}")
    if basis not in BASES:
        raise ScenarioError(f"basis: must be one of {', '.join(BASES)}, not {basis!r}")
    registry = registry or Registry()
    paths, place = tuple(usable_path(file, BuildingError) for file in files), Path(folder)
    changed = _changed_files(place)
    importers, own, values = _options(paths, dict(options or {}), registry)
    findings = list[Finding]()
    with _drafted(place, paths[0]) as draft:
        building = _Draft(draft, own, registry)
        if PLAN in changed:
            building.keep(place)
        else:
            read, findings = _read(paths, importers, z, registry)
            building.write(read, paths[0], own)
        _show("finding openings, exits and rooms")
        openings = find_openings(building.written, building.openings)
        keeper = PLAN if PLAN in changed else CASE if CASE in changed and building.name == MESH else ""
        ways = [] if keeper == PLAN else [opening.exit() for opening in _chosen(exits, openings)]
        if ways:
            building.add(ways)
        written = building.written
        findings += [*building.findings, *_kept(exits, keeper, written, CASE in changed)]
        stated = building.people if density is None else {}
        rooms = fill(written, find_rooms(written), people, DENSITY if density is None else density, stated)
        if people is None and density is None and any(room.number and room.name not in stated for room in rooms):
            text = f"{DENSITY:g} people per square metre in rooms without a number or a known use (density, people)"
            findings.append(Finding("assumed", text))
        least = _least_spacing(written)
        if spacing is None and CASE not in changed and least > SPACING:
            spacing = math.ceil(100.0 * least) / 100.0
            text = f"directions have a spacing of {spacing:g} m: with {SPACING:g} m they need too much memory (spacing)"
            findings.append(Finding("assumed", text))
        findings = sorted(with_missing(written, findings), key=lambda one: FINDING_KINDS.index(one.kind))
        missing = tuple(str(finding) for finding in findings if finding.kind == "missing")
        made = Imported(
            paths,
            place,
            replace(written, source=place / building.name),
            findings=tuple(findings),
            openings=tuple(openings),
            rooms=tuple(rooms),
            options=values,
            missing=missing,
            fault="",
            is_accepted=partial or not missing,
        )
        if CASE in changed:
            shutil.copyfile(place / CASE, draft / CASE)
        else:
            # Names of files need not be UTF-8.
            keys = {"mesh": building.name} | building.kept | ({"missing": list(missing)} if missing else {})
            text = case_text(made, [] if building.name == PLAN else ways, keys, building.lines, spacing, basis)
            (draft / CASE).write_text(text, encoding="utf-8", errors="replace")
        return _tried(building, made, registry, changed)


def _kept(exits: Sequence[int], keeper: str, written: Building, is_case_kept: bool) -> Iterator[Finding]:
    """Yield what is found about files that are kept: exits that a kept file does not have, and that a case is kept."""
    known = {way.name for way in written.exits} if keeper == PLAN else set()
    lost = [name for name in (f"exit {number}" for number in sorted(set(exits))) if keeper and name not in known]
    if lost:
        names = ", ".join(map(repr, lost))
        yield Finding("warning", f"{names}: not among the exits in {keeper}, which is kept; add them")
    if is_case_kept:
        yield Finding("assumed", f"{CASE} has been changed since it was written, and is kept")


def _least_spacing(building: Building) -> float:
    """Return the least spacing [m] with which the grids of a building fit into memory, with classes of bodies."""
    if least_spacing(building, ROUTES) > SPACING:
        return least_spacing(building, 1 + len(find_classes(building, *WIDTHS)))
    return least_spacing(building, 1)


def _tried(building: "_Draft", made: Imported, registry: Registry, changed: dict[str, str]) -> Imported:
    """Check the case in the draft, write report and picture, and publish what is accepted; return what was made."""
    _show("checking the case")
    draft = building.folder
    fault = "the building is incomplete"
    if made.is_accepted:
        fault = _fault(draft, made, registry, CASE in changed) if made.building.exits else "there is no exit"
    made = replace(made, fault=fault)
    produced = {building.name, *([CASE] if made.is_accepted else [])}
    digests = {name: digest_of_file(draft / name)[:16] if name in produced else "none" for name in (CASE, PLAN)}
    (draft / REPORT).write_text(report_text(made, digests | changed), encoding="utf-8", errors="replace")
    _draw(made, draft, are_named=bool(building.openings))
    if building.name == MESH and not made.is_accepted:
        produced = set()
    _publish(draft, made.folder, {PICTURE, REPORT, *produced}, changed)
    return made


def _show(what: str) -> None:
    """Have it shown, if a command does so, what an import is at."""
    for show in shown_by[-1:]:
        show(what, 1, 1)


def _changed_files(folder: Path) -> dict[str, str]:
    """Return the case and the plan that were changed after an import to a folder, with their digests before that."""
    # A folder with other things than an import is refused.
    usable_path(folder, ScenarioError)
    if folder.exists() and not folder.is_dir():
        raise ScenarioError(f"{folder}: not a folder; choose another one for the case")
    if not folder.exists() or not any(folder.iterdir()):
        return {}
    try:
        before = dict(DIGEST.findall((folder / REPORT).read_text(encoding="utf-8")))
        now = {name: digest_of_file(folder / name)[:16] for name in before if (folder / name).exists()}
    except (OSError, EvacError):
        before = {}
    if CASE not in before:
        raise ScenarioError(f"{folder}: contains files other than an import; choose a new or empty folder")
    return {name: digest for name, digest in before.items() if now.get(name, digest) != digest}


class _Draft:
    """The building of an import in a draft of its folder: a plan that users can edit, or a mesh."""

    name = PLAN  # of its file
    written: Building  # as a case reads it
    findings: list[Finding]  # those of the importer and on the building
    people: dict[str, float]  # people of rooms whose number the plan states, by area

    def __init__(self, folder: Path, own: SurfaceOptions, registry: Registry) -> None:
        self.folder, self._registry = folder, registry
        # Keys of [building] of the case; the other options are applied to the file.
        keys = {"flat_angle", "walkable_angle", "treads", "weld"}
        self.kept = own.model_dump(include=keys, exclude_defaults=True)
        self.openings: list[tuple[str, Any]] = []  # that the file names: level and segment (4,) [m]
        self.lines: list[dict[str, Any]] = []  # tables [[line]] of the case

    def keep(self, folder: Path) -> None:
        """Read the plan in a folder, and copy it with the files of its storeys that are there."""
        text = f"{PLAN} has been changed and is kept; to read the files again, remove it or choose another folder"
        self._told = [Finding("warning", text)]
        self._build(folder / PLAN)
        (importer,), _, _ = _options([folder / PLAN], {}, self._registry)
        for file in (file.resolve() for file in importer.files(folder / PLAN)):
            if file.is_relative_to(folder.resolve()):
                copy = self.folder / file.relative_to(folder.resolve())
                copy.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(file, copy)

    def write(self, read: SurfaceMesh | Plan, source: Path, own: SurfaceOptions) -> None:
        """Write what an importer has read as a plan, or as a mesh if it has no plan."""
        plan = read if isinstance(read, Plan) and own.scale == 1.0 and own.up == "z" else None
        if plan is not None:
            self._told = list(plan.findings)
        else:
            self.kept.pop("weld", None)
            mesh = read.surface() if isinstance(read, Plan) else read
            axes: tuple[Axis, ...] = (own.up,) if "up" in own.model_fields_set else ("z", "y")
            up, unit, why = own.up, 1.0, ""
            if "scale" not in own.model_fields_set:
                up, unit, why = likely_frame(checked(source, mesh), axes)
            own = own.model_copy(update={"scale": unit * own.scale, "up": up})
            _show("finding the surface on which people walk")
            surface = clean(mesh, source, own)
            building = building_of(surface, source, need_exit=False)
            lost = sum(one.number for one in building.findings if one.element == "face")
            faces = Finding("found", f"{len(mesh.cells)} faces", element="face", number=len(mesh.cells) + lost)
            self._told = [*building.findings, faces, *([Finding("assumed", why)] if why else [])]
            self.openings = [(name, own.scale * np.asarray(ends)) for name, ends in mesh.openings]
            try:
                plan = plan_of_building(building)
            except ValueError as error:
                self._told.append(Finding("assumed", f"there is no plan to edit, since {error}"))
                self.name = MESH
                write_surface(tagged_surface(surface, building), self.folder / MESH)
        if plan is not None:
            self._table, proposed = table_of(plan), [given for _, given in plan.proposals]
            # What an importer has seen and left out.
            self._comments = [f"# {line}\n" for line in plan_text({"stairs": proposed}).splitlines()]
            self._write_plan()
        self._build(self.folder / self.name)
        for name, storey, ends in read.lines if isinstance(read, Plan) else ():
            line = shapely.LineString(ends)
            near = [level for level in self.written.levels if level.name.partition(" (")[0] == storey]
            level = max(near, key=lambda level: level.polygon.intersection(line).length)
            self.lines.append({"name": name, "level": level.name, "segment": ends.tolist()})

    def add(self, exits: Sequence[Mapping[str, Any]]) -> None:
        """Add exits [name, segment, level] to what has been written."""
        if self.name == MESH:
            self._build(self.folder / MESH, {"exits": exits})
        else:
            storeys = {one["name"] for one in self._table["storeys"]}
            for way in exits:
                level = way["level"] if way["level"] in storeys else way["level"].rpartition(" (")[0]
                more = {"name": way["name"], "storey": level, "segment": way["segment"]}
                self._table["exits"] = [*self._table.get("exits", []), more]
            self._write_plan()
            self._build(self.folder / PLAN)

    def _write_plan(self) -> None:
        text = "".join([PLAN_HEAD, plan_text(self._table), *self._comments])
        (self.folder / PLAN).write_text(text, encoding="utf-8", errors="replace")

    def _build(self, file: Path, more: Mapping[str, Any] | None = None) -> None:
        """Read the building as a case does."""
        _show("finding levels, stairs and doors")
        (importer,), _, _ = _options([file], {}, self._registry)
        read = read_file(importer, file)
        mesh = read if isinstance(read, SurfaceMesh) else read_storeys(read, self._registry).surface()
        surface = clean(mesh, file, SurfaceOptions(**self.kept))
        options = BuildingOptions.model_validate(dict(more or {}))
        self.written = building_of(surface, file, options, need_exit=False)
        own = [area for area in self.written.areas if area.people is not None or area.use in load_table()]
        self.people = {area.name: held_by(area) for area in own}
        self.openings = self.openings or [(name, np.asarray(ends)) for name, ends in mesh.openings]
        self.findings = [*self._told, *(finding for finding in self.written.findings if finding not in self._told)]


@contextmanager
def _drafted(folder: Path, source: Path) -> Iterator[Path]:
    """Yield a draft beside a folder, which an error leaves as it was; one that a killed import has left is removed."""
    # Errors name the file that is imported instead of one in the draft.
    place = folder.resolve()
    draft = place.with_name(f"{place.name}.importing")
    try:
        with locked(place.with_name(f"{place.name}.lock"), str(folder)):
            manifest = read_manifest(draft)
            if os.path.lexists(draft) and not is_empty(draft) and manifest.result != place.name:
                raise ScenarioError(f"{draft}: is not the draft of an import, but it needs this name; move it away")
            shutil.rmtree(draft, ignore_errors=True)  # of an import that was killed
            draft.mkdir()
            mark(draft, RUNNING, place.name)
            try:
                yield draft
            except BuildingError as error:
                error.args = (re.sub(re.escape(str(draft)) + r"/[\w.]+", lambda _: str(source), str(error)),)
                raise
            finally:
                shutil.rmtree(draft, ignore_errors=True)
    except OSError as error:
        raise ScenarioError(f"{folder}: cannot be written: {error.strerror}; choose another folder") from error


def _publish(draft: Path, folder: Path, names: Collection[str], kept: Collection[str]) -> None:
    """Move files of an import to its folder, where those of an earlier import go, except those that are to be kept."""
    folder.mkdir(exist_ok=True)
    for name in (MESH, PLAN, PICTURE, CASE, REPORT):
        if name in names and name not in kept:
            (draft / name).replace(folder / name)
        elif name not in kept:
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
        _show(f"reading {paths[0].name}")
        read = read_file(importers[0], paths[0])
        return (read_storeys(read, registry) if isinstance(read, Plan) else read), []
    heights = [STOREY_HEIGHT * k for k in range(len(paths))] if z is None else list(z)
    if len(heights) != len(paths):
        raise ScenarioError(f"z: {len(heights)} heights for {len(paths)} files; give one for each file")
    plan, notes = Plan(paths[0].parent), []
    for path, importer, height in zip(paths, importers, heights, strict=True):
        _show(f"reading {path.name}")
        read = read_file(importer, path)
        if not isinstance(read, Plan):
            raise BuildingError(f"{path}: is a mesh; with several files, each must be the plan of one storey")
        plan.storey(path.stem, file=path, z=height)
        plan.take(path.stem, read)
        if z is None:
            text = f"z = {height:g} m, {STOREY_HEIGHT:g} m from one file to the next (z)"
            notes.append(Finding("assumed", text, path.stem))
    return plan, notes


def _chosen(numbers: Sequence[int], openings: Sequence[Opening]) -> list[Opening]:
    """Return the openings of some numbers."""
    for number in numbers:
        if not 1 <= number <= len(openings):
            raise ScenarioError(f"exit {number}: no opening has this number; choose from 1 to {len(openings)}")
    return [openings[number - 1] for number in sorted(set(numbers))]


def _fault(draft: Path, made: Imported, registry: Registry, is_changed: bool) -> str:
    """Return why the case in a draft cannot be run; empty if it can. One that is changed may have another building.

    Coarse directions are tried first: they take a fraction of the time. What they find wrong, and whether a large
    building fits into memory, is found with those of the case.
    """
    from evac.case.loading import load_case
    from evac.simulation.assembly import make_shared_scene
    from evac.simulation.simulation import Simulation

    fault = ""
    for cells in COARSE:
        try:
            case = load_case(draft, registry=registry)
            own = case.directions.spacing
            if cells > 1.0 and least_spacing(made.building, ROUTES, own) > own:
                continue
            directions = case.directions.model_copy(update={"spacing": cells * own})
            case = case.model_copy(update={"directions": directions})
            scene = make_shared_scene(case, None if is_changed else made.building)
            Simulation(case, shared_scene=scene, will_run=False)
        except EvacError as error:
            fault = str(error).replace(str(draft.resolve()), str(made.folder))
        else:
            return ""
    return fault


def _draw(made: Imported, folder: Path, *, are_named: bool) -> None:
    """Draw every level, with numbered openings if the file names them, or there is no exit."""
    from evac.pictures.annotated import Mark, draw_levels

    offered = () if made.building.exits and not are_named else made.openings[:MOST_OPENINGS]
    index = {level.name: level.index for level in made.building.levels}
    marks = [
        Mark(f"{one.number}: {one.width:.2f} m", index[one.level], one.segment) for one in offered if one.level in index
    ]
    draw_levels(made.building, folder / PICTURE, made.findings, marks, ", ".join(file.name for file in made.files))
