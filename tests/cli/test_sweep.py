"""evac sweep: points of the command line and of tables."""

import csv
import shutil
import time

import pytest

from evac.base.errors import ScenarioError
from evac.case.loading import load_case
from evac.cli.studies import swept

FEW = ("--runs", "2", "--jobs", "1")


def rows_of(path):
    with path.open() as file:
        return list(csv.DictReader(file))


def test_a_sweep_has_a_point_for_each_combination(evac, tmp_path, capsys):
    values = ("people.people.number=3,4", "contact.model=dem,nsm2", "output.animation=false")
    assert evac("sweep", "square_room", *FEW, "--seed", "7", "--set", *values) == 0
    rows = rows_of(tmp_path / "square_room-sweep" / "runs.csv")
    assert [(row["people.people.number"], row["contact.model"]) for row in rows[::2]] == [
        ("3", "dem"),
        ("3", "nsm2"),
        ("4", "dem"),
        ("4", "nsm2"),
    ]
    assert [row["seed"] for row in rows] == ["7", "8"] * 4
    assert len(rows_of(tmp_path / "square_room-sweep" / "statistics.csv")) == 4
    assert (tmp_path / "square_room-sweep" / "statistics.png").read_bytes().startswith(b"\x89PNG")
    assert "in 8 of 8 runs" in capsys.readouterr().out


def test_a_refused_point_is_named_with_its_seed_and_the_others_are_run(evac, tmp_path, capsys):
    values = ("people.people.tau=0.3,0.005", "simulation.driving=explicit", "people.people.number=3")
    assert evac("sweep", "square_room", *FEW, "--out", "r", "--set", *values) == 2
    out, err = capsys.readouterr()
    assert "failed: point 1 (people.people.tau = 0.005), seed 1" in err
    assert "in 2 of 2 runs" in out
    assert [row["failed"] for row in rows_of(tmp_path / "r" / "statistics.csv")] == ["0", "2"]
    assert [row["ended"] for row in rows_of(tmp_path / "r" / "runs.csv")] == ["everybody out"] * 2 + ["failed"] * 2


PLUGIN = """
from pathlib import Path
from evac import Behaviour, hookimpl
evac_interface = 3
Path({mark!r}).touch()

class Idle(Behaviour):
    \'\'\'Does nothing.\'\'\'
    name = "idle"

    def act(self, crowd, time):
        pass

@hookimpl
def evac_behaviours():
    return [Idle]
"""


def case_with_plugin(folder):
    folder.mkdir(parents=True)
    (folder / "own.py").write_text(PLUGIN.format(mark=str(folder / "ran")))
    shipped = load_case("square_room")
    shutil.copy(shipped.mesh, folder / shipped.mesh.name)
    (folder / "case.toml").write_text(f'{shipped.source.read_text()}\n[plugins]\nfiles = ["own.py"]\n')


def test_plugin_files_of_a_case_in_a_table_are_announced(evac, tmp_path, capsys):
    case_with_plugin(tmp_path / "own")
    (tmp_path / "table.csv").write_text("case,people.people.number\nown,2\n")
    assert evac("sweep", "--table", "table.csv", *FEW, "--out", "r", "--set", "output.picture=false") == 0
    assert f": {tmp_path / 'own' / 'own.py'}" in capsys.readouterr().err


@pytest.mark.parametrize("how", ["relative", "link"])
def test_a_table_runs_no_plugin_file_from_elsewhere(evac, tmp_path, capsys, how):
    case_with_plugin(tmp_path / "elsewhere" / "own")
    folder = tmp_path / "strangers"
    folder.mkdir()
    name = "../elsewhere/own"
    if how == "link":
        name = "link"
        (folder / "link").symlink_to(tmp_path / "elsewhere" / "own", target_is_directory=True)
    (folder / "table.csv").write_text(f"case,people.people.number\n{name},2\n")
    assert evac("sweep", "--table", "strangers/table.csv", *FEW) == 2
    assert "plugin files" in capsys.readouterr().err
    assert not (tmp_path / "elsewhere" / "own" / "ran").exists()


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (
            ("--set", *(f"people.people.{key}={','.join(map(str, range(1, 51)))}" for key in ("a", "b", "c", "d"))),
            "6250000",
        ),
        (("--table", "table.csv", "--set", f"simulation.step={','.join(map(str, range(1, 202)))}"), "10050 points"),
        (("--runs", "1000000000", "--set", "contact.model=dem,nsm2"), "1000000000"),
        (("--runs", "1000000", "--set", "contact.model=dem,nsm2"), "2 points"),
        (("--until", "2%", "--most", "1000000000", "--set", "contact.model=dem,nsm2"), "1000000000"),
    ],
)
def test_sweeps_that_are_too_large_are_refused_at_once(evac, tmp_path, capsys, words, named):
    (tmp_path / "table.csv").write_text("people.people.number\n" + "3\n" * 50)
    begin = time.process_time()
    assert evac("sweep", "square_room", *words) == 2
    assert time.process_time() - begin < 5.0
    err = capsys.readouterr().err
    assert named in err.splitlines()[-1]


def test_values_are_divided_at_commas_outside_brackets():
    several, fixed = swept(["a.b=1,2.5,x", "a.c=[1,2],[3]", 'a.d="x,y"', "a.e={ k = 1, l = 2 }"])
    assert several == {"a.b": [1, 2.5, "x"], "a.c": [[1, 2], [3]]}
    assert fixed == ['a.d="x,y"', "a.e={ k = 1, l = 2 }"]
    with pytest.raises(ScenarioError, match=r"a\.b"):
        swept(["a.b=1,,2"])
