"""A hand-made building of three storeys, and crowds in it."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from shapely.geometry import box

from evac.building.model.building import Area, Building, Exit, Level, Portal
from evac.case.loading import load_case
from evac.directions.routes import Route
from evac.folder.files import TRAJECTORY_NAME
from evac.physics.state import Crowd
from evac.results.results import results_of
from evac.trajectory.trajectory import TrajectoryWriter, building_to_json, read_trajectory


def rectangle(x1, x2, y1, y2, z_at_x1, z_at_x2):
    return [[x1, y1, z_at_x1], [x2, y1, z_at_x2], [x2, y2, z_at_x2], [x1, y2, z_at_x1]]


def outline(x1, x2, y1, y2):
    return [[x1, y1, x2, y1], [x2, y1, x2, y2], [x2, y2, x1, y2], [x1, y2, x1, y1]]


def three_storeys(shift=(0.0, 0.0)):
    """Floors at 0, 3 and 6 m: floor 0 -flight-> floor 1 (beside it) -flight-> floor 2 (above floor 0)."""
    plates = [
        ("floor 0", "floor", 0.0, 10.0, 0.0, 6.0, 0.0, 0.0),
        ("flight 1", "flight", 10.0, 14.0, 0.0, 2.0, 0.0, 3.0),
        ("floor 1", "floor", 14.0, 24.0, 0.0, 6.0, 3.0, 3.0),
        ("flight 2", "flight", 10.0, 14.0, 2.0, 4.0, 6.0, 3.0),
        ("floor 2", "floor", 0.0, 10.0, 0.0, 6.0, 6.0, 6.0),
    ]
    move = np.array([shift[0], shift[1], 0.0])
    vertices, levels, walls, wall_level = [], [], [], []
    for index, (name, kind, x1, x2, y1, y2, za, zb) in enumerate(plates):
        first = 4 * index
        vertices += rectangle(x1, x2, y1, y2, za, zb)
        walls += [wall for wall in outline(x1, x2, y1, y2) if kind == "floor" or wall[0] != wall[2]]
        wall_level += [index] * (4 if kind == "floor" else 2)
        levels.append(
            Level(
                index=index,
                name=name,
                kind=kind,
                stair="lower" if index == 1 else "upper" if index == 3 else None,
                triangles=np.array([[first, first + 1, first + 2], [first, first + 2, first + 3]], np.int32),
                polygon=box(x1 + shift[0], y1 + shift[1], x2 + shift[0], y2 + shift[1]),
                uphill=np.array([np.sign(zb - za), 0.0]),
                slope=float(np.arctan2(abs(zb - za), x2 - x1)),
                z_min=min(za, zb),
                z_max=max(za, zb),
            )
        )
    ends = np.array([shift[0], shift[1], shift[0], shift[1]])

    def portal(index, first, second, segment):
        return Portal(index, f"portal {index}", (first, second), np.array([segment]) + ends, 2.0)

    return Building(
        source=Path("three_storeys.msh"),
        vertices=np.array(vertices) + move,
        levels=tuple(levels),
        portals=(
            portal(0, 0, 1, [10.0, 0.0, 10.0, 2.0]),
            portal(1, 1, 2, [14.0, 0.0, 14.0, 2.0]),
            portal(2, 2, 3, [14.0, 4.0, 14.0, 2.0]),
            portal(3, 3, 4, [10.0, 4.0, 10.0, 2.0]),
        ),
        exits=(Exit(0, "door", 0, np.array([[0.0, 2.0, 0.0, 1.0]]) + ends, 1.0),),
        areas=(Area("room", 4, box(shift[0], shift[1], shift[0] + 5.0, shift[1] + 6.0)),),
        walls=np.array(walls) + ends,
        wall_level=np.array(wall_level, np.int32),
        stairs={"lower": (1,), "upper": (3,)},
    )


def crowd_at(position, level, velocity=None, exit_time=None):
    """Everybody of radius 0.2 m; who has an exit time used exit 0."""
    n = len(level)
    exit_time = np.full(n, np.nan) if exit_time is None else np.array(exit_time)
    return Crowd(
        position=np.array(position, float),
        velocity=np.zeros((n, 2)) if velocity is None else np.array(velocity, float),
        level=np.array(level, np.int32),
        radius=np.full(n, 0.2),
        contact_radius=np.full(n, 0.2),
        height=np.full(n, 1.7),
        mass=np.full(n, 80.0),
        tau=np.full(n, 0.5),
        speed=np.tile([1.0, 0.6, 0.8], (n, 1)),
        group=np.zeros(n, np.int32),
        start_time=np.arange(n) * 1.5,
        route=np.zeros(n, np.int32),
        speed_factor=np.ones(n),
        extra_direction=np.zeros((n, 2)),
        exit_time=exit_time,
        exit_used=np.where(np.isfinite(exit_time), 0, -1).astype(np.int32),
        distance=np.arange(n) * 10.0,
        overlap=np.zeros(n),
        mingled=np.zeros(n, np.uint8),
        contact_force=np.arange(n) * 100.0,
        arrival_time=np.zeros(n),
        passing=np.full(n, -1, np.int32),
        ahead=np.zeros((n, 2)),
        firmness=np.ones(n),
    )


@pytest.fixture
def building():
    return three_storeys()


@pytest.fixture
def descent(tmp_path):
    """A written trajectory: person k starts on storey 2 - k % 3; person 0 walks down; frames 0.5 s apart."""

    def write(people=4, frames=5, shift=(0.0, 0.0)):
        building = three_storeys(shift)
        header = {
            "title": "Three storeys",
            "groups": ["even", "odd"],
            "group": [p % 2 for p in range(people)],
            "radius": [0.2] * people,
            "height": [1.7] * people,
            "building": building_to_json(building),
        }
        path = tmp_path / TRAJECTORY_NAME
        writer = TrajectoryWriter(path, header, np.array(shift))
        crowds = []
        for k in range(frames):
            level = [4 - 2 * (p % 3) for p in range(people)]
            position = [[(15.0 if at == 2 else 1.0) + 0.01 * k, 0.5 + 0.25 * (p % 20)] for p, at in enumerate(level)]
            level[0], position[0] = 3, [10.5 + 0.5 * k, 3.0]
            if k == frames - 1:
                level[-1] = -1
            crowds.append(crowd_at(np.array(position) + shift, level, velocity=[[1.0, 0.0]] * people))
            writer.append(0.5 * k, crowds[-1], crowds[-1].velocity)
        writer.close()
        return SimpleNamespace(path=path, building=building, crowds=crowds)

    return write


@pytest.fixture
def written(tmp_path, building):
    """Return a function that writes a trajectory on the three storeys and reads it.

    Positions are (frames, people, 2), levels (frames, people) or one for all, -1 for people who are out; velocities
    are those between frames.
    """

    def write(position, level=0, interval=1.0, radius=0.2, force=0.0):
        position = np.array(position, float)
        frames, people = position.shape[:2]
        level = np.broadcast_to(np.array(level, np.int32), (frames, people))
        header = {
            "title": "Three storeys",
            "groups": ["all"],
            "group": [0] * people,
            "radius": [radius] * people,
            "height": [8.0 * radius] * people,
            "building": building_to_json(building),
        }
        velocity = np.gradient(position, interval, axis=0) if frames > 1 else np.zeros_like(position)
        writer = TrajectoryWriter(tmp_path / "written.evac", header, np.zeros(2))
        for k in range(frames):
            crowd = crowd_at(position[k], level[k])
            crowd.contact_force[:] = force
            writer.append(k * interval, crowd, velocity[k])
        writer.close()
        return read_trajectory(tmp_path / "written.evac")

    return write


@pytest.fixture
def first_out(tmp_path, building):
    """A written trajectory of one frame, in which the first of three different people is out."""
    header = {
        "title": "Three people",
        "groups": ["a", "b", "c"],
        "group": [2, 0, 1],
        "radius": [0.2, 0.3, 0.4],
        "height": [1.6, 1.7, 1.8],
        "building": building_to_json(building),
    }
    writer = TrajectoryWriter(tmp_path / TRAJECTORY_NAME, header, np.zeros(2))
    writer.append(0.0, crowd_at([[1.0, 1.0], [2.0, 2.0], [3.0, 3.0]], [-1, 0, 0]), np.zeros((3, 2)))
    writer.close()
    return tmp_path / TRAJECTORY_NAME


@pytest.fixture
def make_results(building):
    """Return a function that gives results, of which some data can be changed.

    Five people of two groups, two crossings of a flight each for two of them; the last person stays.

    Person 0: storey 0, out at 4 s. Person 1: storey 1, down the lower flight from 2 to 6 s, out at 9 s.
    Person 2: storey 2, down the upper flight from 1 to 5 s, stays on storey 1. Persons 3 and 4: storey 2;
    person 4 steps onto the upper flight at 3 s and back at 3.5 s.
    """
    log = [(2, 3, 1.0), (1, 1, 2.0), (4, 3, 3.0), (4, 3, 3.5), (2, 2, 5.0), (1, 0, 6.0)]
    position = [[0.0, 1.5], [0.0, 1.5], [16.0, 3.0], [2.0, 5.0], [9.0, 3.0]]
    data = dict(
        case=load_case("square_room", {"title": "Three storeys"}),
        building=building,
        crowd=crowd_at(position, [-1, -1, 2, 4, 4], exit_time=[4.0, 9.0, np.nan, np.nan, np.nan]),
        groups=(
            SimpleNamespace(name="low", rows=np.array([0, 1], np.int32)),
            SimpleNamespace(name="high", rows=np.array([2, 4], np.int32)),
        ),
        routes=(Route(exits=("door",), strategy="shortest"),),
        start_position=np.arange(10.0).reshape(5, 2),
        start_level=np.array([0, 2, 4, 4, 4], np.int32),
        crossings=(
            np.array([row for row, _, _ in log], np.int32),
            np.array([link for _, link, _ in log], np.int32),
            np.array([time for _, _, time in log]),
        ),
        ended="no progress",
        time=20.0,
        steps=2000,
        seed=7,
        stuck=(3,),
        warnings=("a narrow place",),
        report={
            "model": "dem",
            "parameters": {},
            "greatest_overlap": np.float64(1e-4),
            "greatest_overlap_at": {"time": 3.21, "person": 2, "level": "floor 1", "x": 9.5, "y": 3.0},
            "promised_overlap": 0.1,
            "residual": np.nan,
            "unconverged_steps": 0,
            "failed_position_corrections": 0,
            "failed_solves": 0,
            "energy": {"driving_work": 0.0, "contact_dissipation": 0.0, "contact_creation": 0.0},
        },
        seen={},
        phases={"contact": 1.5},
        plan=(("social force", "out", "no force is in use"),),
        plugins=("dem",),
        metrics={"density": {"greatest": np.float64(3.0)}},
    )

    return lambda **changes: results_of(**data | changes)


@pytest.fixture
def results(make_results):
    return make_results()
