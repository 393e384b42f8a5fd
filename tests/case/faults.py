"""What loading a faulty case says."""

import re

import pytest

from evac.base.errors import ScenarioError
from evac.case import load_case


def lines_of(source, overrides, registry):
    with pytest.raises(ScenarioError) as caught:
        load_case(source, overrides, registry=registry)
    return str(caught.value).splitlines()


def says(line, source, expected):
    """Return whether a line names the file, the key, and the numbers and quoted names of an expected one."""
    key, _, text = expected.partition(": ")
    facts = re.findall(r"'[^']*'|\d[\d.,e+-]*\d|\d", text)
    return line.startswith(f"{source}: {key}: ") and all(fact in line for fact in facts)
