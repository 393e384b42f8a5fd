"""The frame of the evidence pages: tables, pages, timings, processes."""

import csv
import json
import subprocess
import sys
import time
from types import ModuleType

import numpy as np
import pytest

from evac.cli import evidence as command
from evac.cli import main
from evac.errors import ScenarioError
from evac.evidence import KINDS, report
from evac.evidence.command import run_evidence, write_index
from evac.evidence.report import Evidence, claim, commit, machine, markdown_table, new_figure, timed


def test_table_is_written_in_full_and_shown_rounded(tmp_path):
    evidence = Evidence("lean", tmp_path, quick=True)
    rows = [{"model": "DEM", "time [s]": 1.0 / 3.0, "runs": 5}, {"model": "NSM2", "time [s]": None, "runs": 7}]
    evidence.table("times", rows, "Times.")
    page = evidence.write_page("A page").read_text()
    with (tmp_path / "times.csv").open() as file:
        back = list(csv.DictReader(file))
    assert [float(back[0]["time [s]"]), back[1]["time [s]"]] == [1.0 / 3.0, ""]
    assert "| DEM | 0.333 | 5 |" in page
    assert "| NSM2 | - | 7 |" in page


def test_page_holds_what_was_added_in_order_and_says_what_it_was_computed_with(tmp_path):
    evidence = Evidence("scaling", tmp_path, quick=True, seed=9)
    evidence.text("First\n   words.")
    evidence.heading("Part")
    evidence.plot("line", new_figure()[0], "A line.")
    page = evidence.write_page("Title").read_text()
    places = [
        page.index(words) for words in ("# Title", "Quick run", "First words.", "## Part", "(line.png)", "## Cond")
    ]
    assert places == sorted(places)
    assert (tmp_path / "line.png").read_bytes().startswith(b"\x89PNG")
    found = json.loads((tmp_path / "run.json").read_text())
    assert (found["title"], found["summary"], found["seed"]) == ("Title", "First words.", "9")
    assert found["command"] == "evac evidence scaling --quick"


def test_same_plot_gives_the_same_file(tmp_path):
    evidence = Evidence("scaling", tmp_path)
    for name in ("one", "two"):
        figure, axis = new_figure()
        axis.plot([1, 2], [3, 4])
        evidence.plot(name, figure, "A line.")
    assert (tmp_path / "one.png").read_bytes() == (tmp_path / "two.png").read_bytes()


def test_markdown_table_puts_numbers_to_the_right_and_takes_formats():
    lines = markdown_table([{"a|b": "x|y", "n": 1234567, "f": 0.000123456}], {"n": ",", "f": ".1e"}).splitlines()
    assert lines[1] == "|---|--:|--:|"
    assert lines[2] == "| x\\|y | 1,234,567 | 1.2e-04 |"


def test_timed_counts_the_calls_and_takes_the_median():
    spans = iter([0.05, 0.001, 0.02, 0.001])
    prepared = []
    timing = timed(lambda: time.sleep(next(spans)), repeats=3, prepare=lambda: prepared.append(1))
    assert len(prepared) == 4
    assert timing.least <= timing.median < 0.02 <= timing.greatest < 0.05
    assert timing.repeats == 3


def test_generators_depend_on_kind_seed_and_name_alone(tmp_path):
    draws = {
        (kind, seed, name): Evidence(kind, tmp_path, seed=seed).generator(name).random()
        for kind in ("lean", "table3")
        for seed in (1, 2)
        for name in ("a", "b")
    }
    assert len(set(draws.values())) == len(draws)
    assert Evidence("lean", tmp_path, quick=True, seed=1).generator("a").random() == draws["lean", 1, "a"]


def test_index_lists_the_kinds_that_are_there(tmp_path):
    for kind in ("lean", "table3"):
        evidence = Evidence(kind, tmp_path / kind)
        evidence.text(f"What {kind} found.")
        evidence.write_page(f"Title of {kind}")
    write_index(tmp_path)
    index = (tmp_path / "README.md").read_text()
    assert [kind for kind in KINDS if f"({kind}/README.md)" in index] == ["lean", "table3"]
    assert "What table3 found." in index


def test_unknown_kind_is_refused_with_the_closest(tmp_path):
    with pytest.raises(ScenarioError, match=r"'scalling'.*scaling"):
        run_evidence("scalling", tmp_path)


def test_every_kind_of_the_command_line_is_known():
    assert tuple(KINDS) == command.KINDS


def test_figure_is_laid_out_in_axes():
    assert np.shape(new_figure(4.0, 3.0, 2, 3)[1]) == (2, 3)


def test_command_computes_the_kind_asked_for_and_prints_its_page(tmp_path, monkeypatch, capsys):
    def compute(evidence):
        evidence.text(f"Quick: {evidence.quick}.")
        evidence.write_page("Lean")

    monkeypatch.setattr("evac.evidence.lean.page.run", compute)
    assert main(["evidence", "lean", "--quick", "--out", str(tmp_path)]) == 0
    page = tmp_path / "lean" / "README.md"
    assert capsys.readouterr().out.strip() == str(page)
    assert "Quick: True." in page.read_text()
    assert "Quick: True." in (tmp_path / "README.md").read_text()


def test_a_folder_that_cannot_be_written_is_bad_input(tmp_path, capsys):
    (tmp_path / "lean").write_text("in the way")
    assert main(["evidence", "lean", "--quick", "--out", str(tmp_path)]) == 2
    assert "choose another --out" in capsys.readouterr().err


def test_findings_head_the_page_and_stand_on_the_index_with_their_chart(tmp_path):
    evidence = Evidence("accuracy", tmp_path / "accuracy")
    evidence.text("What was done.")
    evidence.finding("A is better.", "line", "A over B")
    evidence.plot("line", new_figure()[0], "A line.")
    page = evidence.write_page("Title").read_text()
    assert page.index("A is better.") < page.index("![A over B](line.png)") < page.index("What was done.")
    write_index(tmp_path)
    index = (tmp_path / "README.md").read_text()
    assert "A is better.\n\n![A over B](accuracy/line.png)" in index


def test_claims_say_whether_they_are_met():
    assert claim("a", "at most", 150.0, 150.0)["met"] == "yes"
    assert claim("a", "at most", 150.0, 151.0)["met"] == "no"
    assert claim("a", "at least", 300.0, 299.0)["met"] == "no"
    assert claim("a", "at least", 300.0, None)["met"] == "no"


def test_conditions_name_what_was_loaded_and_nothing_else(tmp_path, monkeypatch):
    for package in report.OPTIONAL_PACKAGES:
        monkeypatch.delitem(sys.modules, package, raising=False)
    evidence = Evidence("accuracy", tmp_path)
    assert "cromosim" not in evidence.conditions()["versions"]
    peer = ModuleType("cromosim")
    peer.__version__ = "2.1"
    monkeypatch.setitem(sys.modules, "cromosim", peer)
    monkeypatch.setattr(report, "version", _not_installed(report.version, "cromosim"))
    versions = evidence.conditions()["versions"]
    assert versions.endswith("cromosim 2.1")
    assert "clarabel" not in versions


def _not_installed(version, package):
    def found(name):
        if name == package:
            raise report.PackageNotFoundError(name)
        return version(name)

    return found


def test_commit_is_that_of_a_file_that_git_knows(tmp_path, monkeypatch):
    known, other = tmp_path / "known.py", tmp_path / "other.py"
    for file in (known, other):
        file.write_text("")
    assert commit(known) == ""  # no checkout
    git = ["git", "-C", str(tmp_path), "-c", "user.name=a", "-c", "user.email=a@example.org"]
    for words in (["init", "-q"], ["add", "known.py"], ["commit", "-q", "-m", "One"]):
        subprocess.run([*git, *words], check=True)
    head = subprocess.run([*git, "rev-parse", "HEAD"], check=True, capture_output=True, text=True).stdout
    assert head.startswith(commit(known))
    assert len(commit(known)) == 12
    assert commit(other) == ""
    (tmp_path / "page.md").write_text("")
    subprocess.run([*git, "add", "page.md"], check=True)
    assert len(commit(known)) == 12  # a page is no code
    known.write_text("changed")
    assert commit(known).endswith("-dirty")
    monkeypatch.setenv("PATH", "")
    assert commit(known) == ""  # no git


def test_machine_tells_cores_and_system():
    assert "cores" in machine()
