"""Commands that read a result: evac export, evac map, evac render, evac replay, evac report, evac compare."""

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from evac.base.errors import ResultError, counted
from evac.cli import inputs
from evac.cli.screen import STYLES, note, say, show_table, show_warnings
from evac.cli.studies import study_of
from evac.folder.files import FILM_NAME, PICTURE_NAME, REPLAY_NAME, REPORT_NAME, SUMMARY_NAME

if TYPE_CHECKING:
    from evac.study.study import Study


def declare_export(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `evac export`."""
    inputs.declare_result(parser)
    what = "vtk (default), jupedsim, csv, parquet, geojson, or from a plugin"
    parser.add_argument("--to", default="vtk", metavar="FORMAT", help=what)
    what = "file, or folder for formats with several files (default: RESULT/export/..., for vtk RESULT)"
    parser.add_argument("--out", type=Path, metavar="PATH", help=what)
    inputs.declare_set(parser, "parameters of the exporter", "NAME=VALUE")
    inputs.declare_plugin(parser)


def execute_export(arguments: argparse.Namespace) -> int:
    """Write a recorded run in the format of another program.

    Also works during a run and after a run was killed. Formats are plugins: `evac plugins` lists them.
    """
    from evac.contract.registry import Registry, built_in
    from evac.export.exporter import export

    registry = Registry(arguments.plugins, builtins=built_in("exporter"))
    exporter = registry.get("exporter", arguments.to)(**inputs.values_of("--set", arguments.set))
    trajectory = inputs.trajectory_of(arguments)
    for path in export(trajectory, exporter, arguments.out):
        print(path)
    if len(trajectory):
        note(f"{counted(len(trajectory), 'frame')} up to {trajectory.time[-1]:.2f} s")
    return 0


def declare_map(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `evac map`."""
    inputs.declare_result(parser)
    what = "density, max_density, speed, flow, waiting, time_to_clear, contact_pressure, usage (default: all)"
    parser.add_argument("--of", metavar="MAP,...", default="all", help=what)
    parser.add_argument("--level", metavar="NAME", action="append", help="only this level (may be repeated)")
    parser.add_argument("--from", dest="start", type=float, metavar="S", help="evaluate from this time on [s]")
    parser.add_argument("--to", dest="end", type=float, metavar="S", help="evaluate up to this time [s]")
    parser.add_argument("--spacing", type=float, metavar="M", help="width of the cells of the grid [m] (default: 0.2)")
    parser.add_argument("--kernel", type=float, metavar="M", help="radius of the Gaussian kernel [m] (default: 0.7)")
    inputs.declare_service(parser)
    what = "folder, or file for a single map: .png, .jpg, .svg or .pdf (default: RESULT/map_NAME.png)"
    parser.add_argument("--out", type=Path, metavar="PATH", help=what)


def execute_map(arguments: argparse.Namespace) -> int:
    """Draw maps of a run: density, speed, flow, waiting, time to clear, contact pressure, usage.

    Each map is a picture with the plans of all storeys. Also works during a run and after a run was killed.
    """
    from evac.analysis.maps import KERNEL_RADIUS, SPACING, level_maps

    quantities = inputs.maps_of("--of", arguments.of)
    trajectory = inputs.trajectory_of(arguments)
    maps = level_maps(
        trajectory,
        arguments.level,
        spacing=SPACING if arguments.spacing is None else arguments.spacing,
        kernel_radius=KERNEL_RADIUS if arguments.kernel is None else arguments.kernel,
        start=arguments.start,
        end=arguments.end,
    )
    from evac.pictures.map_pictures import FORMATS, write_maps

    out = arguments.out or trajectory.path.parent
    if out.suffix and not out.is_dir() and (out.suffix.lower() not in FORMATS or len(quantities) > 1):
        advice = "several maps need a folder" if len(quantities) > 1 else f"use {', '.join(FORMATS)}, or a folder"
        raise ResultError(f"{out}: cannot draw to this file; {advice}")
    for path in write_maps(trajectory, maps, quantities, out, arguments.level, arguments.service):
        print(path)
    return 0


PICTURE_SIZE, FILM_SIZE = (1600, 1200), (960, 720)  #: Width and height of pictures and of films [pixels].


def declare_render(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `evac render`."""
    inputs.declare_result(parser)
    what = "file to write: picture (.png, .jpg) or film (.gif, .mp4) (default: picture.png and film.gif in RESULT)"
    parser.add_argument("--out", type=Path, metavar="FILE", nargs="+", help=what)
    what = "oblique view, or view from above (default: 3d)"
    parser.add_argument("--view", choices=("3d", "plan"), default="3d", help=what)
    parser.add_argument("--level", metavar="NAME", action="append", help="only this level (may be repeated)")
    shown = ("group", "speed", "density", "contact_force", "waiting", "dose", "extinction", "visibility")
    what = f"what the colours of people show: {', '.join(shown)} (default: group)"
    parser.add_argument("--colour-by", metavar="QUANTITY", choices=shown, default="group", help=what)
    inputs.declare_service(parser)
    parser.add_argument("--time", type=float, metavar="S", help="time of the picture [s] (default: half of the run)")
    parser.add_argument("--fps", type=float, default=10.0, metavar="N", help="frames per second (default: 10)")
    parser.add_argument("--speed", type=float, default=5.0, metavar="N", help="speed-up of the film (default: 5)")
    what = "width and height in pixels (default: picture 1600 1200, film 960 720)"
    parser.add_argument("--size", type=int, nargs=2, metavar=("W", "H"), help=what)
    camera = parser.add_argument_group("camera of the 3d view")
    what = "direction of the camera, counterclockwise from x (default: -70)"
    camera.add_argument("--azimuth", type=float, default=-70.0, metavar="DEG", help=what)
    camera.add_argument("--elevation", type=float, metavar="DEG", help="angle of the view above the horizontal")
    camera.add_argument("--stretch", type=float, metavar="N", help="factor for heights (default: shows all storeys)")
    camera.add_argument("--zoom", type=float, default=1.0, metavar="N", help="magnification (default: 1)")


def execute_render(arguments: argparse.Namespace) -> int:
    """Draw a picture and a film of a run, off screen.

    Also works during a run and after a run was killed.
    """
    from evac.pictures.palette import LEGEND_GROUPS
    from evac.pictures.render import FILMS, Renderer, number_of_pictures, render_animation, render_picture
    from evac.pictures.view import Camera

    camera = Camera(arguments.azimuth, arguments.elevation, arguments.stretch, arguments.zoom)
    trajectory = inputs.trajectory_of(arguments)
    number_of_pictures(trajectory, arguments.fps, arguments.speed)  # refused before anything is drawn
    groups = len(trajectory.groups)
    if arguments.colour_by == "group" and groups > LEGEND_GROUPS:
        show_warnings([f"no legend, because {groups} groups are too many for one; try --colour-by speed"])
    for path in arguments.out or [trajectory.path.parent / name for name in (PICTURE_NAME, FILM_NAME)]:
        print(f"drawing {path}", file=sys.stderr, flush=True)
        is_film = path.suffix in FILMS
        size = tuple(arguments.size) if arguments.size else FILM_SIZE if is_film else PICTURE_SIZE
        colours = arguments.colour_by, arguments.service
        renderer = Renderer(trajectory, size, arguments.view, camera, arguments.level, *colours)
        if is_film:
            render_animation(renderer, path, arguments.fps, arguments.speed)
        else:
            render_picture(renderer, path, arguments.time)
    return 0


def declare_replay(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `evac replay`."""
    inputs.declare_result(parser)
    parser.add_argument("--out", type=Path, metavar="FILE", help="the page (default: replay.html in RESULT)")
    what = "time between two states [s] (default: those recorded, fewer in large runs)"
    parser.add_argument("--every", type=float, metavar="S", help=what)


def execute_replay(arguments: argparse.Namespace) -> int:
    """Write the replay of a run, a page for the browser.

    Every run writes replay.html unless output.replay is false. This command writes it from a recorded trajectory, also
    of a killed run, to another place or with fewer states.
    """
    from evac.replay.writer import replay_trajectory

    trajectory = inputs.trajectory_of(arguments)
    path = arguments.out or trajectory.path.parent / REPLAY_NAME
    frames = replay_trajectory(trajectory, path, arguments.every)
    print(f"{frames} states up to {trajectory.time[-1]:.2f} s, {path.stat().st_size / 1000:.0f} kB in {path}")
    return 0


def declare_report(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `evac report`."""
    parser.add_argument("result", type=Path, metavar="RESULT", help="result folder of a run or of a study")
    parser.add_argument("--out", type=Path, metavar="FILE", help="file to write (default: RESULT/report.html)")
    what = "also write bundle.zip beside the report, with which somebody else can repeat the run"
    parser.add_argument("--bundle", action="store_true", help=what)
    for name, what in {
        "project": "name of the project",
        "author": "author of the analysis",
        "reviewer": "reviewer of the analysis",
        "date": "date of the report",
    }.items():
        parser.add_argument(f"--{name}", metavar="TEXT", help=what)
    what = "density above which a place counts as congested [1/m2] (default: 4)"
    parser.add_argument("--congestion-density", type=float, metavar="N", help=what)
    what = "total duration above which a place counts as congested [s] (default: a tenth of the evacuation time)"
    parser.add_argument("--congestion-time", type=float, metavar="S", help=what)
    what = "maps to draw, as for `evac map`, or all, or none (default: six of them)"
    parser.add_argument("--maps", metavar="MAP,...", help=what)
    inputs.declare_service(parser)
    what = "result folder of a run of the study, whose plans, congestion and maps are shown (may be repeated)"
    parser.add_argument("--run", dest="runs", type=Path, metavar="RESULT", action="append", default=[], help=what)


def execute_report(arguments: argparse.Namespace) -> int:
    """Write the report of a run or a study, one HTML file for printing.

    It contains the building and its plans, occupants and assumptions, the model with its parameters and versions, the
    verification results, egress curve and times, congestion, maps, warnings and limits of use, and a checklist for the
    documentation. Fields not filled in by options are left empty.
    """
    from evac.analysis.congestion import DENSITY
    from evac.folder.resultfolder import check_result, find_result
    from evac.report.of_run import BUNDLE_NAME, run_report, write_bundle
    from evac.report.pages import Labels, write_page
    from evac.report.sections import MAPS, PlaceSettings
    from evac.report.study import is_study, study_report
    from evac.results.reading import read_results

    folder = find_result(arguments.result)
    check_result(folder)
    if not folder.is_dir():
        raise ResultError(f"{folder}: no such folder; give the result folder of a run or a study")
    labels = Labels(arguments.project, arguments.author, arguments.reviewer, arguments.date)
    density = DENSITY if arguments.congestion_density is None else arguments.congestion_density
    maps = (
        MAPS if arguments.maps is None else () if arguments.maps == "none" else inputs.maps_of("--maps", arguments.maps)
    )
    places = PlaceSettings(density, arguments.congestion_time, maps, arguments.service)
    if arguments.bundle and is_study(folder):
        raise ResultError(f"{folder}: --bundle applies to the folder of a run, but this is that of a study; remove it")
    if is_study(folder):
        text = study_report(folder, arguments.runs, labels, places)
    elif arguments.runs:
        raise ResultError(f"{folder}: --run applies to the folder of a study, but this is that of a run; remove it")
    else:
        text = run_report(folder, labels, places)
    out = arguments.out or folder / REPORT_NAME
    write_page(text, out)
    print(out)
    if arguments.bundle:
        bundle = out.with_name(BUNDLE_NAME)
        write_bundle(read_results(folder), text, bundle)
        print(bundle)
    return 0


def declare_compare(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `evac compare`."""
    what = "folders of runs or studies; with --runs also cases, as for `evac run`"
    parser.add_argument("designs", metavar="RESULT", nargs="+", help=what)
    parser.add_argument("--out", type=Path, metavar="FILE", help="page to write, such as compare.html")
    what = "make so many runs of each CASE, all from the seed of the first one, into ./CASE-runs"
    parser.add_argument("--runs", type=inputs.positive, metavar="N", help=what)


def execute_compare(arguments: argparse.Namespace) -> int:
    """Compare designs by runs with the same seeds: results of runs, studies, the points of a sweep, or cases.

    `evac compare CASE CASE --runs N` makes the runs first, as `evac repeat` does, with maps if a page is written.
    Prints the verdict of each design, and the differences from the first design with their 95 % intervals; --out
    writes them with curves and maps of differences to one page. Each point of a sweep is a design.
    """
    from evac.report.comparison import compare
    from evac.report.pages import fixed, write_page

    comparison = compare(*_designs(arguments))
    first, *others = comparison.designs
    for design in comparison.designs:
        say(f"{design.label}: {design.verdict['text']}", style=STYLES[design.verdict["status"]])
    for design in others:
        own = [change for change in comparison.differences if change.design == design.label]
        rows = []
        for change in own:
            times = (fixed(time, 2) for time in (change.before, change.after, change.change.value))
            rows.append((change.measure, *times, change.change.bounds(), change.verdict))
        columns = ("measure [s]", "first", "design", "difference", "95 % interval", "verdict")
        show_table(f"{design.label}, compared with {first.label}", columns, rows)
        for remark in dict.fromkeys(change.change.note for change in own if change.change.note):
            note(f"evac: {remark}")
    if arguments.out is not None:
        write_page(comparison.page(), arguments.out)
        print(arguments.out)
    return 0


def _designs(arguments: argparse.Namespace) -> "Iterator[Path | Study]":
    """Yield the results, and with --runs the studies of the cases, whose seeds are those of the first one."""
    from evac.case.loading import load_case
    from evac.folder.resultfolder import check_result, find_result

    seed, folders = list[str](), set[Path]()
    for name in arguments.designs:
        path = find_result(Path(name))
        if arguments.runs is None or (path / SUMMARY_NAME).is_file():
            check_result(path)
            yield path
            continue
        case = inputs.with_plugin_files(load_case(name, seed))
        seed, folder = [f"simulation.seed={case.simulation.seed}"], inputs.default_folder(case, "runs")
        if folder in folders:
            folder = Path(f"{folder}-{len(folders) + 1}")
        folders.add(folder)
        yield study_of(case, arguments.runs, folder, bool(arguments.out))
