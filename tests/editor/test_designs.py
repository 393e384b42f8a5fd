"""Runs of designs that the page orders, and what they differ in."""

import pytest

import evac
from evac.base.errors import ResultError, ScenarioError
from evac.cli.main import main
from evac.editor import Session


def made(house, name, *more):
    arguments = ["repeat", str(house), "--runs", "2", "--jobs", "1", "--out", f"runs-{name}", *more]
    assert main([*arguments, "--set", "output.picture=false"]) == 0


@pytest.fixture
def session(house, monkeypatch):
    monkeypatch.chdir(house.parent)
    session = Session(house, house.with_name("result"))
    session.designs.folder = house.with_name("runs")
    yield session
    session.designs.stop()
    session.close()


def test_designs_are_compared_as_by_evac_compare(house, session):
    made(house, "A")
    made(house, "B", "--set", "people.visitors.number=30")
    made(house, "C", "--seed", "9")
    shown = {row["name"]: row["text"] for row in session.designs.state()["designs"]}
    assert list(shown) == ["A", "B", "C"]
    mean = evac.read_study("runs-A").statistics[0].mean
    assert shown["A"].startswith(f"mean {mean.value:.2f} s ({mean.low:.1f} to {mean.high:.1f})")
    assert session.designs.page(["A", "B"]).decode() == evac.compare("runs-A", "runs-B").page()
    with pytest.raises(ResultError, match="seed"):
        session.designs.page(["A", "C"])
    assert session.designs.page(["A", "../house"]) is None


def test_runs_are_made_and_found_by_another_session(house, session, eventually):
    for name, runs in (("../A", 1), ("A.running", 1), ("A", 0)):
        with pytest.raises(ScenarioError):
            session.designs.start(name, runs)
    session.designs.start("A", 400)
    eventually(lambda: session.designs.state().get("making", "").startswith("A: 0 of 400"))
    with pytest.raises(ResultError):
        session.designs.start("B", 1)
    again = type(session.designs)(session.case_file, session.designs.folder)
    assert again.state()["making"] == session.designs.state()["making"]
    again.stop()
    again.close()
    eventually(lambda: "making" not in session.designs.state())
    assert session.designs.state() == {"designs": [], "failed": ""}
    session.designs.start("A", 2)  # continues, with fewer runs
    eventually(lambda: "making" not in session.designs.state())
    assert session.designs.state()["designs"][0]["runs"] == "2 runs"
