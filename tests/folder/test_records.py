"""Records of an Arrow stream: Arrow reads them, and no damage is read."""

import io
import itertools

import pyarrow as pa
import pyarrow.ipc
import pytest

from evac.folder.digests import read_sealed, sealed

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
