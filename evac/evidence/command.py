"""How a kind of evidence is recomputed."""

import importlib
import json
from pathlib import Path

from evac.errors import ResultError, ScenarioError
from evac.evidence import KINDS
from evac.evidence.report import Evidence
from evac.evidence.verdicts import verdict_table
from evac.parameters import did_you_mean


def run_evidence(kind: str, folder: Path, quick: bool = False, seed: int = 1, page_only: bool = False) -> Path:
    """Recompute one kind of evidence from scratch, or write its page again, and return the page.

    Parameters
    ----------
    kind : str
        One of `evac.evidence.KINDS`.
    folder : Path
        The page, tables and plots go to ``folder / kind``; ``folder / README.md`` lists the kinds there.
    quick : bool
        Seconds instead of minutes.
    seed : int
    page_only : bool
        Measure nothing: write the page, and the index, from the tables of an earlier run.

    Raises
    ------
    ScenarioError
        Unknown kind.
    ResultError
        The folder cannot be written, or lacks the tables of an earlier run where only the page is written.
    """
    if kind not in KINDS:
        raise ScenarioError(f"unknown kind of evidence {kind!r}; {did_you_mean(kind, KINDS)}")
    try:
        evidence = Evidence(kind, folder / kind, quick, seed, page_only)
        importlib.import_module(f"evac.evidence.{kind}.page").run(evidence)
        write_index(folder)
    except OSError as error:
        raise ResultError(f"{folder}: cannot write evidence there: {error.strerror}; choose another --out") from error
    return evidence.folder / "README.md"


def write_index(folder: Path) -> None:
    """Write README.md of the evidence folder: the verdict table of each kind that is there."""
    lines = ["# Evidence", "What each page examined and what came of it, made by the command below each table."]
    for kind in KINDS:
        conditions = folder / kind / "run.json"
        if conditions.is_file():
            found = json.loads(conditions.read_text())
            page = f"{kind}/README.md"
            lines += [f"## [{found['title']}]({page})", found["examined"], verdict_table(found["verdicts"], page)]
            lines.append(f"`{found['command']}`, commit {found['commit']}, {found['wall time [s]']} s.")
    (folder / "README.md").write_text("\n\n".join(lines) + "\n")
