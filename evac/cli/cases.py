"""Commands that list, make and edit cases: evac list, evac new, evac import, evac edit."""

import argparse
import math
import tomllib
from collections import Counter
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from evac.base.display import Display
from evac.base.errors import ScenarioError, counted
from evac.cli.inputs import declare_plugin, declare_set, values_of
from evac.cli.main import BAD_INPUT
from evac.cli.screen import note, say, show_facts, show_table, show_warnings
from evac.contract.hooks import BASES

if TYPE_CHECKING:
    from evac.importing import Imported


def declare_list(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `evac list`."""
    declare_plugin(parser)


def execute_list(arguments: argparse.Namespace) -> int:
    """List the cases shipped with evac and with installed plugins."""
    from evac.contract.registry import Registry, built_in

    cases = Registry(arguments.plugins, builtins=built_in("case")).cases
    show_table("Cases", ("name", "title"), [(name, title_of(path)) for name, path in cases.items()])
    for number, parent in enumerate(dict.fromkeys(path.parent for path in cases.values())):
        show_facts({"" if number else "folders in": parent})
    return 0


def title_of(folder: Path) -> str:
    """Return the title of the case in a folder."""
    path = folder / "case.toml"
    try:
        return str(tomllib.loads(path.read_text(encoding="utf-8")).get("title", ""))
    except (OSError, ValueError) as error:
        raise ScenarioError(f"{path}: cannot be read: {error}; correct the file or remove its plugin") from error


def declare_new(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `evac new`."""
    parser.add_argument("folder", metavar="FOLDER", type=Path, help="new folder for case.toml and its plan")
    _declare_basis(parser)


def _declare_basis(parser: argparse.ArgumentParser) -> None:
    what = "; ".join(f"{name}: {meaning}" for name, meaning in BASES.items())
    parser.add_argument("--basis", choices=BASES, default="measured", help=f"{what} (default: measured)")


def execute_new(arguments: argparse.Namespace) -> int:
    """Write an example case with comments, a building of two storeys that can be run and changed."""
    from evac.importing.documents import write_example

    folder: Path = arguments.folder
    write_example(folder, arguments.basis)
    print(f"{folder / 'case.toml'} and house.plan.toml written; next: evac run {folder}")
    return 0


def declare_import(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `evac import`."""
    parser.add_argument("files", metavar="FILE", nargs="+", type=Path, help="file of the building, or of each storey")
    parser.add_argument("--out", type=Path, required=True, metavar="FOLDER", help="new folder for the case")
    what = "numbers of the openings that become exits (may be repeated)"
    parser.add_argument("--exit", dest="exits", action="append", default=[], metavar="N,N", help=what)
    many = parser.add_mutually_exclusive_group()
    many.add_argument("--people", type=int, metavar="N", help="number of people, divided among the rooms by area")
    many.add_argument("--density", type=float, metavar="D", help="people per square metre of every room (default: 0.1)")
    parser.add_argument("--z", metavar="Z,Z", help="heights of the storeys of several files [m] (default: 3 m apart)")
    parser.add_argument("--plan", metavar="N,N", help="numbers of the plans of a drawing to import (default: all)")
    what = "parameters of the importer, see `evac plugins NAME`, and keys of [building], such as scale"
    declare_set(parser, what, option="--option")
    what = "spacing of the grids of directions [m] (default: 0.1, or as much as wide buildings need)"
    parser.add_argument("--spacing", type=float, metavar="S", help=what)
    what = "write a case even if parts of the building are missing; each of its runs has a quality warning"
    parser.add_argument("--partial", action="store_true", help=what)
    _declare_basis(parser)
    declare_plugin(parser)


def execute_import(arguments: argparse.Namespace) -> int:
    """Create a case from building files.

    Writes to --out the plan (building.plan.toml, or building.msh of other surfaces), a case.toml with preliminary
    people, a picture of every level (levels.png) and a report on everything found, assumed, repaired or left out
    (report.md). Several files are the storeys of one building, from the lowest up. If the files name no exit, the outer
    openings are listed and numbered, doorways and the widest first; choose exits among them with --exit. If a storey, a
    stair or more than 2 % of the ground is missing or has no way out, no case is written, and the exit status is 2,
    unless --partial is given.
    """
    for key, least in (("people", 1), ("density", 0.0), ("spacing", 0.001)):
        value = getattr(arguments, key)
        if value is not None and not value >= least:
            raise ScenarioError(f"--{key} must be at least {least:g}, got {value:g}")
    options = values_of("--option", arguments.option)
    if arguments.plan is not None:
        options["plan"] = arguments.plan
    exits = [int(number) for number in _numbers("--exit", ",".join(arguments.exits), whole=True)]
    z = None if arguments.z is None else _numbers("--z", arguments.z)

    with Display(has_lines=False) as display:
        display.phase("reading the building")
        from evac.contract.registry import Registry
        from evac.importing import import_building

        made = import_building(
            arguments.files,
            arguments.out,
            exits=exits,
            people=arguments.people,
            density=arguments.density,
            z=z,
            options=options,
            spacing=arguments.spacing,
            partial=arguments.partial,
            basis=arguments.basis,
            registry=Registry(arguments.plugins),
        )
    _show(made)

    return 0 if made.is_accepted else BAD_INPUT


def _numbers(what: str, text: str, whole: bool = False) -> list[float]:
    try:
        numbers = [float(word) for word in text.split(",") if word.strip()]
        if all(math.isfinite(word) and not (whole and word % 1.0) for word in numbers):
            return numbers
    except ValueError:
        pass
    raise ScenarioError(f"{what} {text}: give {'whole ' if whole else ''}numbers separated by commas, such as 1,3")


def _show(made: "Imported") -> None:
    """Show what is missing, a summary, the openings if there is no exit, the warnings, and the next command."""
    from evac.building.model.findings import FINDING_KINDS, and_more, grouped
    from evac.importing.documents import MOST_OPENINGS, opening_row
    from evac.importing.importing import PICTURE, PLAN, REPORT

    building = made.building
    floors = [own for _, levels in building.storeys if (own := [level for level in levels if level.kind == "floor"])]
    # A storey of two heights has two floors; floors without a storey are named by their height alone.
    named = {own[0].name.removeprefix("floor ").partition(" z=")[0] for own in floors}
    area = sum(level.polygon.area for own in floors for level in own)
    full = [room.number for room in made.rooms if room.number]
    count = Counter(finding.kind for finding in made.findings)
    for missing in made.missing:
        say(f"incomplete: {missing}")
    show_facts(
        {
            "imported": ", ".join(str(file) for file in made.files),
            "storeys": f"{len(named)}, {area:.1f} m2",
            "stairs": ", ".join(building.stairs) or "none",
            "exits": ", ".join(way.name for way in building.exits) or "none",
            "people": f"{sum(full)} in {counted(len(full), 'room')}",
            "findings": ", ".join(f"{count[kind]} {kind}" for kind in FINDING_KINDS if count[kind]) or "none",
            **({"case": made.folder} if made.is_accepted else {}),
            "picture": made.folder / PICTURE,
            "report": made.folder / REPORT,
        }
    )
    if not building.exits and made.openings:
        shown = min(len(made.openings), MOST_OPENINGS)
        more = f", the first {shown} of {len(made.openings)} (all in report.md)" if shown < len(made.openings) else ""
        rows = [opening_row(made, k) for k in range(shown)]
        show_table(f"Openings{more}", ("number", "level", "width [m]", "from", "to", "z [m]"), rows)
    # Of many alike, only the numbers are shown above.
    told = [
        finding
        for finding in made.findings
        if finding.kind == "warning" or (finding.kind == "left out" and finding.number == 1)
    ]
    show_warnings([f"{own[0]}{and_more(own)}" for own in grouped(told)])
    if not made.is_accepted:
        plan = made.folder / PLAN
        add = f"add what is missing to {plan} and import again, or import" if plan.is_file() else "import"
        show_warnings([f"no case has been written, since the building is incomplete; {add} what there is by --partial"])
    elif not building.exits:
        show_warnings(["the building has no exit yet: choose openings with --exit, such as --exit 1"])
    elif made.fault:
        show_warnings([f"the case cannot be run yet: {made.fault}"])
    else:
        show_facts({"next": f"evac run {made.folder}"})


def declare_edit(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `evac edit`."""
    what = "a case.toml, a folder that contains one, or a plan file (.plan.toml)"
    what += "; without it, the page asks what to begin with, and makes a case in the current folder"
    parser.add_argument("case", metavar="CASE|PLAN", type=Path, nargs="?", help=what)
    parser.add_argument("--out", type=Path, metavar="DIR", help="result folder of runs (default: ./CASE-result)")
    declare_plugin(parser)
    parser.add_argument("--no-browser", action="store_true", help="print the address of the page, and open no browser")


def execute_edit(arguments: argparse.Namespace) -> int:
    """Draw a plan in the browser, storey by storey, choose its people, see what evac check says, and run it.

    The page is served on this machine alone, at an address that nobody else knows. Saving changes only the touched
    lines of the file; comments stay. What is not saved is kept in a journal beside the file (.unsaved), and found again
    when the plan is opened. Ends with Ctrl-C, or two minutes after the page was closed.
    """
    from evac.editor import Server, Session

    def tell(server: Server) -> None:
        plan = {} if server.session is None else {"plan": server.session.file}
        show_facts({**plan, "address": server.address})

    plugins = [*map(Path, arguments.plugins)]
    session = None if arguments.case is None else Session(arguments.case, arguments.out, plugins)
    with Server(session, told=tell) as server:
        tell(server)
        note("Ctrl-C ends; so does closing the page, after some time")
        with suppress(KeyboardInterrupt):
            server.serve(not arguments.no_browser)
    if server.session is not None and server.session.journal.exists():
        say(f"not saved, kept for the next time: {server.session.journal}")
    return 0
