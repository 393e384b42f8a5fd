import io
import json
import os
import signal
import subprocess
import sys

import numpy as np
import pyarrow as pa
import pyarrow.ipc
import pytest

from evac.base.change import Change
from evac.base.errors import ResultError, SimulationError
from evac.building.model.cells import LevelField
from evac.folder.files import TRAJECTORY_NAME, read_sealed, sealed
from evac.trajectory.trajectory import (
    FIELDS,
    TrajectoryWriter,
    building_from_json,
    building_to_json,
    columns,
    read_trajectory,
)


def places_of(data):
    """Return the bytes at which the records of a file begin, and its end."""
    places = [0]
    while places[-1] < len(data):
        places.append(places[-1] + len(read_sealed(io.BytesIO(data), places[-1], len(data))))
    return places


def test_round_trip_gives_back_what_was_recorded(descent):
    run = descent(people=5, frames=4)
    trajectory = read_trajectory(run.path)
    assert len(trajectory) == 4
    assert trajectory.dropped_bytes == 0
    assert trajectory.time.tolist() == [0.0, 0.5, 1.0, 1.5]
    for k, crowd in enumerate(run.crowds):
        inside = crowd.level >= 0
        np.testing.assert_array_equal(trajectory.level[k], crowd.level)
        np.testing.assert_allclose(trajectory.position[k][inside], crowd.position[inside], atol=1e-6)
        np.testing.assert_array_equal(trajectory.contact_force[k][inside], crowd.contact_force[inside])
        pressure = crowd.contact_force[inside] / (2.0 * np.pi * trajectory.radius[inside])
        np.testing.assert_allclose(trajectory.crowd_pressure[k][inside], pressure, rtol=1e-12)
        assert np.isnan(trajectory.position[k][~inside]).all()
        assert np.isnan(trajectory.z[k][~inside]).all()


def test_positions_far_from_the_origin_keep_a_tenth_of_a_millimetre(descent):
    run = descent(shift=(5.0e6, 5.0e6))
    trajectory = read_trajectory(run.path)
    inside = run.crowds[0].level >= 0
    np.testing.assert_allclose(trajectory.position[0][inside], run.crowds[0].position[inside], rtol=0.0, atol=1e-5)


def test_building_comes_back_whole(building):
    back = building_from_json(json.loads(json.dumps(building_to_json(building))))
    np.testing.assert_array_equal(back.vertices, building.vertices)
    np.testing.assert_array_equal(back.walls, building.walls)
    np.testing.assert_array_equal(back.wall_level, building.wall_level)
    assert back.stairs == building.stairs
    for level, before in zip(back.levels, building.levels, strict=True):
        np.testing.assert_array_equal(level.triangles, before.triangles)
        np.testing.assert_array_equal(level.uphill, before.uphill)
        assert level.polygon.equals(before.polygon)
        assert (level.index, level.name, level.kind, level.stair) == (
            before.index,
            before.name,
            before.kind,
            before.stair,
        )
        assert (level.slope, level.z_min, level.z_max) == (before.slope, before.z_min, before.z_max)
    for portal, before in zip(back.portals, building.portals, strict=True):
        np.testing.assert_array_equal(portal.segments, before.segments)
        assert (portal.index, portal.name, portal.levels) == (before.index, before.name, before.levels)
    assert [(e.index, e.name, e.level) for e in back.exits] == [(0, "door", 0)]
    np.testing.assert_array_equal(back.exits[0].segments, building.exits[0].segments)
    assert back.areas[0].polygon.equals(building.areas[0].polygon)


def _copy(path, data):
    path.write_bytes(data)
    return path


def test_what_is_not_finite_is_not_written(descent, tmp_path):
    run = descent(people=3, frames=1)
    before = run.path.read_bytes()
    header = read_trajectory(run.path).header
    writer = TrajectoryWriter(tmp_path / "x.evac", header, np.zeros(2))
    for bad in (np.nan, 1e60):
        velocity = run.crowds[0].velocity.copy()
        velocity[1, 0] = bad
        with pytest.raises(SimulationError, match="velocity_x of person 1"):
            writer.append(0.0, run.crowds[0], velocity)
    writer.append(0.0, run.crowds[0], run.crowds[0].velocity)
    writer.close()
    assert (tmp_path / "x.evac").read_bytes() == before


def with_header(text):
    """Return a file without frames, with the given text for a header."""
    return sealed(columns(2, 5).with_metadata({b"evac.trajectory": text}).serialize().to_pybytes(), 0)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"solid mesh", "not a trajectory"),
        (b"\xff\xff\xff\xff\x05", "header is .*incomplete"),
        (b"\xff\xff\xff\xff\x10" + bytes(100), "header is damaged"),
        (b"\xff\xff\xff\xff\xff\xff\xff\x7f" + bytes(100), "header is damaged"),
        (with_header(b'{"format":2}'), r"format 2\b"),
        (with_header(b"{}"), "format None"),
        (b"", "empty"),
    ],
)
def test_what_is_no_trajectory_is_refused(tmp_path, content, words):
    path = tmp_path / "x.evac"
    path.write_bytes(content)
    with pytest.raises(ResultError, match=rf"x\.evac: .*{words}"):
        read_trajectory(path)


def test_file_is_what_the_document_says(descent):
    """Read with Arrow and json alone, as a reader in another language would."""
    run = descent(people=3, frames=3)
    table = pa.ipc.open_stream(run.path).read_all()
    header = json.loads(table.schema.metadata[b"evac.trajectory"])
    assert (header["format"], tuple(header["fields"])) == (4, FIELDS)
    assert table.column_names == ["time", "people", "changes"]
    assert table["time"].to_pylist() == [0.0, 0.5, 1.0]
    assert [len(people) for people in table["people"].to_pylist()] == [3, 3, 2]
    one = table["people"][2][1].as_py()
    x, y, velocity_x, velocity_y, force = one["motion"]
    assert [person["started"] for person in table["people"][2].as_py()] == [True, False]
    assert (one["person"], one["level"], x + header["origin"][0], y) == (1, 2, pytest.approx(15.02), 0.75)
    assert (velocity_x, velocity_y, force) == (1.0, 0.0, 100.0)


@pytest.mark.parametrize(("people", "kind"), [(256, pa.uint8()), (257, pa.uint16()), (65537, pa.int32())])
def test_persons_have_the_smallest_type_that_holds_them(people, kind):
    assert columns(people, 5).field("people").type.value_type.field("person").type == kind


def test_more_people_than_a_byte_counts_come_back(descent):
    trajectory = read_trajectory(descent(people=300, frames=2).path)
    assert trajectory[0]["person"].tolist() == list(range(300))
    assert trajectory.rows[0].person.tolist() == list(range(300))


def test_frames_are_on_disk_before_the_writer_is_closed(descent, tmp_path):
    run = descent(people=3, frames=1)
    header = read_trajectory(run.path).header
    path = tmp_path / "open.evac"
    writer = TrajectoryWriter(path, header, np.zeros(2))
    writer.append(0.0, run.crowds[0], run.crowds[0].velocity)
    assert len(read_trajectory(path)) == 1
    writer.close()


def test_killed_writer_leaves_every_frame_it_announced(descent, tmp_path):
    run = descent(people=140, frames=2)
    path = tmp_path / "killed.evac"
    code = f"""
from pathlib import Path
from types import SimpleNamespace
import numpy as np
from evac.trajectory.trajectory import read_trajectory
from evac.trajectory.trajectory import TrajectoryWriter
header = read_trajectory(Path({str(run.path)!r})).header
crowd = SimpleNamespace(
    level=np.zeros(140, np.int32), position=np.ones((140, 2)), contact_force=np.ones(140), start_time=np.zeros(140)
)
writer = TrajectoryWriter(Path({str(path)!r}), header, np.zeros(2))
for k in range(10**9):
    writer.append(0.5 * k, crowd, np.ones((140, 2)))
    print(k, flush=True)
"""
    child = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    for line in child.stdout:
        if int(line) >= 50:
            break
    child.kill()
    announced = max([50, *(int(line) for line in child.stdout.read().split() if line.isdigit())])
    child.stdout.close()
    assert child.wait() == -signal.SIGKILL
    trajectory = read_trajectory(path)
    assert len(trajectory) >= announced
    assert (trajectory.position == 1.0).all()


def test_what_is_left_out_is_told(descent, tmp_path):
    data = descent(people=3, frames=3).path.read_bytes()
    assert read_trajectory(_copy(tmp_path / "whole.evac", data)).warnings == ()
    (warning,) = read_trajectory(_copy(tmp_path / "torn.evac", data[:-1])).warnings
    assert "torn.evac" in warning
    assert f"byte {places_of(data)[-2]}" in warning


CLOSED, OPENED = (
    Change(0.75, "close", "door"),
    Change(1.25, "open", "door", {"by": "a guard", "after": 3.5, "held": True}),
)


@pytest.fixture
def changing(descent, tmp_path):
    """Return the path of a trajectory of four frames, 0.5 s apart, with a change before the third and the fourth."""
    run = descent(people=3, frames=4)
    path = tmp_path / "changing.evac"
    writer = TrajectoryWriter(path, read_trajectory(run.path).header, np.zeros(2))
    for k, changes in enumerate(([], [], [CLOSED], [OPENED])):
        writer.append(0.5 * k, run.crowds[k], run.crowds[k].velocity, changes)
    writer.close()
    return path


def test_the_building_is_what_the_changes_have_made_of_it(changing):
    trajectory = read_trajectory(changing)
    is_open = [
        trajectory.building_at(time).is_open(trajectory.building.exits[0]) for time in (0, 0.74, 0.75, 1.24, 1.25)
    ]
    assert is_open == [True, True, False, False, True]
    assert trajectory.building_at(0.8) is trajectory.building_at(1.0)
    assert trajectory.building_at(0.0) is trajectory.building


def test_fields_come_back_and_a_writer_that_continues_goes_on_with_them(descent, building, tmp_path):
    run = descent(people=3, frames=3)
    header, path = read_trajectory(run.path).header, tmp_path / "fields.evac"
    fields = [LevelField(building, "smoke", "1/m", 1), LevelField(building, "heat", "kW/m2", 2.0)]
    writer = TrajectoryWriter(path, header, np.zeros(2), fields)
    for k, crowd in enumerate(run.crowds):
        for number, field in enumerate(fields):
            field.values[:] = np.arange(field.size) + 100 * k + 0.5 * number
        writer.append(0.5 * k, crowd, crowd.velocity, (), fields)
    writer.close()
    whole = path.read_bytes()
    trajectory = read_trajectory(path)
    assert [(one.name, one.unit, one.spacing) for one in trajectory.level_fields] == [
        ("smoke", "1/m", 1.0),
        ("heat", "kW/m2", 2.0),
    ]
    heat = trajectory.field("heat")
    assert heat.values.tolist() == [[k + 100.0 * frame + 0.5 for k in range(heat.size)] for frame in range(3)]
    assert heat.values[-1].tolist() == fields[1].values.tolist()
    del trajectory
    writer = TrajectoryWriter(path, header, np.zeros(2), fields, length=places_of(whole)[3])
    fields[0].values[0] = np.nan
    with pytest.raises(SimulationError, match="'smoke'"):
        writer.append(1.0, run.crowds[2], run.crowds[2].velocity, (), fields)
    fields[0].values[0] = 200.0
    writer.append(1.0, run.crowds[2], run.crowds[2].velocity, (), fields)
    writer.close()
    assert path.read_bytes() == whole
    assert writer.length == len(whole)


@pytest.fixture
def changed(descent, tmp_path):
    """Return the bytes of a file of three frames, their places, and a function that writes other bytes."""
    data = descent(people=3, frames=3).path.read_bytes()

    def write(other):
        (tmp_path / "changed.evac").write_bytes(other)
        return tmp_path / "changed.evac"

    return data, places_of(data), write


def test_torn_last_frame_is_dropped_at_every_byte(changed):
    data, places, write = changed
    for left in range(places[-1] - places[-2]):
        trajectory = read_trajectory(write(data[: places[-2] + left]))
        assert (len(trajectory), trajectory.end, trajectory.dropped_bytes) == (2, places[-2], left)


def test_every_changed_byte_of_a_frame_before_the_last_is_an_error_that_names_the_frame(changed):
    data, places, write = changed
    for byte in range(places[2], places[3]):
        wrong = bytearray(data)
        wrong[byte] ^= 1 << byte % 8
        with pytest.raises(ResultError, match=rf"frame 1 at byte {places[2]} .*cut to {places[2]} bytes"):
            read_trajectory(write(wrong))
    assert len(read_trajectory(write(data[: places[2]]))) == 1


def test_every_changed_byte_of_the_last_frame_drops_it(changed):
    data, places, write = changed
    for byte in range(places[3], places[4]):
        wrong = bytearray(data)
        wrong[byte] ^= 1 << byte % 8
        trajectory = read_trajectory(write(wrong))
        assert (len(trajectory), trajectory.end) == (2, places[3])


def test_frames_that_are_missing_or_twice_are_found(changed):
    data, places, write = changed
    for wrong in (data[: places[1]] + data[places[2] :], data[: places[2]] + data[places[1] :]):
        with pytest.raises(ResultError, match=r"frame [01] at byte"):
            read_trajectory(write(wrong))


@pytest.mark.parametrize("whole", [0, 1, 2])
def test_zeros_at_the_end_are_left_out(changed, whole):
    """As a file system leaves them that had grown the file before the power failed."""
    data, places, write = changed
    end = places[1 + whole]
    for left in (0, 30):  # of the next frame
        trajectory = read_trajectory(write(data[: end + left] + bytes(1000)))
        assert (len(trajectory), trajectory.end) == (whole, end)


def test_every_changed_byte_of_the_header_is_found(changed):
    data, places, write = changed
    for byte in [*range(200), *range(200, places[1], 97)]:
        wrong = bytearray(data)
        wrong[byte] ^= 1 << byte % 8
        with pytest.raises(ResultError, match=r"changed.evac: "):
            read_trajectory(write(wrong))


def test_a_folder_or_a_pipe_is_no_trajectory(tmp_path):
    (tmp_path / TRAJECTORY_NAME).mkdir()
    with pytest.raises(ResultError, match=TRAJECTORY_NAME):
        read_trajectory(tmp_path)
    os.mkfifo(tmp_path / "pipe.evac")
    with pytest.raises(ResultError, match=r"pipe\.evac"):
        read_trajectory(tmp_path / "pipe.evac")
