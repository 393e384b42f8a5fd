"""Designs of a case: their runs with many seeds, made one after the other, and what they differ in."""

import re
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

from evac.base.errors import ResultError, ScenarioError, counted
from evac.editor.running import Command
from evac.folder.files import COMPLETE, MANIFEST_NAME, STUDY_NAME, read_manifest
from evac.folder.lock import holder_here
from evac.folder.resultfolder import running_beside
from evac.report.comparison import compare
from evac.study.study import read_study

#: Greatest number of runs that the page can order.
MOST_RUNS = 1000
#: Number of designs of which what is shown is kept.
MOST_SHOWN = 100
NAME = re.compile(r"\w[\w-]{0,39}")


class Designs:
    """Studies of a case: that of a design is in ``CASE-runs-NAME``; that in ``CASE-runs`` is of `evac repeat`."""

    def __init__(self, case_file: Path, folder: Path, plugins: Sequence[Path] = ()) -> None:
        self.case_file, self.folder, self.plugins = case_file, folder.absolute(), plugins
        locks = self.folder.parent.glob(f"{self.folder.name}*.lock")
        going_on = [lock.with_suffix("") for lock in locks if holder_here(lock) is not None]
        self._command = Command(going_on[0] if going_on else self.folder)

    def start(self, name: str, runs: int) -> None:
        """Start `evac repeat` for a design, or continue one that was stopped.

        Raises
        ------
        EvacError
            The name is no name of a folder, the number is out of range, or other runs are being made.
        """
        if not NAME.fullmatch(name) or not 1 <= runs <= MOST_RUNS:
            raise ScenarioError(f"{name!r}, {runs} runs: give a name of letters and digits, and 1 to {MOST_RUNS} runs")
        if self._command.holder() is not None:
            raise ResultError(f"{self._command.folder}: is being written; wait until this has ended, or stop it")
        self._command.close()
        self._command = command = Command(self.folder.with_name(f"{self.folder.name}-{name}"), self.plugins)
        more = [*command.options, *(["--resume"] if (command.running / STUDY_NAME).is_file() else [])]
        command.start("repeat", str(self.case_file), "--out", str(command.folder), "--runs", str(runs), *more)

    def stop(self) -> None:
        """Stop the runs that are being made; the same order continues them."""
        self._command.stop()

    def close(self) -> None:
        """Forget what commands have printed; one that runs goes on."""
        self._command.close()

    def state(self) -> dict[str, Any]:
        """Return the designs that are complete, and in ``making`` and ``failed`` what is told of the command."""
        found = {"designs": [_shown(name, *folder) for name, folder in sorted(self._folders().items())]}
        if self._command.holder() is not None:
            name = self._name(self._command.folder)
            return found | {"making": f"{name}: {self._progress()}"}
        return found | {"failed": self._command.failure()}

    def page(self, names: Sequence[str]) -> bytes | None:
        """Return the page of `evac compare` with designs beside each other; None if there is no such design.

        Raises
        ------
        ResultError
            Their runs have no seed in common.
        """
        folders = self._folders()
        if not folders.keys() >= {*names}:
            return None
        return compare(*((read_study(folders[name][0]), 0) for name in names)).page().encode()

    def _folders(self) -> dict[str, tuple[Path, int]]:
        """Return the folders of complete studies by the names of their designs, and when they were written."""
        near = [path.parent for path in self.folder.parent.glob(f"{self.folder.name}*/{STUDY_NAME}")]
        whole = [folder for folder in near if read_manifest(folder).state == COMPLETE]
        return {self._name(folder): (folder, (folder / MANIFEST_NAME).stat().st_mtime_ns) for folder in whole}

    def _name(self, folder: Path) -> str:
        return folder.name.removeprefix(f"{self.folder.name}-")

    def _progress(self) -> str:
        lines = [line for line in self._command.lines() if line.endswith("runs")]
        try:
            study = read_study(running_beside(self._command.folder))
        except ResultError:  # nothing is written yet, or the folder has just been renamed
            return lines[-1] if lines else "starting"
        return f"{study.stored_runs} of {study.rule.first} runs"


@lru_cache(MOST_SHOWN)
def _shown(name: str, folder: Path, written: int) -> dict[str, Any]:
    """Return what the list has of a design; `written` is when its study was."""
    study = read_study(folder)
    each = study.statistics[0]
    found = [(one.name, one.text, one.bounds(".1f")) for one in (each[study.central], each.percentiles[-1])]
    text = ", ".join(f"{what} {value} s" + (f" ({bounds})" if bounds else "") for what, value, bounds in found)
    return {"name": name, "runs": counted(each.runs, "run"), "text": text}
