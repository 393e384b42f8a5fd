"""evac compare."""


def test_differences_are_shown_and_written(evac, tmp_path, capsys):
    quiet = ("output.animation=false", "output.picture=false", "output.replay=false", "simulation.duration=3")
    for name, number in (("a", 4), ("b", 7)):
        evac("run", "square_room", "--out", tmp_path / name, "--set", *quiet, f"people.people.number={number}")
    capsys.readouterr()
    assert evac("compare", tmp_path / "a", tmp_path / "b", "--out", tmp_path / "c.html") == 0
    shown = capsys.readouterr()
    assert "b, compared with a" in shown.out
    assert "evacuation time" in shown.out
    assert shown.out.splitlines()[-1] == str(tmp_path / "c.html")
    assert "no interval" in shown.err or "without 1 pair" in shown.err
    assert (tmp_path / "c.html").read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
    assert evac("compare", tmp_path / "a") == 2
    assert "two or more" in capsys.readouterr().err


def test_cases_are_run_with_the_same_seeds_and_compared(evac, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert evac("compare", "square_room", "square_room", "--runs", 2, "--out", "c.html") == 0
    shown = capsys.readouterr().out
    assert "square_room-runs: No limit set" in shown
    assert "square_room-runs-2, compared with square_room-runs" in shown
    page = (tmp_path / "c.html").read_text(encoding="utf-8")
    assert page.count("<img") == 3  # curves, maximum density, waiting
    assert (tmp_path / "square_room-runs/study.json").is_file()
