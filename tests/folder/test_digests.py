"""What tells runs, studies and imports from others, and records of an Arrow stream, of which no damage is read."""

import hashlib
import io
import itertools

import pyarrow as pa
import pyarrow.ipc
import pytest

from evac.base.errors import EvacError
from evac.folder.files import RunningDigest, differences, digest_of_data, digest_of_file, read_sealed, sealed


def test_differences_have_their_keys_and_both_values():
    before = {"a": {"x": 1, "gone": 2}, "rows": [1, {"y": 3.0}], "same": [1, 2]}
    now = {"a": {"x": 1, "new": None}, "rows": [1, {"y": 4.0}], "same": [1, 2]}
    assert list(differences(before, now)) == [(("a", "gone"), 2, None), (("rows", "1", "y"), 3.0, 4.0)]
    assert list(differences([1], [1, 2])) == [((), [1], [1, 2])]


def test_the_order_of_keys_does_not_count_and_values_do():
    assert digest_of_data({"a": 1, "b": [2]}) == digest_of_data({"b": [2], "a": 1})
    assert digest_of_data({"a": 1}) != digest_of_data({"a": 1.5})


def test_a_file_that_cannot_be_read_is_named(tmp_path):
    (tmp_path / "a").write_bytes(b"abc")
    assert digest_of_file(tmp_path / "a") == "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
    with pytest.raises(EvacError, match="missing"):
        digest_of_file(tmp_path / "missing")


def test_a_digest_goes_on_as_its_file_grows_and_begins_anew_where_it_is_shorter(tmp_path):
    path, running = tmp_path / "a", RunningDigest()
    for text in (b"abc", b"abcdef", b"xy"):
        path.write_bytes(text)
        assert running.extend(path, len(text)) == hashlib.sha256(text).hexdigest()
    with pytest.raises(EvacError, match="2 bytes, not 3"):
        running.extend(path, 3)


TABLE = pa.table({"run": [3], "times": [[1.5, 2.5, 3.5]], "words": ["deep"]})


@pytest.fixture(scope="module")
def stream():
    """A schema and two equal batches, and the places where these three records begin and end."""
    (batch,) = TABLE.to_batches()
    data, places = b"", [0]
    for message in (TABLE.schema.serialize(), batch.serialize(), batch.serialize()):
        data += sealed(message.to_pybytes(), len(data))
        places.append(len(data))
    return data, places


def test_records_are_read_as_they_were_written(stream):
    data, places = stream
    file = io.BytesIO(data)
    for start, end in itertools.pairwise(places):
        assert read_sealed(file, start, len(data)) == data[start:end]
        assert file.tell() == end


def test_no_changed_byte_and_no_cut_is_read(stream):
    data, places = stream
    start, end = places[1:3]
    for place in range(start, end):
        changed = bytearray(data)
        changed[place] ^= 1 << place % 8
        assert read_sealed(io.BytesIO(changed), start, len(data)) is None, place
    for length in range(start, end):
        assert read_sealed(io.BytesIO(data[:length]), start, length) is None, length


def test_a_record_is_not_read_at_another_place(stream):
    data, places = stream
    swapped = data[: places[1]] + data[places[2] :] + data[places[1] : places[2]]
    assert read_sealed(io.BytesIO(swapped), places[1], len(data)) is None
