"""How a kind of evidence is recomputed."""

import importlib
import json
from pathlib import Path

from evac.errors import ResultError, ScenarioError
from evac.evidence import KINDS
from evac.evidence.report import Evidence
from evac.parameters import did_you_mean


def run_evidence(kind: str, folder: Path, quick: bool = False, seed: int = 1) -> Path:
    """Recompute one kind of evidence from scratch and return its page.

    Parameters
    ----------
    kind : str
        One of `evac.evidence.KINDS`.
    folder : Path
        The page, tables and plots go to ``folder / kind``; ``folder / README.md`` lists the kinds there.
    quick : bool
        Seconds instead of minutes.
    seed : int

    Raises
    ------
    ScenarioError
        Unknown kind.
    ResultError
        The folder cannot be written.
    """
    if kind not in KINDS:
        raise ScenarioError(f"unknown kind of evidence {kind!r}; {did_you_mean(kind, KINDS)}")
    try:
        evidence = Evidence(kind, folder / kind, quick, seed)
        importlib.import_module(f"evac.evidence.{kind}.page").run(evidence)
        write_index(folder)
    except OSError as error:
        raise ResultError(f"{folder}: cannot write evidence there: {error.strerror}; choose another --out") from error
    return evidence.folder / "README.md"


def write_index(folder: Path) -> None:
    """Write README.md of the evidence folder: each kind that is there, with the first paragraph of its page."""
    lines = ["# Evidence", "Each page is recomputed from scratch by the command on it; nothing is typed by hand."]
    for kind in KINDS:
        conditions = folder / kind / "run.json"
        if conditions.is_file():
            found = json.loads(conditions.read_text())
            lines += [f"## [{found['title']}]({kind}/README.md)", found["summary"]]
            lines += [f"![{caption}]({kind}/{name}.png)" for name, caption in found.get("charts", ())]
            lines.append(f"`{found['command']}`")
    (folder / "README.md").write_text("\n\n".join(lines) + "\n")
