"""Files that evac has not written stay as they are, whatever their names: the whole tree is compared."""

import os

import pytest

import evac
from evac.cli.main import main

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
