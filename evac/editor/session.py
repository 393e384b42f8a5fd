"""What is edited: the plan in a file, what was judged of it, and the journal of what is not saved yet."""

import difflib
import hashlib
import json
import queue
import shutil
import threading
from collections.abc import Mapping
from concurrent.futures import BrokenExecutor
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from evac.base.errors import BuildingError, EvacError, ScenarioError
from evac.base.processes import Pool
from evac.building.plan.plan import PLAN
from evac.building.plan.plantable import read_table
from evac.case.loading import load_case
from evac.editor.judging import judge
from evac.editor.patching import patched
from evac.editor.running import Runner
from evac.folder.files import content_of, replacing
from evac.folder.textfiles import plain, write_json

#: Ending of the name of the journal, which is beside the file.
JOURNAL = ".unsaved"
#: Time between two looks at the file on the disk, and at the run of the case [s].
LOOK_EVERY = 0.5


class ChangedOnDiskError(EvacError):
    """The file is not the one that the page has read."""


@dataclass
class Request:
    """A plan that waits to be judged, and the page and the revision that it is of."""

    page: str
    revision: int
    table: Mapping[str, Any]


class Session:
    """A plan file, or the plan in a case.toml, that pages edit.

    Parameters
    ----------
    source : Path
        A case, a folder with one, or a plan file.
    result : Path, optional
        Result folder of runs of the case; by default that of `evac run`.

    Raises
    ------
    EvacError
        There is no such file, it is not valid, or the building of the case is not a plan.
    """

    def __init__(self, source: Path, result: Path | None = None) -> None:
        self.case_file: Path | None = None
        self.runner: Runner | None = None
        self.place: tuple[str, ...] = ()
        if source.name.lower().endswith(PLAN):
            self.file, self.title = source.resolve(), source.name
        else:
            case = load_case(source)
            self.case_file = self.file = case.source
            self.title = case.title or case.folder.name
            if case.building.plan is not None:
                self.place = ("building", "plan")
            elif case.mesh is not None and case.mesh.name.lower().endswith(PLAN):
                self.file = case.mesh.resolve()
            else:
                raise ScenarioError(
                    f"{case.source}: the building is {case.building.mesh!r}, which is no plan; a plan ({PLAN}), or a "
                    "[building.plan] in the case, can be edited: `evac new FOLDER` writes one"
                )
            self.runner = Runner(case.source, result or Path(f"{case.name}-result"))
        self.run: dict[str, Any] = {"phase": "none"}  # as it was told last
        self.journal = self.file.with_name(self.file.name + JOURNAL)
        self.listeners: list[queue.Queue[tuple[str, Any]]] = []
        self.is_over = threading.Event()
        self._lock, self._waiting = threading.Condition(), dict[str, Request]()
        self._pool: Pool | None = None
        text, table = self._read()
        self._seen = _digest(text)
        self._judged(Request("", 0, table), is_awaited=False)  # while the browser opens the page
        for work in (self._judge_always, self._look_always):
            threading.Thread(target=work, daemon=True).start()

    def document(self) -> dict[str, Any]:
        """Return the plan as the page gets it, the digest of its file, and what the journal has."""
        text, table = self._read()
        found = {"title": self.title, "file": self.file.name, "digest": _digest(text), "table": plain(table)}
        found["can_run"] = self.runner is not None
        with suppress(OSError, ValueError, KeyError):
            journal = json.loads(content_of(self.journal))
            found["unsaved"] = {"table": journal["table"], "of_this_file": journal["digest"] == found["digest"]}
        return found

    def check(self, request: Request) -> dict[str, Any]:
        """Have a plan judged, instead of an earlier one of the same page that still waits, and note it in the journal.

        Raises
        ------
        EvacError
            The journal cannot be written.
        """
        with self._lock:
            self._waiting[request.page] = request
            self._lock.notify()
        text, table = self._read()
        if plain(table) == request.table:
            self.journal.unlink(missing_ok=True)
        else:
            write_json(self.journal, {"digest": _digest(text), "table": request.table}, "the journal")
        return {"revision": request.revision}

    def save(self, table: Mapping[str, Any], digest: str) -> dict[str, Any]:
        """Write a plan to its file, of which only the changed lines change; return the difference and the digest.

        Raises
        ------
        ChangedOnDiskError
            The digest is not that of the file.
        EvacError
            The file cannot be written, or the change cannot be made in its text.
        """
        with self._lock:
            text, _ = self._read()
            if _digest(text) != digest:
                raise ChangedOnDiskError(f"{self.file}: has changed since it was read here; nothing is written")
            new = self._patched(text, table)
            if new != text:
                with replacing(self.file, "the plan") as path:
                    shutil.copymode(self.file, path)
                    path.write_bytes(new.encode())
            self.journal.unlink(missing_ok=True)
            self._seen = _digest(new)
        self.tell("saved", {"digest": _digest(new)})
        return {"difference": self._difference(text, new), "digest": _digest(new)}

    def command(self, what: str) -> dict[str, Any]:
        """Start ``run`` or ``report``, or ``stop`` what writes the result; return the state of the run.

        Raises
        ------
        EvacError
            A plan file was opened, which is no case, or the result is being written.
        """
        if self.runner is None:
            raise ScenarioError(f"{self.file}: is a plan, not a case; open a case with it: `evac edit CASE`")
        if what == "stop":
            self.runner.stop()
        else:
            self.runner.start(what)
        self.run = self.runner.state()
        self.tell("run", self.run)
        return self.run

    def tell(self, event: str, data: Any) -> None:
        """Send an event to all pages."""
        for listener in list(self.listeners):
            listener.put((event, data))

    def close(self) -> None:
        """End the processes, except a run, which goes on."""
        self.is_over.set()
        if self.runner is not None:
            self.runner.close()
        with self._lock:
            self._lock.notify()
        if self._pool is not None:
            self._pool.kill()

    def _read(self) -> tuple[str, dict[str, Any]]:
        """Return the text of the file and the plan in it."""
        try:
            table = read_table(self.file)
            for key in self.place:
                table = table[key]
            return content_of(self.file).decode(), table
        except (OSError, ValueError, KeyError) as error:
            raise BuildingError(f"{self.file}: cannot be read: {error}; correct it") from error

    def _patched(self, text: str, table: Mapping[str, Any]) -> str:
        try:
            return patched(text, self.place, table)
        except ValueError as error:
            raise BuildingError(f"{self.file}: {error}") from error

    def _difference(self, old: str, new: str) -> str:
        lines = difflib.unified_diff(
            old.splitlines(), new.splitlines(), self.file.name, self.file.name, lineterm="", n=1
        )
        return "\n".join(lines)

    def _judge_always(self) -> None:
        """Judge what waits, one plan after the other, in a process that is started again if it dies."""
        while not self.is_over.is_set():
            with self._lock:
                while not self._waiting and not self.is_over.is_set():
                    self._lock.wait()
                if self.is_over.is_set():
                    return
                request = self._waiting.pop(next(iter(self._waiting)))
            self.tell("judged", {"page": request.page, "revision": request.revision} | self._judged(request))

    def _judged(self, request: Request, is_awaited: bool = True) -> dict[str, Any]:
        try:
            self._pool = self._pool or Pool(1, is_quiet=True)
            prefix = "".join(f"{key}." for key in self.place)
            future = self._pool.submit(judge, self.file, self.case_file, prefix, request.table)
            if not is_awaited:
                return {}
            found: dict[str, Any] = future.result()
            text, _ = self._read()
            return plain(found) | {"difference": self._difference(text, self._patched(text, request.table))}  # type: ignore[no-any-return]
        except EvacError as error:
            return {"failed": str(error)}
        except BrokenExecutor:
            self._pool = None
            return {"failed": "the process that judges the plan has died; the next change starts it again"}
        except Exception as error:
            return {
                "failed": f"the plan could not be judged, which is a fault of evac: {type(error).__name__}: {error}"
            }

    def _look_always(self) -> None:
        """Tell pages when the file on the disk changes, and how the run goes on."""
        while not self.is_over.wait(LOOK_EVERY):
            if self.runner is not None and self.listeners and (state := self.runner.state()) != self.run:
                self.run = state
                self.tell("run", state)
            with suppress(OSError, UnicodeDecodeError):
                now = _digest(content_of(self.file).decode())
                if now != self._seen:
                    self._seen = now
                    self.tell("changed", {"digest": now})


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()
