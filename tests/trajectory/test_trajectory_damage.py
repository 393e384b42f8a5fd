"""Damaged, torn and impossible trajectory files: what is refused, and what is still read."""

import json
import os
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest

from evac.base.errors import ResultError
from evac.folder.files import TRAJECTORY_NAME
from evac.trajectory.header import building_to_json
from evac.trajectory.layout import FRAME_HEAD_BYTES, RECORD_BYTES
from evac.trajectory.trajectory import read_trajectory


def frame_bytes(people):
    return FRAME_HEAD_BYTES + RECORD_BYTES * people


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
