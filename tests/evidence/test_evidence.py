"""The frame of the evidence pages: tables, pages, timings, processes."""

import csv
import json
import math
import os
import re
import shutil
import subprocess
import sys
import time
from importlib import metadata
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from evac.base.errors import ResultError, RunWarning, ScenarioError
from evac.cli import main
from evac.cli import verify as command
from evac.evidence import KINDS
from evac.evidence.command import run_evidence, write_index
from evac.evidence.evidence import OPTIONAL_PACKAGES, Evidence, commit, machine, markdown_table, new_figure, timed
from evac.evidence.verdicts import MET, MOST_ROWS, NOT_MET, REPORTED, UNDECIDED, anchor, at_most, reported

LEAN, SCALING = "evac.evidence.lean.page", "evac.evidence.scaling.page"
PAGES = Path(__file__).parents[2] / "docs" / "evidence"


def figure_of(number):
    figure, axis = new_figure()
    axis.plot([1, 2], [3, number])
    return figure


def test_table_is_written_in_full_and_shown_rounded(tmp_path):
    evidence = Evidence("lean", tmp_path, quick=True)
    rows = [{"model": "DEM", "time [s]": 1.0 / 3.0, "runs": 5}, {"model": "NSM2", "time [s]": None, "runs": 7}]
    evidence.add(f"Times. {evidence.table('times', rows)}")
    page = evidence.write_page(LEAN).read_text()
    with (tmp_path / "times.csv").open() as file:
        back = list(csv.DictReader(file))
    assert [float(back[0]["time [s]"]), back[1]["time [s]"]] == [1.0 / 3.0, ""]
    assert "| DEM | 0.333 | 5 |" in page
    assert "| NSM2 | - | 7 |" in page


def test_page_holds_what_was_added_in_order_and_says_what_it_was_computed_with(tmp_path):
    evidence = Evidence("scaling", tmp_path, quick=True, seed=9)
    evidence.add("First\n   words.\n\n## Part")
    evidence.add(evidence.plot("line", "A line.", figure_of, 1))
    evidence.verdict(at_most("time [s]", 1.0, 2.0, section="Part"))
    page = evidence.write_page(SCALING).read_text()
    head = ("# Time and memory against", "Examined: time", "| [time [s]](#part) |", "Quick run")
    places = [page.index(words) for words in (*head, "First words.", "## Part", "(line.png)")]
    assert places == sorted(places)
    assert (tmp_path / "line.png").read_bytes().startswith(b"\x89PNG")
    found = json.loads((tmp_path / "run.json").read_text())
    assert found["title"].startswith("Time and memory")
    assert (found["examined"][:14], found["seed"]) == ("Examined: time", "9")
    assert found["command"] == "evac evidence scaling --quick"
    assert [row["verdict"] for row in found["verdicts"]] == [MET]


def test_files_are_replaced_as_a_whole_and_links_are_not_followed(tmp_path):
    own, names = tmp_path / "lean", ("times.csv", "line.png", "run.json", "README.md")
    own.mkdir()
    for name in names:
        (tmp_path / name).write_text("mine")
        (own / name).symlink_to(tmp_path / name)
    evidence = Evidence("lean", own, quick=True)
    evidence.table("times", [{"runs": 5}])
    evidence.plot("line", "A line.", figure_of, 1)
    evidence.write_page(LEAN)
    assert {(tmp_path / name).read_text() for name in names} == {"mine"}
    assert sorted(path.name for path in own.iterdir()) == sorted(names)
    assert not any((own / name).is_symlink() for name in names)


def test_same_plot_gives_the_same_file(tmp_path):
    evidence = Evidence("scaling", tmp_path)
    for name in ("one", "two"):
        evidence.plot(name, "A line.", figure_of, 1)
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


def test_index_lists_the_verdicts_of_the_kinds_that_are_there(tmp_path):
    for kind in ("lean", "table3"):
        evidence = Evidence(kind, tmp_path / kind)
        evidence.verdict(reported(f"{kind}?", "5 s", section="A part"))
        evidence.write_page(f"evac.evidence.{kind}.page")
    write_index(tmp_path)
    index = (tmp_path / "README.md").read_text()
    assert [kind for kind in KINDS if f"({kind}/README.md)" in index] == ["lean", "table3"]
    assert "| [table3?](table3/README.md#a-part) | 5 s |" in index


def measured_rows(evidence, *values):
    return evidence.measured("values", lambda: [{"name": "a", "count": 3, "value": value} for value in values])


def test_rows_come_back_from_the_file_with_their_types(tmp_path):
    (first, second, third) = measured_rows(Evidence("lean", tmp_path), 1.0 / 3.0, None, np.inf)
    assert first == {"name": "a", "count": 3, "value": 1.0 / 3.0}
    assert isinstance(first["count"], int)
    assert (second["value"], third["value"]) == (None, np.inf)


def test_a_page_written_again_is_the_page_of_the_run_that_measured(tmp_path):
    pages = []
    for page_only in (False, True):
        evidence = Evidence("lean", tmp_path, seed=1 if page_only else 4, page_only=page_only)
        rows = measured_rows(evidence, 0.1, 0.2)
        assert evidence.seed == 4
        evidence.add(f"Values. {evidence.table('values', rows)}\n\n{evidence.plot('line', 'A line.', figure_of, 1)}")
        pages.append(evidence.write_page(LEAN).read_text())
        (tmp_path / "line.png").unlink(missing_ok=True)
    assert pages[0] == pages[1]
    assert not (tmp_path / "line.png").exists()  # drawn by the run that measures alone


def test_a_page_cannot_be_written_again_where_nothing_was_measured(tmp_path, capsys):
    assert main(["evidence", "lean", "--page-only", "--out", str(tmp_path)]) == 2
    assert "run.json" in capsys.readouterr().err
    Evidence("lean", tmp_path).write_page(LEAN)
    with pytest.raises(ResultError, match=r"values\.csv"):
        measured_rows(Evidence("lean", tmp_path, page_only=True))


@pytest.mark.parametrize("kind", KINDS)
def test_committed_pages_open_with_a_verdict_table_that_fits_one_screen(kind):
    page = (PAGES / kind / "README.md").read_text()
    head = page[: page.index("\n## ")].splitlines()
    rows = [line for line in head if line.startswith("| ") and not line.startswith("| question")]
    assert 0 < len(rows) <= MOST_ROWS
    assert head[2].endswith(".")
    assert all(row.split(" | ")[-1].rstrip(" |").startswith((MET, NOT_MET, REPORTED, UNDECIDED)) for row in rows)
    assert {link for row in rows for link in re.findall(r"\]\(#(.+?)\)", row)} <= {
        anchor(line.removeprefix("## ")) for line in page.splitlines() if line.startswith("## ")
    }


@pytest.mark.parametrize("kind", KINDS)
def test_committed_pages_are_made_of_the_committed_tables(tmp_path, kind):
    """What `evac evidence KIND --page-only` writes; the last digits of derived tables depend on the processor."""
    earlier = shutil.copytree(PAGES / kind, tmp_path / kind)
    run_evidence(kind, tmp_path, page_only=True)
    for name in ("README.md", "run.json"):
        assert (earlier / name).read_text() == (PAGES / kind / name).read_text(), name


def test_committed_index_is_made_of_the_committed_pages(tmp_path):
    for kind in KINDS:
        (tmp_path / kind).mkdir()
        (tmp_path / kind / "run.json").write_text((PAGES / kind / "run.json").read_text())
    write_index(tmp_path)
    assert (tmp_path / "README.md").read_text() == (PAGES / "README.md").read_text()


def test_unknown_kind_is_refused_with_the_closest(tmp_path):
    with pytest.raises(ScenarioError, match="scalling"):
        run_evidence("scalling", tmp_path)


def test_every_kind_of_the_command_line_is_known():
    assert tuple(KINDS) == command.KINDS


def test_figure_is_laid_out_in_axes():
    assert np.shape(new_figure(4.0, 3.0, 2, 3)[1]) == (2, 3)


def test_command_computes_the_kind_asked_for_and_prints_its_page(tmp_path, monkeypatch, capsys):
    def compute(evidence):
        evidence.add(f"Quick: {evidence.quick}.")
        evidence.write_page(LEAN)

    monkeypatch.setattr("evac.evidence.lean.page.run", compute)
    assert main(["evidence", "lean", "--quick", "--out", str(tmp_path)]) == 0
    page = tmp_path / "lean" / "README.md"
    assert capsys.readouterr().out.strip() == str(page)
    assert "Quick: True." in page.read_text()
    assert "evac evidence lean --quick" in (tmp_path / "README.md").read_text()


@pytest.mark.parametrize("quick", [True, False])
def test_pages_say_what_came_of_runs_and_runs_do_not_warn(quick, tmp_path, monkeypatch):
    """In this process as in others."""

    def compute(evidence):
        filters = evidence.map(eval, [("__import__('warnings').filters[0][:3:2]",)])
        assert filters == [("ignore", RunWarning)]

    monkeypatch.setattr("evac.evidence.lean.page.run", compute)
    run_evidence("lean", tmp_path, quick)


def test_a_process_that_dies_is_told_in_one_line(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("evac.evidence.lean.page.run", lambda evidence: evidence.map(os._exit, [(0,)]))
    assert main(["evidence", "lean", "--out", str(tmp_path)]) == 2
    assert re.fullmatch(r"computing.*\nevac: evidence of lean: .*\n", capsys.readouterr().err)


def test_a_folder_that_cannot_be_written_is_bad_input(tmp_path, capsys):
    (tmp_path / "lean").write_text("in the way")
    assert main(["evidence", "lean", "--quick", "--out", str(tmp_path)]) == 2
    assert "--out" in capsys.readouterr().err


def test_conditions_name_what_was_loaded_and_nothing_else(tmp_path, monkeypatch):
    for package in OPTIONAL_PACKAGES:
        monkeypatch.delitem(sys.modules, package, raising=False)
    evidence = Evidence("accuracy", tmp_path)
    assert "cromosim" not in evidence.conditions()["versions"]
    peer = ModuleType("cromosim")
    peer.__version__ = "2.1"
    monkeypatch.setitem(sys.modules, "cromosim", peer)
    monkeypatch.setattr("evac.evidence.evidence.version", _not_installed("cromosim"))
    versions = evidence.conditions()["versions"]
    assert versions.endswith("cromosim 2.1")
    assert "clarabel" not in versions


def _not_installed(package):
    def found(name):
        if name == package:
            raise metadata.PackageNotFoundError(name)
        return metadata.version(name)

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


@pytest.mark.parametrize("quick", [True, False])
def test_results_are_in_the_order_of_the_items(quick, tmp_path):
    # A function that a new process can import: `tests` is importable only where pytest runs.
    assert Evidence("scaling", tmp_path, quick).map(math.factorial, [(3,), (1,), (2,)]) == [6, 1, 2]
