import importlib
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
def plugin_files():
    """The plugins that the pages on plugins show, by the names of their files."""
    return {path.name: path for path in (ROOT / "docs/examples/plugins").glob("*.py")}
