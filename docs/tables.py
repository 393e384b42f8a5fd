"""The pages with the tables that the code knows, in the places of marks such as ``<!-- table: case -->``.

Building the site fills them in. ``python docs/tables.py PAGE`` prints a page with its tables.
"""

import re
import sys
from pathlib import Path

from case_reference import reference
from plugin_tables import checks, hooks, plugins
from summary_keys import keys

from evac.cli.main import COMMANDS, parser
from evac.conditions.source import QUANTITIES

MARK = re.compile(r"^<!-- table: (\w+) -->$", re.MULTILINE)


def filled(text: str) -> str:
    """Return the text of a page with its tables."""
    return MARK.sub(lambda mark: table(mark[1]), text)


def table(name: str) -> str:
    """Return a table in Markdown: commands, options, keys, hooks, checks, quantities, or plugins of a kind."""
    if name == "commands" or name in COMMANDS:
        return options(name)
    made = {"case": reference, "summary": keys, "hooks": hooks, "checks": checks, "quantities": quantities}
    return made[name]() if name in made else plugins(name)


def options(name: str) -> str:
    """Return the options of a command with their meanings, or all commands."""
    (commands,) = (action for action in parser()._actions if action.dest == "command")
    if name == "commands":
        rows = {f"evac {one.dest}": one.help for one in commands._choices_actions}
    else:
        declared = commands.choices[name]._actions
        values = {one: one.metavar or ", ".join(one.choices or ()) for one in declared[1:]}
        values |= {one: " ".join(value) for one, value in values.items() if isinstance(value, tuple)}
        rows = {" ".join([*one.option_strings[-1:], value]).strip(): one.help for one, value in values.items()}
    head = "command" if name == "commands" else "option"
    return "\n".join([f"| {head} | meaning |", "|---|---|", *(f"| `{key}` | {text} |" for key, text in rows.items())])


def quantities() -> str:
    """Return the quantities of the air with their units; concentrations are those of volumes."""
    rows = (f"| `{name}` | {one.unit} | {one.doc} |" for name, one in QUANTITIES.items())
    return "\n".join(["| quantity | unit | meaning |", "|---|---|---|", *rows])


if __name__ == "__main__":
    print(filled(Path(sys.argv[1]).read_text(encoding="utf-8")))
