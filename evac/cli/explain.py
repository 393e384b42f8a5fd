"""evac explain: show which parts of the program a case needs, and why.

The other parts are left out, which does not change the trajectories; `evac run --full` includes them. Plugin files of
the case are executed, as by `evac run`, because forces and behaviours decide themselves whether they are needed.
"""

import argparse

from evac.base.display import Display
from evac.cli.inputs import case_to_run, declare_case, note_unused_plugins
from evac.cli.screen import show_facts, show_table


def declare(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    declare_case(parser)


def execute(arguments: argparse.Namespace) -> int:
    """Print every optional part, whether it is used, and why."""
    case = case_to_run(arguments)
    note_unused_plugins(case)
    from evac.cli.outcome import response_times
    from evac.simulation.simulation import Simulation

    with Display(has_lines=False) as display:
        simulation = Simulation(case, will_run=False, compiling=display.compiling)
    rows = [part.as_row() for part in simulation.plan]
    show_table(case.title or str(case.source), ("part", "in or out", "why"), rows)
    show_facts({"response times": response_times(simulation.population.crowd)})
    return 0
