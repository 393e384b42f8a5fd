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

#: Identifiers of the appendices.
EVIDENCE, STANDARD = "evidence", "standard"

#: What it means for a building that a model does not meet a standard test, by one of the names of the test.
MEANINGS = {
    "RiMEA-4": "In crowds of this density people walk faster or slower than measured: times of long, crowded corridors "
    "are too short or too long by about the ratio that was found.",
    "RiMEA-5": "People who have not responded yet are pushed aside by others: they may begin their way somewhere else.",
    "RiMEA-9": "The effect of closing exits is not that of the standard: compare variants of exits with care.",
    "RiMEA-11": "The choice between a near and a farther exit is not that expected: numbers of people of each exit "
    "are uncertain where people choose the quickest way.",
    "RiMEA-12": "Bottlenecks do not behave as expected in all details, or block: times there are uncertain.",
    "RiMEA-13": "Speeds on stairs at common densities are not those measured: times of stairs are uncertain.",
    "RiMEA-15": "People lose less or more time at corners than expected: times of ways with many turns are uncertain.",
    "RiMEA-16": "The speeds in crowds leave the range of experiments: times of crowded ways are uncertain.",
    "IMO-4": "More people pass a door per second than the standard allows: where doors decide, evacuation times are "
    "too short for a design value.",
    "IMO-8": "Crossing or opposing streams block: runs with such streams may not end.",
    "IMO-12": "Flows in dense crowds do not decrease as expected: queues may dissolve too fast.",
    "NIST-2.10": "A slow, wide person does not delay those behind: effects of impaired people may be too small.",
    "ISO-12": "More or fewer people pass a stair per second than the standard expects: where stairs decide, evacuation "
    "times are uncertain, and too short where the flow is greater.",
    "ISO-13": "The speed does not decrease with the number of people everywhere: it has little effect on times.",
    "ISO-14": "A class does not stay as close together as expected: arrivals of classes are spread.",
}

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
    """Return the section on verification, with the tests that the model of a case failed; see `subject_like`."""
    rows = evidence()["tests"]
    subject = subject_like(case, keepers, _subjects())
    failed = [(row, row[subject]) for row in rows if subject and row[subject].startswith("NO")]
    grouped: dict[str, list[str]] = {}
    for row, found in failed:
        grouped.setdefault(row["test"], []).append(f"{row['measured']}: {row['expected']} ({found})")
    return section(
        "verification",
        "Verification: failed tests of the model",
        model=" with ".join([case.model, *keepers]),
        subject=subject,
        number=len(rows),
        failed=len(failed),
        rows=[(test, "; ".join(criteria), meaning(test)) for test, criteria in grouped.items()],
        annex=STANDARD,
        evidence=EVIDENCE,
    )


def meaning(names: str) -> str:
    """Return what it means for a building that a model does not meet the standard test of some names."""
    (found,) = [words for test, words in MEANINGS.items() if test in names.split()]
    return found


def standard_section(case: CaseTable, keepers: Sequence[str]) -> Section:
    """Return the appendix with all standard tests, for the model of a case or, if it is none of these, all models."""
    verdicts = evidence()
    subject = subject_like(case, keepers, _subjects())
    columns = _subjects() if subject is None else [subject]
    return section(
        STANDARD,
        f"{APPENDIX}standard tests",
        "standard.html",
        columns=["met"] if subject else columns,
        rows=[
            [*(row[name] for name in TEST_COLUMNS), *(Cell(row[name], _kind_of_test(row[name])) for name in columns)]
            for row in verdicts["tests"]
        ],
        validation=verdicts["kinds"]["validation"],
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


def _subjects() -> list[str]:
    """Return the models that were put to the standard tests."""
    return [column for column in evidence()["tests"][0] if column not in TEST_COLUMNS]


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
