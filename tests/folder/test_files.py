import errno
import os
import stat

import pytest

import evac
from evac.base.errors import ResultError
from evac.cli.main import main
from evac.contract.registry import Registry, built_in
from evac.export.exporter import export
from evac.folder.files import COMPLETE, MANIFEST_NAME, mark, note_written, replacing, writing


def test_what_the_system_refuses_names_the_place_and_the_way_out(tmp_path):
    place = tmp_path / "absent" / "file"
    with pytest.raises(ResultError, match=r"file: .*the table"), writing("the table", place):
        place.write_text("a")


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    folder = tmp_path_factory.mktemp("links") / "r"
    evac.run(evac.load("square_room", {"simulation.duration": 0.2, "output.picture": False}), folder)
    return folder


def test_a_file_that_cannot_be_written_whole_stays_as_it_was(tmp_path, monkeypatch):
    path = tmp_path / "people.csv"
    path.write_text("before")

    def full(descriptor):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(ResultError, match=r"people\.csv: .*No space left"), replacing(path, "the table") as new:
        new.write_text("aft")
    assert path.read_text() == "before"
    assert [path.name for path in tmp_path.iterdir()] == ["people.csv"]


def test_files_can_be_read_as_others_are(tmp_path):
    (tmp_path / "other").touch()
    mark(tmp_path, COMPLETE, "r")
    with replacing(tmp_path / "file", "it") as new:
        new.write_text("it")
    assert len({(tmp_path / name).stat().st_mode for name in ("file", "other", MANIFEST_NAME)}) == 1


def test_a_file_and_then_its_folder_are_forced_to_the_disk(tmp_path, monkeypatch):
    synced = []
    monkeypatch.setattr(os, "fsync", lambda descriptor: synced.append(stat.S_ISDIR(os.fstat(descriptor).st_mode)))
    with replacing(tmp_path / "file", "it") as new:
        new.write_text("it")
    assert synced == [False, True]


def test_a_temporary_name_that_is_taken_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("secrets.token_hex", lambda number: "taken")
    with replacing(tmp_path / "a.csv", "it") as new:
        new.write_text("it")
    new.write_text("mine")
    with pytest.raises(ResultError, match=r"b\.csv"), replacing(tmp_path / "b.csv", "it"):
        raise AssertionError


@pytest.mark.parametrize(
    ("name", "command"),
    [
        ("replay.html", "replay"),
        ("report.html", "report --maps density"),
        ("picture.png", "render --out {} --view plan --size 100 100"),
        ("export/trajectory.csv", "export --to csv"),
        ("export/jupedsim/room.sqlite", "export --to jupedsim"),
        ("animation.pvd", "export"),
    ],
)
def test_links_in_a_result_are_replaced_and_not_followed(result, tmp_path, name, command):
    thesis, place = tmp_path / "thesis.txt", result / name
    thesis.write_text("precious")
    place.parent.mkdir(parents=True, exist_ok=True)
    place.unlink(missing_ok=True)
    note_written([place])
    place.symlink_to(thesis)
    assert main([*(word.format(place) for word in command.split()), str(result)]) == 0
    assert thesis.read_text() == "precious"
    assert place.is_file()
    assert not place.is_symlink()


@pytest.mark.parametrize("kind", ["csv", "jupedsim"])
def test_a_linked_folder_of_a_result_is_not_written_to(tmp_path, kind):
    folder, elsewhere = tmp_path / "r", tmp_path / "elsewhere"
    evac.run(evac.load("square_room", {"simulation.duration": 0.2, "output.picture": False}), folder)
    elsewhere.mkdir()
    (folder / "export").symlink_to(elsewhere, target_is_directory=True)
    exporter = Registry(builtins=built_in("exporter")).get("exporter", kind)()
    with pytest.raises(ResultError, match="is a link"):
        export(evac.read_trajectory(folder), exporter)
    assert not [path for path in elsewhere.rglob("*") if path.is_file()]
