"""evac compare: compare designs by runs with the same seeds: results of runs, studies, or the points of a sweep.

Prints the differences from the first design with their 95 % intervals; --out writes them with curves and maps of
differences to one page. Each point of a sweep is a design.
"""

import argparse
from pathlib import Path

from evac.cli.screen import show_table
from evac.cli.streams import note


def declare(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("designs", type=Path, metavar="RESULT", nargs="+", help="folders of runs or studies")
    parser.add_argument("--out", type=Path, metavar="FILE", help="page to write, such as compare.html")


def execute(arguments: argparse.Namespace) -> int:
    """Show the differences, and write the page if wanted."""
    from evac.folder.resultfolder import check_result, find_result
    from evac.report.comparison import compare
    from evac.report.pages import fixed, write_page

    folders = [find_result(path) for path in arguments.designs]
    for folder in folders:
        check_result(folder)
    found = compare(*folders)
    first, *others = found.designs
    for design in others:
        own = [one for one in found.differences if one.design == design.label]
        rows = []
        for one in own:
            times = (fixed(time, 2) for time in (one.before, one.after, one.change.value))
            rows.append((one.measure, *times, one.change.bounds(), one.verdict))
        columns = ("measure [s]", "first", "design", "difference", "95 % interval", "verdict")
        show_table(f"{design.label}, compared with {first.label}", columns, rows)
        for remark in dict.fromkeys(one.change.note for one in own if one.change.note):
            note(f"evac: {remark}")
    if arguments.out is not None:
        write_page(found.page(), arguments.out)
        print(arguments.out)
    return 0
