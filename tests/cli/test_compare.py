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


def test_studies_with_maps_are_compared(evac, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("a", "b"):
        assert evac("repeat", "square_room", "--runs", 2, "--maps", "--out", name) == 0
    capsys.readouterr()
    assert evac("compare", "a", "b", "--out", "c.html") == 0
    shown = capsys.readouterr().out
    assert "a: No limit set" in shown
    assert "b, compared with a" in shown
    page = (tmp_path / "c.html").read_text(encoding="utf-8")
    assert page.count("<img") == 3  # curves, maximum density, waiting
