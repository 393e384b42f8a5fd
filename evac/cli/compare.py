"""evac compare: compare designs by runs with the same seeds: results of runs, studies, or the points of a sweep.

Prints the differences from the first design with their 95 % intervals; --out writes them with curves and maps of
differences to one page. Each point of a sweep is a design.
"""

import argparse
import sys
from pathlib import Path

from evac.cli.screen import show_table


def declare(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("designs", type=Path, metavar="RESULT", nargs="+", help="folders of runs or studies")
    parser.add_argument("--out", type=Path, metavar="FILE", help="page to write, such as compare.html")


def execute(arguments: argparse.Namespace) -> int:
    """Show the differences, and write the page if wanted."""
    from evac.folder.resultfolder import check_result, find_result
    from evac.report.comparison import compare, interval
    from evac.report.pages import write_page

    folders = [find_result(path) for path in arguments.designs]
    for folder in folders:
        check_result(folder)
    found = compare(*folders)
    first, *others = found.designs
    for design in others:
        own = [one for one in found.differences if one.design == design.label]
        rows = [
            (one.measure, one.before, one.after, one.change.value, interval(one.change), one.verdict) for one in own
        ]
        columns = ("measure [s]", "first", "design", "change", "95 % interval", "verdict")
        show_table(f"{design.label}, compared with {first.label}", columns, rows)
        for note in dict.fromkeys(one.change.note for one in own if one.change.note):
            print(f"evac: {note}", file=sys.stderr)
    if arguments.out is not None:
        write_page(found.page(), arguments.out)
        print(arguments.out)
    return 0
