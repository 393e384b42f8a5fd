"""Runs and studies of a case in processes of their own, and their state, which is read from their folders."""

import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from evac.base.display import numbers_of
from evac.base.errors import EvacError, ResultError, ScenarioError, counted
from evac.base.progress import Progress
from evac.case.loading import load_case
from evac.editor.judging import storeys_of
from evac.folder.files import (
    COMPLETE,
    MANIFEST_NAME,
    REPLAY_NAME,
    REPORT_NAME,
    STUDY_NAME,
    SUMMARY_NAME,
    TRAJECTORY_NAME,
    read_manifest,
)
from evac.folder.resultfolder import holder_here, running_beside
from evac.report.comparison import compare
from evac.results.reading import read_results
from evac.study.study import read_study
from evac.trajectory.trajectory import Trajectory, continued, read_trajectory

SHOWN = (REPLAY_NAME, REPORT_NAME)  #: Files of a result that the page links to.


class Command:
    """A command that writes a result folder, in a process of its own, which goes on when `evac edit` ends."""

    def __init__(self, folder: Path, plugins: Sequence[Path] = ()) -> None:
        self.folder, self.plugins = folder.absolute(), plugins
        self.options = [f"--plugin={path}" for path in plugins]
        self.running = running_beside(self.folder)
        self._lock = self.folder.with_name(f"{self.folder.name}.lock")
        self._place = tempfile.TemporaryDirectory()
        self._output = Path(self._place.name) / "output.txt"
        self._process: subprocess.Popen[bytes] | None = None

    def start(self, *arguments: str) -> None:
        """Start a command of evac; ResultError if another one writes the result."""
        if self.holder() is not None:
            raise ResultError(f"{self.folder}: is being written; wait until this has ended, or stop it")
        with self._output.open("wb") as output:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "evac", *arguments],
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )

    def stop(self) -> None:
        """Stop the command that writes the result; a run ends at the end of its tick, and can be resumed."""
        if (process := self.holder()) is not None:
            os.kill(process, signal.SIGTERM)  # which shells do not have ignored in the background, unlike SIGINT

    def close(self) -> None:
        """Forget what the command has printed; one that runs goes on."""
        self._place.cleanup()

    def holder(self) -> int | None:
        """Return the process that writes the result."""
        if self._process is not None and self._process.poll() is None:
            return self._process.pid
        return holder_here(self._lock)

    def failure(self) -> str:
        """Return why the command that was started here has failed; empty if it has not, or was stopped."""
        status = 0 if self._process is None else self._process.returncode
        if status in (0, 3, -signal.SIGTERM) or status >= 128:  # from 128 on, it was stopped
            return ""
        text = "\n".join(line for line in self.lines() if line.startswith("evac: "))
        return text or f"the command ended with status {status}"

    def lines(self) -> list[str]:
        """Return the last lines that the command has printed."""
        text = self._output.read_text(errors="replace") if self._output.exists() else ""
        return [line for line in text.splitlines() if line.strip()]


class Runner(Command):
    """Starts and stops `evac run` and `evac report`, and tells what is in their folder, whoever has written it."""

    def __init__(self, case_file: Path, plan_file: Path | None, folder: Path, plugins: Sequence[Path] = ()) -> None:
        super().__init__(folder, plugins)
        self.case_file, self._sources = case_file, [case_file, *([plan_file] if plan_file is not None else [])]
        self._trajectory: Trajectory | None = None
        self._first: tuple[float, Progress] | None = None  # when it was seen [s], and what
        self._ended: tuple[Any, dict[str, Any]] = (None, {})

    def begin(self, command: str) -> None:
        """Start ``run`` on the case, or ``report`` on its result."""
        self._trajectory = self._first = None
        run = [str(self.case_file), "--out", str(self.folder), *self.options]
        self.start(command, *{"run": run, "report": [str(self.folder)]}[command])

    def file(self, name: str) -> bytes | None:
        """Return a file of the result that the page links to, if evac has written it."""
        return (self.folder / name).read_bytes() if name in self._files() else None

    def state(self) -> dict[str, Any]:
        """Return what goes on: ``phase`` is none, running, failed or ended, with what the page shows of it."""
        if self.holder() is not None:
            return {"phase": "running", **self._progress()}
        if text := self.failure():
            return {"phase": "failed", "text": text}
        try:
            written = (self.folder / SUMMARY_NAME).stat().st_mtime_ns, self._files()
        except OSError:
            return {"phase": "none"}
        if written != self._ended[0]:
            self._ended = written, self._outcome()
        changed = max((path.stat().st_mtime_ns for path in self._sources if path.exists()), default=0)
        stopped = [line.removeprefix("evac: ") for line in self.lines() if line.startswith("evac: interrupted")]
        return self._ended[1] | {"is_old": changed > written[0], "stopped": "".join(stopped)}

    def _files(self) -> list[str]:
        manifest = read_manifest(self.folder)
        return [name for name in SHOWN if manifest.state == COMPLETE and name in manifest.files]

    def _outcome(self) -> dict[str, Any]:
        try:
            results = read_results(self.folder)
        except EvacError as error:
            return {"phase": "failed", "text": str(error)}
        when = time.strftime("%Y-%m-%d %H:%M", time.localtime((self.folder / SUMMARY_NAME).stat().st_mtime))
        verdict, answer, files = results.verdict["status"], results.answer.lines(), self._files()
        return {"phase": "ended", "status": verdict, "answer": answer, "files": files, "when": when}

    def _progress(self) -> dict[str, Any]:
        """Return how far a run is, in words, and by storey where people are: x, y, z, ... [m]."""
        try:
            if self._trajectory is None:
                self._trajectory = read_trajectory(self.running / TRAJECTORY_NAME)
            self._trajectory = trajectory = continued(self._trajectory)
            frame = trajectory[-1]
        except (EvacError, IndexError):  # nothing is recorded yet, or the folder of the run has just been renamed
            self._trajectory = None
            begun = "starting" if self._first is None else "writing the results"
            return {"text": (self.lines() or [begun])[-1].removeprefix("evac: "), "people": {}}
        out, duration = trajectory.out_at(len(trajectory) - 1), self._duration()
        now = Progress(frame["time"], duration, trajectory.number_of_people, out)
        seen, first = self._first = self._first or (time.perf_counter(), now)
        text = numbers_of(first, now, time.perf_counter() - seen) if now != first else "running"
        at = np.round(np.column_stack([frame["position"], frame["z"]]), 2)
        storey = np.array(storeys_of(trajectory.building))[frame["level"]]
        return {"text": text, "people": {str(name): at[storey == name].ravel().tolist() for name in set(storey)}}

    def _duration(self) -> float:
        if self._first is not None:
            return self._first[1].duration
        return float(load_case(self.case_file, plugin_files=self.plugins).simulation.duration)


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
        """Start `evac repeat` for a design, or continue one that was stopped, unless other runs are being made."""
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
        """Return the page of `evac compare` with designs beside each other; None if there is no such design."""
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
