"""The standard tests that the model of a case has failed, from the evidence that is installed with evac."""

import json
import tomllib
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

from evac.report.pages import Section, read, section
from evac.results.recordedcase import CaseTable

#: Verdicts of docs/evidence, as `evac evidence` writes them beside this module.
EVIDENCE_NAME = "evidence.json"

#: Columns of the standard tests that are not those of a model.
TEST_COLUMNS = ("test", "measured", "expected", "by")


@cache
def evidence() -> Mapping[str, Any]:
    """Return the evidence that this version of evac comes with."""
    verdicts: Mapping[str, Any] = json.loads(read(EVIDENCE_NAME))
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
    """Return the section on verification, with the tests that the model of a case failed; see `subject_like`."""
    rows = evidence()["tests"]
    subject = subject_like(case, keepers, [column for column in rows[0] if column not in TEST_COLUMNS])
    failed = [(row, row[subject]) for row in rows if subject and row[subject].startswith("NO")]
    grouped: dict[str, list[str]] = {}
    for row, verdict in failed:
        grouped.setdefault(row["test"], []).append(f"{row['measured']}: {row['expected']} ({verdict})")
    return section(
        "verification",
        "Verification: failed tests of the model",
        model=" with ".join([case.model, *keepers]),
        subject=subject,
        number=len(rows),
        failed=len(failed),
        rows=[(test, "; ".join(criteria), meaning(test)) for test, criteria in grouped.items()],
        source=evidence(),
    )


def meaning(names: str) -> str:
    """Return what it means for a building that a model does not meet the standard test of some names."""
    (words,) = [text for test, text in tomllib.loads(read("meanings.toml")).items() if test in names.split()]
    return str(words)
