"""evac repeat: run a case with many seeds, and say how certain the result is.

Runs go to several processes. To ./CASE-runs, or to --out, go runs.csv (one row for each seed), the mean and the
percentiles over runs of the egress curves (egress.csv, egress.png), and summary.json; with --replay also
replay-median.html and replay-worst.html. `evac run CASE --seed N` shows any of them.
"""

import argparse
import math
import sys
from collections.abc import Mapping
from pathlib import Path

from evac.cli.cases import case_to_run, declare_case, default_folder
from evac.display import Display


def declare(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    declare_case(parser)
    parser.add_argument("--runs", type=_positive, default=20, metavar="N", help="number of runs (20)")
    parser.add_argument("--jobs", type=_positive, metavar="N", help="processes (default: one for each core)")
    parser.add_argument(
        "--replay", action="store_true", help="make the median and the worst run again, with a replay of each"
    )
    parser.add_argument("--out", type=Path, metavar="DIR", help="result folder (default: ./CASE-runs)")


def execute(arguments: argparse.Namespace) -> int:
    """Run, write, report; return 0 if everybody is out in every run, 3 if people are left in one."""
    from evac.cli.screen import show_facts, show_table, show_warnings
    from evac.ending import EVERYBODY_OUT
    from evac.ensemble import run_many
    from evac.output.resultfolder import ResultFolder
    from evac.simulation import Simulation

    case = case_to_run(arguments)
    folder = arguments.out or Path(f"{default_folder(case).name.removesuffix('-result')}-runs")
    with ResultFolder(folder) as place:
        with Display() as display:
            display.phase("reading the building, computing directions")
            warnings = Simulation(case, compiling=display.compiling).warnings()
        show_warnings(warnings)
        print(f"runs: {arguments.runs}, seeds from {case.simulation.seed} on", file=sys.stderr, flush=True)
        with Display() as display:
            ensemble = run_many(case, arguments.runs, workers=arguments.jobs, progress=display.runs)
        place.start()
        ensemble.write_to(place.running)
        replays = ensemble.replay(place.running) if arguments.replay else []
        place.publish()
    complete, runs = len(ensemble.complete), len(ensemble.runs)
    show_facts({"case": case.title, "people": ensemble.people, "everybody out": f"in {complete} of {runs} runs"})
    show_table("When the last person left", ("statistic", "value", "over"), _rows(ensemble.last_out()))
    left = [str(run.seed) for run in ensemble.runs if run.ended != EVERYBODY_OUT]
    if left:
        print(
            f"evac: people are left with seeds {', '.join(left)}, which count as endless in the percentiles and are not"
            " in the mean; evac run --seed N shows where people are left",
            file=sys.stderr,
        )
    for run in ensemble.runs:
        show_warnings(f"seed {run.seed}: {line}" for line in run.quality_warnings)
    show_facts({"results in": ", ".join([str(folder), *(path.name for path in replays)])})
    return 0 if complete == runs else 3


def _rows(last_out: Mapping[str, Mapping[str, float]]) -> list[tuple[str, str, str]]:
    """Return the statistics of the last person out with what each is taken over."""
    runs, complete = (int(last_out[over]["runs"]) for over in ("over_runs", "over_complete_runs"))
    never = f"not reached: people are left in {runs - complete} of {runs} runs"
    everybody = f"{complete} of {runs} runs, in which everybody got out"
    rows = []
    for over, what in (("over_runs", f"{runs} of {runs} runs"), ("over_complete_runs", everybody)):
        for name, value in last_out[over].items():
            if name != "runs":
                rows.append((name.replace("_", " "), f"{value:.2f} s" if math.isfinite(value) else never, what))
    return rows


def _positive(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError("must be a whole number, at least 1")
    return int(text)
