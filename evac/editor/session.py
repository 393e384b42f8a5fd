"""A session of the editor: the plan in a file, the findings on it, and the journal of edits that are not saved yet."""

import base64
import difflib
import hashlib
import json
import math
import queue
import shutil
import tempfile
import threading
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor
from contextlib import suppress
from functools import partial
from itertools import chain, count
from os.path import isfile
from pathlib import Path
from typing import Any

import numpy as np

from evac.base.distributions import parse
from evac.base.errors import BuildingError, EvacError, ScenarioError
from evac.base.processes import Pool
from evac.building.plan.plan import PLAN
from evac.building.plan.plantable import read_table
from evac.case.jsonschema import case_schema
from evac.case.loading import is_inside, load_case
from evac.case.schema import shipped_presets
from evac.contract.registry import Registry
from evac.editor.judging import floors_of, judge
from evac.editor.patching import patched
from evac.editor.runner import Designs, Runner
from evac.folder.files import content_of, replacing, writing
from evac.folder.textfiles import plain, write_json
from evac.importing import import_building
from evac.importing.documents import write_example
from evac.importing.importing import PLAN as IMPORTED
from evac.people.starts import load_table
from evac.simulation.assembly import make_building

#: Ending of the name of the file with the pictures.
PICTURES = ".pictures"
#: First bytes of the formats that are shown, which browsers draw without executing anything.
SIGNS = (b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff")
MOST_BYTES = 20_000_000


class Pictures:
    """The pictures of the storeys of a file: of each, its content, its lower left corner and its width [m]."""

    def __init__(self, file: Path) -> None:
        self.file, self._lock = file.with_name(file.name + PICTURES), threading.Lock()

    def all(self) -> dict[str, Any]:
        """Return the pictures by storey; none if the file is not valid."""
        with suppress(OSError, ValueError, AttributeError, ScenarioError, LookupError, TypeError):
            return {storey: _checked(row) for storey, row in json.loads(content_of(self.file)).items()}
        return {}

    def put(self, storey: str, given: Mapping[str, Any] | None) -> dict[str, Any]:
        """Keep the picture (PNG or JPEG) of a storey, or without ``data`` only where it is; None takes it away."""
        with self._lock:
            rows = self.all()
            if given is None:
                rows.pop(storey, None)
            else:
                rows[storey] = _checked({**rows.get(storey, {}), **given})
            if rows:
                write_json(self.file, rows, "the pictures")
            else:
                self.file.unlink(missing_ok=True)
        return {"storeys": list(rows)}


def _checked(row: Mapping[str, Any]) -> dict[str, Any]:
    data, at, width = str(row["data"]), [float(value) for value in row["at"]], float(row["width"])
    content = base64.b64decode(data, validate=True)
    if not content.startswith(SIGNS) or len(content) > MOST_BYTES:
        raise ScenarioError(f"this is no PNG or JPEG of at most {MOST_BYTES // 1_000_000} MB; save the picture as one")
    if len(at) != 2 or not all(map(math.isfinite, [*at, width])) or width <= 0.0:
        raise ScenarioError("a picture needs a place and a width above 0 m")
    return {"data": data, "at": at, "width": width}


#: Ending of the name of the journal, which is beside the file.
JOURNAL = ".unsaved"
#: Time between two looks at the file on the disk, and at the run of the case [s].
LOOK_EVERY = 0.5
SHARES = np.linspace(0.0, 1.0, 101)[1:-1]  #: Shares of people for which the page gets the values of a distribution.


class ChangedOnDiskError(EvacError):
    """The file is not the one that the page has read."""


class Session:
    """A plan file or a case that pages edit: a table of the plan, with the rest as ``case``.

    Of a case whose building is no plan, such as a mesh, the case is edited, and the building is shown. Runs of the case
    are written to `result`, by default the folder of `evac run`. Files in `plugins` are executed; those that the case
    names are executed by runs only.
    """

    def __init__(self, source: Path, result: Path | None = None, plugins: Sequence[Path] = ()) -> None:
        self.case_file: Path | None = None
        self.plugins = [path.absolute() for path in plugins]
        self.registry = Registry(self.plugins)
        self._floors: list[dict[str, Any]] | None = None  # of a building that is no plan, which is not drawn
        self.runner: Runner | None = None
        self.designs: Designs | None = None
        if source.name.lower().endswith(PLAN):
            self.file, self.title = source.resolve(), source.name
        else:
            case = load_case(source, plugin_files=self.plugins, registry=self.registry)
            self.case_file = self.file = case.source
            self.title = case.title or case.name
            if case.mesh is not None and case.mesh.name.lower().endswith(PLAN):
                self.file = case.mesh.resolve()
            elif case.building.plan is None:
                self._floors = floors_of(make_building(case))
            result = result or Path(f"{case.name}-result")
            self.runner = Runner(case.source, case.mesh, result, self.plugins)
            runs = result.with_name(f"{result.name.removesuffix('-result')}-runs")
            self.designs = Designs(case.source, runs, self.plugins)
        self.told: dict[str, Any] = {"run": {"phase": "none"}, "designs": {"designs": []}}  # last
        self.pictures = Pictures(self.file)
        self.journal = self.file.with_name(self.file.name + JOURNAL)
        self.listeners: list[queue.Queue[tuple[str, Any]]] = []
        self.is_over = threading.Event()
        self._lock, self._pool = threading.Condition(), Pool(1, is_quiet=True)
        texts, table = self._read()
        self._seen = _digest(texts)
        self._waiting: dict[str, tuple[int, Mapping[str, Any]]] = {
            "": (0, table)
        }  # by page: revision and table; this one while the browser opens the page
        for work in (self._judge_always, self._look_always):
            threading.Thread(target=work, daemon=True).start()

    def document(self) -> dict[str, Any]:
        """Return what is edited as the page gets it, the digest of the files, and what the journal has."""
        texts, table = self._read()
        found = {"title": self.title, "file": self.file.name, "digest": _digest(texts), "table": plain(table)}
        found |= {
            "is_drawn": self._floors is None,
            "loads": load_table(),
            "folder": str(self.file.parent),
            "working": str(Path.cwd()),
        }
        with suppress(OSError, ValueError, KeyError):
            journal = json.loads(content_of(self.journal))
            found["unsaved"] = {"table": journal["table"], "of_this_file": journal["digest"] == found["digest"]}
        return found

    def page(self, kind: str, name: str) -> bytes | None:
        """Return a page beside that of the editor: a file of the ``result``, or the ``comparison`` of designs."""
        if kind == "result" and self.runner is not None:
            return self.runner.file(name)
        if kind == "comparison" and self.designs is not None:
            return self.designs.page(name.split(","))
        return None

    def forms(self) -> dict[str, Any]:
        """Return the schema of the case, with the parameters of all plugins, and the shipped presets."""
        return {"schema": case_schema(self.registry), "presets": {k: v["about"] for k, v in shipped_presets().items()}}

    def check(self, page: str, revision: int, table: Mapping[str, Any]) -> dict[str, Any]:
        """Have a plan judged, instead of an earlier one of the page that still waits, and note it in the journal."""
        with self._lock:
            self._waiting[page] = (revision, table)
            self._lock.notify()
        texts, written = self._read()
        if plain(written) == table:
            self.journal.unlink(missing_ok=True)
        else:
            write_json(self.journal, {"digest": _digest(texts), "table": table}, "the journal")
        return {"revision": revision}

    def save(self, table: Mapping[str, Any], digest: str) -> dict[str, Any]:
        """Write what was edited to the files, of which only the changed lines change; return difference and digest.

        ChangedOnDiskError if the given digest is not that of the files.
        """
        with self._lock:
            texts, _ = self._read()
            if _digest(texts) != digest:
                raise ChangedOnDiskError(f"{self.file}: has changed since it was read here; nothing is written")
            new = self._patched(texts, table)
            for file, text in new.items():
                if text != texts[file]:
                    with replacing(file, "what was edited") as path:
                        shutil.copymode(file, path)
                        path.write_bytes(text.encode())
            self.journal.unlink(missing_ok=True)
            self._seen = _digest(new)
            self.tell("changed", {"digest": self._seen})
        return {"difference": _difference(texts, new), "digest": _digest(new)}

    def copied(self, table: Mapping[str, Any], folder: Path) -> Path:
        """Write what was edited, with all files that it names, to a new folder; return the case or the plan there."""
        with self._lock:
            texts, _ = self._read()
            main = self.case_file or self.file
            others = {
                one for file, content in self._contents(table).items() for one in files_named(content, file.parent)
            }
            others |= {self.pictures.file} if self.pictures.file.exists() else set()
            write_copy(folder, main.parent, self._patched(texts, table), others)
        return folder / main.name

    def orders(self, given: Mapping[str, Any]) -> dict[str, Callable[[], Any]]:
        """Return by name what a page can have done with what it has given; each raises an EvacError if it cannot be."""
        found: dict[str, Callable[[], Any]] = {
            "check": lambda: self.check(str(given["page"]), int(given["revision"]), dict(given["table"])),
            "save": lambda: self.save(dict(given["table"]), str(given["digest"])),
            "curve": lambda: _curve(given["value"]),
            "picture": lambda: self.pictures.put(str(given["storey"]), given["picture"]),
        }
        runner, designs = self.runner, self.designs
        if runner is None or designs is None:
            return found
        runs = {
            "run": lambda: runner.begin("run"),
            "report": lambda: runner.begin("report"),
            "stop": runner.stop,
            "repeat": lambda: designs.start(str(given["name"]), int(given["runs"])),
            "stop-runs": designs.stop,
        }

        def told_after(start: Callable[[], None]) -> dict[str, Any]:
            start()
            self._tell_runs()
            return self.told

        return found | {name: partial(told_after, start) for name, start in runs.items()}

    def _tell_runs(self) -> None:
        """Tell the pages what is new of the run and of those of designs."""
        for name, what in (("run", self.runner), ("designs", self.designs)):
            if what is not None and (state := what.state()) != self.told[name]:
                self.told[name] = state
                self.tell(name, state)

    def tell(self, event: str, data: Any) -> None:
        """Send an event to all pages."""
        for listener in list(self.listeners):
            listener.put((event, data))

    def close(self) -> None:
        """End the processes, except a run, which goes on."""
        self.is_over.set()
        for runs in (self.runner, self.designs):
            if runs is not None:
                runs.close()
        with self._lock:
            self._lock.notify()
        self._pool.kill()

    def _read(self) -> tuple[dict[Path, str], dict[str, Any]]:
        """Return the texts of the files, and what is edited of their content."""
        contents, texts = dict[Path, dict[str, Any]](), dict[Path, str]()
        for file in dict.fromkeys([self.file, self.case_file or self.file]):
            try:
                contents[file], texts[file] = read_table(file), content_of(file).decode()
            except (OSError, ValueError) as error:
                raise BuildingError(f"{file}: cannot be read: {error}; correct it") from error
        if self.case_file is None:
            return texts, contents[self.file]
        case = contents[self.case_file]
        if self._floors is not None:
            return texts, {"storeys": self._floors, "case": case}
        if self.file == self.case_file:
            building = case.get("building", {})
            case = case | {"building": {key: value for key, value in building.items() if key != "plan"}}
            return texts, {**building.get("plan", {}), "case": case}
        return texts, {**contents[self.file], "case": case}

    def _contents(self, table: Mapping[str, Any]) -> dict[Path, Mapping[str, Any]]:
        """Return the content that the files get from what was edited."""
        plan = {key: value for key, value in table.items() if key != "case"}
        if self.case_file is None:
            return {self.file: plan}
        case = table["case"]
        if self._floors is not None:
            return {self.file: case}
        if self.file == self.case_file:
            return {self.file: {**case, "building": {**case["building"], "plan": plan}}}
        return {self.file: plan, self.case_file: case}

    def _patched(self, texts: Mapping[Path, str], table: Mapping[str, Any]) -> dict[Path, str]:
        new = {}
        for file, content in self._contents(table).items():
            try:
                new[file] = patched(texts[file], content)
            except ValueError as error:
                raise BuildingError(f"{file}: {error}") from error
        return new

    def _judge_always(self) -> None:
        """Judge what waits, one plan after the other, in a process that is started again if it dies."""
        while not self.is_over.is_set():
            with self._lock:
                while not self._waiting and not self.is_over.is_set():
                    self._lock.wait()
                if self.is_over.is_set():
                    return
                page = next(iter(self._waiting))
                revision, table = self._waiting.pop(page)
            self.tell("judged", {"page": page, "revision": revision} | self._judged(table))

    def _judged(self, table: Mapping[str, Any]) -> dict[str, Any]:
        try:
            contents = self._contents(table)
            plan = {key: value for key, value in table.items() if key != "case"}
            case = None if self.case_file is None else contents[self.case_file]
            drawn = plan if self._floors is None else None
            found: dict[str, Any] = plain(
                self._pool.submit(judge, self.file, self.case_file, drawn, case, self.plugins).result()
            )
            texts, _ = self._read()
            return found | {"difference": _difference(texts, self._patched(texts, table))}
        except EvacError as error:
            return {"failed": str(error)}
        except BrokenExecutor:
            self._pool = Pool(1, is_quiet=True)
            return {"failed": "the process that judges the plan has died; the next change starts it again"}
        except Exception as error:
            return {
                "failed": f"the plan could not be judged, which is a fault of evac: {type(error).__name__}: {error}"
            }

    def _look_always(self) -> None:
        """Tell pages when the file on the disk changes, and how the run goes on."""
        while not self.is_over.wait(LOOK_EVERY):
            with suppress(EvacError, OSError):  # what is written just now is read the next time
                if self.listeners:
                    self._tell_runs()
            with suppress(OSError, UnicodeDecodeError):
                files = dict.fromkeys([self.file, self.case_file or self.file])
                now = _digest({file: content_of(file).decode() for file in files})
                if now != self._seen:
                    self._seen = now
                    self.tell("changed", {"digest": now})


def _curve(value: Any) -> dict[str, Any]:
    """Return what the page draws of a distribution: the values that `SHARES` of people do not exceed, and the mean."""
    distribution = parse(value, "the distribution")
    return {"values": distribution.quantiles(SHARES).tolist(), "mean": distribution.mean()}


def _digest(texts: Mapping[Path, str]) -> str:
    return hashlib.sha256("\0".join(texts.values()).encode()).hexdigest()


def _difference(old: Mapping[Path, str], new: Mapping[Path, str]) -> str:
    """Return the changed lines of all files."""
    lines = [
        difflib.unified_diff(old[file].splitlines(), new[file].splitlines(), file.name, file.name, lineterm="", n=1)
        for file in new
    ]
    return "\n".join(chain.from_iterable(lines))


EMPTY = """# Drawn with evac edit. Lengths are in metres.

[[storeys]]
name = "ground"
z = 0.0
wall = 0.1
"""


def new_folder(name: str) -> Path:
    """Return a folder in the current one by its name, which may be a path; ScenarioError if it leads out of that."""
    folder = Path(name)
    if not folder.parts or ".." in folder.parts or not is_inside(folder, Path()):
        raise ScenarioError(f"{name}: give the name of a new folder in {Path.cwd()}")
    return folder


def write_copy(folder: Path, home: Path, texts: Mapping[Path, str], others: Iterable[Path]) -> None:
    """Write files with their new texts, and copies of others, to a new folder; all must be in `home`."""
    files = [*dict.fromkeys([*texts, *others])]
    if outside := [file for file in files if not is_inside(file, home)]:
        raise ScenarioError(
            f"{outside[0]}: is outside of {home}, of which this is a copy; put it there, or copy by hand"
        )
    with writing("the copy", folder):
        folder.mkdir(parents=True)
        for file in files:
            copy = folder / file.resolve().relative_to(home.resolve())
            copy.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(file, copy)
            if file in texts:
                copy.write_bytes(texts[file].encode())


def files_named(value: Any, folder: Path) -> Iterator[Path]:
    """Yield the files that a case or a plan in a folder names by paths relative to it."""
    if isinstance(value, Mapping | list):
        for part in value.values() if isinstance(value, Mapping) else value:
            yield from files_named(part, folder)
    elif isinstance(value, str) and not Path(value).is_absolute() and isfile(folder / value):
        yield folder / value


def begin(folder: Path, what: str, name: str = "", content: bytes = b"") -> tuple[Path, list[str]]:
    """Write a case to a new folder, with a number if its name is taken; return the folder, and what is to be told.

    `what`: empty, example, or file, whose `name` and `content` are given; it must be a plan.
    """
    names = chain([folder], (folder.with_name(f"{folder.name}-{number}") for number in count(2)))
    folder = next(path for path in names if not path.exists())
    if what != "file":
        write_example(folder)
        if what == "empty":
            _clear(folder / "case.toml", folder / "house.plan.toml")
        return folder, []
    with tempfile.TemporaryDirectory() as place:
        source = Path(place) / Path(name).name
        source.write_bytes(content)
        try:
            made = import_building([source], folder, partial=True)
        except EvacError as error:  # names the copy
            raise ScenarioError(str(error).replace(str(source), source.name)) from error
    if not (folder / IMPORTED).exists():
        text = "its floors are not level, so that it cannot be drawn on; it can be run"
        raise ScenarioError(f"{source.name}: {text}: `evac run {folder}`")
    told = [f"incomplete: {missing}" for missing in made.missing]
    return folder, told + [str(one) for one in made.findings if one.kind in ("warning", "left out")]


def _clear(case_file: Path, plan_file: Path) -> None:
    """Take away what the example has of a building."""
    text = case_file.read_text(encoding="utf-8")
    case = tomllib.loads(text)
    case |= {"title": "New building", "people": case["people"][:1], "building": {"mesh": "building.plan.toml"}}
    case_file.write_text(patched(text, case), encoding="utf-8")
    plan_file.unlink()
    plan_file.with_name("building.plan.toml").write_text(EMPTY, encoding="utf-8")
