"""evac resume: continue a run that was killed or stopped, from its last checkpoint.

On the same machine, with the same versions, plugins and building, the results are bitwise those of a run without
interruption, except wall times.
"""

import argparse
from pathlib import Path

from evac.base.display import Display
from evac.cli.inputs import announce_plugin_file, declare_plugin
from evac.cli.run import declare_checkpoint, declare_threads, declare_verbose


def declare(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("result", type=Path, metavar="RESULT", help="result folder of the interrupted run")
    case = "case of the run; needed if it names plugin files and is not beside RESULT"
    parser.add_argument("--case", type=Path, metavar="FILE", help=case)
    declare_checkpoint(parser, "as the interrupted run")
    declare_threads(parser)
    declare_verbose(parser)
    differences = "continue, with a note, even if versions, kernels, plugins or the file of the building have changed"
    parser.add_argument("--allow-differences", action="store_true", help=differences)
    declare_plugin(parser)


def execute(arguments: argparse.Namespace) -> int:
    """Resume the run, write and show the results; return the exit status of `evac run`."""
    with Display() as display:
        display.phase("reading the checkpoint")
        from evac.cli.running import run_shown, show_run
        from evac.folder.resultfolder import ResultFolder
        from evac.simulation.running import resumed

        with ResultFolder(arguments.result) as place:
            simulation, every = resumed(
                place,
                arguments.plugins,
                allow_differences=arguments.allow_differences,
                threads=arguments.threads,
                case_file=arguments.case,
                compiling=display.compiling,
                announce=announce_plugin_file,
            )
            display.line(f"evac: resuming at {simulation.time:.2f} s in {place.running}")
            checkpoint = every if arguments.checkpoint is None else arguments.checkpoint
            results, status = run_shown(simulation, place, display, checkpoint)
    show_run(results, arguments.verbose)
    return status
