"""The runs behind the page: a row for each scene, setting, model and seed, which survives an interruption."""

import csv
import math
from collections.abc import Iterator, Mapping
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from time import process_time
from typing import Any, NamedTuple, TextIO

import numpy as np

import evac
from evac.case.loading import load_case
from evac.contract.registry import built_in
from evac.evidence.evidence import Evidence, Row
from evac.evidence.people import measures, scenes
from evac.evidence.people.measures import MEASURES, Line, Track, Values
from evac.evidence.people.scenes import NARROW_DOOR, OF_DEFAULT, SCENES, TWO_WAY_2, Experiment, imo_8_name
from evac.evidence.scenes import model_overrides
from evac.folder.files import digest_of_data, digest_of_file, replacing
from evac.simulation.simulation import Simulation
from evac.standard import plans

#: The movement models: behaviours of the case.
SETTINGS: Mapping[str, Mapping[str, Any]] = {"walking": {"walking": {}}, "headway": {"headway": {}}, "paper": {}}
DEFAULT = "walking"

MODELS = ("NSM2", "NSM1 inertial", "DEM")

#: Number of runs of each, of a quick measurement, and of the default in the scenes in which no run may block.
RUNS, QUICK_RUNS, MANY_RUNS = 10, 3, 100
NEVER_BLOCKED = (NARROW_DOOR, TWO_WAY_2, imo_8_name(100))

#: Longest run, and how long nobody may come nearer to an exit before the run is blocked [s].
DURATION, NO_PROGRESS = 600.0, 60.0

#: Name of the table, and its columns that are not measures; the code comes last, so that a broken line has none.
TABLE = "runs"
KEY = ("scene", "setting", "model", "seed")
LEFT, CODE = "people left", "code"
COLUMNS = (*KEY, LEFT, "CPU time [s]", *MEASURES, CODE)

#: Parts of evac that do not affect the runs.
OTHER_PARTS = ("cli", "conformance", "evidence", "export", "pictures", "replay", "report")


class Job(NamedTuple):
    """A run."""

    scene: str
    setting: str
    model: str
    seed: int

    @property
    def key(self) -> tuple[str, ...]:
        """The first columns of its row."""
        return (self.scene, self.setting, self.model, str(self.seed))


def jobs(quick: bool, seed: int) -> list[Job]:
    """Return all runs of a measurement, the default first."""
    subjects = [(setting, model) for setting in SETTINGS for model in MODELS]
    return [
        Job(scene, setting, model, seed + k)
        for setting, model in (subjects[:1] if quick else subjects)
        for scene in SCENES
        if setting == DEFAULT or scene not in OF_DEFAULT
        for k in range(QUICK_RUNS if quick else _runs(scene, setting, model))
    ]


def _runs(scene: str, setting: str, model: str) -> int:
    return MANY_RUNS if (setting, model) == (DEFAULT, MODELS[0]) and scene in NEVER_BLOCKED else RUNS


def run_job(job: Job) -> Row:
    """Run a scene and return its row: a run in which people are left has no measures."""
    start = process_time()
    values, left = walked(job.scene, SETTINGS[job.setting], job.model, job.seed)
    told = {name: None if math.isnan(value) else value for name, value in values.items()}
    row = dict(zip(KEY, job.key, strict=True)) | {LEFT: left, "CPU time [s]": round(process_time() - start, 2)}
    return row | told | {CODE: code()}


def walked(name: str, behaviours: Mapping[str, Any], model: str, seed: int) -> tuple[Values, int]:
    """Run a scene and return its measures, none if people are left, and how many are."""
    scene = SCENES[name]()
    track, left = follow(simulation_of(name, scene, behaviours, model, seed), scene.line)
    return {} if left else scene.measure(track), left


def simulation_of(name: str, scene: Experiment, behaviours: Mapping[str, Any], model: str, seed: int) -> Simulation:
    """Return the simulation of an experiment with a movement model and a contact model."""
    content = {
        "title": name,
        "building": scene.plan,
        "simulation": {"duration": DURATION, "no_progress": NO_PROGRESS, "seed": seed},
        "output": {"trajectory": False, "replay": False, "picture": False},
        "people": [{"name": f"group {k}", "speed": scene.speed, **group} for k, group in enumerate(scene.people)],
        "behaviours": behaviours,
    }
    return Simulation(load_case(content, model_overrides(model)))


def follow(simulation: Simulation, line: Line | None) -> tuple[Track, int]:
    """Return how people move until everybody is beyond a line, or has left, and how many are not."""
    crowd = simulation.population.crowd  # the same one in all ticks
    times, places, levels = [simulation.time], [crowd.position.copy()], [crowd.level.copy()]
    is_through = np.zeros(len(crowd.level), bool)
    while not (simulation.ended or is_through.all()):
        simulation.advance_tick()
        times.append(simulation.time)
        places.append(crowd.position.copy())
        levels.append(crowd.level.copy())
        is_through = levels[-1] < 0 if line is None else line.beyond(places[-1]) >= 0.0
    exit_time = np.where(np.isfinite(crowd.exit_time), crowd.exit_time, np.nan)
    return Track(np.array(times), np.array(places), np.array(levels), exit_time), int((~is_through).sum())


def measure_runs(evidence: Evidence) -> list[Row]:
    """Make the runs that the table in the folder lacks, and return all of its rows.

    Each row is written when its run has ended. Those of an earlier measurement with the same code are kept.
    """
    path = evidence.folder / f"{TABLE}.csv"
    by_key: dict[tuple[str, ...], Row] = {tuple(row[key] for key in KEY): row for row in _kept(path)}
    wanted = jobs(evidence.quick, evidence.seed)
    missing = [job for job in wanted if job.key not in by_key]
    with replacing(path, "the table") as new, new.open("w", newline="", encoding="utf-8") as file:
        _writer(file).writeheader()
        _writer(file).writerows(by_key.values())
    with path.open("a", newline="", encoding="utf-8") as file:
        for row in evidence.results(run_job, [(job,) for job in missing]):
            _writer(file).writerow(row)
            file.flush()
            by_key[tuple(row[key] for key in KEY)] = row
    first = [by_key.pop(job.key) for job in wanted]
    return [{name: row.get(name) for name in COLUMNS} for row in (*first, *by_key.values())]


def _writer(file: TextIO) -> "csv.DictWriter[str]":
    return csv.DictWriter(file, COLUMNS, lineterminator="\n")


def _kept(path: Path) -> Iterator[dict[str, str]]:
    if path.is_file():
        with path.open(newline="", encoding="utf-8") as file:
            yield from (row for row in csv.DictReader(file) if row.get(CODE) == code())


@cache
def code() -> str:
    """Return a digest of all code that affects the runs: evac without its surface, plugins, scenes and measures."""
    root = Path(evac.__file__).parent
    core = (path for path in root.rglob("*.py") if path.relative_to(root).parts[0] not in OTHER_PARTS)
    plugins = (find_spec(name) for name in built_in())
    files = {
        **{str(path.relative_to(root)): path for path in core},
        **{plugin.name: Path(plugin.origin) for plugin in plugins if plugin and plugin.origin},
        **{module.__name__: Path(str(module.__file__)) for module in (measures, scenes, plans)},
    }
    return digest_of_data({name: digest_of_file(path) for name, path in files.items()})[:12]
