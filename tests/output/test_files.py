from pathlib import PurePath

import pytest

from evac.errors import ResultError
from evac.output.files import FRAMES, WRITTEN, frame_name, writing


def test_frames_are_found_by_their_pattern():
    assert PurePath(frame_name(7)).match(FRAMES)
    assert FRAMES in WRITTEN


def test_what_the_system_refuses_names_the_place_and_the_way_out(tmp_path):
    place = tmp_path / "absent" / "file"
    with pytest.raises(ResultError, match=r"file: .*the table"), writing("the table", place):
        place.write_text("a")


def test_other_errors_pass(tmp_path):
    with pytest.raises(ZeroDivisionError), writing("the table", tmp_path):
        1 / 0  # noqa: B018
