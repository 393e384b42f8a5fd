"""The core knows no contact model, solver, force or behaviour by name."""

import re
from functools import cache
from pathlib import Path

import pytest

import evac
from evac.contract.registry import Registry

ROOT = Path(evac.__file__).parent

#: Where names are allowed: the defaults, the case that `evac import` writes, the standard tests, evidence.
MAY_NAME = ("contract/hooks.py", "importing/documents.py", "standard/", "evidence/")

#: Registered names that are common words, too, or a column of people.csv.
WORDS = {"familiarity", "response_time", "rest", "together", "walking"}


@cache
def names():
    registry = Registry()
    tables = (registry.contact_models, registry.solvers, registry.forces, registry.behaviours)
    return sorted({name for table in tables for name in table} - WORDS)


def named_in(text):
    pattern = re.compile(rf"(?<![a-z])({'|'.join(names())})(?![a-z0-9])", re.IGNORECASE)
    return pattern.findall(text)


def test_no_module_of_the_core_names_a_model():
    read = {str(path.relative_to(ROOT)): path.read_text(encoding="utf-8") for path in ROOT.rglob("*.py")}
    found = {path: named_in(text) for path, text in read.items() if not path.startswith(MAY_NAME)}
    assert {path: sorted(set(words)) for path, words in found.items() if words} == {}
    assert set(named_in(read["importing/documents.py"])) == {"nsm2"}


@pytest.mark.parametrize("text", ['"""As NSM1 does."""', "x = headway", "dem_step = 1", "class Headway:", "'uzawa'"])
def test_names_are_found_in_code_strings_and_docstrings(text):
    assert named_in(text)


def test_other_words_are_no_names():
    assert not named_in("demand, academic, socialise, a headwayless hall")
