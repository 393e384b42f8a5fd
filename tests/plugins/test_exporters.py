"""What exporters write, read with the programs that it is for."""

import csv
import json
import sqlite3
from types import SimpleNamespace

import numpy as np
import pytest
from pyarrow import parquet
from shapely.geometry import shape

from evac import Plan, read_building
from evac.analysis.tables import MOTION_COLUMNS
from evac.base.errors import ResultError
from evac.contract.registry import Registry, built_in
from evac.export.exporter import export, file_stems
from evac.trajectory.trajectory import read_trajectory

pedpy = pytest.importorskip("pedpy")
EXPORTERS = Registry(builtins=built_in("exporter")).exporters


@pytest.fixture(scope="module")
def trajectory(tmp_path_factory):
    """Two seconds of the shipped school."""
    import evac

    folder = tmp_path_factory.mktemp("school")
    evac.run(
        evac.load("primary_school", {"simulation.duration": 2.0, "output.animation": False, "output.replay": False}),
        folder / "result",
    )
    return read_trajectory(folder / "result")


def test_jupedsim_files_are_read_by_pedpy(trajectory, tmp_path):
    files = {path.stem: path for path in export(trajectory, EXPORTERS["jupedsim"](), tmp_path / "out")}
    levels = {name for k in range(len(trajectory)) for name in np.unique(trajectory.level[k]).tolist()} - {-1}
    assert len(files) == len(levels)
    for name in ("ground", "first", "second"):
        motion = pedpy.load_trajectory_from_jupedsim_sqlite(trajectory_file=files[name])
        area = pedpy.load_walkable_area_from_jupedsim_sqlite(trajectory_file=files[name])
        level = trajectory.building.level_named(name)
        assert area.area == pytest.approx(level.polygon.area)
        assert motion.frame_rate == 2.0
        people = motion.data[motion.data.frame == 3]
        there = trajectory.level[3] == level.index
        assert people.id.tolist() == np.flatnonzero(there).tolist()
        np.testing.assert_array_equal(people[["x", "y"]], trajectory.position[3, there])


def test_jupedsim_files_have_the_schema_of_version_2(trajectory, tmp_path):
    (path, *_) = export(trajectory, EXPORTERS["jupedsim"](), tmp_path)
    base = sqlite3.connect(path)
    metadata = dict(base.execute("SELECT key, value FROM metadata"))
    assert metadata["version"] == "2"
    assert {"fps", "xmin", "xmax", "ymin", "ymax"} < set(metadata)
    frames = base.execute("SELECT frame, geometry_hash FROM frame_data ORDER BY frame").fetchall()
    assert [frame for frame, _ in frames] == list(range(5))
    assert {key for _, key in frames} == {base.execute("SELECT hash FROM geometry").fetchone()[0]}
    assert base.execute("SELECT wkt FROM geometry").fetchone()[0].startswith("GEOMETRYCOLLECTION (POLYGON")
    lengths = base.execute("SELECT ori_x * ori_x + ori_y * ori_y FROM trajectory_data").fetchall()
    np.testing.assert_allclose(lengths, 1.0)
    base.close()


def test_pedpy_takes_a_level_in_one_call(trajectory):
    motion, area = trajectory.to_pedpy("ground")
    assert motion.number_pedestrians == (trajectory.level[0] == 0).sum()
    assert area.area == pytest.approx(trajectory.building.levels[0].polygon.area)
    cells = pedpy.compute_individual_voronoi_polygons(traj_data=motion, walkable_area=area)
    assert cells.density.min() > 0.0
    speed = pedpy.compute_individual_speed(traj_data=motion, frame_step=1)
    assert speed.speed.between(0.0, 3.0).all()
    with pytest.raises(ResultError, match="'ground'"):
        trajectory.to_pedpy("grund")
    with pytest.raises(ResultError, match="nobody"):
        trajectory.to_pedpy("upper landing z=4.95")


def test_parquet_columns_have_units_types_and_the_rows_of_csv(trajectory, tmp_path):
    units = {name: unit for name, unit in MOTION_COLUMNS.items() if name not in ("dose", "extinction")}
    (path,) = export(trajectory, EXPORTERS["parquet"](), tmp_path / "p")
    table = parquet.read_table(path)
    assert {one.name: one.metadata[b"unit"].decode() for one in table.schema} == units
    words = {one.name for one in table.schema if str(one.type).startswith("dictionary<values=string, indices=int32")}
    assert words == {"level", "group"}
    (written,) = export(trajectory, EXPORTERS["csv"](), tmp_path / "c")
    with written.open(newline="", encoding="utf-8") as file:
        rows = [*csv.DictReader(file)]
    assert len(rows) == table.num_rows
    for name in units:
        values = table[name].to_pylist()
        assert [type(value)(row[name]) for value, row in zip(values, rows, strict=True)] == values


def test_a_last_frame_between_two_output_times_is_left_out(trajectory, tmp_path):
    from evac.analysis.tables import regular_frames

    class Fewer:
        path = trajectory.path
        time = np.array([0.0, 0.5, 1.0, 1.3])

    frames, rate = regular_frames(Fewer)
    assert (frames.tolist(), rate) == ([0, 1, 2], 2.0)
    Fewer.time = np.array([0.0])
    with pytest.raises(ResultError, match="two or more"):
        regular_frames(Fewer)
    Fewer.time = np.array([0.0, 0.5, 1.3, 1.8])
    with pytest.raises(ResultError, match="frame 2"):
        regular_frames(Fewer)


def test_geojson_has_the_building_by_name(trajectory, tmp_path):
    (path,) = export(trajectory, EXPORTERS["geojson"](), tmp_path / "building.geojson")
    data = json.loads(path.read_text(encoding="utf-8"))
    found = {(one["properties"]["kind"], one["properties"]["name"]): one for one in data["features"]}
    building = trajectory.building
    assert "metres" in data["coordinates"]
    for level in building.levels:
        assert shape(found[level.kind, level.name]["geometry"]).equals(level.polygon)
        assert found[level.kind, level.name]["properties"]["z_max"] == level.z_max
    for exit_ in building.exits:
        assert shape(found["exit", exit_.name]["geometry"]).length == pytest.approx(exit_.width)
    walls = sum(shape(one["geometry"]).length for (kind, _), one in found.items() if kind == "wall")
    assert walls == pytest.approx(np.hypot(*(building.walls[:, 2:] - building.walls[:, :2]).T).sum())
    assert len(found) == len(data["features"])
    assert {name for kind, name in found if kind == "area"} == {area.name for area in building.areas}


def test_geojson_keeps_doors_and_tells_what_was_closed(tmp_path):
    plan = Plan()
    plan.storey("ground", [[[0, 0], [8, 0], [8, 6], [0, 6]], [[8.2, 0], [14, 0], [14, 6], [8.2, 6]]])
    plan.door("door", "ground", [(8.1, 2), (8.1, 3)])
    plan.exit("main", "ground", [(0, 3), (0, 4.2)])
    plan.exit("back", "ground", [(14, 3), (14, 4.2)])
    plan.obstacle("table", "ground", [[2, 2], [3, 2], [3, 3], [2, 3]])
    one = plan.building(closed=["back", "door"])
    path = tmp_path / "building.geojson"
    assert [*EXPORTERS["geojson"]().write(SimpleNamespace(building=one, changes=()), path)] == [path]
    other = read_building(path)
    assert [(door.name, door.width) for door in other.doors] == [("door", pytest.approx(1.0))]
    assert np.allclose(other.doors[0].segment, one.doors[0].segment)
    assert len(other.walls) == len(one.walls)
    told = [text.text for text in other.findings if "closed at the start" in text.text]
    assert [text.split(" was ")[0] for text in told] == ["exit 'back'", "door 'door'"]


def test_names_of_files_are_safe_and_differ():
    assert file_stems(["a/b", "a b", "A_b", "..", "flight z=0.00..1.50"]) == [
        "a_b",
        "a_b_2",
        "A_b_3",
        "unnamed",
        "flight_z_0.00..1.50",
    ]
