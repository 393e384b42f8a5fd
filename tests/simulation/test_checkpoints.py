"""A run that was killed or stopped goes on to the bits of one that was not; what cannot go on is refused by name."""

import base64
import hashlib
import json
import os
import re
import shutil
import textwrap
import zlib

import numpy as np
import pytest

import evac
from evac.base.errors import EvacError, FolderWarning, PluginError, ResultError
from evac.folder.files import CHECKPOINT_NAME
from evac.replay.writer import replay_trajectory
from evac.results.ending import Stopped
from evac.simulation.checkpoints import find_checkpoint, write_checkpoint
from tests.runs import two_doors

QUIET = {"output.picture": False, "output.animation": False}
TABLES = ("people.csv", "egress.csv", "trajectory.evac")

PLUGIN = """
    import numpy as np
    from evac import Behaviour, Recorder, hookimpl
    evac_interface = 3

    class Closing(Behaviour):
        '''Closes the front door after 1 s.'''
        name = "closing"
        def prepare(self, scene):
            self.seen = scene
        def act(self, crowd, time):
            if time >= 1.0 and self.seen.version == 0:
                self.seen.scene.set_open("front", False)
        {state}

    class Inside(Recorder):
        '''Writes a line at every output time.'''
        name = "inside"
        def start(self, simulation):
            self.write(simulation, "w", "")
        def write(self, simulation, mode, text):
            with (simulation.folder / "inside.txt").open(mode) as file:
                file.write(text)
                self.length = file.tell()
        def record(self, simulation):
            self.write(simulation, "a", f"{{simulation.population.inside}}\\n")
        def state(self):
            return {{"length": np.array(self.length)}}
        def restore(self, simulation, state):
            self.length = int(state["length"])
        def files(self):
            return {{"inside.txt": self.length}}

    @hookimpl
    def evac_behaviours():
        return [Closing]

    @hookimpl
    def evac_recorders():
        return [Inside]
"""


def hall_in(folder):
    """Return the table of a room with the exits front and back."""
    output = {"picture": False, "animation": False, "every": 0.2}
    return two_doors(folder) | {"simulation": {"duration": 6.0}, "output": output}


@pytest.fixture
def hall(tmp_path):
    return hall_in(tmp_path)


@pytest.fixture(scope="module")
def killed_once(tmp_path_factory):
    folder = tmp_path_factory.mktemp("killed")
    kill(evac.load(hall_in(folder)), folder / "r", 1.0)
    return folder / "r.running"


@pytest.fixture
def killed(killed_once, tmp_path):
    """Return the result folder of a run that was killed after 1 s."""
    shutil.copytree(killed_once, tmp_path / "r.running")
    return tmp_path / "r"


@pytest.fixture
def closing(tmp_path, hall):
    """Return a case whose front door a plugin closes, and the plugin."""
    plugin = tmp_path / "closing.py"
    plugin.write_text(textwrap.dedent(PLUGIN.format(state="def state(self): return {}")))
    choice = {"route_choice": {"every": 0.7}, "headway": {}, "closing": {}}
    return evac.load({**hall, "behaviours": choice}, plugin_files=[plugin]), plugin


class Killed(BaseException):
    """Ends a run as a kill does: nothing that it writes comes after it."""


def until(time, raised=Killed):
    def look(progress):
        if progress.time >= time - 1e-9:
            raise raised

    return look


def kill(case, folder, time, **options):
    with pytest.raises(Killed):
        evac.run(case, folder, checkpoint=0.0, progress=until(time), **options)
    assert (folder.with_name(f"{folder.name}.running") / CHECKPOINT_NAME).is_file()


def assert_same_files(one, other, names=TABLES):
    assert sorted(path.name for path in one.iterdir()) == sorted(path.name for path in other.iterdir())
    for name in names:
        assert (one / name).read_bytes() == (other / name).read_bytes(), name
    a, b = (json.loads((folder / "summary.json").read_text()) for folder in (one, other))
    assert b["resumed"]
    for summary in (a, b):
        del summary["wall_time"], summary["resumed"]
    assert a == b


def check_goes_on(case, tmp_path, times, **options):
    evac.run(case, tmp_path / "whole", **options)
    kill(case, tmp_path / "r", times[0], **options)
    plugins = case.plugin_files
    for time in times[1:]:
        with pytest.raises(Killed):
            evac.resume(tmp_path / "r", plugin_files=plugins, progress=until(time))
    evac.resume(tmp_path / "r", plugin_files=plugins)
    assert_same_files(tmp_path / "whole", tmp_path / "r")
    # Nothing of what was interrupted is left; Python keeps byte code beside plugin files.
    assert {path.name for path in tmp_path.iterdir() if path.is_dir()} - {"__pycache__"} == {"r", "whole"}


@pytest.mark.parametrize("model", ["dem", "nsm1", "nsm2"])
def test_every_contact_model_with_forces_goes_on_to_the_same_bits(tmp_path, model):
    changes = {"contact.model": model, "simulation.duration": 4.0, "forces.social": {}, "output.every": 0.3} | QUIET
    check_goes_on(evac.load("square_room", changes), tmp_path, [1.0, 1.3, 2.9])


def closed_by_time(page):
    """Return what a page shows as closed: links from a time on."""
    page = page.read_text(encoding="utf-8")
    about = re.search(r'id="data-about">([^<]*)<', page)[1]
    return [[one["since"], one["shut"]] for one in json.loads(zlib.decompress(base64.b64decode(about)))["states"]]


def test_a_door_that_has_closed_stays_closed(tmp_path, closing):
    """Killed before, at and after the closure, with choice of routes, and a recorder of a plugin."""
    case, _ = closing
    check_goes_on(case, tmp_path, [0.5, 1.0, 1.1, 2.0])
    replay_trajectory(evac.read_trajectory(tmp_path / "r"), tmp_path / "later.html")
    for page in ("r/replay.html", "whole/replay.html", "later.html"):
        assert closed_by_time(tmp_path / page) == [[0.0, []], [1.0, [0]]]
    assert (tmp_path / "r" / "inside.txt").read_text() == (tmp_path / "whole" / "inside.txt").read_text()


def test_a_stopped_run_goes_on_beside_what_a_killed_one_has_left(tmp_path, hall):
    case = evac.load(hall)
    evac.run(case, tmp_path / "whole")
    evac.run(case, tmp_path / "r", progress=until(1.0, Stopped))
    with pytest.raises(Killed):
        evac.run(case, tmp_path / "r", progress=until(2.0))
    (tmp_path / "r.running" / "notes.txt").write_text("mine")
    evac.resume(tmp_path / "r")
    assert (tmp_path / "r" / "notes.txt").read_text() == "mine"
    (tmp_path / "r" / "notes.txt").unlink()
    assert_same_files(tmp_path / "whole", tmp_path / "r")


def test_a_stopped_run_leaves_an_earlier_result_alone(tmp_path, hall):
    case = evac.load(hall)
    evac.run(case, tmp_path / "r")
    before = (tmp_path / "r" / "summary.json").read_bytes()
    results = evac.run(case, tmp_path / "r", progress=until(1.0, Stopped))
    assert results.folder == tmp_path / "r.running"
    assert (tmp_path / "r" / "summary.json").read_bytes() == before
    assert evac.resume(tmp_path / "r").folder == tmp_path / "r"
    assert not (tmp_path / "r.running").exists()


def test_plugins_without_state_are_refused_by_name(tmp_path, hall):
    plugin = tmp_path / "closing.py"
    text = textwrap.dedent(PLUGIN.format(state=""))
    plugin.write_text(
        text[: text.index("    def state(self):\n        return {{".replace("{{", "{"))]
        + text[text.index("@hookimpl") :]
    )
    case = evac.load({**hall, "behaviours": {"closing": {}}}, plugin_files=[plugin])
    with pytest.raises(PluginError) as caught:
        evac.run(case, tmp_path / "r", checkpoint=60)
    for words in ("behaviour 'closing'", "seen", "recorder 'inside'", "length"):
        assert words in str(caught.value)
    assert not (tmp_path / "r").exists()
    with pytest.warns(FolderWarning, match=r"behaviour 'closing' .*seen"):
        evac.run(case, tmp_path / "r", progress=until(1.0, Stopped))
    assert (tmp_path / "r" / "people.csv").is_file()
    assert not (tmp_path / "r" / CHECKPOINT_NAME).exists()


def test_a_plugin_that_was_given_is_to_be_given_again_and_unchanged(tmp_path, closing):
    case, plugin = closing
    kill(case, tmp_path / "r", 1.5)
    with pytest.raises(PluginError, match=r"closing\.py"):
        evac.resume(tmp_path / "r")
    plugin.write_text(plugin.read_text() + "# changed\n")
    with pytest.raises(ResultError, match=r"file .*closing\.py: "):
        evac.resume(tmp_path / "r", plugin_files=[plugin])
    assert find_checkpoint(tmp_path / "r").header.time == pytest.approx(1.4)


def test_other_versions_and_files_are_refused_unless_allowed(tmp_path, hall, monkeypatch):
    kill(evac.load(hall), tmp_path / "r", 1.5)
    monkeypatch.setattr("evac.simulation.checkpoints.versions", lambda: {"numpy": "0.1"})
    mesh = tmp_path / "room.obj"
    mesh.write_text(mesh.read_text() + "# changed\n")
    with pytest.raises(ResultError) as caught:
        evac.resume(tmp_path / "r")
    for words in ("version numpy: ", "0.1 now", "file room.obj: "):
        assert words in str(caught.value)
    evac.resume(tmp_path / "r", allow_differences=True)
    (resumed,) = json.loads((tmp_path / "r" / "summary.json").read_text())["resumed"]
    assert any("0.1 now" in line for line in resumed["differences"])


def test_other_kernels_are_refused(killed, monkeypatch):
    monkeypatch.setattr("evac.simulation.checkpoints.digest_of", lambda entry, processor: "changed")
    with pytest.raises(ResultError, match=r"kernel .*advance.*changed now"):
        evac.resume(killed)


def test_a_file_that_was_cut_is_refused(killed):
    path = killed.with_name("r.running") / "trajectory.evac"
    os.truncate(path, 100)
    with pytest.raises(ResultError, match=r"trajectory\.evac: .* 100 "):
        evac.resume(killed)
    path.unlink()
    with pytest.raises(ResultError, match=r"trajectory\.evac: .*removed"):
        evac.resume(killed)


@pytest.mark.parametrize("name", ["../thesis.txt", "/thesis.txt", "link"])
def test_no_file_outside_the_folder_is_cut(tmp_path, killed, name):
    (tmp_path / "thesis.txt").write_text("precious")
    found = find_checkpoint(killed)
    (found.path.parent / "link").symlink_to(tmp_path / "thesis.txt")
    name = str(tmp_path / "thesis.txt") if name.startswith("/") else name
    empty = {"length": 0, "sha256": hashlib.sha256().hexdigest()}
    write_checkpoint(found.path, found.header.model_dump() | {"files": {name: empty}}, found.arrays)
    with pytest.raises(ResultError, match=f"{name} .*folder"):
        evac.resume(killed)
    assert (tmp_path / "thesis.txt").read_text() == "precious"


def content(folder):
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def forge(folder, header=(), **arrays):
    """Replace parts of a checkpoint, with a valid checksum, and return the content of the folder."""
    found = find_checkpoint(folder)
    write_checkpoint(found.path, found.header.model_dump() | dict(header), {**found.arrays, **arrays})
    return content(found.path.parent)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("simulation.population.crowd.route", np.full(16, 10**6, np.int32)),
        ("simulation.population.crowd.level", np.full(16, 7, np.int32)),
        ("simulation.population.crowd.position", np.zeros((16, 3))),
        ("simulation.population.crowd.radius", np.full(16, 1, np.int32)),
        ("simulation.population.crowd.mass", np.ones(15)),
        ("simulation.population.crowd.exit_used", np.full(16, 5, np.int32)),
        ("simulation.population.crowd.level", np.full(16, -1, np.int32)),
        ("simulation.step", np.array([1, 2])),
        ("simulation.scene.journal", np.frombuffer(b'[[{"time": "soon"}], []]', np.uint8)),
        ("simulation.scene.journal", np.frombuffer(b"[", np.uint8)),
        ("simulation.engine.data.tally", np.zeros(29)),
        ("recorder.trajectory.changes", np.array(9.0)),
    ],
)
def test_arrays_that_no_run_can_have_are_refused_by_name(killed, name, value):
    before = forge(killed, **{name: value})
    with pytest.raises(ResultError, match=rf"checkpoint\.evac: .*: {name}") as caught:
        evac.resume(killed)
    assert "\n" not in str(caught.value)
    assert content(killed.with_name("r.running")) == before


@pytest.mark.parametrize("key", ["files", "made_with", "case", "time"])
def test_headers_that_evac_does_not_write_are_refused_by_name(killed, key):
    before = forge(killed, {key: None})
    with pytest.raises(ResultError, match=rf"checkpoint\.evac: {key}"):
        evac.resume(killed)
    assert content(killed.with_name("r.running")) == before


def test_a_checkpoint_without_the_entry_of_the_trajectory_is_refused_and_leaves_it(killed):
    before = forge(killed, {"files": {}})
    with pytest.raises(ResultError, match="trajectory"):
        evac.resume(killed)
    assert content(killed.with_name("r.running")) == before


def test_the_trajectory_of_another_run_is_refused_before_it_is_cut(tmp_path, killed, hall):
    """Both runs record frames of the same length, so that one ends where the checkpoint says."""
    kill(evac.load(hall, {"simulation.seed": 2}), tmp_path / "other", 2.0)
    path = killed.with_name("r.running") / "trajectory.evac"
    path.write_bytes((tmp_path / "other.running" / "trajectory.evac").read_bytes())
    before = content(killed.with_name("r.running"))
    with pytest.raises(ResultError, match=r"trajectory\.evac: .*checkpoint"):
        evac.resume(killed)
    assert content(killed.with_name("r.running")) == before


@pytest.mark.parametrize(
    ("restore", "raised"), [("raise ValueError('no')", Stopped), ("self.length = int(state['length']) - 1", Killed)]
)
def test_a_recorder_that_cannot_be_restored_leaves_the_files_as_they_were(tmp_path, hall, restore, raised):
    plugin = tmp_path / "inside.py"
    plugin.write_text(textwrap.dedent(PLUGIN.format(state="def state(self): return {}")))
    case = evac.load(hall, plugin_files=[plugin])
    if raised is Killed:
        kill(case, tmp_path / "r", 1.0)
    else:
        evac.run(case, tmp_path / "r", progress=until(1.0, raised))
    folder = tmp_path / ("r.running" if raised is Killed else "r")
    for name in ("inside.txt", "trajectory.evac"):  # as from a run that was killed after its checkpoint
        with (folder / name).open("ab") as file:
            file.write(b"behind the checkpoint")
    plugin.write_text(plugin.read_text().replace('self.length = int(state["length"])', restore))
    before = content(folder)
    with pytest.raises(EvacError, match="inside"):
        evac.resume(tmp_path / "r", plugin_files=[plugin], allow_differences=True)
    after = content(folder)
    assert after.pop("manifest.jsonl").startswith(before.pop("manifest.jsonl"))
    assert after == before


def test_plugin_files_of_a_case_are_run_only_beside_the_result_or_where_the_user_says(tmp_path, killed):
    (tmp_path / "elsewhere" / "case").mkdir(parents=True)
    case = tmp_path / "elsewhere" / "case" / "case.toml"
    (case.parent / "mark.py").write_text(
        "from pathlib import Path\nfrom evac import hookimpl\nevac_interface = 3\n"
        f"Path({str(tmp_path / 'run')!r}).touch()\n@hookimpl\ndef evac_prepare(): pass\n"
    )
    given = find_checkpoint(killed).header.case
    table = {**given.table, "plugins": {"files": ["mark.py"]}}
    forge(killed, {"case": {**given.model_dump(), "table": table, "source": str(case)}})
    with pytest.raises(PluginError, match="--case"):
        evac.resume(killed)
    with pytest.raises(PluginError, match="--case"):
        evac.resume(killed, case_file=tmp_path)
    assert not (tmp_path / "run").exists()
    with pytest.raises(ResultError, match="--allow-differences"):  # it has come since
        evac.resume(killed, case_file=case)
    assert (tmp_path / "run").exists()


def test_files_of_plugins_go_with_their_result_and_those_of_others_stay(tmp_path, closing, hall):
    case, plugin = closing
    evac.run(case, tmp_path / "r", progress=until(1.0, Stopped))
    (tmp_path / "r" / "notes.txt").write_text("mine")
    evac.resume(tmp_path / "r", plugin_files=[plugin])
    assert json.loads((tmp_path / "r" / "summary.json").read_text())["plugin_files"] == ["inside.txt"]
    evac.run(evac.load(hall), tmp_path / "r")
    assert not (tmp_path / "r" / "inside.txt").exists()
    assert (tmp_path / "r" / "notes.txt").read_text() == "mine"


def test_a_checkpoint_that_cannot_be_written_is_warned_of_and_the_run_goes_on(tmp_path, hall, monkeypatch):
    def full(*given):
        raise ResultError("checkpoint.evac: No space left on device")

    monkeypatch.setattr("evac.simulation.checkpoints.write_checkpoint", full)
    with pytest.warns(FolderWarning, match="No space left") as caught:
        results = evac.run(evac.load(hall), tmp_path / "r", checkpoint=0.0)
    assert len(caught) == 1
    assert results.time > 1.0


def test_checkpoints_change_no_bit_and_are_gone_at_the_end(tmp_path, hall):
    case = evac.load(hall)
    evac.run(case, tmp_path / "without")
    evac.run(case, tmp_path / "with", checkpoint=0.0)
    for name in TABLES:
        assert (tmp_path / "with" / name).read_bytes() == (tmp_path / "without" / name).read_bytes()
    assert not (tmp_path / "with" / CHECKPOINT_NAME).exists()


@pytest.mark.parametrize("duration", [1.0, 60.0])
def test_a_kill_after_the_last_step_loses_no_more_than_others(tmp_path, duration, monkeypatch):
    """When the outputs are being written, no step is left to make, of time or of people."""
    case = evac.load("square_room", QUIET | {"simulation.duration": duration, "people.people.number": 3})
    evac.run(case, tmp_path / "whole")

    def killed(*_):
        raise Killed

    with monkeypatch.context() as patch:
        patch.setattr("evac.results.results.Results.write_tables", killed)
        with pytest.raises(Killed):
            evac.run(case, tmp_path / "r", checkpoint=0.0)
    assert find_checkpoint(tmp_path / "r").header.time < evac.read_trajectory(tmp_path / "whole").time[-1]
    results = evac.resume(tmp_path / "r")
    assert results.ended == ("duration over" if duration == 1.0 else "everybody out")
    for name in TABLES:
        assert (tmp_path / "r" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes(), name
