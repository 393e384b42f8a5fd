import csv
import json


def test_repeat_runs_seeds_and_says_how_certain_the_result_is(evac, tmp_path, capsys):
    few = ("people.people.number=5", "output.every=0.5")
    assert evac("repeat", "square_room", "--runs", "3", "--jobs", "1", "--seed", "4", "--set", *few) == 0
    with (tmp_path / "square_room-runs" / "runs.csv").open() as file:
        assert [row["seed"] for row in csv.DictReader(file)] == ["4", "5", "6"]
    out = capsys.readouterr().out
    assert "in 3 of 3 runs" in out
    mean = json.loads((tmp_path / "square_room-runs" / "summary.json").read_text())["last_out"]["mean"]
    assert f"{mean:.2f} s" in out


def test_runs_with_people_left_are_named(evac, capsys):
    assert evac("repeat", "square_room", "--runs", "2", "--jobs", "1", "--set", "simulation.duration=1.0") == 3
    assert "people are left with seeds 1, 2" in capsys.readouterr().err
