"""The scripts of docs/examples and the two notebooks of the page on embedding run, each of at most 60 lines."""

import json
import os
import runpy
import sys
import threading
import time
import tomllib
import urllib.error
import urllib.request
from http.server import ThreadingHTTPServer
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest

import evac
from tests.docs.conftest import ROOT

EXAMPLES = ROOT / "docs" / "examples"
NOTEBOOKS = [ROOT / "docs" / "notebooks" / f"{name}.ipynb" for name in ("dashboard", "lesson")]


@pytest.fixture
def run(tmp_path, monkeypatch):
    """Run a script in an empty folder, and return its names."""
    monkeypatch.chdir(tmp_path)
    return lambda name, as_main=True: runpy.run_path(str(EXAMPLES / name), run_name="__main__" if as_main else name)


def code_of(notebook):
    cells = json.loads(notebook.read_text(encoding="utf-8"))["cells"]
    return "\n\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "code")


def test_the_service_runs_cases_and_tells_about_them(run):
    names = run("service.py", False)
    server = ThreadingHTTPServer(("127.0.0.1", 0), names["Service"])
    threading.Thread(target=server.serve_forever, daemon=True).start()

    def ask(path, content=None):
        request = urllib.request.Request(f"http://127.0.0.1:{server.server_port}{path}", content)
        with urllib.request.urlopen(request) as answer:
            return json.loads(answer.read())

    try:
        numbers = [ask("/runs", b'{"people.people.number": 5}')["run"] for _ in range(2)]
        while {ask(f"/runs/{number}")["state"] for number in numbers} == {"running"}:
            time.sleep(0.05)
        names["WORKERS"].shutdown()
        first, second = (ask(f"/runs/{number}") for number in numbers)
        assert first == second
        assert first["out"] == 5
        with pytest.raises(urllib.error.HTTPError) as wrong:
            ask("/runs", b'{"people.people.numer": 5}')
        assert "did you mean 'number'" in json.loads(wrong.value.read())["error"]
        with pytest.raises(urllib.error.HTTPError, match="404"):
            ask("/runs/99")
    finally:
        server.shutdown()
        server.server_close()


def test_the_design_passes_as_a_test(capsys):
    bare = ["-c", os.devnull, "-p", "no:xdist", "-p", "no:cacheprovider", "--import-mode=importlib"]
    assert pytest.main(["-q", *bare, str(EXAMPLES / "test_design.py")]) == 0
    assert "5 passed" in capsys.readouterr().out


def test_tables_are_asked_in_sql(run, capsys):
    pytest.importorskip("duckdb")
    names = run("query.py")
    results = evac.read_results("result")
    assert names["exits"].fetchall()[0][:2] == ("door", results.evacuated)
    assert names["curve"].fetchall()[0][1] == 30


def test_the_narrowest_door_is_found(run, capsys):
    names = run("width.py")
    tried = [line.split(" m: ") for line in capsys.readouterr().out.splitlines()]
    width = float(tried[-1][0].removeprefix("narrowest door: ").split()[0])
    times = {float(one): float(mean.removesuffix(" s")) for one, mean in tried[:-1]}
    assert times[0.9] > names["REQUIRED"] > times[2.4]
    assert min(abs(width - one) for one in times) < 0.05


def test_the_learner_finds_what_is_quicker_than_doing_nothing(run, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["learning.py", "3"])
    names = run("learning.py")
    assert (names["table"] > 0.0).any()
    assert min(names["times"]) < evac.run(names["own"]).time


def test_rooms_of_another_program_are_converted(run, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["converter.py"])
    run("converter.py")
    plan = tomllib.loads(Path("converted/house.plan.toml").read_text(encoding="utf-8"))
    assert {area["name"] for area in plan["areas"]} == {"office", "corridor"}
    case = evac.load("converted")
    again = evac.run(case)
    motion = np.genfromtxt("converted/motion.csv", delimiter=",", skip_header=1, usecols=(0, 1))
    assert motion[-1, 0] == pytest.approx(again.trajectory.frame.time.iloc[-1])
    assert again.evacuated == 6


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebooks_run(notebook, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "ipywidgets", None)
    mpl.use("Agg")
    names = {}
    exec(compile(code_of(notebook), notebook.name, "exec"), names)
    if notebook.stem == "lesson":
        assert len(capsys.readouterr().out.splitlines()) == 4
        assert names["runs"][1.8].last_out < names["runs"][0.9].last_out
    else:
        assert names["results"].evacuated == 20
