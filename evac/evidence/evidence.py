"""Common parts of all kinds of evidence: measured tables, plots, timings and the page with them.

A kind of evidence is a package with ``page.run(evidence: Evidence) -> None`` and the template of its page, ``page.md``.
It passes a function that measures, and writes the page from the returned rows. Rows are stored as CSV files and read
from them, so that the page can be written again without measuring:

>>> evidence = Evidence("scaling", folder)  # doctest: +SKIP
>>> rows = evidence.measured("hall", lambda: [{"people": people, "time [s]": walk(people)}])  # doctest: +SKIP
>>> evidence.verdict(at_most("Time of the hall", rows[0]["time [s]"], 2.0, "s", "The hall"))  # doctest: +SKIP
>>> evidence.show("hall", __name__, rows=rows)  # doctest: +SKIP
>>> evidence.write_page(__name__)  # doctest: +SKIP
"""

import csv
import json
import platform
import re
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cache
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from itertools import starmap
from os import cpu_count
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined

from evac.base.arrays import FloatArray
from evac.base.distributions import generator_for
from evac.base.errors import ResultError
from evac.evidence.verdicts import Finding, verdict_table
from evac.folder.files import replacing
from evac.jit.loading import cores
from evac.standard.verify import QUIET, commit, in_processes, write_rows

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from evac.case.case import Case
    from evac.study.study import Study

Result = TypeVar("Result")
Row = dict[str, Any]

#: Packages whose versions affect the results, and those used only by some evidence, which are listed if imported.
PACKAGES = ("evac", "numpy", "scipy", "numba", "llvmlite", "scikit-fmm", "shapely", "matplotlib")
OPTIONAL_PACKAGES = ("clarabel", "cromosim", "cvxopt", "jupedsim", "pyrvo", "pyvista", "vtk")

#: Number of processes, the same on all machines so that times per core are comparable.
WORKERS = 2

#: Conditions of the measurement that are stored in run.json and shown on the page below its verdicts.
REFERENCE = "reference run, at start and end [ms]"
CONDITIONS = ("command", "seed", "machine", "python", "commit", "versions", REFERENCE, "wall time [s]")


class Timing(NamedTuple):
    """Wall times of repeated calls [s]."""

    median: float
    least: float
    greatest: float
    repeats: int
    reference: float  # median time of the reference run, made before each call


class Evidence:
    """The measurement of one kind of evidence: its folder, settings, and the page so far.

    A quick run has smaller and fewer cases, which the page says; the seed is that of all random numbers, together with
    names. With `page_only` nothing is measured or drawn: the page is written from the tables and run.json of an earlier
    run in the folder, whose `quick` and `seed` it has, and a missing file is a `ResultError`.
    """

    def __init__(self, kind: str, folder: Path, quick: bool = False, seed: int = 1, page_only: bool = False) -> None:
        self.kind = kind
        self.folder = folder
        self.page_only = page_only
        self._page: list[str] = []
        self._findings: list[Finding] = []
        self._stored: set[str] = set()
        if page_only:
            earlier = json.loads(self._earlier("run.json").read_text())
            self._conditions = {key: earlier[key] for key in CONDITIONS}
            self.quick, self.seed = earlier["command"].endswith("--quick"), int(earlier["seed"])
            return
        self.quick, self.seed = quick, seed
        self._start = time.perf_counter()
        self._reference = reference_time()
        folder.mkdir(parents=True, exist_ok=True)

    def generator(self, *names: str) -> np.random.Generator:
        """Return a random generator determined by the seed and the names."""
        return generator_for(self.seed, "evidence", self.kind, *names)

    def map(self, function: Callable[..., Result], tasks: Iterable[tuple[Any, ...]]) -> list[Result]:
        """Return ``[function(*task) for task in tasks]``, in processes unless the run is quick."""
        return list(self.results(function, tasks))

    def results(self, function: Callable[..., Result], tasks: Iterable[tuple[Any, ...]]) -> Iterator[Result]:
        """Yield what `map` returns, each result when it and those before it are there."""
        if self.quick:
            yield from starmap(function, tasks)
            return
        remedy = "make the evidence again, or a part of it with --quick"
        yield from in_processes(function, tasks, min(WORKERS, cores()), f"evidence of {self.kind}", remedy)

    def study(self, case: "Case", runs: int, **settings: Any) -> "Study":
        """Return a study of a case, as `evac.repeat`, with the seed of the case and the following ones."""
        from evac.study.api import repeat

        return repeat(case, runs, workers=1 if self.quick else WORKERS, **settings)

    def exit_times(self, case: "Case", runs: int) -> FloatArray:
        """Return the exit times (runs, people) [s] of a case with the seed of the evidence and the following ones.

        They are NaN for people who are left.
        """
        study = self.study(case.change({"simulation.seed": self.seed}), runs)
        return np.array([row["exit_time"] for row in study.rows(columns=["exit_time"])])

    def measured(self, name: str, measure: Callable[..., Iterable[Row]], *arguments: Any) -> list[Row]:
        """Measure, write NAME.csv with full precision, and return its rows; with `page_only` only read them.

        Rows are read from the file in both cases: integers, floats and text; None for an empty field.
        """
        self._stored.add(name)
        if not self.page_only:
            write_rows(self.folder / f"{name}.csv", list(measure(*arguments)))
        with self._earlier(f"{name}.csv").open(newline="", encoding="utf-8") as file:
            return [{key: _read(text) for key, text in row.items()} for row in csv.DictReader(file)]

    def verdict(self, finding: Finding) -> None:
        """Add a row to the verdict table at the head of the page."""
        self._findings.append(finding)

    def show(self, block: str, module: str, **values: Any) -> None:
        """Add a block of the template of the page, which knows the constants of a module and the values.

        The template is page.md in the package of the kind. Numbers are never typed into it. Beside `table`, `data` and
        `plot` it has ``imported``, for the constants of other modules, and the filter ``told``, which formats a number
        by a specification, ``"g"`` by default.
        """
        self._page += self._rendered(block, module, values)

    def _rendered(self, block: str, module: str, values: Row) -> list[str]:
        template = templates().get_template(f"{self.kind}/page.md")
        own = {"table": self.table, "data": self.data, "plot": self.plot}
        context = template.new_context({**vars(import_module(module)), **own, **values})
        return paragraphs("".join(template.blocks[block](context)))

    def add(self, text: str) -> None:
        """Add Markdown to the page; the lines of a paragraph are joined."""
        self._page += paragraphs(text)

    def table(
        self, name: str, rows: Sequence[Row], formats: Mapping[str, str] | None = None, columns: Sequence[str] = ()
    ) -> str:
        """Return a table and the link to its file, which follow its caption; write NAME.csv unless it was measured.

        The keys of the first row are the headings of the columns, with units. `formats` has format specifications of
        columns, such as ``{"time [s]": ".2f"}``; other floats have three significant digits. `columns` are those of the
        file that the page shows, by default all.
        """
        self._store(name, rows)
        shown = [{key: row[key] for key in columns or row} for row in rows]
        return f"([{name}.csv]({name}.csv))\n\n{markdown_table(shown, formats or {})}"

    def data(self, name: str, rows: Sequence[Row]) -> str:
        """Return a link to NAME.csv, for long tables, and write it unless it was measured."""
        self._store(name, rows)
        return f"[{name}.csv]({name}.csv), {len(rows)} rows."

    def plot(self, name: str, caption: str, draw: Callable[..., "Figure"], *data: Any) -> str:
        """Return the figure NAME.png with its caption; draw it from the data, unless only the page is written."""
        if not self.page_only:
            with replacing(self.folder / f"{name}.png", "the figure") as new:
                draw(*data).savefig(new, dpi=130, metadata={"Software": None})
        return f"![{caption}]({name}.png)\n\n*{caption}*"

    def write_page(self, module: str, **values: Any) -> Path:
        """Write README.md and run.json: the subject, the verdicts, the conditions, and everything added, in order.

        Title and subject are the block ``head`` of the template, see `show`.
        """
        title, examined = self._rendered("head", module, values)
        conditions = self.conditions()
        described = {"title": title[2:], "examined": examined, "verdicts": self._findings, **conditions}
        write_whole(self.folder / "run.json", json.dumps(described, indent=2))
        text = (
            f"Measured by `{conditions['command']}` in {conditions['wall time [s]']} s: {conditions['machine']}; commit"
            f" {conditions['commit']}, seed {conditions['seed']}; python {conditions['python']},"
            f" {conditions['versions']}; {REFERENCE}: {conditions[REFERENCE]}."
            f" `evac evidence {self.kind} --page-only` writes this page again from the tables beside it."
        )
        if self.quick:
            text = f"**Quick run: smaller problems and fewer runs than the full one.** {text}"
        lines = [title, examined, verdict_table(self._findings), text, *self._page]
        return write_whole(self.folder / "README.md", "\n\n".join(lines))

    def conditions(self) -> dict[str, str]:
        """Return machine, commit, versions, seed and duration of the run that measured."""
        if self.page_only:
            return self._conditions
        used = [package for package in OPTIONAL_PACKAGES if package in sys.modules]
        versions = ", ".join(f"{package} {_version(package)}" for package in (*PACKAGES, *used))
        values = (
            f"evac evidence {self.kind}{' --quick' if self.quick else ''}",
            str(self.seed),
            machine(),
            platform.python_version(),
            commit() or "no checkout",
            versions,
            f"{1e3 * self._reference:.1f}, {1e3 * reference_time():.1f}",
            f"{time.perf_counter() - self._start:.0f}",
        )
        return dict(zip(CONDITIONS, values, strict=True))

    def _store(self, name: str, rows: Sequence[Row]) -> None:
        if name not in self._stored:
            self._stored.add(name)
            write_rows(self.folder / f"{name}.csv", rows)

    def _earlier(self, name: str) -> Path:
        path = self.folder / name
        if not path.is_file():
            raise ResultError(f"{path}: no such file; run `evac evidence {self.kind}` without --page-only first")
        return path


@cache
def templates() -> Environment:
    """Return the templates of the pages, in Markdown."""
    environment = Environment(loader=PackageLoader("evac", "evidence"), undefined=StrictUndefined, trim_blocks=True)
    environment.globals["imported"] = import_module
    environment.filters["told"] = lambda value, specification="g": format(value, specification)
    return environment


def paragraphs(text: str) -> list[str]:
    """Return the paragraphs of Markdown, with the lines of each joined except for those of tables."""
    parts = re.split(r"\n\s*\n", text.strip())
    return [part if part.startswith("|") else " ".join(part.split()) for part in parts]


def in_fresh_process(function: Callable[..., Result], *arguments: Any) -> Result:
    """Return what a function returns in a process of its own."""
    from evac.base.processes import Pool

    with Pool(1, *QUIET) as pool:
        return pool.submit(function, *arguments).result()


def _read(text: str) -> Any:
    if not text:
        return None
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text


def markdown_table(rows: Sequence[Row], formats: Mapping[str, str]) -> str:
    """Return rows as a Markdown table with numbers aligned to the right."""
    columns = list(rows[0])
    is_number = {key: not any(isinstance(row[key], str) for row in rows) for key in columns}
    rule = "|".join("--:" if is_number[key] else "---" for key in columns)
    lines = ["| " + " | ".join(columns) + " |", f"|{rule}|"]
    for row in rows:
        lines.append("| " + " | ".join(_cell(row[key], formats.get(key, "")) for key in columns) + " |")
    return "\n".join(lines)


def _cell(value: Any, specification: str) -> str:
    if value is None:
        return "-"
    if isinstance(value, str):
        return value.replace("|", "\\|")
    if not specification and isinstance(value, float | np.floating):
        specification = ".3g"
    return format(value, specification)


def timed(call: Callable[[], Any], repeats: int = 5, prepare: Callable[[], Any] | None = None) -> Timing:
    """Time a call repeatedly, after one call that is not counted, each next to a reference run.

    `prepare` is called before each call without being timed; it restores what the call changes. If the times of the
    reference runs differ between two timings, the machine was busier in one of them.
    """
    spans, references = [], []
    for repeat in range(repeats + 1):
        if prepare is not None:
            prepare()
        reference = reference_time(1)
        start = time.perf_counter()
        call()
        span = time.perf_counter() - start
        if repeat:
            spans.append(span)
            references.append(reference)
    return Timing(float(np.median(spans)), min(spans), max(spans), repeats, float(np.median(references)))


def reference_time(repeats: int = 5) -> float:
    """Return the median time of a fixed piece of work on one core [s]: sorting a million numbers."""
    numbers = np.random.default_rng(0).random(1_000_000)
    spans = []
    for _ in range(repeats):
        start = time.perf_counter()
        np.sort(numbers)
        spans.append(time.perf_counter() - start)
    return float(np.median(spans))


def machine() -> str:
    """Return processor and clock if known, cores and system in one line."""
    name = platform.processor() or platform.machine()
    clock = ""
    information = Path("/proc/cpuinfo")
    if information.is_file():
        facts: dict[str, str] = {}
        for line in information.read_text().splitlines():
            key, _, value = line.partition(":")
            facts.setdefault(key.strip(), value.strip())
        name = facts.get("model name", name)
        clock = f" at {float(facts['cpu MHz']):.0f} MHz" if "cpu MHz" in facts else ""
    return f"{name}{clock}, {cpu_count()} cores, {platform.system()} {platform.machine()}"


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return str(getattr(sys.modules.get(package), "__version__", "of unknown version"))


def new_figure(
    width: float = 7.0, height: float = 4.5, rows: int = 1, columns: int = 1, **settings: Any
) -> tuple["Figure", Any]:
    """Return a figure and its axes (one, or an array) [inches]; matplotlib's object interface, no screen.

    ``settings`` go to ``Figure.subplots``, e.g. ``sharex=True``.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    axes = figure.subplots(rows, columns, **settings)
    for axis in np.ravel(axes):
        axis.grid(True, color="0.9", linewidth=0.6)
        axis.set_axisbelow(True)
        axis.spines[["top", "right"]].set_visible(False)
    return figure, axes


#: One colour per contact model, in all plots (Okabe-Ito, readable by colour-blind people).
MODEL_COLOURS = {"DEM": "#0072B2", "NSM1 inertial": "#D55E00", "NSM1 overdamped": "#E69F00", "NSM2": "#009E73"}


def write_whole(path: Path, text: str) -> Path:
    """Write a text and a line feed to a file, which it replaces as a whole."""
    with replacing(path, "the evidence") as new:
        new.write_text(f"{text}\n", encoding="utf-8")
    return path
