"""Paths from outside that the system cannot look up."""

import io
import os
import sys
from pathlib import Path

import numpy as np
import pytest

import evac
from evac.base.distributions import distribution_from
from evac.base.errors import BuildingError, EvacError, PluginError, in_order, place_of, plugin_code, usable_path

CALLS = {
    "building": lambda path: evac.read_building(f"{path}.obj"),
    "case": lambda path: evac.load(path),
    "mesh": lambda path: evac.load("square_room", {"building.mesh": str(path)}),
    "plugin": lambda path: evac.load("square_room", plugin_files=[path]),
    "results": lambda path: evac.read_results(path),
    "study": lambda path: evac.read_study(path),
    "trajectory": lambda path: evac.read_trajectory(path),
    "resumed": lambda path: evac.resume(path),
    "run": lambda path: evac.run("square_room", path),
    "imported": lambda path: evac.import_building([f"{path}.obj"], "case"),
    "case of an import": lambda path: evac.import_building(["room.wkt"], path),
}


PATHS = ["x" * 300, "x" * 5000, "x/" * 3000 + "x", "a\0b", "loop", "loop/case"]


@pytest.mark.parametrize(
    ("call", "path"), [*((call, "loop/case") for call in CALLS), *(("building", path) for path in PATHS[:-1])]
)
def test_a_path_that_cannot_be_looked_up_is_one_line(call, path, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "room.wkt").write_text("POLYGON ((0 0, 4 0, 4 3, 0 3, 0 0))")
    os.symlink("other", "loop")
    os.symlink("loop", "other")
    with pytest.raises(EvacError) as caught:
        CALLS[call](path)
    told = str(caught.value)
    assert "\n" not in told
    assert "\0" not in told
    assert len(told) < 1500
    assert sorted(os.listdir()) == ["loop", "other", "room.wkt"]


def test_a_path_that_is_not_utf_8_is_refused(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for path in ("b\udcff", tmp_path / "b\udcff" / "case.toml"):
        with pytest.raises(BuildingError, match=r"b\\udcff.*UTF-8"):
            usable_path(path, BuildingError)


def test_a_path_need_not_exist(tmp_path):
    for path in (tmp_path, tmp_path / "none", tmp_path / "none" / "file.obj"):
        assert usable_path(str(path), BuildingError) == path


def test_an_error_of_evac_in_a_plugin_keeps_the_remedy_that_it_states():
    remedy = r"^odd: ValueError: the value 2 is outside [^;]*test_errors\.py, line \d+\); correct it; check it"
    with pytest.raises(PluginError, match=remedy), plugin_code("odd", usable_path):
        distribution_from({"constant": 2.0, "maximum": 1.0})


def test_things_are_listed_in_the_order_that_people_expect():
    names = ["storey 10", "Storey 1", "10", "storey 2", "2", "storey", "b2 a10", "b2 a9", ""]
    assert in_order(names, str) == ["", "2", "10", "b2 a9", "b2 a10", "storey", "Storey 1", "storey 2", "storey 10"]


class Stated:
    """A class whose attributes have a place."""

    first = 1
    second: int = 2

    def third(self):
        """Return 3."""
        return 3


def test_the_place_of_an_attribute_is_the_line_of_the_class_that_states_it():
    lines = Path(__file__).read_text(encoding="utf-8").splitlines()
    for attribute, text in (("", "class Stated"), ("second", "    second: int"), ("third", "    def third")):
        (number,) = (k for k, line in enumerate(lines, 1) if line.startswith(text))
        assert place_of(Stated, attribute) == place_of(Stated(), attribute) == f"{__file__}, line {number}"


def raising(error):
    with plugin_code("odd", Stated):
        raise error


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (
            ValueError("oops"),
            r"^odd: ValueError: oops \(.*test_errors\.py, line \d+\); correct the plugin, or remove it; check",
        ),
        (SystemExit(3), r"^odd: SystemExit: 3.*; let the plugin raise an exception instead, or remove it; check"),
        (SyntaxError("no", ("there.py", 7, 1, "x")), r"^odd: SyntaxError: no \(there\.py, line 7\)"),
        (ValueError("assignment destination is read-only"), r"read-only \(.*\); correct the plugin"),
    ],
)
def test_an_exception_of_a_plugin_is_an_error_with_its_place(error, words):
    with pytest.raises(PluginError, match=words) as caught:
        raising(error)
    assert caught.value.__cause__ is error
    for passes in (KeyboardInterrupt(), PluginError("told")):
        with pytest.raises(type(passes)) as caught:
            raising(passes)
        assert caught.value is passes


def test_a_plugin_that_writes_what_it_may_only_read_is_told_what_to_do():
    with pytest.raises(PluginError, match=r"read-only.*; copy it; check"), plugin_code("odd", Stated, "copy it"):
        np.broadcast_to(0.0, 3)[0] = 1.0


def test_streams_that_a_plugin_replaces_are_restored(monkeypatch):
    for name in ("stdout", "stderr"):
        before = getattr(sys, name)
        with pytest.raises(PluginError, match=r"replaces sys\.stdout or sys\.stderr"), plugin_code("odd", Stated):
            setattr(sys, name, io.StringIO())
        assert getattr(sys, name) is before
