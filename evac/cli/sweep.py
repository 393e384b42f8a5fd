"""evac sweep: run a case with many seeds for each combination of parameters, or for each row of a table.

--set KEY=VALUE,VALUE,... varies a key; a single value sets it for all points. All points use the same seeds, so that
they differ only in their parameters. The files of `evac repeat`, for each point, and statistics.png are written to
./CASE-sweep, or to --out.
"""

import argparse
import math
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from evac.cli.inputs import declare_plugin, declare_set, default_folder, with_plugin_files
from evac.cli.studies import declare_study, run_study

if TYPE_CHECKING:
    from collections.abc import Iterable

    from evac.case.case import Case


def declare(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    case = "a case.toml, a folder that contains one, or a shipped case; not needed if the table names cases"
    parser.add_argument("case", metavar="CASE", nargs="?", help=case)
    declare_set(
        parser, "values of keys, such as people.people.number=100,200,300 simulation.step=0.005,0.01", "KEY=VALUES"
    )
    table = "one point per row: CSV with dotted keys as header, or TOML with [[points]]; `case` names a case"
    parser.add_argument("--table", type=Path, metavar="FILE", help=table)
    parser.add_argument("--seed", type=int, metavar="N", help="seed of the first run of each point (simulation.seed)")
    declare_plugin(parser)
    declare_study(parser)
    parser.set_defaults(replay=False)


def execute(arguments: argparse.Namespace) -> int:
    """Run the study and show it; return its status, see `evac.cli.studies.run_study`."""
    from evac.study.points import from_rows, grid

    parameters, fixed = swept(arguments.set)
    if arguments.seed is not None:
        fixed.append(f"simulation.seed={arguments.seed}")
    case = _case(arguments, fixed)
    if arguments.table is not None:
        rows, place = _rows(arguments, parameters, fixed), arguments.table.parent
        points = from_rows(case, rows, place, run_files=partial(_with_files_beside, place))
    else:
        assert case is not None
        points = grid(case, parameters)
    return run_study(arguments, points, default_folder(case or points[0].case, "sweep"))


def swept(overrides: "Iterable[str]") -> tuple[dict[str, list[Any]], list[str]]:
    """Return the keys with several values, and the overrides with a single value."""
    from evac.base.errors import ScenarioError
    from evac.case.overrides import split_values, value_of

    several: dict[str, list[Any]] = {}
    fixed = []
    for text in overrides:
        key, _, words = (part.strip() for part in text.partition("="))
        values = split_values(words)
        if len(values) < 2:
            fixed.append(text)
            continue
        try:
            several[key] = [value_of(word) for word in values]
        except (ValueError, IndexError) as error:
            raise ScenarioError(f"--set {text}: not a list of values: {error or 'a value is empty'}") from error
    return several, fixed


def _case(arguments: argparse.Namespace, fixed: list[str]) -> "Case | None":
    """Return the case of the sweep; None if the table names all cases."""
    from evac.base.errors import ScenarioError
    from evac.case.loading import load_case

    if arguments.case is None and arguments.table is None:
        raise ScenarioError("name a case, or a table of cases (--table)")
    if arguments.table is None and not any("," in text for text in arguments.set):
        raise ScenarioError("no key has several values: give them (--set KEY=V1,V2), or use evac repeat")
    if arguments.case is None:
        return None
    return with_plugin_files(load_case(arguments.case, fixed, arguments.plugins))


def _with_files_beside(folder: Path, case: "Case") -> "Case":
    """Execute the plugin files of a case that a table in a folder names; both must lie there."""
    from evac.base.errors import ScenarioError
    from evac.case.trust import is_inside

    if case.unloaded_files and not is_inside(case.source, folder):
        raise ScenarioError(
            f"{case.source}: has plugin files, and is named by a table in another folder; move the table beside the "
            "folder of the case, or sweep the case itself"
        )
    return with_plugin_files(case)


def _rows(arguments: argparse.Namespace, parameters: dict[str, list[Any]], fixed: list[str]) -> list[dict[str, Any]]:
    """Return the rows of the table, each repeated for all combinations of the swept values."""
    import itertools

    from evac.case.overrides import parsed
    from evac.study.points import check_number, read_table

    rows = read_table(arguments.table)
    check_number(len(rows) * math.prod(map(len, parameters.values())))
    single = {} if arguments.case is not None else dict(parsed(fixed)[0])
    return [
        {**single, **row, **dict(zip(parameters, values, strict=True))}
        for row in rows
        for values in itertools.product(*parameters.values())
    ]
