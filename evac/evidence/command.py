"""The command `evac evidence`: recomputation of one kind of evidence."""

import csv
import importlib
import json
import warnings
from pathlib import Path
from typing import Any

import evac
from evac.base.errors import ResultError, ScenarioError
from evac.base.parameters import did_you_mean
from evac.evidence import KINDS
from evac.evidence.evidence import Evidence, write_whole
from evac.evidence.verdicts import verdict_table
from evac.report.verification import EVIDENCE_NAME
from evac.standard.verify import QUIET

#: What the reports of runs show of the standard tests besides their verdicts.
SHOWN = ("command", "commit", "versions")

#: The evidence of a checkout, and the copy of its verdicts that is installed with evac, for reports.
PACKAGE = Path(evac.__file__).parent
COMMITTED = PACKAGE.parent / "docs" / "evidence"
INSTALLED = PACKAGE / "report" / EVIDENCE_NAME


def run_evidence(kind: str, folder: Path, quick: bool = False, page_only: bool = False) -> Path:
    """Recompute a kind of evidence to the page ``folder / kind``, or with `page_only` write its page again; return it.

    ``folder / README.md`` lists the kinds there. For docs/evidence of a checkout, the verdicts that reports show are
    written as well.
    """
    if kind not in KINDS:
        raise ScenarioError(f"unknown kind of evidence {kind!r}; {did_you_mean(kind, KINDS)}")
    try:
        evidence = Evidence(kind, folder / kind, quick, page_only=page_only)
        with warnings.catch_warnings():
            silence, action = QUIET
            silence(*action)
            importlib.import_module(f"evac.evidence.{kind}.page").run(evidence)
        write_index(folder)
        if COMMITTED.is_dir() and folder.samefile(COMMITTED):
            write_whole(INSTALLED, json.dumps(shown_in_reports(folder), indent=1))
    except OSError as error:
        raise ResultError(f"{error.filename or folder}: {error.strerror}; choose another --out") from error
    return evidence.folder / "README.md"


def write_index(folder: Path) -> None:
    """Write README.md of the evidence folder: the verdict tables of all kinds in it."""
    lines = ["# Evidence", "What each page examined and what came of it, made by the command below each table."]
    for kind in KINDS:
        conditions = folder / kind / "run.json"
        if conditions.is_file():
            kept = json.loads(conditions.read_text())
            page = f"{kind}/README.md"
            lines += [f"## [{kept['title']}]({page})", kept["examined"], verdict_table(kept["verdicts"], page)]
            lines.append(f"`{kept['command']}`, commit {kept['commit']}, {kept['wall time [s]']} s.")
    write_whole(folder / "README.md", "\n\n".join(lines))


def shown_in_reports(folder: Path) -> dict[str, Any]:
    """Return the verdicts on the standard tests in the form of `evac.report.verification.evidence`."""
    run = json.loads((folder / "validation" / "run.json").read_text())
    with (folder / "validation" / "verdicts.csv").open(newline="", encoding="utf-8") as file:
        return {key: run[key] for key in SHOWN} | {"tests": list(csv.DictReader(file))}
