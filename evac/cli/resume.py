"""evac resume: go on with a run that was killed or stopped, from its last checkpoint.

On the same machine, with the same versions, plugins and building, the results are those of a run that was never
stopped, to the last bit, wall times excepted. --set changes the case from here on, such as building.closed='["door"]';
this needs --out, a folder of its own, whose summary says so. People, seed, step, tick and output.every cannot change.
"""

import argparse
from pathlib import Path

from evac.cli.cases import declare_plugin, tell_plugin_file
from evac.cli.run import declare_checkpoint, declare_threads
from evac.display import Display


def declare(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("result", type=Path, metavar="RESULT", help="result folder that the run was given")
    parser.add_argument(
        "--set",
        dest="overrides",
        metavar="KEY=VALUE",
        nargs="+",
        action="extend",
        default=[],
        help="change keys of the case from here on; needs --out",
    )
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="another result folder, which has records from the checkpoint on"
    )
    declare_checkpoint(parser, "as before")
    declare_threads(parser)
    parser.add_argument(
        "--allow-differences",
        action="store_true",
        help="go on even if versions, kernels, plugins or the building's file have changed; the summary says so",
    )
    declare_plugin(parser)


def execute(arguments: argparse.Namespace) -> int:
    """Go on, write, report; return what `evac run` would."""
    with Display() as display:
        display.phase("reading the checkpoint")
        from evac.cli.running import run_shown, show_run
        from evac.output.resultfolder import ResultFolder
        from evac.running import resumed

        with ResultFolder(arguments.out or arguments.result) as place:
            simulation, every = resumed(
                arguments.result,
                place,
                arguments.overrides,
                arguments.plugins,
                allow_differences=arguments.allow_differences,
                threads=arguments.threads,
                compiling=display.compiling,
                tell=tell_plugin_file,
            )
            display.line(f"evac: going on at {simulation.time:.2f} s, in {place.running}")
            checkpoint = every if arguments.checkpoint is None else arguments.checkpoint
            results, status = run_shown(simulation, place, display, checkpoint)
    show_run(results, {})
    return status
