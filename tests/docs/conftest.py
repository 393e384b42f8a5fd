import importlib
import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

#: The folder of the pages, where the modules are that make their tables.
sys.path.insert(0, str(ROOT / "docs"))
MARK, filled, table = (getattr(importlib.import_module("tables"), name) for name in ("MARK", "filled", "table"))


@pytest.fixture(scope="session")
def root():
    """The checkout."""
    return ROOT


@pytest.fixture(scope="session")
def python_blocks():
    """Return the Python blocks of a document, in order."""

    def blocks(path):
        return re.findall(r"^```python\n(.*?)^```", (ROOT / path).read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)

    return blocks


@pytest.fixture(scope="session")
def plugin_files(python_blocks, tmp_path_factory):
    """The files of the pages on plugins as written, by name: each block starts with its file name in a comment."""
    folder = tmp_path_factory.mktemp("plugins")
    files = {}
    for page in sorted((ROOT / "docs").glob("plugins*.md")):
        for text in python_blocks(page):
            name = text.partition("\n")[0].removeprefix("# ")
            assert name.endswith(".py"), f"a block of {page} does not start with its file name: {name}"
            files[name] = folder / name
            files[name].write_text(text, encoding="utf-8")
    return files
