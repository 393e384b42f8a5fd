"""evac replay, and which outputs a run leaves."""

import pytest

from evac.folder.files import REPLAY_NAME

ALL = {"tables", "picture", "replay", "trajectory", "animation"}
FILES = {
    "tables": {"egress.csv", "flows.csv", "people.csv"},
    "picture": {"egress.png"},
    "replay": {"replay.html"},
    "trajectory": {"trajectory.evac"},
    "animation": {"animation.pvd", "building.vtm", "building", "frames"},
}


def run(evac, *off):
    few = ["people.people.number=2", "simulation.duration=0.5"]
    switches = [f"output.{key}={str(key not in off).lower()}" for key in sorted(ALL)]
    assert evac("run", "square_room", "--out", "r", "--set", *few, *switches) == 3


@pytest.mark.parametrize("off", [{"tables"}, {"picture"}, {"replay"}, {"animation"}, {"trajectory", "animation"}, ALL])
def test_each_output_can_be_switched_off(evac, tmp_path, off):
    run(evac, *off)
    on = ALL - off - ({"replay"} if "trajectory" in off else set())  # the page is made from the trajectory
    left = set().union({"summary.json", "manifest.jsonl"}, *(FILES[key] for key in on))
    assert {path.name for path in (tmp_path / "r").iterdir()} == left


def test_vtk_switches_the_animation_on(evac, tmp_path):
    few = ["people.people.number=2", "simulation.duration=0.5", "output.animation=false", "output.picture=false"]
    evac("run", "square_room", "--out", "r", "--vtk", "--set", *few)
    assert (tmp_path / "r" / "animation.pvd").is_file()


def test_the_same_replay_is_made_again(evac, tmp_path, result):
    assert evac("replay", result, "--out", tmp_path / "page.html") == 0
    assert (tmp_path / "page.html").read_bytes() == (result / REPLAY_NAME).read_bytes()


def test_median_and_worst_runs_are_replayed(evac, tmp_path):
    few = ["people.people.number=4", "output.picture=false"]
    assert evac("repeat", "square_room", "--runs", "3", "--jobs", "1", "--out", "r", "--replay", "--set", *few) == 0
    names = {path.name for path in (tmp_path / "r").iterdir()}
    assert {"replay-median.html", "replay-worst.html"} < names
    assert names.isdisjoint({"trajectory.evac", "replay.html", "frames"})
    for rank in ("median", "worst"):
        page = (tmp_path / "r" / f"replay-{rank}.html").read_text(encoding="utf-8")
        assert f"<title>{rank.capitalize()} of 3 runs, seed " in page
