"""Accelerations, turns and speeds of people with the default movement model, and steps back over portals."""

from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import KDTree
from shapely import box

from evac.base.arrays import FloatArray
from evac.building.plan.plan import Plan
from evac.evidence.evidence import Evidence, Row
from evac.evidence.people import scenes
from evac.evidence.people.measures import Track
from evac.evidence.people.runs import DEFAULT, MODELS, SETTINGS, follow, simulation_of
from evac.evidence.people.scenes import SCENES, SPEED, Experiment
from evac.evidence.verdicts import Finding, at_most
from evac.physics.state import Crowd, World

#: Scenes of the page on people in which streams cross, meet, turn and merge, and those with a door and with stairs.
COMPARED = (
    *map(scenes.crossing_name, scenes.CROSSING_DENSITIES),
    *(scenes.TWO_WAY_4, scenes.corner_name(2.4), scenes.JUNCTION, scenes.door_name(1.0), scenes.STAIR_DOWN),
)

#: A tower: storeys with people, people on each, and the height of a storey [m].
TOWER, STOREYS, PEOPLE, HEIGHT = "tower", 5, 40, 3.5

RUNS, QUICK_RUNS = 5, 1

#: Greatest acceleration [m/s2], and the share of the moments in which it may be exceeded [%].
ACCELERATION, SHARE = 5.0, 0.05

#: Greatest speed, of the desired one, and greatest way back over a portal [m].
FASTEST, BACK = 1.1, 0.3

#: Speed below which people have no heading [m/s], and time from which on moments count, when all have started [s].
SLOW, STARTED = 0.1, 2.0

SCENES_HEADING, PORTALS = "Scenes", "Steps back over portals"


def tower() -> Experiment:
    """Return a tower with people on all storeys above the ground, two enclosures of stairs and two exits."""
    plan, names = Plan(), [f"storey {number}" for number in range(STOREYS + 1)]
    for number, name in enumerate(names):
        plan.storey(name, box(0, 0, 24, 14), z=HEIGHT * number)
        plan.area(name, name, box(2, 2, 22, 12))
    for side, x, out in (("west", 0.0, -1.0), ("east", 24.0, 1.0)):
        edge = [(x, 7.0 + 0.6 * out), (x, 7.0 - 0.6 * out)]
        plan.shaft(side, names[0], names[-1], edge, direction=(out, 0.0), length=3.0, turn="left")
        plan.exit(side, names[0], [(x, 1.0), (x, 3.0)])
    people = [{"area": name, "number": PEOPLE} for name in names[1:]]
    return Experiment(plan, people, SPEED, lambda track: {})


def comfort(scene: str, model: str, seed: int) -> Row:
    """Return how people move in a run of a scene."""
    experiment = tower() if scene == TOWER else SCENES[scene]()
    simulation = simulation_of(scene, experiment, SETTINGS[DEFAULT], model, seed)
    track, left = follow(simulation, experiment.line)
    moments = measured_moments(track, simulation.population.crowd, simulation.scene.world)
    return {"scene": scene, "model": model, "seed": seed, "left": left, **moments, **steps_back(track)}


def measured_moments(track: Track, crowd: Crowd, world: World) -> Row:
    """Return the moments of people, and in how many of them acceleration, speed or turn are great.

    A moment is a person at a tick, with the ticks before and after it on the same level. It is away from contacts if
    nobody and no wall are so near at these ticks, and for the relaxation time of the person before them, that the two
    could touch within a tick, whatever the direction of their relative velocity.
    """
    moved = np.diff(track.position, axis=0)
    moved[track.level[1:] != track.level[:-1]] = 0.0
    velocity = moved / track.tick
    speed = np.hypot(velocity[..., 0], velocity[..., 1])
    change = np.diff(velocity, axis=0) / track.tick
    acceleration = np.hypot(change[..., 0], change[..., 1])
    is_apart = np.array([_apart(track, moved, k, crowd.contact_radius, world) for k in range(len(track.time))])
    counts = track.inside[1:-1] & (track.time[1:-1] > STARTED)[:, None]
    counts &= (track.level[:-2] == track.level[1:-1]) & (track.level[2:] == track.level[1:-1])
    touched = np.maximum.accumulate(np.where(is_apart, -np.inf, track.time[:, None]))
    away = counts & (track.time[2:, None] - touched[2:] > 2.5 * track.tick + crowd.tau)
    turns = (velocity[:-1] * velocity[1:]).sum(axis=-1) < 0.0
    turns &= (speed[:-1] > SLOW) & (speed[1:] > SLOW)
    share = speed[1:] / crowd.speed[:, 0]
    return {
        "moments": int(counts.sum()),
        "away from contacts": int(away.sum()),
        "accelerations": int((counts & (acceleration > ACCELERATION)).sum()),
        "accelerations away": int((away & (acceleration > ACCELERATION)).sum()),
        "greatest acceleration away [m/s2]": float(acceleration[away].max(initial=0.0)),
        "turns away": int((away & turns).sum()),
        "greatest speed of the desired one away [-]": float(share[away].max(initial=0.0)),
    }


def _apart(track: Track, moved: FloatArray, k: int, radius: FloatArray, world: World) -> NDArray[np.bool_]:
    """Return whether nobody and no wall can touch each person (n,) within a tick, also through a portal."""
    who = np.flatnonzero(track.inside[k])
    level, place = track.level[k], track.position[k]
    apart: NDArray[np.bool_] = track.inside[k].copy()
    if who.size == 0:
        return apart
    way = moved[max(k - 1, 0)]
    length = np.hypot(way[:, 0], way[:, 1])
    joined = np.eye(len(world.cosine), dtype=bool)
    portals = world.link_to >= 0
    joined[np.repeat(np.arange(len(joined)), np.diff(world.link_start))[portals], world.link_to[portals]] = True
    reach = 2.0 * (radius[who].max() + length[who].max())
    first, second = who[KDTree(place[who]).query_pairs(reach, output_type="ndarray")].T
    gap = np.hypot(*(place[first] - place[second]).T) - radius[first] - radius[second]
    near = (gap < np.hypot(*(way[first] - way[second]).T)) & joined[level[first], level[second]]
    apart[first[near]] = apart[second[near]] = False
    is_wall = world.wall_open == 0
    walls = shapely.STRtree(shapely.linestrings(world.wall[is_wall].reshape(-1, 2, 2)))
    points, reached = shapely.points(place[who]), radius[who] + length[who]
    person, wall = walls.query(points, predicate="dwithin", distance=reached)
    touches = joined[level[who[person]], world.wall_level[is_wall][wall]]
    apart[who[person[touches]]] = False
    return apart


def steps_back(track: Track) -> Row:
    """Return how many people step over a portal and back, how many of them far, and how far beyond it at most [m]."""
    ways = np.zeros(track.level.shape[1])
    for person in range(len(ways)):
        level, place = track.level[:, person], track.position[:, person]
        crossed = np.flatnonzero((level[1:] != level[:-1]) & (level[1:] >= 0)) + 1
        for there, back in pairwise(crossed):
            if level[back] == level[there - 1]:
                portal = shapely.LineString([place[there], place[back]])
                away = shapely.distance(shapely.points(place[there:back]), portal)
                ways[person] = max(ways[person], away.max(), 1e-6)
    return {
        "people": len(ways),
        "step back": int((ways > 0.0).sum()),
        "step back far": int((ways > BACK).sum()),
        "greatest way back [m]": float(ways.max(initial=0.0)),
    }


def run(evidence: Evidence) -> None:
    """Make the runs, and write the page."""
    seeds = range(evidence.seed, evidence.seed + (QUICK_RUNS if evidence.quick else RUNS))
    names = (*COMPARED[:1], TOWER) if evidence.quick else (*COMPARED, TOWER)
    models = MODELS[:1] if evidence.quick else MODELS
    jobs = [(scene, model, seed) for scene in names for model in models for seed in seeds]
    rows = evidence.measured("moments", lambda: evidence.map(comfort, jobs))
    sums = [_sum_of(rows, scene, model) for scene in names for model in models]
    portals = [row for row in sums if row["scene"] in (TOWER, scenes.STAIR_DOWN)]
    for finding in verdicts(sums):
        evidence.verdict(finding)
    evidence.show("page", __name__, rows=rows, sums=sums, portals=portals, seeds=seeds)
    evidence.write_page(__name__)


def _sum_of(rows: list[Row], scene: str, model: str) -> Row:
    """Return the moments of all seeds of a scene with a contact model."""
    own = [row for row in rows if (row["scene"], row["model"]) == (scene, model)]
    total = {name: sum(row[name] for row in own) for name, value in own[0].items() if isinstance(value, int)}
    greatest = {name: max(row[name] for row in own) for name in own[0] if name.startswith("greatest")}
    return {
        "scene": scene,
        "model": model,
        "moments away from contacts [%]": 100.0 * total["away from contacts"] / total["moments"],
        "accelerations [%]": 100.0 * total["accelerations"] / total["moments"],
        "away from contacts [%]": 100.0 * total["accelerations away"] / total["away from contacts"],
        "turns": total["turns away"],
        **{name: total[name] for name in ("people", "step back", "step back far")},
        **greatest,
    }


def verdicts(sums: list[Row]) -> list[Finding]:
    """Return the verdicts on the scenes and contact models with the greatest values."""
    quick, slow = f"acceleration above {ACCELERATION:g} m/s2", "away from contacts"
    return [
        at_most(f"{quick}, {slow}: greatest share", _most(sums, "away from contacts [%]"), SHARE, "%", SCENES_HEADING),
        at_most(f"{quick}, all moments: greatest share", _most(sums, "accelerations [%]"), SHARE, "%", SCENES_HEADING),
        at_most(
            f"greatest speed of the desired one, {slow}",
            *(_most(sums, "greatest speed of the desired one away [-]"), FASTEST),
            section=SCENES_HEADING,
        ),
        at_most(
            f"turns by more than 90 degrees within a tick, {slow}",
            *(float(sum(row["turns"] for row in sums)), 0.0),
            section=SCENES_HEADING,
        ),
        at_most(
            f"people who step back over a portal by more than {BACK:g} m",
            *(float(sum(row["step back far"] for row in sums)), 0.0),
            section=PORTALS,
        ),
    ]


def _most(sums: list[Row], name: str) -> float:
    return float(max(row[name] for row in sums))
