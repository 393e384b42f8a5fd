"""Designs of a case: their runs with many seeds, made one after the other, and what they differ in."""

import re
from pathlib import Path
from typing import Any

from evac.base.errors import ResultError, ScenarioError, counted
from evac.editor.running import Command
from evac.folder.files import COMPLETE, MANIFEST_NAME, STUDY_NAME, read_manifest
from evac.folder.lock import holder_here
from evac.folder.resultfolder import running_beside
from evac.folder.textfiles import plain
from evac.report.comparison import compare
from evac.study.study import read_study

#: Greatest number of runs that the page can order.
MOST_RUNS = 1000
NAME = re.compile(r"\w[\w-]{0,39}")


class Designs:
    """Studies of a case: that of a design is in ``CASE-runs-NAME``; that in ``CASE-runs`` is of `evac repeat`."""

    def __init__(self, case_file: Path, folder: Path) -> None:
        self.case_file, self.folder = case_file, folder.absolute()
        locks = self.folder.parent.glob(f"{self.folder.name}*.lock")
        going_on = [lock.with_suffix("") for lock in locks if holder_here(lock) is not None]
        self._command = Command(going_on[0] if going_on else self.folder)
        self._known: dict[Path, tuple[int, dict[str, Any]]] = {}  # by folder: when it was written, and what is shown

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
        self._command = command = Command(self.folder.with_name(f"{self.folder.name}-{name}"))
        more = ["--resume"] if (command.running / STUDY_NAME).is_file() else []
        command.start("repeat", str(self.case_file), "--out", str(command.folder), "--runs", str(runs), *more)

    def stop(self) -> None:
        """Stop the runs that are being made; the same order continues them."""
        self._command.stop()

    def close(self) -> None:
        """Forget what commands have printed; one that runs goes on."""
        self._command.close()

    def state(self) -> dict[str, Any]:
        """Return the designs that are complete, and in ``making`` and ``failed`` what is told of the command."""
        found = {"designs": [self._shown(name, folder) for name, folder in sorted(self._folders().items())]}
        if self._command.holder() is not None:
            name = self._name(self._command.folder)
            return found | {"making": f"{name}: {self._progress()}"}
        return found | {"failed": self._command.failure()}

    def compared(self, names: list[str]) -> dict[str, Any]:
        """Return the verdicts of designs, their differences from the first one, and their curves.

        Raises
        ------
        ResultError
            There is no such design, or their runs have no seed in common.
        """
        folders = self._folders()
        if missing := [name for name in names if name not in folders]:
            raise ResultError(f"{missing[0]}: there are no such runs")
        comparison = compare(*((read_study(folders[name]), 0) for name in names))
        rows = [
            {
                "verdict": one.verdict["text"],
                "status": one.verdict["status"],
                "out": f"everybody out in {sum(one.is_complete)} of {counted(len(one.seeds), 'run')}",
            }
            for one in comparison.designs
        ]
        keys = {"low": "percentile_5_over_runs", "mean": "mean_over_runs", "high": "percentile_95_over_runs"}
        curves = [{key: curve[column] for key, column in keys.items()} for curve in comparison.curves().values()]
        own = {design.label: name for name, design in zip(names, comparison.designs, strict=True)}
        differences = [
            [own[one.design], one.measure, one.before, one.after, one.change.words(), one.verdict]
            for one in comparison.differences
        ]
        time = next(iter(comparison.curves().values()))["time"]
        found = {"names": names, "designs": rows, "differences": differences, "time": time, "curves": curves}
        shown: dict[str, Any] = plain(found | {"people": comparison.people})
        return shown

    def _folders(self) -> dict[str, Path]:
        """Return the folders of complete studies by the names of their designs."""
        near = self.folder.parent.glob(f"{self.folder.name}*/{STUDY_NAME}")
        whole = [path.parent for path in near if read_manifest(path.parent).state == COMPLETE]
        return {self._name(folder): folder for folder in whole}

    def _name(self, folder: Path) -> str:
        return folder.name.removeprefix(f"{self.folder.name}-")

    def _shown(self, name: str, folder: Path) -> dict[str, Any]:
        written = (folder / MANIFEST_NAME).stat().st_mtime_ns
        if self._known.get(folder, (None,))[0] != written:
            study = read_study(folder)
            each = study.statistics[0]
            found = [(one.name, one.text, one.bounds(".1f")) for one in (each[study.central], each.percentiles[-1])]
            text = ", ".join(f"{what} {value} s" + (f" ({bounds})" if bounds else "") for what, value, bounds in found)
            row = {"name": name, "runs": counted(each.runs, "run"), "text": text}
            self._known[folder] = written, row
        return self._known[folder][1]

    def _progress(self) -> str:
        lines = [line for line in self._command.lines() if line.endswith("runs")]
        try:
            study = read_study(running_beside(self._command.folder))
        except ResultError:  # nothing is written yet, or the folder has just been renamed
            return lines[-1] if lines else "starting"
        return f"{study.stored_runs} of {study.rule.first} runs"
