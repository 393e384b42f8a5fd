"""evac report: where it writes, and what it refuses."""

import shutil
import zipfile
from importlib.resources import files
from pathlib import Path, PurePosixPath

import pytest

BUILDINGS = Path(str(files("evac_buildings")))

PLUGIN = """
from evac import Behaviour, Parameter
evac_interface = 3

class Slow(Behaviour):
    '''Everybody walks more slowly, by a number in a file.'''
    name = "{name}"
    reads = ()
    writes = ("speed_factor",)
    file = Parameter("", doc="file with the share of the speed")

    def prepare(self, scene):
        self.share = float(scene.file(self.file).read_text())

    def act(self, crowd, time):
        crowd.speed_factor *= self.share
"""


def test_a_report_is_written_beside_the_tables(evac, result, tmp_path, capsys):
    folder = shutil.copytree(result, tmp_path / "result")
    assert evac("report", folder, "--maps", "usage", "--author", "A. Engineer") == 0
    assert capsys.readouterr().out.strip() == str(folder / "report.html")
    text = (folder / "report.html").read_text(encoding="utf-8")
    assert text.startswith("<!DOCTYPE html>")
    assert "A. Engineer" in text
    assert not list(folder.glob("*.new"))


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


def repeated_from_the_bundle(evac, folder, place, status=0):
    """Repeat a run from its bundle in another place, without what it was made from; return the names in the zip."""
    assert evac("report", folder, "--maps", "none", "--bundle") == 0
    with zipfile.ZipFile(folder / "bundle.zip") as archive:
        archive.extractall(place)
        names = set(archive.namelist())
    for origin in {*folder.parent.iterdir()} - {folder, place}:
        origin.rename(origin.with_name(f"gone {origin.name}"))
    assert {"README.txt", "requirements.txt", "summary.json", "report.html", "case.toml"} <= names
    assert evac("run", place / "case.toml", "--out", place / "again") == status
    for name in ("people.csv", "egress.csv", "crossings.csv", "flows.csv"):
        assert ((place / "again" / name).exists()) == (folder / name).exists()
        if (folder / name).exists():
            assert (place / "again" / name).read_bytes() == (folder / name).read_bytes()
    return names


def test_all_files_of_a_run_are_in_its_bundle(evac, tmp_path):
    """Slices of FDS, the file of a storey, data of behaviours, a plugin that the case names and one that was given."""
    case, elsewhere = tmp_path / "case", tmp_path / "elsewhere"
    shutil.copytree(BUILDINGS / "office_fire", case)
    (elsewhere / "deep").mkdir(parents=True)
    for path in (*case.glob("*.smv"), *case.glob("*.sf")):
        path.rename(elsewhere / path.name)
    (elsewhere / "offices.wkt").write_text("POLYGON ((0 0, 24 0, 24 12, 0 12, 0 0))", encoding="utf-8")
    (case / "data").mkdir()
    (case / "data" / "slower.txt").write_text("0.9", encoding="utf-8")
    (case / "own.py").write_text(PLUGIN.format(name="own"), encoding="utf-8")
    given = elsewhere / "deep" / "given.py"
    given.write_text(PLUGIN.format(name="given"), encoding="utf-8")
    text = (case / "case.toml").read_text(encoding="utf-8")
    text = text.replace("office_fire.smv", "../elsewhere/office_fire.smv")
    polygon = "polygons = [[[0, 0], [24, 0], [24, 12], [0, 12]]]"
    assert polygon in text
    text = text.replace(polygon, 'file = "../elsewhere/offices.wkt"')
    (case / "case.toml").write_text(f'{text}\n[plugins]\nfiles = ["own.py"]\n', encoding="utf-8")
    out = tmp_path / "result"
    quiet = [f"output.{name}=false" for name in ("picture", "replay", "animation")]
    slow = [f"behaviours.{name}={{file='data/slower.txt'}}" for name in ("own", "given")]
    changes = ["behaviours.response_time.time=0", "people.staff.number=6", "people.visitors.number=2", *quiet, *slow]
    changes += ["simulation.duration=4"]
    more = [word for change in changes for word in ("--set", change)]
    assert evac("run", case / "case.toml", "--plugin", given, *more, "--out", out) == 3
    names = repeated_from_the_bundle(evac, out, tmp_path / "unpacked", status=3)
    assert {"own.py", "data/slower.txt"} <= names
    outside = {PurePosixPath(name).name for name in names if name.startswith("files/")}
    assert {"given.py", "offices.wkt", "office_fire.smv"} <= outside
    assert sum(name.endswith(".sf") for name in outside) == 20
