"""evac verify: the list, statuses, the page, and plugin files."""

import csv
from itertools import starmap

import pytest

from evac.cli.main import main
from evac.standard.verify import TESTS
from tests.standard.test_standard import HALF


def test_passed_tests_give_status_0_and_a_page_but_a_named_one_that_is_not_run_gives_status_1(
    tmp_path, capsys, monkeypatch
):
    out = tmp_path / "out"
    monkeypatch.setattr("evac.standard.verify.cores", lambda: 1)
    few = [test for test in TESTS if test.name in ("ISO-21", "ISO-V")]
    with monkeypatch.context() as patch:
        patch.setattr("evac.standard.verify.TESTS", few)
        assert main(["verify", "ISO", "--out", str(out)]) == 0
    monkeypatch.setattr("evac.standard.verify.in_processes", lambda function, tasks, *_: starmap(function, tasks))
    assert main(["verify", "RiMEA-1", "IMO-1", "ISO-V", "--seed", "4", "--out", str(out)]) == 1
    assert (out / "IMO-1" / "run-4" / "summary.json").is_file()
    page = (out / "verification.html").read_text()
    assert page.index("2 of 2 tests passed") < page.index("not applicable")
    with (out / "verification.csv").open() as file:
        assert {row["met"] for row in csv.DictReader(file)} == {"yes"}
    assert capsys.readouterr().out.splitlines()[-1] == str(out / "verification.html")


def test_a_test_that_is_failed_gives_status_1(tmp_path, capsys):
    plugin, out = tmp_path / "half.py", tmp_path / "out"
    plugin.write_text(HALF)
    words = ["verify", "RiMEA-1", "--plugin", str(plugin), "--out", str(out)]
    assert main([*words, "--set", "behaviours.half={}"]) == 1
    assert "RiMEA-1" in (out / "verification.html").read_text()
    assert "NOT MET" in capsys.readouterr().out


def test_unknown_tests_and_keys_are_refused_before_anything_runs(tmp_path, capsys):
    out = tmp_path / "out"
    assert main(["verify", "RiMEA-99", "--out", str(out)]) == 2
    assert main(["verify", "RiMEA-1", "--set", "contact.modle=dem", "--out", str(out)]) == 2
    assert "modle" in capsys.readouterr().err
    assert not out.exists()


@pytest.mark.parametrize("name", ["verification.html", "verification.csv"])
def test_files_of_others_with_the_names_of_page_and_table_stay(tmp_path, capsys, name):
    (tmp_path / name).write_text("my own")
    words = ["verify", "ISO-V", "--out", str(tmp_path)]
    assert main(words) == 2
    assert str(tmp_path / name) in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert (tmp_path / name).read_text() == "my own"
    (tmp_path / name).unlink()
    assert main(words) == main(words) == 1  # an earlier verification is replaced


@pytest.mark.parametrize("name", ["verification.html", "RiMEA-1", "RiMEA-1/run-1"])
def test_links_in_the_folder_of_tests_are_refused(tmp_path, capsys, name):
    out, elsewhere = tmp_path / "out", tmp_path / "elsewhere"
    elsewhere.mkdir()
    (out / name).parent.mkdir(parents=True)
    (out / name).symlink_to(elsewhere)
    assert main(["verify", "RiMEA-1", "--out", str(out)]) == 2
    assert str(out / name) in capsys.readouterr().err
    assert not [*elsewhere.iterdir()]
