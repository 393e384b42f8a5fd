"""evac evidence: recompute tables, plots and pages on accuracy, stability, speed and validation."""

import argparse
from pathlib import Path

from evac.cli.streams import note
from evac.evidence import KINDS


def declare(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("kind", choices=KINDS, metavar="KIND", help=f"what to compute: {', '.join(KINDS)}")
    effort = parser.add_mutually_exclusive_group()
    effort.add_argument("--quick", action="store_true", help="fewer and smaller cases: seconds instead of minutes")
    effort.add_argument("--page-only", action="store_true", help="only write the page again from the files in DIR/KIND")
    what = "folder; the page is written to DIR/KIND (default: evidence)"
    parser.add_argument("--out", type=Path, default=Path("evidence"), metavar="DIR", help=what)


def execute(arguments: argparse.Namespace) -> int:
    """Compute the evidence and print the path of the page."""
    from evac.evidence.command import run_evidence

    if not arguments.page_only:
        note(f"computing {arguments.kind} from scratch")
    print(run_evidence(arguments.kind, arguments.out, arguments.quick, page_only=arguments.page_only))
    return 0
