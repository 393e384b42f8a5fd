"""Damaged, torn and impossible trajectory files: what is refused, and what is still read."""

import json
import os

import numpy as np
import pyarrow as pa
import pyarrow.ipc
import pytest

from evac.base.errors import ResultError
from evac.building.model.cells import LevelField
from evac.folder.digests import sealed
from evac.folder.files import TRAJECTORY_NAME
from evac.trajectory.header import fields_to_json
from evac.trajectory.layout import columns
from evac.trajectory.trajectory import read_trajectory
from tests.trajectory.parts import Frame, Parts, parts_of, places_of, with_header


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


PERSON = [0, 0, 1, 1, 1, 0, 0, 0]


def change(**odd):
    return json.dumps([{"time": 0.5, "kind": "close", "what": "door", "values": {}} | odd])


@pytest.mark.parametrize(
    ("frames", "words"),
    [
        ([(np.nan, [])], "frame 0 .* time"),
        ([(-1.0, [])], "frame 0 .* time"),
        ([(np.inf, [])], "frame 0 .* time"),
        ([(1.0, []), (1.0, [])], "frame 1 .* time"),
        ([(1.0, []), (0.5, [])], "frame 1 .* time"),
        ([(0.0, [[0, 0, 1, np.nan, 1, 0, 0, 0]])], "x of record 0"),
        ([(0.0, [[0, 0, 1, 1, 1, 0, np.inf, 0]])], "velocity_y of record 0"),
        ([(0.0, [[0, 0, 1, 1, 1, 0, 0, np.nan]])], "contact_force of record 0"),
        ([(0.0, [[2, *PERSON[1:]]])], "person"),
        ([(0.0, [PERSON, PERSON])], "person"),
        ([(0.0, [[1, *PERSON[1:]], PERSON])], "person"),
        ([(0.0, [PERSON] * 3)], "frame 0"),
        ([(0.0, [[0, 5, *PERSON[2:]]])], "level"),
        ([(0.0, [[0, 0, 0, 1e5, 1, 0, 0, 0]])], "person 0 .* outside"),
        ([(1.0, [], "{")], "changes"),
        ([(1.0, [], "[" * 10**5)], "changes"),
        ([(1.0, [], "[3]")], "changes"),
        ([(1.0, [], change(time="0"))], "changes"),
        ([(1.0, [], change(time=float("nan")))], "changes"),
        ([(1.0, [], change(time=-0.5))], "order of time"),
        ([(1.0, [], change(kind=None))], "changes"),
        ([(1.0, [], change(values=[]))], "changes"),
        ([(1.0, [], change(what="nowhere"))], "'nowhere'"),
        ([(1.0, [], change(time=1.5))], "order of time"),
        ([(1.0, [], change(time=0.9)), (2.0, [], change(time=0.8))], "order of time"),
    ],
)
def test_numbers_that_cannot_be_are_refused_though_checksums_match(descent, tmp_path, frames, words):
    header = read_trajectory(descent(people=2, frames=1).path).header
    path = tmp_path / "sealed.evac"
    path.write_bytes(Parts(header, frames=[Frame(*frame) for frame in frames]).seal())
    with pytest.raises(ResultError, match=rf"sealed.evac: .*{words}"):
        read_trajectory(path)


def test_a_value_of_a_field_that_cannot_be_is_refused(descent, tmp_path):
    whole = read_trajectory(descent(people=2, frames=1).path)
    fog = LevelField(whole.building, "fog", "1/m", 1.0)
    header = whole.header | {"level_fields": fields_to_json([fog])}
    path = tmp_path / "sealed.evac"
    for value in (0.5, np.nan):
        frame = Frame(0.0, [PERSON], fields=[[value] * fog.size])
        path.write_bytes(Parts(header, columns(2, len(whole.building.levels), [fog]), [frame]).seal())
        if np.isfinite(value):
            assert (read_trajectory(path).field("fog").values == value).all()
        else:
            with pytest.raises(ResultError, match=r"frame 0 .* field"):
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
        ("height", [1.7, 0.0]),
        ("height", [1.7]),
        ("group", [0, 2]),
        ("group", [0, -2]),
        ("group", [0, 0.5]),
        ("group", [0, ENORMOUS]),
        ("group", [[0], [1]]),
        ("groups", [1, 2]),
        ("groups", {}),
        ("fields", None),
        ("fields", ["x"]),
        ("level_fields", None),
        ("level_fields", [None]),
        ("level_fields", [{"name": "smoke", "unit": "1/m"}]),
        ("level_fields", [{"name": "smoke", "unit": "1/m", "spacing": 1.0}] * 2),
        ("level_fields", [{"name": f"{k}", "unit": "1/m", "spacing": 1.0} for k in range(101)]),
        ("level_fields", [{"name": "smoke", "unit": "1/m", "spacing": 0.0}]),
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
        else:
            del table[last]
        path.write_bytes(Parts(header).seal())
        with pytest.raises(ResultError, match=rf"sealed.evac: .*{last}"):
            read_trajectory(path)


@pytest.mark.parametrize("text", [b"[" * 10**5, b'{"format": NaN}', b'{"format": ' + b"9" * 5000 + b"}", bytes([255])])
def test_json_that_cannot_be_read_is_refused(tmp_path, text):
    path = tmp_path / "sealed.evac"
    path.write_bytes(with_header(text))
    with pytest.raises(ResultError, match=r"sealed.evac: the header"):
        read_trajectory(path)


def test_a_stated_length_takes_no_memory(tmp_path):
    path = tmp_path / "sparse.evac"
    with path.open("wb") as file:
        file.write(b"\xff\xff\xff\xff" + b"\xff\xff\xff\x7f")
        file.truncate(2**40)  # without blocks
    with pytest.raises(ResultError, match=r"sparse.evac: the header"):
        read_trajectory(path)


def test_rows_that_no_writer_makes_are_refused_though_checksums_match(changed):
    data, (_, start, *_), write = changed
    batch = next(iter(pa.ipc.open_stream(data)))
    columns = [batch.column(0), pa.array([None], batch.schema.types[1]), batch.column(2)]
    missing = pa.RecordBatch.from_arrays(columns, schema=batch.schema)
    message = bytearray(batch.serialize())
    end_of_people = 8 + int.from_bytes(message[4:8], "little") + 12  # after the time and the first offset
    message[end_of_people] = 9
    for odd, words in ((missing.serialize(), "missing"), (batch.slice(0, 0).serialize(), "0 rows"), (message, "Arrow")):
        with pytest.raises(ResultError, match=rf"changed.evac: frame 0 .*{words}"):
            read_trajectory(write(data[:start] + sealed(bytes(odd), start)))


def test_columns_of_another_program_are_refused(descent, tmp_path):
    parts = parts_of(descent(people=2, frames=1).path.read_bytes())
    path = tmp_path / "sealed.evac"
    path.write_bytes(Parts(parts.header, pa.schema([("time", pa.float32())])).seal())
    with pytest.raises(ResultError, match=r"sealed.evac: .*columns"):
        read_trajectory(path)


def test_a_folder_or_a_pipe_is_no_trajectory(tmp_path):
    (tmp_path / TRAJECTORY_NAME).mkdir()
    with pytest.raises(ResultError, match=TRAJECTORY_NAME):
        read_trajectory(tmp_path)
    os.mkfifo(tmp_path / "pipe.evac")
    with pytest.raises(ResultError, match=r"pipe\.evac"):
        read_trajectory(tmp_path / "pipe.evac")
