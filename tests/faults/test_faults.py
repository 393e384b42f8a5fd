"""The list of faults fits the code; ``python -m tests.faults`` tries them."""

import tomllib
from pathlib import Path

import pytest

from tests.faults import CHECKOUT, read_faults

FAULTS = read_faults()


@pytest.mark.parametrize("name", FAULTS)
def test_the_text_of_a_fault_occurs_once(name):
    fault = FAULTS[name]
    assert (CHECKOUT / fault.file).read_text(encoding="utf-8").count(fault.old) == 1
    assert fault.new != fault.old
    assert all((CHECKOUT / test).exists() for test in fault.tests)


def test_faults_are_spread_over_the_code():
    assert len(FAULTS) >= 40
    assert len({Path(fault.file).parent for fault in FAULTS.values()}) >= 12


def test_mutants_that_change_nothing_are_each_of_a_file_and_have_a_reason():
    with (CHECKOUT / "tests/faults/equivalent.toml").open("rb") as file:
        entries = tomllib.load(file)["mutant"]
    assert all(set(entry) == {"file", "old", "new", "reason"} for entry in entries)
    assert all((CHECKOUT / entry["file"]).is_file() for entry in entries)
