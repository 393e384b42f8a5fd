"""The frame that all kinds of evidence share: tables, plots, timings and the page that holds them.

A kind of evidence is a module with ``run(evidence: Evidence) -> None``. It computes, and hands over rows of
plain dicts, figures and sentences in the order of the page:

>>> evidence = Evidence("scaling", folder, quick=True)  # doctest: +SKIP
>>> evidence.text(f"The hall of {people} takes {seconds:.3g} s.")  # doctest: +SKIP
>>> evidence.table("hall", [{"people": people, "time [s]": seconds}], "A hall.")  # doctest: +SKIP
>>> evidence.write_page("Time and memory against the number of people")  # doctest: +SKIP
"""

import csv
import json
import platform
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from os import cpu_count
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from evac.ensemble import in_processes
from evac.people.distributions import generator_for

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Item = TypeVar("Item")
Result = TypeVar("Result")
Row = Mapping[str, Any]

#: Packages whose versions matter to what comes out, and those that only some evidence uses: named where loaded.
PACKAGES = ("evac", "numpy", "scipy", "numba", "scikit-fmm", "shapely", "matplotlib")
OPTIONAL_PACKAGES = ("clarabel", "cromosim", "cvxopt", "pyvista", "vtk")

#: What of a checkout decides what comes out.
CODE = (":/*.py", ":/*.toml", ":/*.msh")

#: Never more processes than this, however many cores there are: a run states times per core.
WORKERS = 2


@dataclass(frozen=True)
class Timing:
    """Wall times of one call, several times over [s]."""

    median: float
    least: float
    greatest: float
    repeats: int
    reference: float  # median time of the reference run, made before each call


class Evidence:
    """One kind of evidence under way: where it writes, whether it is quick, and the page so far.

    Parameters
    ----------
    kind : str
        accuracy, stability, lean, table3, scaling or validation; part of every generator's name.
    folder : Path
        Made if it is not there. Files of the same names are overwritten.
    quick : bool
        Seconds instead of minutes: smaller, fewer; stated on the page.
    seed : int
        All random numbers follow from it and from names.
    """

    def __init__(self, kind: str, folder: Path, quick: bool = False, seed: int = 1) -> None:
        self.kind = kind
        self.folder = folder
        self.quick = quick
        self.seed = seed
        self._page: list[str] = []
        self._first: list[str] = []
        self._charts: list[tuple[str, str]] = []
        self._start = time.perf_counter()
        self._reference = reference_time()
        folder.mkdir(parents=True, exist_ok=True)

    def generator(self, *names: str) -> np.random.Generator:
        """Return a random generator of its own for what the names say."""
        return generator_for(self.seed, "evidence", self.kind, *names)

    def map(self, function: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
        """Return ``[function(item) for item in items]``, in processes unless the run is quick."""
        return list(in_processes(function, items, 1 if self.quick else WORKERS))

    def heading(self, words: str) -> None:
        """Open a section of the page."""
        self._page.append(f"## {words}")

    def text(self, sentences: str) -> None:
        """Add a paragraph; numbers in it are formatted from data, never typed."""
        self._page.append(" ".join(sentences.split()))

    def finding(self, sentence: str, chart: str, caption: str) -> None:
        """Put a sentence at the head of the page, with a chart that is on it; both also stand on the index."""
        self._first.append(" ".join(sentence.split()))
        self._charts.append((chart, caption))

    def table(self, name: str, rows: Sequence[Row], caption: str, formats: Mapping[str, str] | None = None) -> None:
        """Write NAME.csv with full precision and put the table on the page.

        Parameters
        ----------
        name : str
            File name without ending.
        rows : sequence of dicts
            Keys are the columns' headings, with units, in the order of the first row.
        caption : str
            What the table shows, and how it was computed.
        formats : dict, optional
            Format specification of a column on the page, e.g. ``{"time [s]": ".2f"}``; otherwise floats have
            three significant digits.
        """
        self._write_csv(name, rows)
        self._page.append(f"{caption} ([{name}.csv]({name}.csv))")
        self._page.append(markdown_table(rows, formats or {}))

    def data(self, name: str, rows: Sequence[Row], words: str = "The numbers behind it") -> None:
        """Write NAME.csv and only a link to it on the page: for what is too long to read."""
        self._write_csv(name, rows)
        self._page.append(f"{words}: [{name}.csv]({name}.csv)")

    def _write_csv(self, name: str, rows: Sequence[Row]) -> None:
        with (self.folder / f"{name}.csv").open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
            writer.writeheader()
            writer.writerows(rows)

    def plot(self, name: str, figure: "Figure", caption: str) -> None:
        """Write NAME.png and put it on the page."""
        figure.savefig(self.folder / f"{name}.png", dpi=130, metadata={"Software": None})
        self._page.append(f"![{caption}]({name}.png)\n\n*{caption}*")

    def write_page(self, title: str) -> Path:
        """Write README.md: title, what was added in its order, and what it was computed with; also run.json."""
        head = [" ".join(self._first)] if self._first else []
        head += [f"![{caption}]({name}.png)" for name, caption in self._charts]
        page = [*head, *self._page]
        summary = next((part for part in page if not part.startswith(("#", "|", "!"))), "")
        conditions = self.conditions()
        described = {"title": title, "summary": summary, "charts": self._charts, **conditions}
        (self.folder / "run.json").write_text(json.dumps(described, indent=2) + "\n")
        command = f"evac evidence {self.kind}{' --quick' if self.quick else ''}"
        lines = [f"# {title}", f"Recomputed from scratch by `{command}`; nothing on this page is typed by hand."]
        if self.quick:
            lines.append("**Quick run: smaller problems and fewer runs than the full one.**")
        rows = [{"what": key, "value": value} for key, value in conditions.items()]
        lines += [*page, "## Conditions", markdown_table(rows, {})]
        path = self.folder / "README.md"
        path.write_text("\n\n".join(lines) + "\n")
        return path

    def conditions(self) -> dict[str, str]:
        """Return machine, commit, versions, seed and duration."""
        used = [package for package in OPTIONAL_PACKAGES if package in sys.modules]
        versions = ", ".join(f"{package} {_version(package)}" for package in (*PACKAGES, *used))
        return {
            "command": f"evac evidence {self.kind}{' --quick' if self.quick else ''}",
            "seed": str(self.seed),
            "machine": machine(),
            "python": platform.python_version(),
            "commit": commit() or "no checkout",
            "versions": versions,
            "reference run, at start and end [ms]": f"{1e3 * self._reference:.1f}, {1e3 * reference_time():.1f}",
            "wall time [s]": f"{time.perf_counter() - self._start:.0f}",
        }


def markdown_table(rows: Sequence[Row], formats: Mapping[str, str]) -> str:
    """Return rows as a Markdown table: numbers to the right."""
    columns = list(rows[0])
    is_number = {key: any(isinstance(row[key], int | float | np.number) for row in rows) for key in columns}
    rule = "|".join("--:" if is_number[key] else "---" for key in columns)
    lines = ["| " + " | ".join(columns) + " |", f"|{rule}|"]
    for row in rows:
        lines.append("| " + " | ".join(_cell(row[key], formats.get(key, "")) for key in columns) + " |")
    return "\n".join(lines)


def _cell(value: Any, specification: str) -> str:
    """Return a value as a table shows it; None is a dash."""
    if value is None:
        return "-"
    if isinstance(value, str):
        return value.replace("|", "\\|")
    if not specification and isinstance(value, float | np.floating):
        specification = ".3g"
    return format(value, specification)


def claim(what: str, bound: str, target: float, measured: float | None) -> dict[str, Any]:
    """Return the row of a target: ``"at most"`` or ``"at least"`` so much, None where nothing came."""
    met = measured is not None and (measured <= target if bound == "at most" else measured >= target)
    return {"what": what, "target": f"{bound} {target:g}", "measured": measured, "met": "yes" if met else "no"}


def timed(call: Callable[[], Any], repeats: int = 5, prepare: Callable[[], Any] | None = None) -> Timing:
    """Time a call several times over, after one call that is not counted, each beside a reference run.

    Parameters
    ----------
    call : callable
        What is timed.
    repeats : int
        Number of calls that count.
    prepare : callable, optional
        Called before each call, not timed; sets back what the call changes.

    Returns
    -------
    Timing
        Median, extremes, and the reference run's median over the same stretch: where that differs between two
        timings, the machine was busier for one of them.
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
    """Return processor and its clock as far as the platform tells them, cores and system in one line."""
    name = platform.processor() or platform.machine()
    clock = ""
    information = Path("/proc/cpuinfo")
    if information.is_file():
        told: dict[str, str] = {}
        for line in information.read_text().splitlines():
            key, _, value = line.partition(":")
            told.setdefault(key.strip(), value.strip())
        name = told.get("model name", name)
        clock = f" at {float(told['cpu MHz']):.0f} MHz" if "cpu MHz" in told else ""
    return f"{name}{clock}, {cpu_count()} cores, {platform.system()} {platform.machine()}"


def commit(file: Path = Path(__file__)) -> str:
    """Return the commit that a file is checked out from, with ``-dirty`` where code has changed since; or nothing.

    An installed package may lie inside the checkout of something else: only a file that git knows counts. Pages
    that are being recomputed are no code.
    """
    git = ["git", "-C", str(file.resolve().parent)]
    try:
        subprocess.run([*git, "ls-files", "--error-unmatch", file.name], check=True, capture_output=True)
        described = [*git, "describe", "--always", "--abbrev=12"]
        found = subprocess.run(described, check=True, capture_output=True, text=True).stdout.strip()
        changed = subprocess.run([*git, "diff", "--quiet", "HEAD", "--", *CODE], capture_output=True).returncode
    except (OSError, subprocess.CalledProcessError):
        return ""
    return f"{found}-dirty" if changed else found


def _version(package: str) -> str:
    """Return the version of a package; of one that is not installed as a package, what its module says."""
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
MODEL_COLOURS = {
    "DEM": "#0072B2",
    "NSM1 inertial": "#D55E00",
    "NSM1 overdamped": "#E69F00",
    "NSM2": "#009E73",
}
