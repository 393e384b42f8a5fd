"""What of evac has been verified, and what has failed: the evidence that is kept with the program."""

import json
from collections.abc import Mapping, Sequence
from functools import cache
from importlib.resources import files
from typing import Any

from evac.report.html import Cell, Html, Section, heading, link, note, paragraph, table
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
    found: Mapping[str, Any] = json.loads(text)
    return found


def subject_like(case: CaseTable, keepers: Sequence[str], subjects: Sequence[str]) -> str | None:
    """Return which subject of the standard tests is like the model of a case; None if none is.

    Subjects are named by model and variant, then by the behaviour with which people keep distances, if there is one;
    `keepers` are the behaviours of the case that do so.
    """
    words = {case.model.lower(), *(str(value).lower() for value in case.model_parameters.values())}
    for subject in subjects:
        model, *behaviours = subject.split(", ")
        if set(model.lower().split()) <= words and behaviours == list(keepers):
            return subject
    return None


def verification_section(case: CaseTable, keepers: Sequence[str]) -> Section:
    """Return the section on verification, with the standard tests of the model of a case; see `subject_like`."""
    found = evidence()
    return Section(
        "verification",
        "Verification and validation: passed and failed tests",
        (
            paragraph(
                "These are the verdicts of the evidence that is distributed with evac (docs/evidence). They were"
                " measured once by the commands named below, not for this building. Nothing was tuned to pass a test."
                " A verdict is followed by the measured value where it fails, and where its 95 % confidence interval"
                " extends over the bound (not certain)."
            ),
            *_tests(case, keepers, found["tests"], found["kinds"]["validation"]),
            heading("All kinds of evidence"),
            paragraph("The verdicts that are not met or undecided are listed in ", link(EVIDENCE, "the appendix"), "."),
            _kinds(found["kinds"]),
        ),
    )


def evidence_section() -> Section:
    """Return the appendix with the verdicts of all kinds of evidence that are not met or undecided."""
    words = paragraph("They concern the numerical methods of evac and its models in general, not this building.")
    kinds = evidence()["kinds"]
    return Section(EVIDENCE, "Appendix: verdicts of the evidence that are not met", (words, _failures(kinds)))


def _tests(case: CaseTable, keepers: Sequence[str], rows: list[dict[str, str]], kind: Mapping[str, str]) -> list[Html]:
    """Return the standard tests, as the model of a case has fared, or all models where it was not put to them."""
    subjects = [column for column in rows[0] if column not in TEST_COLUMNS]
    subject = subject_like(case, keepers, subjects)
    parts = [heading("Standard tests (RiMEA, IMO, NIST, ISO)")]
    if subject is None:
        parts.append(
            note(
                "bad",
                paragraph(
                    f"The contact model of this case, {' with '.join([case.model, *keepers])}, has not been tested with"
                    " these parameters in the standard tests. The author must provide such tests. The table shows the"
                    " models that were tested."
                ),
            )
        )
        shown = subjects
    else:
        passed = sum(row[subject].startswith("yes") for row in rows)
        failed = sum(row[subject].startswith("NO") for row in rows)
        parts.append(
            paragraph(
                f"The contact model of this case was tested as {subject}: of {len(rows)} criteria, {passed} were met"
                f" and {failed} were not. The model's other parameters were those of the tests, which may differ from"
                " those of this case. They do not compare flows through doors with those of laboratories;"
                " docs/evidence/validation does."
            )
        )
        shown = [subject]
    head = ("test", "quantity", "expected", "source of the test", *("met" if subject else name for name in shown))
    lines = [
        [*(row[column] for column in TEST_COLUMNS), *(Cell(row[name], _kind_of_test(row[name])) for name in shown)]
        for row in rows
    ]
    told = f"{kind['command']}, commit {kind['commit']}, {kind['versions']}"
    return [*parts, table(f"Criteria of the standard tests ({told})", head, lines)]


def _kind_of_test(words: str) -> str:
    if words.startswith("NO"):
        return "bad"
    return "open" if "not certain" in words else "good"


def _kind(verdict: str) -> str:
    if verdict == "met":
        return "good"
    return "bad" if verdict.startswith("not met") else "open"


def _kinds(kinds: Mapping[str, Any]) -> Html:
    def count(kind: Mapping[str, Any], wanted: str) -> int:
        return sum(row["verdict"].startswith(wanted) for row in kind["verdicts"])

    rows = [
        (
            kind["title"],
            count(kind, "met"),
            count(kind, "not met"),
            count(kind, "undecided"),
            count(kind, "reported"),
            f"{kind['command']}, commit {kind['commit']}",
        )
        for kind in kinds.values()
    ]
    columns = ("evidence", "met", "not met", "undecided", "reported only", "measured by")
    return table("Verdicts of each kind; those without a target are reported only", columns, rows)


def _failures(kinds: Mapping[str, Any]) -> Html:
    rows = [
        (
            name,
            row["question"],
            row["measured"],
            row["wanted"],
            Cell(row["verdict"], _kind(row["verdict"])),
        )
        for name, kind in kinds.items()
        for row in kind["verdicts"]
        if row["verdict"].startswith(("not met", "undecided"))
    ]
    return table("Verdicts", ("evidence", "question", "measured", "wanted", "verdict"), rows)
