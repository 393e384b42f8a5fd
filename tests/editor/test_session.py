"""What is saved, what is told, and what is found again."""

import copy
import json
import queue
from pathlib import Path

import pytest

from evac.base.processes import Pool
from evac.cli.main import main
from evac.editor import Session
from evac.editor.session import ChangedOnDiskError


@pytest.fixture
def opened():
    """A function that opens a plan."""
    sessions = []

    def opening(path, **options):
        sessions.append(Session(path, **options))
        return sessions[-1]

    yield opening
    for session in sessions:
        session.close()


def judged(session, table, revision=1):
    told = queue.Queue()
    session.listeners.append(told)
    session.check("page", revision, table)
    while True:
        event, data = told.get(timeout=120)
        if event == "judged" and data["revision"] == revision:
            return data


def changed(document, width):
    table = copy.deepcopy(document["table"])
    table["doors"][0]["segment"]["width"] = width
    return table


def test_only_the_changed_line_of_the_file_changes(house, opened):
    session = opened(house)
    before = session.file.read_text().splitlines()
    found = session.document()
    saved = session.save(changed(found, 1.4), found["digest"])
    after = session.file.read_text().splitlines()
    assert [new for old, new in zip(before, after, strict=True) if old != new] == [
        'segment = { rooms = ["hall", "shop"], at = 2.5, width = 1.4 }'
    ]
    assert "width = 1.4" in saved["difference"]
    assert session.document()["digest"] == saved["digest"]


def test_a_plugin_has_a_form_is_judged_and_is_run(house, opened, eventually, monkeypatch):
    monkeypatch.chdir(house.parent)
    (house.parent / "hurry.py").write_text(
        "from evac import Behaviour, Parameter\n"
        "evac_interface = 3\n"
        "class Hurry(Behaviour):\n"
        "    name = 'hurry'\n"
        "    writes = ('speed_factor',)\n"
        "    factor = Parameter(2.0, 'factor of speeds', maximum=3.0)\n"
        "    def act(self, crowd, time):\n"
        "        crowd.speed_factor *= self.factor\n"
    )
    session = opened(house, plugins=[Path("hurry.py")])
    assert "hurry" in session.forms()["schema"]["properties"]["behaviours"]["properties"]
    found = session.document()
    table = copy.deepcopy(found["table"])
    table["case"]["behaviours"]["hurry"] = {"factor": 4.0}
    assert "behaviours.hurry.factor" in judged(session, table)["findings"][0]["text"]
    table["case"]["behaviours"]["hurry"] = {"factor": 3.0}
    assert judged(session, table, 2)["errors"] == 0
    table["case"]["simulation"]["duration"] = 1.0
    session.save(table, found["digest"])
    session.orders({})["run"]()
    eventually(lambda: session.runner.state()["phase"] == "ended")
    assert session.runner.state()["answer"]


def test_the_plan_in_a_case_is_edited_in_the_case(fire, opened):
    session = opened(fire / "case.toml")
    found = session.document()
    found["table"]["storeys"][1]["z"] = 3.5
    assert session.save(found["table"], found["digest"])["difference"].count("\n-    {") == 1
    assert judged(session, found["table"])["errors"] == 0


def test_a_file_that_has_changed_is_not_overwritten(house, opened):
    session = opened(house)
    one = two = session.document()
    session.save(changed(one, 1.4), one["digest"])  # of another page
    with pytest.raises(ChangedOnDiskError, match="has changed"):
        session.save(changed(two, 0.7), two["digest"])
    assert "width = 1.4" in session.file.read_text()


def test_what_is_not_saved_is_found_again(house, opened):
    session = opened(house)
    table = changed(session.document(), 1.4)
    session.check("page", 1, table)
    session.close()
    again = opened(house)
    assert again.document()["unsaved"] == {"table": table, "of_this_file": True}
    again.save(table, again.document()["digest"])
    assert "unsaved" not in again.document()
    assert sorted(path.name for path in house.iterdir()) == ["case.toml", "house.plan.toml"]


def test_going_back_to_the_file_clears_the_journal(house, opened):
    session = opened(house)
    table = session.document()["table"]
    session.check("page", 1, changed(session.document(), 1.4))
    assert session.journal.exists()
    session.check("page", 2, table)
    assert not session.journal.exists()


def test_findings_are_those_of_evac_check(house, opened, capsys):
    session = opened(house)
    found = judged(session, session.document()["table"])
    main(["check", "--json", str(house / "house.plan.toml")])
    assert found["findings"] == json.loads(capsys.readouterr().out)["findings"]
    table = changed(session.document(), 40.0)
    del table["areas"]
    found = judged(session, table, 2)
    items = {row["item"] for row in found["findings"] if row["kind"] == "error"}
    assert "doors.door" in items
    assert found["building"] is not None  # of what is right
    table = session.document()["table"]
    del table["areas"]
    texts = [row["text"] for row in judged(session, table, 3)["findings"]]
    assert any("staff.area" in text for text in texts)  # the case needs it


def test_a_process_that_dies_is_told_and_started_again_and_ends_with_the_session(
    house, opened, started, eventually, monkeypatch
):
    monkeypatch.setattr("evac.editor.session.Pool", Pool)
    session = opened(house)
    table = session.document()["table"]
    assert judged(session, table)["errors"] == 0
    started[0].kill()
    assert "died" in judged(session, table, 2)["failed"]
    assert judged(session, table, 3)["errors"] == 0
    session.close()
    eventually(lambda: all(process.exitcode is not None for process in started))
    assert len(started) == 2


def test_floor_without_an_exit_is_told(house, opened):
    session = opened(house)
    table = session.document()["table"]
    del table["shafts"], table["doors"]
    table["exits"] = table["exits"][:1]
    levels = judged(session, table)["building"]["levels"]
    assert [level["reached"] for level in levels] == [True, False, False]


def test_a_building_that_is_no_plan_is_judged_as_it_is(opened):
    session = opened(Path("classroom"))
    document = session.document()
    assert [row["name"] for row in document["table"]["storeys"]] == ["classroom"]
    found = judged(session, document["table"])
    assert (found["errors"], len(found["building"]["segments"]["exits"])) == (0, 1)


def test_the_curve_of_a_distribution_has_its_percentiles_and_its_mean(house, opened):
    curve = opened(house).orders({"value": {"uniform": [10.0, 20.0]}})["curve"]()
    assert curve["values"] == pytest.approx([10.0 + 0.1 * share for share in range(1, 100)])
    assert curve["mean"] == pytest.approx(15.0)
