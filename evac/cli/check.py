"""Commands that read a case or a building without running it: evac check, evac explain, evac conditions."""

import argparse
import itertools
import json
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from evac.base.display import Display
from evac.base.errors import BuildingError, EvacError, ResultError, ScenarioError, counted, in_order
from evac.cli.inputs import case_of, case_to_run, declare_case
from evac.cli.screen import note, show_facts, show_table, show_warnings
from evac.contract.hooks import DEFAULT_FIRE
from evac.folder import files
from evac.folder.resultfolder import CASE_NAME, find_result, is_within

if TYPE_CHECKING:
    from evac.building.model.building import Building, Exit, Level, Portal
    from evac.building.model.findings import Finding
    from evac.case.case import Case
    from evac.simulation.simulation import Simulation


#: Ending of plan files, which are TOML as cases are.
PLAN = ".plan.toml"
#: Beginnings of the names of files of a run that a command writes again from its trajectory.
WRITTEN_AGAIN = {"replay.html": "replay", "report.html": "report", "map_": "map"}


def declare_check(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `evac check`."""
    declare_case(parser, "CASE|BUILDING|RESULT")
    parser.add_argument("--verbose", action="store_true", help="show the portals within stairs as well")
    what = "print all errors and findings as JSON: number, kind, storey, level, place, item, text and remedy"
    parser.add_argument("--json", action="store_true", help=what)
    what = "draw every level with all names and with warnings marked at their places (.png, .svg, .pdf)"
    parser.add_argument("--picture", type=Path, metavar="FILE", help=what)


def execute_check(arguments: argparse.Namespace) -> int:
    """Read a case or a building file and show levels, exits, areas and warnings.

    A building file can be given instead of a case. Of a result, a study or a checkpoint, digests, trajectory, tables
    and rows are verified; what is damaged or missing, and what can still be used, is named. Plugin files named in a
    case are listed but not executed, so names that they provide cannot be checked, unless --plugin FILE executes them.
    """
    path = Path(arguments.case)
    result = find_result(path)
    if is_result(result) or path.name == files.CHECKPOINT_NAME:
        return check_result(result)
    is_building = path.is_file() and (path.suffix != ".toml" or path.name.lower().endswith(PLAN))
    return _check_building(arguments, path) if is_building else _check_case(arguments, path)


def is_result(folder: Path) -> bool:
    """Return whether a folder is that of a run or a study, also without its manifest."""
    names = () if (folder / CASE_NAME).exists() else (files.TRAJECTORY_NAME, files.STUDY_NAME, files.SUMMARY_NAME)
    return folder.is_dir() and bool(
        files.read_manifest(folder).state or any((folder / name).exists() for name in names)
    )


def _check_building(arguments: argparse.Namespace, path: Path) -> int:
    """Show what is in a building file."""
    from evac.building.model.findings import refusal
    from evac.building.surface.build import check_exits
    from evac.contract.registry import Registry
    from evac.simulation.assembly import read_building

    if arguments.set or arguments.seed is not None:
        raise ScenarioError(f"{path}: --set and --seed apply to a case, not to a building file; remove them")
    with _telling(arguments) as told:
        building = read_building(path, registry=Registry(arguments.plugins), need_exit=False)
        told += [*building.findings, *check_exits(building)]
        _draw(arguments.picture, building, told, path.name)
        if not arguments.json:
            show_building(building, arguments.verbose)
            show_findings(told)
            # Last, so that a user who has to add an exit sees the levels first.
            if not building.exits:
                raise refusal(path, told[-1:])
    return print_findings(path, told) if arguments.json else 0


def _check_case(arguments: argparse.Namespace, path: Path) -> int:
    """Show what is in a case."""
    from evac.building.model.findings import findings_of
    from evac.simulation.assembly import make_building
    from evac.simulation.simulation import Simulation

    with _telling(arguments) as told:
        case = case_of(arguments)
        if not arguments.json:
            show_facts({"case": case.title or case.folder.name, "file": case.source})
        if case.unloaded_files:
            told.append(_not_checked(case))
            if not arguments.json:
                _show_unchecked(case, arguments.verbose)
                show_warnings([told[0].text])
            return print_findings(path, told) if arguments.json else 0
        try:
            with Display(has_lines=False) as display:
                simulation = Simulation(case, will_run=False, compiling=display.compiling)
        except BuildingError:
            raise
        except EvacError as error:
            # The building helps to understand errors about people or directions.
            building = make_building(case)
            told += [*findings_of(error, case.source), *building.findings]
            if not arguments.json:
                show_building(building, arguments.verbose)
                show_findings(told)
            _draw(arguments.picture, building, told, case.title)
            raise
        told += simulation.findings
        if not arguments.json:
            show_building(simulation.building, arguments.verbose)
            show_people(simulation)
            show_available(simulation)
            show_course(case)
            show_findings(told)
            show_warnings(simulation.warnings()[sum(finding.kind == "warning" for finding in told) :])
        _draw(arguments.picture, simulation.building, told, case.title)
    return print_findings(path, told) if arguments.json else 0


@contextmanager
def _telling(arguments: argparse.Namespace) -> "Iterator[list[Finding]]":
    """Yield a list of findings, to which errors are added, shown, drawn, and raised unless JSON is asked for."""
    from evac.building.model.findings import findings_of

    told: list[Finding] = []
    try:
        yield told
    except EvacError as error:
        path = Path(arguments.case)
        if all(finding.kind != "error" for finding in told):
            told[:0] = findings_of(error, path)
            if isinstance(error, BuildingError) and error.findings and not arguments.json:
                show_findings(told)
            if isinstance(error, BuildingError) and error.building is not None:
                _draw(arguments.picture, error.building, told, path.name)
        if not arguments.json:
            raise


def show_findings(findings: "Sequence[Finding]") -> None:
    """Show findings, repeats together, with the numbers that they have in pictures and as JSON."""
    from evac.building.model.findings import and_more, listed

    rows = [
        (number, own[0].kind, own[0].item or "", own[0].where, f"{own[0].text}{own[0].advice}{and_more(own)}")
        for number, own in listed(findings)
    ]
    show_table("Findings", ("number", "kind", "item", "place", "description"), rows)


def print_findings(path: Path, findings: "Sequence[Finding]") -> int:
    """Print findings as JSON, repeats together, with the numbers that they have in pictures; return 2 for errors."""
    from evac.building.model.findings import numbered_rows

    errors, rows = sum(finding.kind == "error" for finding in findings), numbered_rows(findings)
    print(json.dumps({"file": str(path), "errors": errors, "findings": rows}, indent=1, ensure_ascii=False))
    return 2 if errors else 0


def check_result(path: Path) -> int:
    """Verify a result, a study or a checkpoint; tell which files are damaged or missing, and what can still be used."""
    folder, manifest = path if path.is_dir() else path.parent, files.read_manifest(path)
    checks = _checks_of(path, manifest) if path.is_dir() else {}
    if (folder / files.CHECKPOINT_NAME).exists() or folder != path:
        checks[files.CHECKPOINT_NAME] = partial(_check_checkpoint, folder / files.CHECKPOINT_NAME)
    rows, is_damaged = [], False
    for name, check in checks.items():
        try:
            rows.append((name, f"whole{check()}"))
        except EvacError as error:
            is_missing = name in (files.MANIFEST_NAME, *manifest.files) and not (folder / name).exists()
            rows.append((name, f"{'missing' if is_missing else 'damaged'}: {error}"))
            is_damaged = True
    show_table("Files of the result", ("file", "state"), rows)
    return 2 if is_damaged else 0


def _checks_of(folder: Path, manifest: files.Manifest) -> dict[str, Callable[[], str]]:
    """Return the checks of a folder by what they verify; each returns more about what is whole, or raises an error."""
    is_complete = manifest.state == files.COMPLETE

    def has(name: str) -> bool:
        return (is_complete and name in manifest.files) or (folder / name).exists()

    checks: dict[str, Callable[[], str]] = {files.MANIFEST_NAME: partial(_check_manifest, folder, manifest)}
    for name, digest in manifest.files.items():
        is_checked = name != files.CHECKPOINT_NAME and is_within(name) and not name.startswith(files.TEMPORARY)
        if digest and is_checked and has(name):
            checks[name] = partial(_check_digest, folder, name, digest)
    if has(files.TRAJECTORY_NAME):
        checks[files.TRAJECTORY_NAME] = partial(_check_trajectory, folder / files.TRAJECTORY_NAME, is_complete)
    if has(files.STUDY_NAME):
        checks["runs of the study"] = partial(_check_study, folder, is_complete)
    elif is_complete or has(files.SUMMARY_NAME):
        checks["files together"] = partial(_check_together, folder)
    return checks


def _check_manifest(folder: Path, manifest: files.Manifest) -> str:
    """Verify that a manifest is whole, and that it does not end before the folder of a run was published."""
    is_cut = manifest.state == files.RUNNING and folder.resolve().name == manifest.result
    if manifest.damaged or is_cut or not manifest.state:
        raise ResultError(
            f"{folder / files.MANIFEST_NAME}: files that it does not list are not compared with what was written, and "
            "evac neither removes nor replaces them; to have them listed, run the case again into another folder"
        )
    return ""


def _check_digest(folder: Path, name: str, digest: str) -> str:
    what = next((command for start, command in WRITTEN_AGAIN.items() if name.startswith(start)), "")
    remedy = f"evac {what} {folder} writes it again" if what else "run the case again"
    if (folder / files.STUDY_NAME).exists() and not what and name != files.STUDY_NAME:
        remedy = "the same command with --resume writes it again"
    if not (folder / name).exists():
        raise ResultError(f"{folder / name}: {remedy}")
    if files.digest_of_file(folder / name) != digest:
        raise ResultError(f"{folder / name}: has changed since it was written; {remedy}")
    return ""


def _check_trajectory(path: Path, is_complete: bool) -> str:
    from evac.trajectory.trajectory import read_trajectory

    trajectory = read_trajectory(path)
    end = f"complete up to {trajectory.time[-1]:.2f} s" if len(trajectory) else "without a frame"
    if is_complete and trajectory.dropped_bytes:
        raise ResultError(
            f"{path}: {end}, which evac replay, map and export can use; {trajectory.dropped_bytes} bytes after it are "
            "not valid; run the case again"
        )
    return f", {end}"


def _check_checkpoint(path: Path) -> str:
    """Verify a checkpoint, and what the files of its folder contained when it was written."""
    from evac.simulation.checkpoints import checkpoint_at

    checkpoint = checkpoint_at(path)
    for name, (length, digest) in checkpoint.files.items():
        if files.RunningDigest().extend(path.parent / name, length) != digest:
            raise ResultError(
                f"{path}: cannot be resumed, because {name} has changed before byte {length}; run the case again"
            )
    return f", at {checkpoint.header.time:.2f} s"


def _check_study(path: Path, is_complete: bool) -> str:
    """Verify the rows of a study, and their number by its summary."""
    from evac.folder.textfiles import read_json
    from evac.study.study import read_study

    study = read_study(path)
    runs, lost = study.stored_runs, study.dropped_bytes
    if lost:
        raise ResultError(f"{path}: {runs} runs are whole, {lost} bytes after them are not; --resume makes these again")
    if is_complete and (written := read_json(path / files.SUMMARY_NAME).get("runs")) != runs:
        raise ResultError(
            f"{path}: {runs} runs are there, but {files.SUMMARY_NAME} has {written}; --resume writes it again"
        )
    return f", {runs} runs"


def _check_together(path: Path) -> str:
    """Verify that summary, tables and trajectory are of one run and end at the same time."""
    from evac.results.ending import FAILED
    from evac.results.reading import read_results

    results = read_results(path)
    trajectory = results.trajectory
    if trajectory and results.ended != FAILED and trajectory.time[-1] < results.time:
        end = f"ends at {trajectory.time[-1]:.2f} s, the run at {results.time:.2f} s"
        raise ResultError(f"{trajectory.path}: {end}; run the case again")
    return ""


def _show_unchecked(case: "Case", is_verbose: bool) -> None:
    """Show the plugin files of a case, which are not executed, and its building, if that needs none of them."""
    from evac.case.loading import is_inside
    from evac.simulation.assembly import make_building

    rows = [
        (path, "yes" if is_inside(path, case.folder) else "only with --plugin: it is outside the case's folder")
        for path in case.unloaded_files
    ]
    show_table("Plugin files of the case, not executed", ("file", "executed by evac run"), rows)
    with suppress(BuildingError):
        building = make_building(case)
        show_building(building, is_verbose)
        show_findings(building.findings)


def _not_checked(case: "Case") -> "Finding":
    """Return a warning about what cannot be checked without the plugin files of a case."""
    from evac.building.model.findings import Finding
    from evac.case.overrides import dotted

    unchecked = ", ".join(dotted(key, {}) for key in case.unchecked) or "none"
    option = " ".join(f"--plugin {path}" for path in case.unloaded_files)
    what = (
        f"people, and keys that may need the plugin files ({unchecked}), are not checked; to check them, use {option}"
    )
    return Finding("warning", what)


def _draw(path: Path | None, building: "Building", findings: "Sequence[Finding]", title: str) -> None:
    """Draw the levels to `path`, unless it is None."""
    if path is not None:
        from evac.pictures.annotated import draw_levels

        draw_levels(building, path, findings, title=title)
        note(f"drawn: {path}")


def show_building(building: "Building", is_verbose: bool) -> None:
    """Show levels, portals, exits, doors, areas and stairs; portals within stairs only if verbose."""
    show_facts({"building": building.source, "walls": f"{len(building.walls)} segments"})

    def row_of(level: "Level") -> tuple[object, ...]:
        kind, why = ("ramp", "up to") if level.is_ramp else ("stair", "above")
        ratio = f"{kind} 1:{1.0 / math.tan(level.slope):.3g}, {why} building.ramp" if level.slope else "level"
        area, slope = round(level.polygon.area, 2), round(math.degrees(level.slope), 1)
        walls = int((building.wall_level == level.index).sum())
        return level.name, level.kind, _span(level.z_min, level.z_max), area, slope, ratio, walls

    title = "Levels" if is_verbose else "Levels (without the flights and landings of stairs)"
    columns = ("level", "kind", "z [m]", "plan [m2]", "slope [deg]", "walked as", "walls")
    show_table(title, columns, [row_of(level) for level in building.levels if is_verbose or level.stair is None])
    names = [level.title for level in building.levels]

    def state(link: "Portal | Exit") -> str:
        return "open" if building.is_open(link) else "closed"

    within = {levels for parts in building.stairs.values() for levels in itertools.permutations(parts, 2)}
    rows = [
        (p.name, round(p.width, 3), state(p)) for p in building.portals if is_verbose or tuple(p.levels) not in within
    ]
    which = "Portals" if is_verbose else "Portals (without those within a stair)"
    show_table(which, ("portal", "width [m]", ""), rows)
    exits = [(e.name, names[e.level], round(e.width, 3), state(e)) for e in in_order(building.exits)]
    show_table("Exits", ("exit", "level", "width [m]", ""), exits)
    doors = [(door.name, names[door.level], round(door.width, 3)) for door in in_order(building.doors)]
    show_table("Doors between rooms", ("door", "level", "clear width [m]"), doors)
    areas = [(area.name, names[area.level], round(area.polygon.area, 2)) for area in in_order(building.areas)]
    show_table("Areas", ("area", "level", "m2"), areas)
    places = [(p.name, p.kind, names[p.level], p.area or p.exit, p.use) for p in building.places]
    show_table("Places and lines", ("name", "kind", "level", "area or exit", ""), places)
    shaft_of = {stair: shaft for shaft, stairs in building.shafts.items() for stair in stairs}
    stairs = []
    for name, pieces in building.stairs.items():
        parts = [building.levels[index] for index in pieces]
        slope, ratio = row_of(max(parts, key=lambda level: level.slope))[4:6]
        heights = _span(min(level.z_min for level in parts), max(level.z_max for level in parts))
        number = sum(level.kind == "flight" for level in parts)
        stairs.append((name, shaft_of[name], heights, number, slope, ratio))
    show_table("Stairs", ("stair", "shaft", "z [m]", "flights", "steepest [deg]", "walked as"), stairs)


def show_available(simulation: "Simulation") -> None:
    """Show until when compartments are available, or at least, and by which criterion."""
    from evac.results.verdict import BY

    safety = simulation.safety
    if safety is not None:
        rows = [
            (compartment.name, f"at least {safety.until:g}" if math.isinf(time) else round(time, 1), BY.get(why))
            for compartment, (time, why) in zip(safety.compartments, safety.available, strict=True)
        ]
        show_table("Compartments", ("compartment", "available [s]", "criterion"), rows)


def show_people(simulation: "Simulation") -> None:
    """Show the groups with their start levels and their times to an exit."""
    import numpy as np

    population = simulation.population
    crowd = population.crowd
    is_here, lengths = crowd.level >= 0, np.zeros((len(crowd.level), 3))
    lengths[is_here] = simulation.fields.lengths_at(*crowd.ways(is_here))
    with np.errstate(divide="ignore", invalid="ignore"):
        # A length of 0 takes no time, even at speed 0.
        time = np.where(lengths > 0.0, lengths / crowd.speed, 0.0).sum(axis=1)
    rides = np.array([bool(route.lifts) for route in simulation.fields.routes])[crowd.route] & np.isinf(time)
    time[rides] = simulation.fields.travel_time_at(*crowd.ways(rides))
    names = [level.title for level in simulation.building.levels]
    rows = []
    for group in in_order(population.groups):
        inside = group.rows[crowd.level[group.rows] >= 0]
        on = {names[index]: None for index in np.unique(crowd.level[inside]).tolist()}
        levels = ", ".join(on) or "they arrive"
        goes = np.setdiff1d(inside, population.staying)
        unimpeded = f"{time[goes].min():.1f} to {time[goes].max():.1f}" if len(goes) else ""
        radius = _span(crowd.radius[group.rows].min(), crowd.radius[group.rows].max()) if len(group.rows) else ""
        rows.append((group.name, len(group.rows), levels, unimpeded, radius))
    columns = ("group", "people", "levels", "shortest time to an exit or place [s]", "radius [m]")
    refuges = {place.area for place in simulation.case.place if place.kind == "refuge"}
    is_left = np.array([route.area in refuges for route in simulation.fields.routes])[crowd.route] & (crowd.level >= 0)
    left = {group.name: int(is_left[group.rows].sum()) for group in in_order(population.groups)}
    only = ", ".join(f"{number} of {name!r}" for name, number in left.items() if number)
    others = f" but {only}, who can reach only a refuge" if only else ""
    narrow = counted(len(simulation.stopping), "place")
    reach = f"Some do not fit through {narrow} on their ways" if simulation.stopping else "All can reach an exit"
    show_table(f"People: {len(crowd.level)}. {reach}{others}.", columns, rows)


def show_course(case: "Case") -> None:
    """Show who arrives when and where, who stays, and the events."""
    from evac.base.toml import toml_value

    rows = []
    for group in in_order(case.people):
        came = group.arrive
        if came is not None:
            where = came.exit or came.portal or group.area or group.level
            if came.times is not None:
                when = f"{len(came.times)} people, {_span(min(came.times), max(came.times))} s"
            else:
                when = f"{came.rate:g} people per second, {_span(came.from_ or 0.0, came.to or 0.0)} s"
            rows.append((group.name, where, when))
        elif not group.leave:
            rows.append((group.name, group.area or group.level, "they do not leave"))
    show_table("People who arrive or stay", ("group", "place", ""), rows)
    events = [
        (
            event.name or "",
            f"{event.time:g} s" if event.when is None else toml_value(event.when.model_dump(exclude_defaults=True)),
            event.kind,
            event.target,
            "" if event.value is None else toml_value(event.value),
        )
        for event in case.events
    ]
    show_table("Events", ("event", "time or condition", "kind", "target", "value"), events)


def _span(low: float, high: float) -> str:
    return f"{low:z.2f}" if high - low < 0.005 else f"{low:z.2f} to {high:z.2f}"


def declare_explain(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `evac explain`."""
    declare_case(parser)


def execute_explain(arguments: argparse.Namespace) -> int:
    """Show which parts of the program a case needs, and why.

    The other parts are left out, which does not change the trajectories; `evac run --full` includes them. Plugin files
    of the case are executed, as by `evac run`, because forces and behaviours decide themselves whether they are needed.
    """
    case = case_to_run(arguments)
    from evac.cli.run import response_times
    from evac.simulation.simulation import Simulation

    with Display(has_lines=False) as display:
        simulation = Simulation(case, will_run=False, compiling=display.compiling)
    show_table(case.title or str(case.source), ("part", "in or out", "why"), simulation.plan)
    show_facts({"response times": response_times(simulation.population.crowd)})
    return 0


def declare_conditions(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `evac conditions`."""
    parser.add_argument("what", choices=("deck",), help="deck: lines for the input file of the fire simulation")
    declare_case(parser)
    what = f"source of conditions that will read the data (default: {DEFAULT_FIRE})"
    parser.add_argument("--source", default=DEFAULT_FIRE, metavar="NAME", help=what)


def execute_conditions(arguments: argparse.Namespace) -> int:
    """Print the output that a fire simulation must write for a case.

    `evac conditions deck CASE` prints the lines for the input file of FDS: slices at the heads of people on every
    level, and volumes on stairs, of the quantities that the case needs. The data need not exist yet. If the case has a
    table [[conditions]], its `shift` is taken into account.
    """
    from evac.case.schema import ConditionSettings
    from evac.conditions.exposure import heads_of, law_of, quantities_needed
    from evac.conditions.source import SourceScene
    from evac.simulation.assembly import make_building

    case = case_of(arguments)
    cls = case.registry.get("condition_source", arguments.source)
    tables = [table for table in case.conditions if table.source == cls.name] or [ConditionSettings(source=cls.name)]
    needed = quantities_needed(case, law_of(case))
    scene = SourceScene(make_building(case), case.folder, tables[0], heads_of(case), needed)
    lines = cls(**tables[0].parameters).deck(scene)
    print("\n".join(lines) or f"source {cls.name!r} needs no lines")
    return 0
