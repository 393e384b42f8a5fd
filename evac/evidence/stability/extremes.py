"""The extreme scenes for every contact model, and their verdicts."""

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from evac.base.errors import EvacError
from evac.evidence import scenes
from evac.evidence.evidence import Evidence, Row
from evac.evidence.scenes import Scene
from evac.evidence.stability import trials
from evac.physics.scenes import room, towards
from evac.physics.state import make_crowd

ROOM = (0.0, 0.0, 6.0, 4.0)

STEP = 0.01

#: The models tried on scenes that take long.
LARGE = ("DEM", "NSM1 inertial", "NSM2 K_N = 1e5")

#: How long a crowd presses against a closed door: long enough for 10,000 to have walked up to each other [s].
PRESSED = 12.0


class Extreme(NamedTuple):
    """An extreme scene with its criterion."""

    words: str
    make: Callable[[], Scene]
    verdict: Callable[[str, trials.Trial], trials.Verdict]  # of a contact model's name and its trial
    duration: float = 5.0
    every: float = 0.1
    tolerance: float | None = None  # of the solvers [m/s], where it is not the default


def denser_than_discs() -> Scene:
    """Return a start denser than discs can pack: 40 bodies of 7.9 m2 in all on 4 m2."""
    bounds = (0.0, 0.0, 2.0, 2.0)
    grid = np.linspace(0.26, 1.74, 7)
    places = np.array([(x, y + 0.01 * k) for k, x in enumerate(grid) for y in grid[:6]])[:40]
    return scenes.people_in(bounds, places, radius=0.25, speed=1.0)


def closed_door(people: int) -> Scene:
    """Return people who press against a closed door of 1 m from all over the room."""
    rows = round(np.sqrt(0.75 * people))
    bounds = (0.0, 0.0, 1.0 + 0.37 * (people // rows + 1), 0.42 * (rows + 1))
    middle = 0.5 * bounds[3]
    door = (bounds[2], middle - 0.5, bounds[2], middle + 0.5)
    places = scenes.packed(people, rows, 0.2, bounds[2] - 0.02, 0.02, 0.02)
    building, fields = room(bounds, exits=(door,)), towards(bounds, (bounds[2] + 0.1, middle))
    return Scene(bounds, building, fields, make_crowd(places, speed=1.5), is_closed=True)


def narrow_door() -> Scene:
    """Return twelve people at an open door of 0.3 m, narrower than their bodies of 0.4 m."""
    building = room(ROOM, exits=((6.0, 1.85, 6.0, 2.15),))
    crowd = make_crowd(scenes.packed(12, 4, 0.2, 5.0, 1.0, 0.01), speed=1.5)
    return Scene(ROOM, building, towards(ROOM, (6.2, 2.0)), crowd)


def far_from_origin(gap: float, east: float = 5e5, north: float = 5e6) -> Scene:
    """Return people `gap` [m] apart who walk against a wall, at UTM coordinates."""
    bounds = (east, north, east + 6.0, north + 4.0)
    return scenes.people_in(bounds, scenes.packed(12, 4, 0.2, east + 5.9, north + 1.0, gap), speed=1.5)


def extremes(quick: bool) -> dict[str, Extreme]:
    """Return the extreme scenes by name; quick ones are smaller and shorter."""
    number, hour = (400, 60.0) if quick else (10_000, 3600.0)
    sideways = 0.1 * np.sqrt(2.0 * 1.2e5 / 80.0)  # DEM: the springs' energy of a start 0.1 m off the middle [m/s]
    return {
        "coincident centres": _overlap_to_remove(lambda: scenes.people_in(ROOM, 2 * [(2.0, 2.0)], speed=1.0), 5.0),
        "half-overlapping start": _overlap_to_remove(
            lambda: scenes.people_in(ROOM, [(2.0, 2.0), (2.2, 2.0), (2.1, 2.2), (2.0, 1.8)], speed=1.0), 5.0
        ),
        "denser than discs can pack": _overlap_to_remove(denser_than_discs, 2.0),
        f"{number} people at a closed door": Extreme(
            f"greatest overlap in {PRESSED:g} s, as on the map of speeds",
            lambda: closed_door(number),
            lambda variant, trial: trials.judge_overlap(variant, trial, STEP),
            PRESSED,
            1.0,
        ),
        "door narrower than a body": Extreme(
            "people who came through, right up to 0",
            narrow_door,
            _bounded(lambda trial: float((trial.crowd.level < 0).sum()), 0.0, 0.0, "people"),
            10.0,
        ),
        "squeezed between two walls": Extreme(
            "speed beyond the desired one, right up to 0.02 m/s",
            lambda: scenes.people_in((0.0, 0.0, 6.0, 0.3), [(1.0, 0.15), (2.0, 0.1), (3.0, 0.2)], speed=1.0),
            _bounded(
                lambda trial: max(0.0, float(trial.speed().max() - trial.crowd.speed.max())), 0.02, sideways, "m/s"
            ),
        ),
        "UTM coordinates": Extreme(
            "greatest distance to the same run at the origin, both solved to 1e-9 m/s, right up to 1e-6 m",
            lambda: far_from_origin(0.03),
            _bounded(lambda trial: _far_and_near(trial, 0.03)[0], 1e-6, 1e-6, "m"),
            0.5,
            tolerance=1e-9,
        ),
        "UTM coordinates, touching": Extreme(
            "greatest overlap beyond that of the same run at the origin, right up to 1e-3 m",
            lambda: far_from_origin(0.0),
            _bounded(lambda trial: _far_and_near(trial, 0.0)[1], 1e-3, 1e-3, "m"),
            2.0,
        ),
        f"{hour:g} s against a wall": Extreme(
            "speed in the last second, right up to 0.005 m/s",
            lambda: scenes.people_in((0.0, 0.0, 6.0, 1.8), scenes.packed(20, 4, 0.2, 5.9, 0.0, 0.0), speed=1.5),
            _bounded(trials.last_speed, 0.005, 1.5, "m/s"),
            hour,
            1.0,
        ),
    }


def _bounded(
    measure: Callable[[trials.Trial], float], right: float, tolerable: float, unit: str, is_reported: bool = False
) -> Callable[[str, trials.Trial], trials.Verdict]:
    return lambda _, trial: trials.judge(trial, measure, right, tolerable, unit, is_reported=is_reported)


def _overlap_to_remove(make: Callable[[], Scene], duration: float) -> Extreme:
    """Return the extreme of a start with overlaps, which the theory of a model may allow to remain if reported."""
    scene = make()
    start = trials.deepest_overlap(scene, scene.crowd.position)
    words = f"overlap left after {duration:g} s, right up to {trials.SMALL_OVERLAP:g} m; {start:.3g} m at the start"
    return Extreme(words, make, _bounded(_overlap_left, trials.SMALL_OVERLAP, start, "m", is_reported=True), duration)


def _overlap_left(trial: trials.Trial) -> float:
    """Return the overlap at the end [m], infinite if the report conceals the start's."""
    return trials.last_overlap(trial) if np.isfinite(trials.greatest_overlap(trial)) else np.inf


def _far_and_near(trial: trials.Trial, gap: float) -> tuple[float, float]:
    near = trials.attempt(trial.model, far_from_origin(gap, 0.0, 0.0), STEP, float(trial.time[-1]))
    distance = np.abs(trial.position[-1] - trial.scene.room[:2] - near.position[-1]).max()
    return float(distance), max(0.0, trials.greatest_overlap(trial) - trials.greatest_overlap(near))


def try_extreme(extreme: Extreme, variant: str) -> trials.Verdict:
    """Return the verdict on one extreme scene with one contact model."""
    model = trials.make_model(variant)
    if extreme.tolerance is not None and "velocity_tolerance" in model.declared():
        model = trials.make_model(variant, velocity_tolerance=extreme.tolerance)
    trial = trials.attempt(model, extreme.make(), STEP, extreme.duration, every=extreme.every)
    return extreme.verdict(variant, trial)


#: A building of one triangle: a file in the OFF format, an exit on its side, and five people.
TRIANGLE = "v 0 0 0\nv 6 0 0\nv 0 6 0\nf 1 2 3\n"
DOOR = {"name": "door", "segment": [[0.0, 1.0], [0.0, 2.0]], "z": 0.0}
PLACES = [[2.0, 1.0], [3.0, 1.0], [2.0, 2.0], [1.0, 3.0], [3.0, 2.0]]
VISITORS = {"positions": PLACES, "z": 0.0, "radius": 0.2, "mass": 80.0, "tau": 0.5, "speed": 1.3}


def try_triangle(model: str) -> trials.Verdict:
    """Return the verdict on a building of one triangle with an exit on its side: all five are to get out."""
    from evac.case.loading import load_case
    from evac.simulation.simulation import Simulation

    with tempfile.TemporaryDirectory() as folder:
        mesh = Path(folder) / "triangle.obj"
        mesh.write_text(TRIANGLE)
        content = {
            "building": {"mesh": str(mesh), "exits": [DOOR]},
            "people": [{"name": "visitors", **VISITORS}],
            "contact": {"model": model},
            "simulation": {"duration": 30.0},
        }
        try:
            simulation = Simulation(load_case(content))
            simulation.run()
        except EvacError as error:
            return trials.Verdict(trials.REFUSED, np.nan, str(error))
    inside = float(simulation.population.inside)
    kind = trials.RIGHT if inside == 0.0 else trials.WRONG
    return trials.Verdict(kind, inside, f"{inside:.0f} of 5 still inside after 30 s")


def extreme_scenes(evidence: Evidence) -> list[str]:
    """Try every extreme scene with every contact model and tabulate the verdicts."""
    rows = evidence.measured("extremes", _scene_rows, evidence.quick)
    evidence.show("extreme_scenes", __name__, rows=rows)
    return [row["verdict"] for row in rows]


def _scene_rows(quick: bool) -> list[Row]:
    rows = []
    for name, extreme in extremes(quick).items():
        variants = trials.VARIANTS if extreme.make().crowd.radius.size < 1000 and extreme.duration < 1000.0 else LARGE
        rows += [(name, variant, extreme.words, try_extreme(extreme, variant)) for variant in variants]
    for model in ("dem", "nsm1", "nsm2"):
        rows.append(("building of one triangle", model, "people still inside after 30 s", try_triangle(model)))
    columns = ("scene", "model", "verdict", "judged by", "error", "words")
    return [
        dict(zip(columns, (scene, model, outcome.kind, by, outcome.error, outcome.words), strict=True))
        for scene, model, by, outcome in rows
    ]
