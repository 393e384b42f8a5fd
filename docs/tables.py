"""The pages with the tables that the code knows, in the places of marks such as ``<!-- table: case -->``.

Building the site fills them in. ``python docs/tables.py PAGE`` prints a page with its tables.
"""

import re
import sys
from pathlib import Path

from case_reference import reference
from plugin_tables import plugins
from summary_keys import keys

MARK = re.compile(r"^<!-- table: (\w+) -->$", re.MULTILINE)


def filled(text: str) -> str:
    """Return the text of a page with its tables."""
    return MARK.sub(lambda mark: table(mark[1]), text)


def table(name: str) -> str:
    """Return a table in Markdown: of the keys of a case or of a summary, or of the plugins of a kind."""
    if name == "case":
        return reference()
    return keys() if name == "summary" else plugins(name)


if __name__ == "__main__":
    print(filled(Path(sys.argv[1]).read_text(encoding="utf-8")))
