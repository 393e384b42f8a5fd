"""New cases: an empty storey, the example, and the building of a file."""

import pytest

import evac
from evac.base.errors import EvacError
from evac.cli.main import main
from evac.editor import Session
from evac.editor.session import begin

WKT = "POLYGON ((0 0, 12 0, 12 8, 0 8, 0 0), (4 3, 5 3, 5 4, 4 4, 4 3))"


def table_of(folder):
    session = Session(folder)
    session.close()
    return session.document()["table"]


def test_an_empty_storey_has_nothing_of_the_example(tmp_path):
    assert begin(tmp_path / "new", "empty") == (tmp_path / "new", [])
    case = evac.load(tmp_path / "new")
    assert case.title == "New building"
    assert [group.level for group in case.people] == ["ground"]
    assert case.simulation.duration == 3600.0  # so that a tower is left in it
    assert table_of(tmp_path / "new")["storeys"] == [{"name": "ground", "z": 0.0, "wall": 0.1}]


def test_the_example_is_that_of_evac_new(tmp_path):
    begin(tmp_path / "a", "example")
    main(["new", str(tmp_path / "b")])
    for name in ("case.toml", "house.plan.toml"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


def test_a_file_is_imported_and_what_is_wrong_is_told(tmp_path):
    begin(tmp_path / "new", "file", "../hall.wkt", WKT.encode())
    assert table_of(tmp_path / "new")["storeys"][0]["name"] == "floor"
    assert evac.load(tmp_path / "new").title == "hall"
    with pytest.raises(EvacError, match=r"^hall\.wkt: "):
        begin(tmp_path / "other", "file", "hall.wkt", b"POLYGON ((0 0, 1")
    assert not (tmp_path / "other/case.toml").exists()


def test_a_folder_whose_name_is_taken_has_a_number(tmp_path):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine-2").write_text("a file")
    assert begin(tmp_path / "mine", "example") == (tmp_path / "mine-3", [])
    assert [*(tmp_path / "mine").iterdir()] == []
