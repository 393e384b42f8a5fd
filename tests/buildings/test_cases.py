"""The shipped buildings: the mesh is what the script draws, and people of the case's size get through."""

import importlib.util
import tomllib
from pathlib import Path

import meshio
import numpy as np
import pytest
import shapely

import evac
from evac.case import load_case
from evac.simulation.assembly import read_building
from evac.simulation.simulation import Simulation

CASES = Path(__file__).parents[2] / "buildings"


def script(name):
    """Return the module that draws a case."""
    spec = importlib.util.spec_from_file_location(f"draw_{name}", CASES / name / f"draw_{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def read(path):
    return meshio.read(path, file_format="gmsh")


def plans(name, low=-np.inf, high=np.inf):
    """Return the plan of each physical surface of a shipped mesh between two heights."""
    mesh = read(CASES / name / f"{name}.msh")
    tags = {number: tag for tag, (number, dim) in mesh.field_data.items() if dim == 2}
    found = {}
    for block, numbers in zip(mesh.cells, mesh.cell_data["gmsh:physical"], strict=True):
        if block.type == "triangle":
            corners = mesh.points[block.data]
            inside = (corners[:, :, 2].min(axis=1) >= low) & (corners[:, :, 2].max(axis=1) <= high)
            for number in np.unique(numbers[inside]):
                cells = shapely.polygons(corners[inside & (numbers == number)][:, :, :2])
                found[tags[number]] = shapely.union_all([found.get(tags[number]), *cells])
    return found


@pytest.mark.parametrize("name", ["square_room", "classroom", "primary_school"])
def test_shipped_mesh_is_what_the_script_draws(name, tmp_path):
    script(name).draw().write(tmp_path / "drawn.msh")
    shipped, drawn = read_building(CASES / name / f"{name}.msh"), read_building(tmp_path / "drawn.msh")
    assert drawn.findings == shipped.findings == ()
    for array in ("vertices", "walls", "wall_level"):
        assert np.array_equal(getattr(shipped, array), getattr(drawn, array))
    for one, other in zip(shipped.levels, drawn.levels, strict=True):
        assert (one.name, one.kind, one.stair) == (other.name, other.kind, other.stair)
        assert np.array_equal(one.triangles, other.triangles)
        assert one.polygon.equals_exact(other.polygon, 0.0)
    for one, other in zip((*shipped.portals, *shipped.exits), (*drawn.portals, *drawn.exits), strict=True):
        assert one.name == other.name
        assert np.array_equal(one.segments, other.segments)
    for one, other in zip(shipped.areas, drawn.areas, strict=True):
        assert (one.name, one.level) == (other.name, other.level)
        assert one.polygon.equals_exact(other.polygon, 0.0)


def test_square_room_is_that_of_the_paper():
    assert plans("square_room")["floor:room"].equals(shapely.box(0, 0, 5, 5))


def test_classroom_is_that_of_the_paper():
    plan = plans("classroom")
    assert plan["floor:classroom"].area + plan["obstacle:desks"].area == pytest.approx(5.85 * 6.75)
    desks = shapely.get_parts(plan["obstacle:desks"])
    centres = np.round(shapely.get_coordinates(shapely.centroid(desks)), 6)
    columns, rows = np.unique(centres[:, 0]), np.unique(centres[:, 1])
    assert len(desks) == 30
    assert np.diff(columns) == pytest.approx([1.35] * 4)
    assert np.diff(rows) == pytest.approx([0.9] * 5)


def test_every_pupil_of_the_classroom_stands_free_and_reaches_the_door():
    case = tomllib.loads((CASES / "classroom" / "case.toml").read_text())
    (pupils,) = case["people"]
    radius = pupils["radius"]["uniform"][1]
    free = plans("classroom")["floor:classroom"].buffer(-(radius + 0.004))
    starts = shapely.points(pupils["positions"])
    assert len(starts) == 30
    assert isinstance(free, shapely.Polygon)
    assert shapely.covers(free, starts).all()
    assert free.distance(shapely.Point(5.6, 0.0)) < radius + 0.005


@pytest.mark.parametrize("storey", [0, 1, 2])
def test_a_pupil_of_the_school_gets_from_every_desk_to_the_stairs(storey):
    height = 3.3 * storey
    plan = plans("primary_school", height - 0.01, height + 0.01)
    floor = [shape for tag, shape in plan.items() if tag.startswith(("floor:", "area:"))]
    free = shapely.union_all(floor, grid_size=1e-6).buffer(-0.55 / 2)
    assert isinstance(free, shapely.Polygon)
    assert len(free.interiors) == 24
    for letter in "ab":
        assert free.intersects(plan[f"area:teacher_{storey}{letter}"])


def test_the_school_has_six_classes_of_130_pupils_that_follow_six_teachers():
    groups = {
        group["name"]: group for group in tomllib.loads((CASES / "primary_school" / "case.toml").read_text())["people"]
    }
    teachers = {name for name, group in groups.items() if name.startswith("teacher_") and group["number"] == 1}
    classes = {name: group for name, group in groups.items() if name.startswith("class_")}
    assert sum(group["number"] for group in classes.values()) == 130
    assert {group["behaviours"]["teacher_following"]["teacher"] for group in classes.values()} == teachers
    areas = {tag.removeprefix("area:") for tag in plans("primary_school") if tag.startswith("area:")}
    assert {group["area"] for group in groups.values()} == areas


def test_the_reader_finds_the_schools_levels_stairs_and_exit():
    school = read_building(CASES / "primary_school" / "primary_school.msh")
    kinds = [level.kind for level in school.levels]
    assert [kinds.count(kind) for kind in ("floor", "flight", "landing")] == [3, 4, 2]
    assert [portal.width for portal in school.portals] == pytest.approx([1.5] * 8)
    assert [(exit_.name, exit_.width) for exit_ in school.exits] == [("main_door", pytest.approx(1.8))]
    assert {name: len(levels) for name, levels in school.stairs.items()} == {"lower": 3, "upper": 3}
    assert {area.name for area in school.areas} == {
        f"{who}_{storey}{letter}" for who in ("class", "teacher") for storey in range(3) for letter in "ab"
    }
    assert school.warnings == ()


@pytest.mark.parametrize(("name", "width"), [("square_room", 0.82), ("classroom", 0.5)])
def test_the_reader_finds_one_level_and_one_door(name, width):
    room = read_building(CASES / name / f"{name}.msh")
    assert (len(room.levels), len(room.portals), len(room.exits)) == (1, 0, 1)
    assert room.exits[0].width == pytest.approx(width)


def finished(name, **overrides):
    """Return a shipped case's simulation after its run, and the time each person got out."""
    simulation = Simulation(load_case(CASES / name / "case.toml", overrides))
    simulation.run()
    return simulation, simulation.population.crowd.exit_time


@pytest.mark.parametrize("model", ["dem", "nsm1", "nsm2"])
def test_everybody_leaves_the_square_room(model):
    _, exit_time = finished("square_room", **{"contact.model": model})
    assert np.isfinite(exit_time).all()
    assert 3.0 < exit_time.max() < 20.0


def test_a_teacher_who_cannot_move_holds_back_nobody_else():
    still = {f"people.teacher_1a.{key}": 0.0 for key in ("speed", "speed_up", "speed_down")}
    school, exit_time = finished("primary_school", **still, **{"simulation.no_progress": 30.0})
    (teacher,) = next(group.rows for group in school.population.groups if group.name == "teacher_1a")
    assert np.flatnonzero(np.isnan(exit_time)).tolist() == [teacher]


def test_the_drill_is_the_school_with_measured_people():
    paper, drill = (load_case(name) for name in ("primary_school", "primary_school_drill"))
    assert drill.mesh.resolve() == paper.mesh.resolve()
    assert [(one.name, one.count, one.area) for one in drill.people] == [
        (one.name, one.count, one.area) for one in paper.people
    ]
    assert {one.preset for one in drill.people} == {"adult", "child"}
    assert drill.keeps_distance == ["walking"]
    assert not paper.keeps_distance


def test_in_the_drill_no_pupil_leaves_before_its_teacher():
    names = ("0a", "0b", "1a", "1b", "2a", "2b")
    few = {f"people.class_{name}.number": 5 for name in names}
    results = evac.run(load_case("primary_school_drill", {**few, "output.trajectory": False, "simulation.seed": 2}))
    assert results.ended == "everybody out"
    rows = {group.name: group.rows for group in results.groups}
    exit_time, start = results.crowd.exit_time, results.crowd.start_time
    for name in names:
        teacher, pupils = rows[f"teacher_{name}"], rows[f"class_{name}"]
        assert exit_time[pupils].min() > exit_time[teacher[0]]
        assert (start[pupils] == start[teacher[0]]).all()
        assert 3.0 <= start[teacher[0]] <= 59.0


def test_cars_of_the_tower_serve_the_storey_of_the_fire_first():
    coarse = {"output.trajectory": False, "simulation.duration": 20.0, "directions.spacing": 0.3}
    results = evac.run(load_case("tower", coarse))
    rides = [change.values["value"] for change in results.changes if change.values["value"][0] == "leaves"]
    assert rides == [("leaves", "ground", "sixth"), ("leaves", "ground", "eleventh")]


@pytest.mark.slow
def test_everybody_leaves_the_tower_those_in_wheelchairs_by_lift():
    results = evac.run(load_case("tower", {"output.trajectory": False}))
    assert results.ended == "everybody out"
    assert 150.0 < results.last_out < 300.0
    assert 2 <= sum(lift["people"] for lift in results.lifts) <= 25
    assert all(lift["mean_load"] <= 1.0 for lift in results.lifts)
