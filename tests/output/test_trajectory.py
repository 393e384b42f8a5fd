import json
import os
import signal
import struct
import subprocess
import sys
import time
import zlib
from pathlib import Path

import numpy as np
import pytest

from evac.building.links import close_links
from evac.errors import ResultError, SimulationError
from evac.output.files import TRAJECTORY_NAME
from evac.output.header import building_from_json, building_to_json
from evac.output.layout import FIELDS, FRAME_HEAD_BYTES, RECORD_BYTES
from evac.output.trajectory import read_trajectory
from evac.output.trajectory_writer import TrajectoryWriter


def frame_bytes(people):
    return FRAME_HEAD_BYTES + RECORD_BYTES * people


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


def test_what_is_closed_is_kept_and_absent_in_earlier_files(building):
    closed = close_links(building, ["door", "portal 1"])
    data = json.loads(json.dumps(building_to_json(closed)))
    assert building_from_json(data).closed == closed.closed == {1, 4}
    del data["closed"]
    assert building_from_json(data).closed == frozenset()


def test_crowd_pressure_is_over_the_own_circumference(first_out):
    trajectory = read_trajectory(first_out)
    assert trajectory[0]["person"].tolist() == [1, 2]
    expected = np.array([100.0, 200.0]) / (2.0 * np.pi * np.array([0.3, 0.4]))
    np.testing.assert_allclose(trajectory[0]["crowd_pressure"], expected, rtol=1e-12)


def test_result_folder_stands_for_its_trajectory(descent):
    run = descent()
    assert run.path.name == TRAJECTORY_NAME
    np.testing.assert_array_equal(read_trajectory(run.path.parent).time, read_trajectory(run.path).time)


def test_heights_are_those_of_three_storeys_and_of_the_flight(descent):
    trajectory = read_trajectory(descent(people=4, frames=5).path)
    np.testing.assert_allclose(trajectory.z[0, 1:], [3.0, 0.0, 6.0], atol=1e-6)
    along_flight = np.array([0.5, 1.0, 1.5, 2.0, 2.5])
    np.testing.assert_allclose(trajectory.z[:, 0], 6.0 - 0.75 * along_flight, atol=1e-5)


def test_velocity_follows_the_slope_and_speed_is_its_length(descent):
    trajectory = read_trajectory(descent(people=4, frames=2).path)
    np.testing.assert_allclose(trajectory.velocity[0, 0], [1.0, 0.0, -0.75], atol=1e-6)
    np.testing.assert_allclose(trajectory.speed[0], [1.25, 1.0, 1.0, 1.0], atol=1e-6)


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


def test_torn_last_frame_is_dropped_at_every_byte(descent, tmp_path):
    run = descent(people=3, frames=3)
    whole = run.path.read_bytes()
    last = frame_bytes(2)  # one of three is out in the last frame
    torn = tmp_path / "torn.evac"
    for left in range(last):
        torn.write_bytes(whole[: len(whole) - last + left])
        trajectory = read_trajectory(torn)
        assert len(trajectory) == 2
        assert trajectory.dropped_bytes == left


@pytest.mark.parametrize("byte", [0, 8, 12, 16, 20, FRAME_HEAD_BYTES + 5])
def test_damage_before_the_last_frame_is_an_error_that_names_the_frame(descent, tmp_path, byte):
    run = descent(people=3, frames=3)
    data = bytearray(run.path.read_bytes())
    second = len(data) - frame_bytes(2) - frame_bytes(3)
    data[second + byte] ^= 0x40
    damaged = tmp_path / "damaged.evac"
    damaged.write_bytes(data)
    with pytest.raises(ResultError, match=rf"frame 1 at byte {second} .*cut to {second} bytes"):
        read_trajectory(damaged)
    damaged.write_bytes(data[:second])
    assert len(read_trajectory(damaged)) == 1


@pytest.mark.parametrize("byte", [0, 8, 12, 16])
def test_damage_in_the_head_of_the_last_frame_is_no_torn_frame(descent, tmp_path, byte):
    """Where the frame ends is not known then, so that what is lost may be more than one frame."""
    run = descent(people=3, frames=3)
    data = bytearray(run.path.read_bytes())
    data[len(data) - frame_bytes(2) + byte] ^= 0x01
    damaged = tmp_path / "damaged.evac"
    damaged.write_bytes(data)
    with pytest.raises(ResultError, match=r"frame 2 at byte"):
        read_trajectory(damaged)


def test_frames_that_are_missing_or_twice_are_found(descent, tmp_path):
    run = descent(people=3, frames=4)
    data = run.path.read_bytes()
    frame = frame_bytes(3)
    first = len(data) - frame_bytes(2) - 3 * frame
    damaged = tmp_path / "damaged.evac"
    for wrong in (data[: first + frame] + data[first + 2 * frame :], data[: first + frame] + data[first:]):
        damaged.write_bytes(wrong)
        with pytest.raises(ResultError, match=r"frame 1 at byte"):
            read_trajectory(damaged)


@pytest.mark.parametrize("whole", [0, 1, 2])
def test_zeros_at_the_end_are_left_out(descent, tmp_path, whole):
    """As a file system leaves them that had grown the file before the power failed."""
    run = descent(people=3, frames=3)
    data = run.path.read_bytes()
    end = len(data) - frame_bytes(2) - (2 - whole) * frame_bytes(3)
    for left in (0, 30):  # of the next frame
        blank = tmp_path / "blank.evac"
        blank.write_bytes(data[: end + left] + bytes(1000))
        trajectory = read_trajectory(blank)
        assert (len(trajectory), trajectory.end) == (whole, end)


def test_every_changed_bit_of_the_header_is_found(descent, tmp_path):
    run = descent(people=3, frames=1)
    data = run.path.read_bytes()
    damaged = tmp_path / "damaged.evac"
    for byte in [*range(40), *range(40, len(data) - frame_bytes(2), 97)]:
        wrong = bytearray(data)
        wrong[byte] ^= 1 << byte % 8
        damaged.write_bytes(wrong)
        with pytest.raises(ResultError, match=r"damaged.evac: "):
            read_trajectory(damaged)


def test_format_1_still_reads(descent):
    """The file was written by the version before format 2, by the fixture `descent` of five people and four frames."""
    old = read_trajectory(Path(__file__).with_name("format_1.evac"))
    new = read_trajectory(descent(people=5, frames=4).path)
    assert (old.header["format"], new.header["format"]) == (1, 2)
    assert old.dropped_bytes == 0
    np.testing.assert_array_equal(old.time, new.time)
    for one, other in zip(old.records, new.records, strict=True):
        np.testing.assert_array_equal(one, other)
    assert building_to_json(old.building) == building_to_json(new.building)
    assert (old.groups, old.group.tolist()) == (new.groups, new.group.tolist())


def test_format_1_torn_and_damaged(tmp_path):
    data = Path(__file__).with_name("format_1.evac").read_bytes()
    path = tmp_path / "old.evac"
    for left in (1, 15, 40):
        path.write_bytes(data[:-left])
        assert len(read_trajectory(path)) == 3
    wrong = bytearray(data)
    wrong[-200] ^= 0x10  # the last frame has 128 bytes, 16 + 28 * 4
    path.write_bytes(wrong)
    with pytest.raises(ResultError, match=r"frame 2 at byte"):
        read_trajectory(path)


def sealed(header, frames=()):
    """Return a file of format 2 with right checksums, whatever is in it."""
    text = header if isinstance(header, bytes) else json.dumps(header).encode()
    start = b"EVACTRJ2" + struct.pack("<I", len(text))
    data = start + struct.pack("<I", zlib.crc32(start + text)) + text
    for number, (seconds, rows) in enumerate(frames):
        head = struct.pack("<dII", seconds, number, len(rows))
        records = np.array(rows, "<f4").reshape(-1, 7).tobytes()
        data += head + struct.pack("<II", zlib.crc32(head), zlib.crc32(records)) + records
    return data


PERSON = [0, 0, 1, 1, 0, 0, 0]


@pytest.mark.parametrize(
    ("frames", "words"),
    [
        ([(np.nan, [])], "frame 0 .* time"),
        ([(-1.0, [])], "frame 0 .* time"),
        ([(np.inf, [])], "frame 0 .* time"),
        ([(1.0, []), (1.0, [])], "frame 1 .* time"),
        ([(1.0, []), (0.5, [])], "frame 1 .* time"),
        ([(0.0, [[0, 0, np.nan, 1, 0, 0, 0]])], "x of record 0"),
        ([(0.0, [[0, 0, 1, 1, 0, np.inf, 0]])], "velocity_y of record 0"),
        ([(0.0, [[0, 0, 1, 1, 0, 0, np.nan]])], "contact_force of record 0"),
        ([(0.0, [[-1, *PERSON[1:]]])], "person"),
        ([(0.0, [[2, *PERSON[1:]]])], "person"),
        ([(0.0, [PERSON, PERSON])], "person"),
        ([(0.0, [[1, *PERSON[1:]], PERSON])], "person"),
        ([(0.0, [[0.5, *PERSON[1:]]])], "person"),
        ([(0.0, [PERSON] * 3)], "frame 0"),
        ([(0.0, [[0, -1, *PERSON[2:]]])], "level"),
        ([(0.0, [[0, 5, *PERSON[2:]]])], "level"),
        ([(0.0, [[0, 0.5, *PERSON[2:]]])], "level"),
        ([(0.0, [[0, 0, 1e5, 1, 0, 0, 0]])], "person 0 .* outside"),
    ],
)
def test_numbers_that_cannot_be_are_refused_though_checksums_match(descent, tmp_path, frames, words):
    header = read_trajectory(descent(people=2, frames=1).path).header
    path = tmp_path / "sealed.evac"
    path.write_bytes(sealed(header, frames))
    with pytest.raises(ResultError, match=rf"sealed.evac: .*{words}"):
        read_trajectory(path)


ENORMOUS = 10**30


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("building", None),
        ("building", []),
        ("origin", [0.0]),
        ("origin", ["0", "0"]),
        ("origin", [1e300, 0.0]),
        ("group", [0]),
        ("radius", [0.2, 0.0]),
        ("radius", [0.2, -1.0]),
        ("radius", [True, True]),
        ("radius", "ab"),
        ("group", [0, 2]),
        ("group", [0, -2]),
        ("group", [0, 0.5]),
        ("group", [0, ENORMOUS]),
        ("group", [[0], [1]]),
        ("groups", [1, 2]),
        ("groups", {}),
        ("fields", None),
        ("fields", ["x"]),
        ("building.vertices", []),
        ("building.vertices", [[0, 0]]),
        ("building.vertices", [[0, 0, 0], [1]]),
        ("building.vertices", [[0, 0, 1e300]]),
        ("building.vertices", {"0": 1}),
        ("building.source", 5),
        ("building.levels", []),
        ("building.levels", [None]),
        ("building.levels.0.triangles", [[0, 1, 20]]),
        ("building.levels.0.triangles", [[0, 1, -1]]),
        ("building.levels.0.triangles", [[0, 1, 1.5]]),
        ("building.levels.0.triangles", []),
        ("building.levels.0.triangles", [[0, 1, 1]]),
        ("building.levels.0.kind", "lift"),
        ("building.levels.0.kind", []),
        ("building.levels.0.name", 3),
        ("building.levels.0.stair", 3),
        ("building.levels.0.uphill", [1.0]),
        ("building.levels.0.slope", 2.0),
        ("building.levels.0.slope", "0"),
        ("building.levels.0.z_min", ENORMOUS * 10**300),
        ("building.levels.0.polygon", {}),
        ("building.levels.0.polygon", {"type": "Point", "coordinates": [0, 0]}),
        ("building.levels.0.polygon", {"type": "Polygon", "coordinates": [[[0, 0]]]}),
        ("building.levels.0.polygon", {"type": "Polygon", "coordinates": 5}),
        ("building.levels.0.polygon", {"type": 7, "coordinates": []}),
        ("building.portals.0.levels", [0]),
        ("building.portals.0.levels", [0, 5]),
        ("building.portals.0.segments", [[0, 0, 1]]),
        ("building.portals.0.segments", []),
        ("building.exits.0.level", 5),
        ("building.exits.0.level", -1),
        ("building.exits.0.level", True),
        ("building.exits.0.width", -1),
        ("building.areas.0.level", 1.0),
        ("building.walls", [[0, 0, 1, 1]]),
        ("building.wall_level", [0]),
        ("building.stairs", []),
        ("building.stairs", {"a": [9]}),
        ("building.stairs", {"a": 1}),
        ("building.closed", [9]),
        ("building.closed", ["a"]),
        ("building.warnings", [1]),
    ],
)
def test_headers_that_cannot_be_are_refused_though_checksums_match(descent, tmp_path, key, value):
    header = read_trajectory(descent(people=2, frames=1).path).header
    *places, last = key.split(".")
    table = header
    for place in places:
        table = table[int(place) if isinstance(table, list) else place]
    path = tmp_path / "sealed.evac"
    for wrong in ("changed", "missing"):
        if wrong == "changed":
            table[last] = value
        elif last != "closed":  # which may be missing
            del table[last]
        path.write_bytes(sealed(header))
        with pytest.raises(ResultError, match=rf"sealed.evac: .*{last}"):
            read_trajectory(path)


@pytest.mark.parametrize("text", [b"[" * 10**5, b'{"format": NaN}', b'{"format": ' + b"9" * 5000 + b"}", bytes([255])])
def test_json_that_cannot_be_read_is_refused(tmp_path, text):
    path = tmp_path / "sealed.evac"
    path.write_bytes(sealed(text))
    with pytest.raises(ResultError, match=r"sealed.evac: the header"):
        read_trajectory(path)


def test_a_stated_length_takes_no_memory(tmp_path):
    path = tmp_path / "sparse.evac"
    with path.open("wb") as file:
        file.write(b"EVACTRJ2" + struct.pack("<II", 2**32 - 1, 0))
        file.truncate(2**40)  # without blocks
    with pytest.raises(ResultError, match=r"sparse.evac: the header .* byte 8"):
        read_trajectory(path)


def test_a_folder_or_a_pipe_is_no_trajectory(tmp_path):
    (tmp_path / TRAJECTORY_NAME).mkdir()
    with pytest.raises(ResultError, match=TRAJECTORY_NAME):
        read_trajectory(tmp_path)
    os.mkfifo(tmp_path / "pipe.evac")
    with pytest.raises(ResultError, match=r"pipe\.evac"):
        read_trajectory(tmp_path / "pipe.evac")


def test_a_writer_continues_to_the_same_bytes(descent, tmp_path):
    run = descent(people=3, frames=4)
    whole = run.path.read_bytes()
    second = len(whole) - frame_bytes(2) - frame_bytes(3)
    path = tmp_path / "cut.evac"
    path.write_bytes(whole + b"what is behind")
    writer = TrajectoryWriter.reopen(path, second)
    assert (writer.length, writer.frames) == (second, 2)
    for k in (2, 3):
        writer.append(0.5 * k, run.crowds[k], run.crowds[k].velocity)
    writer.close()
    assert path.read_bytes() == whole
    assert writer.length == len(whole) == read_trajectory(path).end


def test_a_writer_continues_no_other_file(descent, tmp_path):
    run = descent(people=3, frames=4)
    whole = run.path.read_bytes()
    for end in (len(whole) + 1, len(whole) - 1, 20):
        with pytest.raises(ResultError, match=r"run\.evac"):
            TrajectoryWriter.reopen(_copy(tmp_path / "run.evac", whole), end)
        assert (tmp_path / "run.evac").read_bytes() == whole
    old = Path(__file__).with_name("format_1.evac").read_bytes()
    with pytest.raises(ResultError, match="format 1"):
        TrajectoryWriter.reopen(_copy(tmp_path / "old.evac", old), len(old))


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


def test_damage_in_the_last_frame_drops_it(descent, tmp_path):
    run = descent(people=3, frames=3)
    data = bytearray(run.path.read_bytes())
    data[-1] ^= 0x01
    damaged = tmp_path / "damaged.evac"
    damaged.write_bytes(data)
    trajectory = read_trajectory(damaged)
    assert (len(trajectory), trajectory.dropped_bytes) == (2, frame_bytes(2))


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"solid mesh", "not a trajectory"),
        (b"EVACTRJ1\x05", "header"),
        (b"EVACTRJ1" + struct.pack("<I", 99) + b"{}", "header"),
        (b"EVACTRJ1" + struct.pack("<I", 2) + b"{]", "header .* JSON"),
        (b"EVACTRJ1" + struct.pack("<I", 12) + b'{"format":2}', r"format 2\b"),
        (b"EVACTRJ1" + struct.pack("<I", 2) + b"[]", r"format \[\]"),
        (b"EVACTRJ1" + struct.pack("<I", 12) + b'{"format":1}', "header's fields .* None"),
        (b"", "not a trajectory"),
    ],
)
def test_what_is_no_trajectory_is_refused(tmp_path, content, words):
    path = tmp_path / "x.evac"
    path.write_bytes(content)
    with pytest.raises(ResultError, match=words):
        read_trajectory(path)


def test_missing_file_is_named(tmp_path):
    with pytest.raises(ResultError, match="nowhere"):
        read_trajectory(tmp_path / "nowhere.evac")


def test_file_is_what_the_document_says(descent):
    """Read with struct and json alone, as a reader in another language would."""
    run = descent(people=3, frames=1)
    data = run.path.read_bytes()
    assert data[:8] == b"EVACTRJ2"
    length, check = struct.unpack("<II", data[8:16])
    assert check == zlib.crc32(data[:12] + data[16 : 16 + length])
    header = json.loads(data[16 : 16 + length])
    assert tuple(header["fields"]) == FIELDS
    start = 16 + length
    seconds, number, count, own, check = struct.unpack("<dIIII", data[start : start + 24])
    assert (seconds, number, count) == (0.0, 0, 2)
    assert own == zlib.crc32(data[start : start + 16])
    assert check == zlib.crc32(data[start + 24 :])
    person, level, x, y, velocity_x, velocity_y, force = struct.unpack("<7f", data[start + 52 :])
    assert (person, level, x + header["origin"][0], y, velocity_x, velocity_y) == (1.0, 2.0, 15.0, 0.75, 1.0, 0.0)
    assert force == 100.0


def test_frames_are_on_disk_before_the_writer_is_closed(descent, tmp_path):
    run = descent(people=3, frames=1)
    header = read_trajectory(run.path).header
    path = tmp_path / "open.evac"
    writer = TrajectoryWriter(path, header, np.zeros(2))
    writer.append(0.0, run.crowds[0], run.crowds[0].velocity)
    assert len(read_trajectory(path)) == 1
    writer.close()


def test_unwritable_place_is_named(tmp_path):
    (tmp_path / "taken").write_text("a file")
    with pytest.raises(ResultError, match="taken"):
        TrajectoryWriter(tmp_path / "taken" / "x.evac", {"radius": [0.2]}, np.zeros(2))


def test_a_frame_of_140_people_costs_little(descent):
    run = descent(people=140, frames=2)
    header = read_trajectory(run.path).header
    writer = TrajectoryWriter(run.path, header, np.zeros(2))
    started = time.perf_counter()
    for k in range(500):
        writer.append(0.5 * k, run.crowds[0], run.crowds[0].velocity)
    spent = (time.perf_counter() - started) / 500
    writer.close()
    assert spent < 1e-3  # a bound that a busy machine keeps too; 30 us were measured on an idle one


def test_killed_writer_leaves_every_frame_it_announced(descent, tmp_path):
    run = descent(people=140, frames=2)
    path = tmp_path / "killed.evac"
    code = f"""
import sys
from pathlib import Path
from types import SimpleNamespace
import numpy as np
from evac.output.trajectory import read_trajectory
from evac.output.trajectory_writer import TrajectoryWriter
header = read_trajectory(Path({str(run.path)!r})).header
crowd = SimpleNamespace(
    level=np.zeros(140, np.int32), position=np.ones((140, 2)), contact_force=np.ones(140)
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
    assert f"byte {len(data) - frame_bytes(2)}" in warning
