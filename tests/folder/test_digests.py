"""What tells runs, studies and imports from others."""

import pytest

from evac.base.errors import EvacError
from evac.folder.digests import differences, digest_of_data, digest_of_file


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
