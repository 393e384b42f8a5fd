"""Code that comes with a case: loading runs none of it, running only what lies in its folder."""

import textwrap

import pytest

import evac
from evac.base.errors import ScenarioError
from evac.case.loading import run_plugin_files
from evac.cli import main
from evac.contract.registry import Registry

PLUGIN = """
    from pathlib import Path
    from evac import Behaviour, Parameter, hookimpl
    evac_interface = 3
    Path(__file__).with_suffix(".ran").touch()

    class Odd(Behaviour):
        name = "odd"
        share = Parameter(0.5, "share", maximum=1.0)
        group_keys = ("share",)

        def act(self, crowd, time):
            pass

    @hookimpl
    def evac_behaviours():
        return [Odd]
"""


@pytest.fixture
def folder(tmp_path):
    """A folder with a case that names a plugin file of its own."""
    folder = tmp_path / "stranger"
    folder.mkdir()
    for path in Registry().cases["square_room"].iterdir():
        if path.is_file():
            (folder / path.name).write_bytes(path.read_bytes())
    with (folder / "case.toml").open("a", encoding="utf-8") as file:
        file.write('\n[behaviours.odd]\nshare = 0.25\n\n[plugins]\nfiles = ["odd.py"]\n')
    (folder / "odd.py").write_text(textwrap.dedent(PLUGIN), encoding="utf-8")
    return folder


def _has_run(folder):
    return (folder / "odd.ran").exists()


def test_loading_runs_nothing_and_names_what_it_cannot_check(folder):
    case = evac.load(folder)
    assert not _has_run(folder)
    assert case.unloaded_files == case.plugin_files == (folder / "odd.py",)
    assert case.loaded_files == ()
    assert case.unchecked == (("behaviours", "odd"),)
    assert case.to_dict()["behaviours"]["odd"] == {"share": 0.25}
    assert case.change({"simulation.seed": 3}).unloaded_files == case.unloaded_files
    assert not _has_run(folder)


def test_running_runs_the_files_and_checks_the_names(folder):
    case = evac.load(folder)
    told = []
    ready = run_plugin_files(case, told.append)
    assert told == [folder / "odd.py"]
    assert _has_run(folder)
    assert (ready.unloaded_files, ready.loaded_files, ready.unchecked) == ((), (folder / "odd.py",), ())
    assert run_plugin_files(ready) is ready
    with pytest.raises(ScenarioError, match=r"behaviours\.odd\.share: .* 1"):
        ready.change({"behaviours.odd.share": 2.0})
    simulation = evac.Simulation(case)
    assert [behaviour.name for behaviour, _ in simulation.behaviours] == ["odd"]
    assert simulation.case.unchecked == ()


@pytest.mark.parametrize(
    "change",
    [
        {"behaviours.odd.share": 2.0},
        {"behaviours.even": {}},
        {"contact.model": "soft"},
        {"contact.soft": {}},
        {"contact.nsm2.solver": "fast"},
        {"forces.pull": {}},
        {"recorders.tape": {}},
        {"importers.drawn": {}},
        {"people.people.behaviours.even": {}},
    ],
    ids=str,
)
def test_a_name_that_the_files_do_not_know_either_is_refused_when_they_have_run(folder, change):
    (key,) = change
    case = evac.load(folder, change)
    assert len(case.unchecked) == 1 + (key != "behaviours.odd.share")
    with pytest.raises(ScenarioError, match=key.replace(".", r"\.")):
        run_plugin_files(case)


def _by_path(folder, place):
    return str(place / "odd.py")


def _by_dots(folder, place):
    return "../elsewhere/odd.py"


def _by_link(folder, place):
    (folder / "link.py").symlink_to(place / "odd.py")
    return "link.py"


def _by_linked_folder(folder, place):
    (folder / "more").symlink_to(place)
    return "more/odd.py"


@pytest.mark.parametrize("way", [_by_path, _by_dots, _by_link, _by_linked_folder])
def test_a_file_outside_of_the_folder_is_run_only_if_it_is_given(folder, way):
    place = folder.parent / "elsewhere"
    place.mkdir()
    (folder / "odd.py").rename(place / "odd.py")
    change = {"plugins.files": [way(folder, place)]}
    case = evac.load(folder, change)
    assert case.unloaded_files == (place / "odd.py",)
    with pytest.raises(ScenarioError, match=r"plugins\.files: .*odd\.py.* --plugin"):
        evac.Simulation(case)
    assert not _has_run(place)
    trusted = evac.load(folder, change, plugin_files=[place / "odd.py"])
    assert _has_run(place)
    assert (trusted.unloaded_files, trusted.unchecked) == ((), ())


def test_nothing_is_run_if_one_file_lies_outside(folder):
    (folder.parent / "other.py").write_text("raise SystemExit", encoding="utf-8")
    with pytest.raises(ScenarioError, match=r"other\.py"):
        run_plugin_files(evac.load(folder, {"plugins.files": ["odd.py", "../other.py"]}))
    assert not _has_run(folder)


def test_a_file_that_became_a_link_since_is_not_run(folder):
    case = evac.load(folder)
    (folder / "odd.py").rename(folder.parent / "odd.py")
    (folder / "odd.py").symlink_to(folder.parent / "odd.py")
    with pytest.raises(ScenarioError, match="outside"):
        run_plugin_files(case)


def test_check_lists_the_files_and_runs_them_only_if_they_are_given(folder, capsys):
    assert main(["check", str(folder)]) == 0
    out, err = capsys.readouterr()
    assert "odd.py" in out
    assert "behaviours.odd" in err
    assert main(["check", str(folder), "--json"]) == 0
    assert "behaviours.odd" in capsys.readouterr().out
    assert not _has_run(folder)
    assert main(["check", str(folder), "--plugin", str(folder / "odd.py")]) == 0
    assert _has_run(folder)
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    "words", [["explain"], ["run", "--out", "result"], ["repeat", "--runs", "1", "--out", "result"]]
)
def test_commands_that_run_the_files_say_so(folder, capsys, monkeypatch, words):
    monkeypatch.chdir(folder.parent)
    quick = ["--set", "simulation.duration=0.5", "output.picture=false", "output.animation=false"]
    assert main([words[0], str(folder), *words[1:], *quick]) in (0, 3)
    assert str(folder / "odd.py") in capsys.readouterr().err
    assert _has_run(folder)
