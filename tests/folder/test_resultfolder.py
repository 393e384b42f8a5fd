"""A result is replaced as a whole, and nothing that others have put there is lost; wherever a process is killed."""

import json
import os
import re
from contextlib import suppress

import numpy as np
import pytest

import evac
from evac.base.errors import PluginError, ResultError
from evac.cli.main import main
from evac.folder.files import COMPLETE, MANIFEST_NAME, RUNNING, mark, note_written, replacing
from evac.folder.resultfolder import ResultFolder, find_result
from evac.results.ending import Stopped

SUMMARY = json.dumps({"versions": {"evac": "1"}, "plugin_files": ["inside.csv", "sub/more.csv"]})


def write(folder, **texts):
    for name, text in texts.items():
        path = folder / name.replace("__", "/").replace("_", ".")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)


def write_noted(folder, **texts):
    """Write files as evac does."""
    write(folder, **texts)
    note_written(folder / name.replace("__", "/").replace("_", ".") for name in texts)


def contents(folder):
    files = [path for path in folder.rglob("*") if path.is_file() and path.name != MANIFEST_NAME]
    return {path.relative_to(folder).as_posix(): path.read_text() for path in files}


@pytest.fixture
def earlier(tmp_path):
    """An earlier result with files of plugins and of others."""
    folder = tmp_path / "r"
    folder.mkdir()
    mark(folder, COMPLETE, "r")
    write_noted(folder, summary_json=SUMMARY, people_csv="old", egress_csv="old", inside_csv="old", sub__more_csv="old")
    write(folder, notes_txt="mine", frames__own_vtp="mine", deep__er__notes_txt="mine", sub__own_txt="mine")
    return folder


def run_into(folder):
    with ResultFolder(folder) as place:
        place.start()
        before = contents(folder) if folder.exists() else {}
        write_noted(place.running, summary_json=SUMMARY, people_csv="new", notes_txt="of a plugin", deep="new")
        assert not before or contents(folder) == before
        place.publish()


OTHERS = {"frames/own.vtp": "mine", "deep.earlier/er/notes.txt": "mine", "sub/own.txt": "mine"}
AFTER = {"summary.json": SUMMARY, "people.csv": "new", "notes.txt": "of a plugin", "deep": "new"} | OTHERS
AFTER |= {"notes.txt.earlier": "mine"}


def test_a_new_result_takes_the_place_of_an_earlier_one(earlier):
    run_into(earlier)
    assert contents(earlier) == AFTER
    assert [path.name for path in earlier.parent.iterdir()] == ["r"]


class Killed(BaseException):
    """Ends a process as a signal does."""


def publish_until(folder, calls, monkeypatch):
    """Write a new result, and be killed after so many calls of the system while it replaces the earlier one."""

    def counted(real):
        def call(*args, **options):
            nonlocal calls
            calls -= 1
            if calls < 0:
                raise Killed
            return real(*args, **options)

        return call

    with ResultFolder(folder) as place:
        place.start()
        write_noted(place.running, summary_json=SUMMARY, people_csv="new", notes_txt="of a plugin", deep="new")
        with monkeypatch.context() as patch:
            for name in ("rename", "unlink", "rmdir", "open"):
                patch.setattr(os, name, counted(getattr(os, name)))
            place.publish()


@pytest.mark.parametrize("calls", range(1, 24))
def test_a_kill_during_the_replacement_loses_nothing(earlier, monkeypatch, calls):
    """One of the two results is whole after each call of the system, and the next command ends what was begun."""
    before = contents(earlier)
    with suppress(Killed):
        publish_until(earlier, calls, monkeypatch)
    now = contents(find_result(earlier))
    is_new = now["people.csv"] == "new"
    assert is_new or now == before
    with ResultFolder(earlier):
        pass
    assert contents(earlier) == (AFTER if is_new else before)


def test_what_a_killed_run_has_left_goes_but_for_files_of_others(tmp_path):
    (tmp_path / "r.running").mkdir()
    mark(tmp_path / "r.running", RUNNING, "r")
    write_noted(tmp_path / "r.running", trajectory_evac="EVACTRJ2", checkpoint_evac="old", people_csv="old")
    write(tmp_path / "r.running", mine_txt="mine")
    with ResultFolder(tmp_path / "r") as place:
        assert place.is_left_over
        place.start()
        assert contents(place.running) == {"mine.txt": "mine"}
        place.publish()
    assert contents(tmp_path / "r") == {"mine.txt": "mine"}


def test_what_a_killed_process_was_writing_goes_in_every_folder(tmp_path):
    folder = tmp_path / "r"
    folder.mkdir()
    mark(folder, COMPLETE, "r")
    write_noted(folder, summary_json=SUMMARY, frames__1_vtp="old", export__parts__1_vtp="old")
    cut = (".evac-x.json", "frames/.evac-y.vtp", "export/parts/.evac-z.vtp", ".evac-draft/frames/1.vtp")
    for name in cut:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text("cut")
    note_written(folder / name.removesuffix("/frames/1.vtp") for name in cut)
    write(folder, **{".evac-notes__thesis_txt": "precious"})
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / ".evac-thesis.txt").write_text("precious")
    (folder / "frames" / ".evac-link").symlink_to(tmp_path / "other", target_is_directory=True)
    run_into(folder)
    assert not set(cut) & contents(folder).keys()
    assert (folder / ".evac-notes" / "thesis.txt").read_text() == "precious"
    assert (tmp_path / "other" / ".evac-thesis.txt").read_text() == "precious"


def test_a_folder_of_others_is_refused_and_left_alone(tmp_path):
    write(tmp_path / "r", thesis_txt="precious")
    with pytest.raises(ResultError, match=r"r: .*folder"), ResultFolder(tmp_path / "r"):
        pass
    assert contents(tmp_path) == {"r/thesis.txt": "precious"}


NAMES = ("r.running", "r.running/notes.md", "r.running/manifest.jsonl", "r/manifest.jsonl")


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(
    "content", ["mine", '{"file": "song.wav"}', '{"is": "running", "of": "r"}\n{"file": "song.wav"}']
)
def test_a_folder_is_known_by_its_mark_and_not_by_its_name(tmp_path, name, content):
    path = tmp_path / name
    path.parent.mkdir(exist_ok=True)
    path.write_text(content)
    if path.parent != tmp_path:
        (path.parent / "song.wav").write_text("precious")
    before = contents(tmp_path), path.read_text()
    with pytest.raises(ResultError, match=re.escape(name.split("/")[0])), ResultFolder(tmp_path / "r"):
        pass
    assert (contents(tmp_path), path.read_text()) == before


def test_a_manifest_of_others_gets_no_lines(tmp_path):
    (tmp_path / MANIFEST_NAME).write_text('{"audio": "a.wav"}')
    run_into(tmp_path / "deep" / "r")
    with replacing(tmp_path / "deep" / "page.html", "the page") as new:
        new.write_text("page")
    assert (tmp_path / MANIFEST_NAME).read_text() == '{"audio": "a.wav"}'


@pytest.mark.parametrize("name", ["../thesis.txt", "/thesis.txt", "linked/thesis.txt", "link.txt"])
def test_a_manifest_cannot_make_files_outside_go(tmp_path, earlier, name):
    write(tmp_path / "other", thesis_txt="precious")
    (earlier / "linked").symlink_to(tmp_path / "other", target_is_directory=True)
    (earlier / "link.txt").symlink_to(tmp_path / "other" / "thesis.txt")
    name = name.replace("..", "../other") if name.startswith("..") else name
    name = str(tmp_path / "other" / "thesis.txt") if name.startswith("/") else name
    with (earlier / MANIFEST_NAME).open("a") as file:
        file.write("\n" + json.dumps({"file": name}) + "\nno json\n[]\n")
    run_into(earlier)
    assert (tmp_path / "other" / "thesis.txt").read_text() == "precious"
    assert (earlier / "link.txt").is_symlink()
    assert (earlier / "linked").is_symlink()


def test_files_of_others_with_the_names_of_maps_and_exports_stay(earlier):
    write(earlier, map_png="mine", export__notes_md="mine", export__sub__notes_md="mine")
    run_into(earlier)
    assert {"map.png", "export/notes.md", "export/sub/notes.md"} <= contents(earlier).keys()


def test_a_result_with_the_name_of_the_folder_of_a_run_is_left_alone(tmp_path):
    run_into(tmp_path / "r.running")
    before = contents(tmp_path)
    with pytest.raises(ResultError, match=r"r\.running: "), ResultFolder(tmp_path / "r"):
        pass
    assert contents(tmp_path) == before


def test_the_runs_of_a_stopped_study_are_left_alone(tmp_path):
    with ResultFolder(tmp_path / "r") as place:
        place.start()
        write_noted(place.running, study_json="{}", runs_arrows="rows")
    before = contents(tmp_path)
    with pytest.raises(ResultError, match=r"r\.running: .*--resume"), ResultFolder(tmp_path / "r") as place:
        place.start()
    assert contents(tmp_path) == before


def test_what_has_not_come_to_its_end_stays_beside_an_earlier_result(earlier, tmp_path):
    for folder, where in ((earlier, "r.running"), (tmp_path / "other", "other")):
        with ResultFolder(folder) as place:
            place.start()
            write(place.running, people_csv="new")
            assert place.publish_if_new().name == where
    assert contents(earlier)["people.csv"] == "old"


def test_a_link_stays_a_link(tmp_path):
    write(tmp_path / "disk" / "r", summary_json=SUMMARY)
    mark(tmp_path / "disk" / "r", COMPLETE, "r")
    (tmp_path / "r").symlink_to(tmp_path / "disk" / "r", target_is_directory=True)
    run_into(tmp_path / "r")
    assert (tmp_path / "r").is_symlink()
    assert contents(tmp_path / "disk" / "r")["people.csv"] == "new"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["disk", "r"]


@pytest.fixture
def case():
    return evac.load("square_room", {"output.picture": False, "output.animation": False})


def test_a_folder_that_is_removed_during_the_run_ends_it(tmp_path, case):
    earlier = tmp_path / "r"
    evac.run(case, earlier)
    before = (earlier / "summary.json").read_bytes()

    def remove(progress):
        if 0.95 < progress.time < 1.05:
            for path in (tmp_path / "r.running").iterdir():
                path.unlink()
            (tmp_path / "r.running").rmdir()
        assert progress.time < 1.2

    with pytest.raises(ResultError, match=r"r\.running: .*removed"):
        evac.run(case, earlier, progress=remove)
    assert (earlier / "summary.json").read_bytes() == before


@pytest.mark.parametrize("cut", [True, False])
def test_a_trajectory_that_is_cut_or_removed_during_the_run_is_noticed(tmp_path, case, cut):
    def damage(progress):
        if 0.95 < progress.time < 1.05:
            path = tmp_path / "r.running" / "trajectory.evac"
            path.write_bytes(b"") if cut else path.unlink()

    with pytest.raises(ResultError, match=r"trajectory\.evac"):
        evac.run(case, tmp_path / "r", progress=damage)


def test_a_failed_run_leaves_an_earlier_result_alone(tmp_path, case):
    evac.run(case, tmp_path / "r")
    before = (tmp_path / "r" / "summary.json").read_bytes()

    def fail(progress):
        if progress.time > 1.0:
            raise PluginError("odd")

    with pytest.raises(PluginError, match="odd") as caught:
        evac.run(case, tmp_path / "r", progress=fail)
    assert any("r.running" in note for note in caught.value.__notes__)
    assert (tmp_path / "r" / "summary.json").read_bytes() == before
    assert json.loads((tmp_path / "r.running" / "summary.json").read_text())["ended"] == "failed"


def test_two_runs_into_one_folder_are_kept_apart(tmp_path, case):
    def second(progress):
        with pytest.raises(ResultError, match=f"r: .* {os.getpid()} "):
            evac.run(case, tmp_path / "r")
        raise Stopped

    evac.run(case, tmp_path / "r", progress=second)
    assert len(np.loadtxt(tmp_path / "r" / "people.csv", delimiter=",", skiprows=1, usecols=0)) == 20


SHORT = ["--set", "simulation.duration=0.3", "output.picture=false", "output.replay=false", "output.animation=false"]

#: Files of somebody else in and beside a result ``r``.
OWN = ("r/report.html", "r/map_density.png", "r/picture.png", "r/replay.html", "r/export/trajectory.csv")
OWN += ("r/.evac-notes/a.md", "r.importing.md", "data/manifest.jsonl", "data/report.html")
COMMANDS = (
    *("report r", "map r --of density", "render r --out r/picture.png --view plan --size 100 100", "replay r"),
    *("export r --to csv", f"run square_room --out r {' '.join(SHORT)}", "report r --out data/rep.html"),
    "export r --to geojson --out data/exp",
)


def tree(folder):
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_files_of_somebody_else_survive_every_command(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["run", "square_room", "--out", "r", *SHORT]) == 3
    for name in OWN:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("mine")
    status = [main(command.split()) for command in COMMANDS]
    assert status == [2, 2, 2, 2, 2, 3, 0, 0]
    after = tree(tmp_path)
    assert {name: after[name] for name in OWN} == dict.fromkeys(OWN, b"mine")
    assert set(after) - set(OWN) == {
        *(f"r/{name}" for name in ("manifest.jsonl", "summary.json", "people.csv", "egress.csv", "flows.csv")),
        *("r/trajectory.evac", "data/rep.html", "data/exp"),
    }


@pytest.mark.parametrize("name", ["summary.json", "people.csv", "trajectory.evac"])
def test_a_pipe_in_a_result_ends_nothing(tmp_path, name):
    evac.run(evac.load("square_room", {"simulation.duration": 0.3, "output.picture": False}), tmp_path / "r")
    (tmp_path / "r" / name).unlink()
    os.mkfifo(tmp_path / "r" / name)
    assert main(["replay", str(tmp_path / "r"), "--out", str(tmp_path / "q.html")]) == 2
    assert (tmp_path / "r" / name).is_fifo()
