"""evac repeat: run a case with many seeds and compute statistics with confidence intervals.

Results are written to ./CASE-runs, or to --out. Each run is saved as soon as it has ended, and --resume continues a
study that was killed. At the end, runs.parquet and runs.csv contain a row for each run, statistics.csv and summary.json
the statistics, and egress.csv and egress.png the mean and percentiles of the egress curves. `evac run CASE --seed N`
repeats one of the runs.
"""

import argparse

from evac.cli.inputs import case_to_run, declare_case, default_folder, note_unused_plugins
from evac.cli.studies import declare_study, run_study


def declare(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    declare_case(parser)
    declare_study(parser)
    step = "make all runs with half the time step as well, and show the difference"
    parser.add_argument("--check-step", action="store_true", help=step)
    replay = "repeat the median and the worst run, and write replay-median.html and replay-worst.html"
    parser.add_argument("--replay", action="store_true", help=replay)


def execute(arguments: argparse.Namespace) -> int:
    """Run the study and show it; return its status, see `evac.cli.studies.run_study`."""
    from evac.study.points import halved_steps, single

    case = case_to_run(arguments)
    note_unused_plugins(case)
    points = halved_steps(case) if arguments.check_step else single(case)
    return run_study(arguments, points, default_folder(case, "runs"))
