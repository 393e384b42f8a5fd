"""evac repeat: run a case with many seeds, and say how certain the result is.

Runs go to several processes. To ./CASE-runs, or to --out, go runs.csv (one row for each seed), the mean and the
percentiles of the egress curves (egress.csv, egress.png), and summary.json. `evac run CASE --seed N` shows one of them.
"""

import argparse
import sys
from pathlib import Path

from evac.cli.cases import case_of, declare_case, default_folder
from evac.cli.progress import Display


def declare(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    declare_case(parser)
    parser.add_argument("--runs", type=_positive, default=20, metavar="N", help="number of runs (20)")
    parser.add_argument("--jobs", type=_positive, metavar="N", help="processes (default: one for each core)")
    parser.add_argument("--out", type=Path, metavar="DIR", help="result folder (default: ./CASE-runs)")


def execute(arguments: argparse.Namespace) -> int:
    """Run, write, report; return 0 if everybody is out in every run, 3 if people are left in one."""
    from evac.cli.screen import show_facts, show_warnings
    from evac.ending import EVERYBODY_OUT
    from evac.ensemble import run_many
    from evac.running import check_folder, make_folder
    from evac.simulation import Simulation

    case = case_of(arguments)
    folder = arguments.out or Path(f"{default_folder(case).name.removesuffix('-result')}-runs")
    check_folder(folder)
    show_warnings(Simulation(case).warnings())
    make_folder(folder)
    print(f"runs: {arguments.runs}, seeds from {case.simulation.seed} on", file=sys.stderr, flush=True)
    with Display() as display:
        ensemble = run_many(case, arguments.runs, workers=arguments.jobs, progress=display.runs)
    ensemble.write(folder)
    complete, runs = len(ensemble.complete), len(ensemble.runs)
    show_facts({"case": case.title, "people": ensemble.people, "everybody out": f"in {complete} of {runs} runs"})
    show_facts({f"last out, {name.replace('_', ' ')}": f"{value:.2f} s" for name, value in ensemble.last_out().items()})
    left = [str(run.seed) for run in ensemble.runs if run.ended != EVERYBODY_OUT]
    if left:
        print(
            f"evac: people are left with seeds {', '.join(left)}, so these times are of the other runs alone;"
            " evac run --seed N shows where people are left",
            file=sys.stderr,
        )
    for run in ensemble.runs:
        show_warnings(f"seed {run.seed}: {line}" for line in run.quality_warnings)
    show_facts({"results in": folder})
    return 0 if complete == runs else 3


def _positive(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError("must be a whole number, at least 1")
    return int(text)
