"""evac report: where it writes, and what it refuses."""

import re
import shutil
import zipfile

import pytest


def test_a_report_is_written_beside_the_tables(evac, result, tmp_path, capsys):
    folder = shutil.copytree(result, tmp_path / "result")
    assert evac("report", folder, "--maps", "usage", "--author", "A. Engineer") == 0
    assert capsys.readouterr().out.strip() == str(folder / "report.html")
    text = (folder / "report.html").read_text(encoding="utf-8")
    assert text.startswith("<!DOCTYPE html>")
    assert "A. Engineer" in text
    assert not list(folder.glob("*.new"))


def test_thresholds_of_congestion_are_options(evac, result, tmp_path):
    out = tmp_path / "sub" / "one.html"
    words = ("--congestion-density", "2.5", "--congestion-time", "0.25", "--maps", "none")
    assert evac("report", result, "--out", out, *words) == 0
    text = out.read_text(encoding="utf-8")
    assert re.search(r"2\.5 .*m².* 0\.[23] s", text)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("--maps", "densty"), "densty"),
        (("--congestion-density", "-1"), "congestion"),
        (("--run", "other"), "--run"),
        (("--out", "taken/report.html", "--maps", "none"), "taken"),
    ],
)
def test_what_cannot_be_done_is_refused(evac, result, tmp_path, capsys, words, told):
    (tmp_path / "taken").write_text("a file")
    assert evac("report", result, *words) == 2
    assert told in capsys.readouterr().err


def test_a_folder_without_a_result_is_refused(evac, tmp_path, capsys):
    assert evac("report", tmp_path / "nowhere") == 2
    assert "nowhere" in capsys.readouterr().err
    assert evac("report", tmp_path) == 2
    assert "summary.json" in capsys.readouterr().err


@pytest.mark.parametrize("command", ["report", "map", "replay", "export"])
def test_a_case_instead_of_a_result_is_told_from_it(evac, tmp_path, capsys, command):
    (tmp_path / "office").mkdir()
    (tmp_path / "office" / "case.toml").write_text("title = 'Office'\n")
    more = ("--to", "csv") if command == "export" else ()
    assert evac(command, "office", *more) == 2
    assert "evac run office" in capsys.readouterr().err
    (tmp_path / "office-result").mkdir()
    for path in ("office", "office/case.toml"):
        assert evac(command, path, *more) == 2
        err = capsys.readouterr().err
        assert "office-result?" in err
        assert "Errno" not in err
    assert evac(command, "offices", *more) == 2
    assert "Errno" not in capsys.readouterr().err


def test_a_run_is_repeated_from_its_bundle(evac, result, tmp_path):
    folder = shutil.copytree(result, tmp_path / "result")
    assert evac("report", folder, "--maps", "none", "--bundle") == 0
    with zipfile.ZipFile(folder / "bundle.zip") as archive:
        archive.extractall(tmp_path / "unpacked")
    unpacked = tmp_path / "unpacked"
    assert {"README.txt", "requirements.txt", "summary.json", "report.html"} <= {one.name for one in unpacked.iterdir()}
    assert evac("run", unpacked / "case.toml", "--out", tmp_path / "again") == 0
    for name in ("people.csv", "egress.csv"):
        assert (tmp_path / "again" / name).read_bytes() == (folder / name).read_bytes()
