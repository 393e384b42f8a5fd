"""What of evac has been verified, and what has failed: the evidence that is kept with the program."""

import json
from collections.abc import Mapping, Sequence
from functools import cache
from importlib.resources import files
from typing import Any

from evac.report.templates import APPENDIX, Cell, Section, section
from evac.results.record import CaseTable

#: Verdicts of docs/evidence, as `evac evidence` writes them beside this module.
EVIDENCE_NAME = "evidence.json"

#: Identifier of the appendix.
EVIDENCE = "evidence"

#: Columns of the standard tests that are not those of a model.
TEST_COLUMNS = ("test", "measured", "expected", "by")


@cache
def evidence() -> Mapping[str, Any]:
    """Return the evidence that this version of evac comes with.

    Returns
    -------
    mapping
        ``kinds``: by name ``title``, ``examined``, ``verdicts``, ``command``, ``commit`` and ``versions``; ``tests``:
        a row for each criterion of the standard tests, with the verdict of each model that was put to them.
    """
    text = files("evac.report").joinpath(EVIDENCE_NAME).read_text(encoding="utf-8")
    verdicts: Mapping[str, Any] = json.loads(text)
    return verdicts


def subject_like(case: CaseTable, keepers: Sequence[str], subjects: Sequence[str]) -> str | None:
    """Return which subject of the standard tests is like the model of a case; None if none is.

    Subjects are named by model and variant, then by the behaviour with which people keep distances, if there is one,
    and its preset, if it was tested apart; `keepers` are the behaviours of the case that do so.
    """
    words = {case.model.lower(), *(str(value).lower() for value in case.model_parameters.values())}
    presets = [f"{name} {(case.behaviours.get(name) or {}).get('preset', '')}" for name in keepers]
    for wanted in (presets, list(keepers)):
        for subject in subjects:
            model, *behaviours = subject.split(", ")
            if set(model.lower().split()) <= words and behaviours == wanted:
                return subject
    return None


def verification_section(case: CaseTable, keepers: Sequence[str]) -> Section:
    """Return the section on verification, with the standard tests of the model of a case; see `subject_like`."""
    verdicts = evidence()
    rows = verdicts["tests"]
    subjects = [column for column in rows[0] if column not in TEST_COLUMNS]
    subject = subject_like(case, keepers, subjects)
    columns = subjects if subject is None else [subject]
    return section(
        "verification",
        "Verification and validation: passed and failed tests",
        model=" with ".join([case.model, *keepers]),
        subject=subject,
        columns=columns,
        rows=[
            [*(row[name] for name in TEST_COLUMNS), *(Cell(row[name], _kind_of_test(row[name])) for name in columns)]
            for row in rows
        ],
        passed=sum(row[subject].startswith("yes") for row in rows) if subject else 0,
        failed=sum(row[subject].startswith("NO") for row in rows) if subject else 0,
        validation=verdicts["kinds"]["validation"],
        evidence=EVIDENCE,
        kinds=[
            (
                kind["title"],
                *(
                    sum(row["verdict"].startswith(wanted) for row in kind["verdicts"])
                    for wanted in ("met", "not met", "undecided", "reported")
                ),
                f"{kind['command']}, commit {kind['commit']}",
            )
            for kind in verdicts["kinds"].values()
        ],
    )


def evidence_section() -> Section:
    """Return the appendix with the verdicts of all kinds of evidence that are not met or undecided."""
    rows = [
        (name, row["question"], row["measured"], row["wanted"], Cell(row["verdict"], _kind(row["verdict"])))
        for name, kind in evidence()["kinds"].items()
        for row in kind["verdicts"]
        if row["verdict"].startswith(("not met", "undecided"))
    ]
    return section(EVIDENCE, f"{APPENDIX}verdicts of the evidence that are not met", rows=rows)


def _kind_of_test(words: str) -> str:
    if words.startswith("NO"):
        return "bad"
    return "open" if "not certain" in words else "good"


def _kind(verdict: str) -> str:
    if verdict == "met":
        return "good"
    return "bad" if verdict.startswith("not met") else "open"
