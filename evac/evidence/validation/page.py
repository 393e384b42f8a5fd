"""Validation: the standard tests with the movement model of new cases, with its preset for them, and as in the paper.

The tests are those of `evac verify`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import chain
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

from evac.contract.hooks import DEFAULT_MOVEMENT
from evac.evidence.evidence import Evidence, Row
from evac.evidence.verdicts import all_of, reported
from evac.standard.trial import StandardTest, Trial
from evac.standard.verify import FAILED, STANDARDS, TESTS, carry_out, check_rows

#: The model of new cases, and its name in reports of runs.
DEFAULT = f"NSM2, {DEFAULT_MOVEMENT}"


class Subject(NamedTuple):
    """A model under test: settings of all cases, whether people walk as in the paper, and whether one run suffices."""

    settings: tuple[str, ...] = ()
    is_paper: bool = False
    is_brief: bool = False


#: The models under test, by their names in tables: those that are compared besides make one run of each test.
SUBJECTS: Mapping[str, Subject] = {
    DEFAULT: Subject(),
    f"{DEFAULT} regulation": Subject((f"behaviours.{DEFAULT_MOVEMENT}.preset=regulation",)),
    "NSM2": Subject(is_paper=True),
    f"DEM, {DEFAULT_MOVEMENT}": Subject(("contact.model=dem",), is_brief=True),
    f"NSM1 inertial, {DEFAULT_MOVEMENT}": Subject(("contact.model=nsm1",), is_brief=True),
    "NSM2, headway": Subject(("behaviours.headway={}",), is_paper=True, is_brief=True),
    "DEM": Subject(("contact.model=dem",), is_paper=True, is_brief=True),
    "NSM1 inertial": Subject(("contact.model=nsm1",), is_paper=True, is_brief=True),
}

#: The models of a quick run, which makes one run of each test.
QUICK_SUBJECTS = tuple(SUBJECTS)[:3]

#: Heading of the verdicts.
RELY = "Verdicts of the tests"


def carry_out_with(name: str, test: StandardTest, seed: int) -> list[Row]:
    """Carry out a test with a subject; return the rows of its checks. Its result folders are removed."""
    subject = SUBJECTS[name]
    if subject.is_brief:
        test = replace(test, runs=1)
    with TemporaryDirectory() as folder:
        trial = Trial(Path(folder), settings=subject.settings, is_paper=subject.is_paper)
        return list(check_rows(carry_out(test, trial, seed), model=name))


def run(evidence: Evidence) -> None:
    """Run every test with every model and write the page."""
    subjects = QUICK_SUBJECTS if evidence.quick else tuple(SUBJECTS)
    made = [replace(test, runs=1) if evidence.quick else test for test in TESTS if test.measure is not None]

    tasks = [(subject, test, evidence.seed) for test in made for subject in subjects]
    rows = evidence.measured("tests", lambda: chain(*evidence.map(carry_out_with, tasks)))
    _judge(evidence, rows, made)
    left = [{"test": " ".join(test.names), "subject": test.title, "why": test.why} for test in TESTS if test.why]
    sources = [{"name": name, "read": source} for name, source in STANDARDS.items()]
    brief = [name for name, subject in SUBJECTS.items() if subject.is_brief]
    evidence.show("tests", __name__, rows=rows, brief=brief, left=left, sources=sources)
    evidence.write_page(__name__)


def failed_tests(rows: Sequence[Row]) -> dict[str, list[str]]:
    """Return the tests that each model fails: a test is passed if all its checks are."""
    failed: dict[str, list[str]] = {row["model"]: [] for row in rows}
    for row in rows:
        if not row["met"].startswith("yes") and row["test"] not in failed[row["model"]]:
            failed[row["model"]].append(row["test"])
    return failed


def _judge(evidence: Evidence, rows: Sequence[Row], tests: Sequence[StandardTest]) -> None:
    failed = failed_tests(rows)
    for subject, names in failed.items():
        evidence.verdict(all_of(f"Tests passed: {subject}", len(tests) - len(names), len(tests), RELY))
    by_design = [" ".join(test.names) for test in tests if test.by_design]
    told = "; ".join(name for name in failed[DEFAULT] if name in by_design)
    evidence.verdict(reported(f"{FAILED} by {DEFAULT}, by design", told or "none", "-", RELY))
    told = "; ".join(name for name in failed[DEFAULT] if name not in by_design)
    evidence.verdict(reported(f"{FAILED} by {DEFAULT}, other tests", told or "none", "none", RELY))


def verdict_rows(rows: Sequence[Row]) -> list[Row]:
    """Return a row for each criterion, with the verdict on each model."""
    by_criterion: dict[tuple[str, str], dict[str, Any]] = {}
    for row in rows:
        key = row["test"], row["measured"]
        verdicts = by_criterion.setdefault(key, {name: row[name] for name in ("test", "measured", "expected", "by")})
        verdicts[row["model"]] = row["met"]
    models = dict.fromkeys(row["model"] for row in rows)
    return [row | {model: row.get(model, "-") for model in models} for row in by_criterion.values()]
