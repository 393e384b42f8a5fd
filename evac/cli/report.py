"""evac report: write the report of a run or a study, one HTML file for printing.

It contains the building and its plans, occupants and assumptions, the model with its parameters and versions, the
verification results, egress curve and times, congestion, maps, warnings and limits of use, and a checklist for the
documentation. Fields not filled in by options are left empty.
"""

import argparse
from pathlib import Path

from evac.cli.inputs import declare_service, maps_of


def declare(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
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
    declare_service(parser)
    what = "result folder of a run of the study, whose plans, congestion and maps are shown (may be repeated)"
    parser.add_argument("--run", dest="runs", type=Path, metavar="RESULT", action="append", default=[], help=what)


def execute(arguments: argparse.Namespace) -> int:
    """Write the report and print its path."""
    from evac.analysis.congestion import DENSITY
    from evac.base.errors import ResultError
    from evac.folder.files import REPORT_NAME
    from evac.folder.resultfolder import check_result, find_result
    from evac.report.bundle import BUNDLE_NAME, write_bundle
    from evac.report.of_run import run_report
    from evac.report.pages import Labels, write_page
    from evac.report.sections import MAPS, Places
    from evac.report.study import is_study, study_report
    from evac.results.reading import read_results

    folder = find_result(arguments.result)
    check_result(folder)
    if not folder.is_dir():
        raise ResultError(f"{folder}: no such folder; give the result folder of a run or a study")
    labels = Labels(arguments.project, arguments.author, arguments.reviewer, arguments.date)
    density = DENSITY if arguments.congestion_density is None else arguments.congestion_density
    maps = MAPS if arguments.maps is None else () if arguments.maps == "none" else maps_of("--maps", arguments.maps)
    places = Places(density, arguments.congestion_time, maps, arguments.service)
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
