"""evac repeat: run a case with many seeds and compute statistics with confidence intervals.

The row of each run is written to ./CASE-runs, or to --out, as soon as it is done; --resume continues a study that was
killed. At the end runs.parquet and runs.csv contain the rows, statistics.csv and summary.json the statistics,
egress.csv and egress.png the mean and percentiles of the egress curves over runs; with --replay also
replay-median.html and replay-worst.html. `evac run CASE --seed N` repeats one of the runs.
"""

import argparse
import sys
from pathlib import Path

from evac.base.display import Display
from evac.cli.cases import case_to_run, declare_case, default_folder, note_unused_plugins
from evac.cli.studies import Rows, declare_study, executor_of, options_of, prepare, show_study


def declare(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    declare_case(parser)
    declare_study(parser)
    parser.add_argument(
        "--check-step",
        action="store_true",
        help="make all runs with half the time step as well, and show the difference",
    )
    parser.add_argument(
        "--replay", action="store_true", help="repeat the median and the worst run, and write a replay of each"
    )


def execute(arguments: argparse.Namespace) -> int:
    """Run the study and show it; return its status, see `evac.cli.studies.show_study`."""
    from evac.study.asking import conducted, rule_of
    from evac.study.points import halved_steps, single

    case = case_to_run(arguments)
    note_unused_plugins(case)
    options = options_of(arguments)
    rule = rule_of(*(options[key] for key in ("runs", "until", "statistic", "least", "most", "repetitions")))
    folder = arguments.out or Path(f"{default_folder(case).name.removesuffix('-result')}-runs")
    prepare(case)
    number = rule.first if rule.until is None else f"{rule.first} to {rule.most}"
    print(f"runs: {number}, seeds from {case.simulation.seed} on", file=sys.stderr, flush=True)
    with executor_of(arguments) as executor, Display() as display:
        display.phase("checking points and seeds")
        study = conducted(
            halved_steps(case) if arguments.check_step else single(case),
            rule,
            folder,
            options["repetitions"],
            options["workers"],
            executor,
            arguments.resume,
            Rows(display),
            arguments.replay,
        )
    return show_study(study)
