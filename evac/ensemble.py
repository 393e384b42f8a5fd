"""Many runs of one case, each with a seed of its own: how certain a result is."""

import json
import math
import signal
import textwrap
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from multiprocessing import active_children, get_context
from os import cpu_count
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from evac.arrays import FloatArray
from evac.ending import EVERYBODY_OUT
from evac.errors import EvacError, ScenarioError, SimulationError
from evac.output.files import (
    EGRESS_NAME,
    EGRESS_PICTURE_NAME,
    MEDIAN_REPLAY_NAME,
    REPLAY_NAME,
    RUNS_NAME,
    SUMMARY_NAME,
    WORST_REPLAY_NAME,
    writing,
)
from evac.output.resultfolder import ResultFolder
from evac.output.results import plain, versions, write_csv
from evac.scenario.trust import run_plugin_files
from evac.simulation import Simulation

if TYPE_CHECKING:
    from evac.scenario.case import Case

Item = TypeVar("Item")
Result = TypeVar("Result")

#: Of the interval of the mean.
CONFIDENCE = 0.95
#: Windows waits for no more processes than these.
MOST_WORKERS = 61
#: Percentiles of the egress curves, beside their mean.
PERCENTILES = (5, 50, 95)


@dataclass(frozen=True)
class Run:
    """How one run ended."""

    seed: int
    ended: str
    time: float  # simulated [s]
    plugins: tuple[str, ...]  # name and version of each with a part in it
    exit_time: FloatArray  # (people,) [s], NaN for who is still inside
    quality_warnings: tuple[str, ...] = ()  # what its numbers say against it


@dataclass(frozen=True)
class Ensemble:
    """Runs of one case with different seeds.

    Attributes
    ----------
    case : Case
    runs : tuple of Run
        In the order of their seeds.
    """

    case: "Case"
    runs: tuple[Run, ...]

    @property
    def people(self) -> int:
        """Number of people in each run."""
        return len(self.runs[0].exit_time)

    @property
    def plugins(self) -> tuple[str, ...]:
        """Name and version of each plugin with a part in the runs."""
        return self.runs[0].plugins

    @property
    def complete(self) -> tuple[Run, ...]:
        """The runs in which everybody got out."""
        return tuple(run for run in self.runs if run.ended == EVERYBODY_OUT)

    def last_out(self) -> dict[str, dict[str, float]]:
        """Return statistics of the time at which the last person leaves.

        Returns
        -------
        dict of str to dict of str to float [s]
            ``over_runs``: number of ``runs``, ``least`` and ``greatest``, and of two runs or more ``percentile_5``,
            ``percentile_50`` and ``percentile_95``; a run with people left counts as endless, so that any of these
            can be infinite. ``over_complete_runs``: number of ``runs`` in which everybody got out, ``mean`` of these if
            there is one, and of two or more ``standard_deviation``, ``mean_from`` and ``mean_to`` (`mean_interval`).
        """
        last = np.array([_last_out(run) for run in self.runs])
        over_runs = {"runs": last.size, "least": float(last.min()), "greatest": float(last.max())}
        if last.size > 1:
            over_runs |= {f"percentile_{of}": percentile(last, of) for of in PERCENTILES}
        last = last[np.isfinite(last)]
        over_complete: dict[str, float] = {"runs": last.size}
        if last.size:
            over_complete["mean"] = float(last.mean())
        if last.size > 1:
            over_complete["standard_deviation"] = float(last.std(ddof=1))
            over_complete["mean_from"], over_complete["mean_to"] = mean_interval(last)
        return {"over_runs": over_runs, "over_complete_runs": over_complete}

    def egress(self) -> dict[str, FloatArray]:
        """Return mean and percentiles over all runs of the number of people out; who is left in a run is never out.

        Returns
        -------
        dict of str to (k,) float64
            ``time`` [s], every ``output.every`` seconds to the end of the longest run, ``mean_over_runs``, and
            ``percentile_5_over_runs``, ``percentile_50_over_runs`` and ``percentile_95_over_runs``.
        """
        end, every = max(run.time for run in self.runs), self.case.output.every
        time = every * np.arange(math.ceil(end / every * (1.0 - 1e-12)) + 1)
        # NaN sorts last, behind every time.
        out = np.array([np.searchsorted(np.sort(run.exit_time), time, "right") for run in self.runs])
        columns = {"time": time, "mean_over_runs": out.mean(axis=0)}
        for of in PERCENTILES:
            columns[f"percentile_{of}_over_runs"] = np.percentile(out, of, axis=0)
        return columns

    def replay(self, folder: Path) -> list[Path]:
        """Make the median and the worst run again, and write their replays.

        They are those of the (lower) median and of the greatest time at which the last person leaves; runs with people
        left are worse than any other.

        Parameters
        ----------
        folder : Path
            There already.

        Returns
        -------
        list of Path
            ``replay-median.html`` and ``replay-worst.html``; of a single run the first alone.

        Raises
        ------
        EvacError
            As `evac.run`.
        """
        ranked = sorted(self.runs, key=lambda run: (_last_out(run), -np.isfinite(run.exit_time).sum()))
        chosen = {MEDIAN_REPLAY_NAME: ranked[(len(ranked) - 1) // 2], WORST_REPLAY_NAME: ranked[-1]}
        written = []
        for name, run in list(chosen.items())[: len(self.runs)]:
            changes = {"simulation.seed": run.seed, "output.replay": True, "output.animation": False}
            with writing("the replays", folder), TemporaryDirectory(dir=folder) as place:
                Simulation(self.case.change(changes | {"output.trajectory": False}), Path(place)).run()
                written.append((Path(place) / REPLAY_NAME).replace(folder / name))
        return written

    def write(self, folder: str | Path) -> None:
        """Write summary.json, runs.csv, egress.csv and egress.png.

        Parameters
        ----------
        folder : Path
            New, empty, or a result folder of evac, which is replaced.

        Raises
        ------
        ResultError
            The folder is somebody else's, is being written by another run, or cannot be written.
        """
        with ResultFolder(folder) as place:
            place.start()
            self.write_to(place.running)
            place.publish()

    def write_to(self, folder: Path) -> None:
        """As `write`, to a folder that is there already and empty."""
        summary = {
            "title": self.case.title,
            "people": self.people,
            "runs": len(self.runs),
            "complete": len(self.complete),
            "last_out": self.last_out(),
            "case": self.case.to_dict(),
            "plugins": self.plugins,
            "versions": versions(),
        }
        egress = self.egress()
        with writing("the results", folder):
            (folder / SUMMARY_NAME).write_text(json.dumps(plain(summary), indent=2) + "\n", encoding="utf-8")
            write_csv(
                folder / RUNS_NAME, ("seed", "ended", "out", "last_out", "quality_warnings"), map(_row, self.runs)
            )
            rows = zip(*(column.tolist() for column in egress.values()), strict=True)
            write_csv(folder / EGRESS_NAME, egress, rows)
            self._draw(folder / EGRESS_PICTURE_NAME, egress)

    def _draw(self, path: Path, egress: dict[str, FloatArray]) -> None:
        from evac.output.pictures import new_axes, save

        low, median, high = (egress[f"percentile_{of}_over_runs"] for of in PERCENTILES)
        time, mean = egress["time"], egress["mean_over_runs"]
        note = f"{len(self.runs)} runs, everybody out in {len(self.complete)}"
        figure, axes = new_axes(f"{textwrap.fill(self.case.title, 90)}\n{note}", self.people)
        label = f"percentiles {PERCENTILES[0]} to {PERCENTILES[-1]} over runs"
        axes.fill_between(time, low, high, color="#9fb3c8", label=label)
        axes.plot(time, median, color="#486581", linewidth=1.2, linestyle="--", label="median over runs")
        axes.plot(time, mean, color="#1f2933", linewidth=2.0, label="mean over runs")
        axes.set_xlim(0.0, float(time[-1]))
        axes.legend(frameon=False, loc="lower right")
        save(figure, path)


def percentile(times: FloatArray, of: float) -> float:
    """Return a percentile of times of which some may be infinite, linear between neighbours as `numpy.percentile`.

    It is infinite where one of the neighbours that it lies between is.
    """
    ascending = np.sort(times)
    place = 0.01 * of * (len(ascending) - 1)
    lower, upper = ascending[math.floor(place)], ascending[math.ceil(place)]
    return math.inf if np.isinf(upper) else float(lower + (place - math.floor(place)) * (upper - lower))


def mean_interval(values: FloatArray) -> tuple[float, float]:
    """Return the interval of `CONFIDENCE` of the mean of two positive values or more; it is positive.

    With m the mean, s the standard deviation and t the quantile of Student's t for n - 1 degrees of freedom, it goes
    from m / c to m c with c = exp(t sqrt(ln(1 + s^2 / (n m^2)))). Of skewed samples it covers the mean more often than
    m +- t s / sqrt(n), which it tends to where s is small, and than bootstrap intervals, of few values by far.

    References
    ----------
    Buckland et al.: Introduction to Distance Sampling. Oxford University Press (2001), chapter 3, with t for z.
    """
    from scipy.special import stdtrit  # takes a quarter of a second, which the processes of single runs do without

    n, mean = len(values), float(values.mean())
    quantile = float(stdtrit(n - 1, 0.5 + 0.5 * CONFIDENCE))
    factor = math.exp(quantile * math.sqrt(math.log1p(float(values.var(ddof=1)) / (n * mean**2))))
    return mean / factor, mean * factor


def run_many(
    case: "Case", runs: int, *, workers: int | None = None, progress: Callable[[int, int], None] | None = None
) -> Ensemble:
    """Run a case with `runs` seeds, from ``simulation.seed`` on, several at a time.

    Parameters
    ----------
    case : Case
        From `evac.load`.
    runs : int
        At least 1.
    workers : int, optional
        Processes; as many as there are cores by default. Results do not depend on it. With more than one, a script has
        its commands under ``if __name__ == "__main__":``, for each process reads it.
    progress : callable, optional
        Called with the number of runs done and of all of them, whenever one is.

    Returns
    -------
    Ensemble

    Raises
    ------
    EvacError
        As `evac.run`, from the first run that fails; a note tells its seed. Or `runs` or `workers` is below 1.
    """
    if runs < 1 or (workers is not None and workers < 1):
        raise ScenarioError(f"runs and workers must be at least 1, not {runs} and {workers}")
    case = run_plugin_files(case)
    first = case.simulation.seed
    cases = [case.change({"simulation.seed": first + k}) for k in range(runs)]
    found = []
    for run in in_processes(_one, cases, min(workers or cpu_count() or 1, runs)):
        found.append(run)
        if progress is not None:
            progress(len(found), runs)
    return Ensemble(case, tuple(found))


def in_processes(function: Callable[[Item], Result], items: Iterable[Item], workers: int) -> Iterator[Result]:
    """Yield ``function(item) for item in items``, computed in processes; the order is that of the items.

    Parameters
    ----------
    function : callable
        At module level. What it returns depends on the item alone.
    items : iterable
        Picklable. Make each worth a second or more: one call per item.
    workers : int
        Processes; 1 computes in this one.

    Yields
    ------
    What the function returns.

    Raises
    ------
    SimulationError
        A process was killed, or could not start.
    """
    if workers == 1:
        yield from map(function, items)
        return
    before = active_children()
    try:
        with ProcessPoolExecutor(
            min(workers, cpu_count() or 1, MOST_WORKERS),
            mp_context=get_context("spawn"),
            initializer=signal.signal,  # Ctrl-C reaches all processes; this one alone decides what it means
            initargs=(signal.SIGINT, signal.SIG_IGN),
        ) as pool:
            # Not pool.map: it cancels pending futures on interrupt, which makes the broken pool raise again.
            futures = [pool.submit(function, item) for item in items]
            try:
                for future in futures:
                    yield future.result()
            except Exception:
                pool.shutdown(cancel_futures=True)  # what has not begun need not be waited for
                raise
            except BaseException:  # nor, once interrupted, what has
                for process in active_children():
                    if process not in before:
                        process.terminate()
                raise
    except BrokenProcessPool as error:
        raise SimulationError(
            "a process ended before its time: too little memory? use fewer of them. A script that starts processes has "
            "its commands under: if __name__ == '__main__':"
        ) from error


def _one(case: "Case") -> Run:
    try:
        results = Simulation(case).run()
    except EvacError as error:
        error.add_note(f"in the run with simulation.seed = {case.simulation.seed}")
        raise
    plugins, exit_time = tuple(results.plugins), results.crowd.exit_time
    return Run(results.seed, results.ended, results.time, plugins, exit_time, results.quality_warnings)


def _last_out(run: Run) -> float:
    """Return when the last person left [s]; infinite where people are left."""
    return float(run.exit_time.max()) if run.ended == EVERYBODY_OUT else math.inf


def _row(run: Run) -> tuple[Any, ...]:
    last = _last_out(run)
    out = int(np.isfinite(run.exit_time).sum())
    return run.seed, run.ended, out, last if math.isfinite(last) else None, "; ".join(run.quality_warnings)
