"""Exporters: where they write, what they return, and names of files."""

from types import SimpleNamespace

import pytest

from evac.base.errors import PluginError, ResultError
from evac.export.exporter import Exporter, export, file_stems


class One(Exporter):
    """One file."""

    name = "one"
    suffix = ".txt"

    def write(self, trajectory, path):
        path.write_text("one")
        return [path]


class Several(Exporter):
    """Files in a folder."""

    name = "several"

    def write(self, trajectory, path):
        for name in ("a", "b"):
            (path / f"{name}.txt").write_text(name)
            yield path / f"{name}.txt"


@pytest.fixture
def trajectory(tmp_path):
    return SimpleNamespace(path=tmp_path / "trajectory.evac")


def test_files_are_in_the_export_folder_of_the_result_or_at_a_path(trajectory, tmp_path):
    assert export(trajectory, One()) == [tmp_path / "export" / "trajectory.txt"]
    assert (tmp_path / "export/trajectory.txt").read_text() == "one"
    assert export(trajectory, One(), tmp_path / "x" / "here.txt") == [tmp_path / "x" / "here.txt"]
    for place, path in ((tmp_path / "export" / "several", None), (tmp_path / "y", tmp_path / "y")):
        assert export(trajectory, Several(), path) == [place / "a.txt", place / "b.txt"]
        assert sorted((one.name, one.read_text()) for one in place.iterdir()) == [("a.txt", "a"), ("b.txt", "b")]
    with pytest.raises(ResultError, match="no result folder"):
        export(SimpleNamespace(path=tmp_path / "none" / "trajectory.evac"), One())


@pytest.mark.parametrize("returned", [None, [], ["a.txt"], "missing"])
def test_an_exporter_returns_the_files_that_it_has_written(trajectory, tmp_path, returned):
    class Odd(One):
        def write(self, trajectory, path):
            return [path] if returned == "missing" else returned

    with pytest.raises(PluginError, match=r"'one'.* write\(\) returns .*no path of an existing file"):
        export(trajectory, Odd())
    assert not (tmp_path / "export" / "trajectory.txt").exists()


def test_a_single_path_is_as_good_as_a_list_and_a_failure_leaves_no_file(trajectory, tmp_path):
    class Single(One):
        def write(self, trajectory, path):
            path.write_text("one")
            return path

    assert export(trajectory, Single()) == [tmp_path / "export" / "trajectory.txt"]

    class Failing(One):
        def write(self, trajectory, path):
            path.write_text("half")
            raise ValueError("oops")

    with pytest.raises(PluginError, match="exporter 'one': ValueError: oops"):
        export(trajectory, Failing(), tmp_path / "half.txt")
    assert not [*tmp_path.glob("*half*")]


def test_names_of_files_are_plain_and_different():
    names = ["ground", "Ground", "flight z=0.00..1.50", "..", "a/b", "a b", "Büro"]
    assert file_stems(names) == ["ground", "Ground_2", "flight_z_0.00..1.50", "unnamed", "a_b", "a_b_2", "B_ro"]
