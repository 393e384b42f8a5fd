"""evac conditions: print the output that a fire simulation must write for a case.

`evac conditions deck CASE` prints the lines for the input file of FDS: slices at the heads of people on every level,
and volumes on stairs, of the quantities that the case needs. The data need not exist yet. If the case has a table
[[conditions]], its `shift` is taken into account.
"""

import argparse

from evac.cli.inputs import case_of, declare_case
from evac.contract.hooks import DEFAULT_FIRE


def declare(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("what", choices=("deck",), help="deck: lines for the input file of the fire simulation")
    declare_case(parser)
    what = f"source of conditions that will read the data (default: {DEFAULT_FIRE})"
    parser.add_argument("--source", default=DEFAULT_FIRE, metavar="NAME", help=what)


def execute(arguments: argparse.Namespace) -> int:
    """Print the lines."""
    from evac.case.fire import ConditionSettings
    from evac.conditions.exposure import heads_of, law_of, quantities_needed
    from evac.conditions.source import SourceScene
    from evac.simulation.assembly import make_building

    case = case_of(arguments)
    cls = case.registry.get("condition_source", arguments.source)
    tables = [one for one in case.conditions if one.source == cls.name] or [ConditionSettings(source=cls.name)]
    needed = quantities_needed(case, law_of(case))
    scene = SourceScene(make_building(case), case.folder, tables[0], heads_of(case), needed)
    lines = cls(**tables[0].parameters).deck(scene)
    print("\n".join(lines) or f"source {cls.name!r} needs no lines")
    return 0
