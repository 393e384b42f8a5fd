"""What the documents say is there, is there; what they show, runs."""

import csv
import re
import runpy
import shlex
import shutil
from collections import Counter
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from shapely import Point

import evac
from evac.cli.main import main, parser
from evac.results.results import EGRESS_COLUMNS, EXPOSURE_COLUMNS, PEOPLE_COLUMNS
from evac.simulation.simulation import Simulation
from tests.docs.conftest import ROOT, filled, table

PAGES = sorted(page.name for page in (ROOT / "docs").glob("*.md") if page.name != "changelog.md")
DOCUMENTS = ("README.md", *(f"docs/{name}" for name in PAGES))


def fenced(text, kind):
    return re.findall(rf"^```{kind}\n(.*?)^```", text, re.MULTILINE | re.DOTALL)


@pytest.fixture
def text(root):
    """Return the text of a document."""
    return lambda path: (root / path).read_text(encoding="utf-8")


@pytest.mark.parametrize("document", DOCUMENTS)
def test_named_files_exist(document, root, text):
    named = re.findall(r"`((?:evac|plugins|buildings|tests|docs|\.ci)/[\w./*]*)`", text(document))
    linked = re.findall(r"\]\((?!http)([^)#]+)\)", text(document))
    for folder, names in ((root, named), ((root / document).parent, linked)):
        for name in names:
            found = list(folder.glob(name.rstrip("/").replace("NAME", "*")))
            assert found, f"{document} names {name}, which is not there"


@pytest.mark.parametrize("document", DOCUMENTS)
def test_tables_are_whole(document, text):
    """A table that begins without a line below its head is the rest of one that an empty line cuts."""
    assert not re.findall(r"^\n(\|.*)\n(?!\|[-:| ]+\|$)", text(document), re.MULTILINE)


@pytest.mark.parametrize("document", DOCUMENTS)
def test_named_modules_exist(document, text):
    """``evac.a.b.c`` is a module, or a name in one."""
    import importlib

    for name in re.findall(r"`(evac(?:\.\w+)+)`", text(document)):
        if name == "evac.egg":
            continue
        try:
            importlib.import_module(name)
        except ModuleNotFoundError:
            module, _, attribute = name.rpartition(".")
            assert hasattr(importlib.import_module(module), attribute), f"{document} names {name}"


def commands_of(page):
    """Return the commands of evac in the blocks of a page, as words."""
    lines = "\n".join(fenced(page, "bash")).replace("\\\n", " ").splitlines()
    commands = [part.partition(">")[0].strip() for line in lines for part in line.split("&&")]
    return [shlex.split(command, comments=True)[1:] for command in commands if command.startswith("evac ")]


@pytest.mark.parametrize("document", DOCUMENTS)
def test_commands_are_those_of_the_parser(document, text):
    for words in commands_of(text(document)):
        parser().parse_args([word.replace("...", "") for word in words if word != "--help"])


def words_of(screen):
    """Return the words of a screen, without what a narrow terminal cuts off and adds."""
    return [word for word in screen.split() if word != "..." and not set(word) <= {"─"}]


@pytest.mark.parametrize(
    ("block", "command"),
    [
        (0, ["run", "primary_school"]),
        pytest.param(1, ["repeat", "primary_school_drill", "--runs", "20"], marks=pytest.mark.slow),
    ],
)
def test_screens_of_the_readme_are_those_of_its_commands(text, tmp_path, monkeypatch, capsys, block, command):
    monkeypatch.chdir(tmp_path)
    assert main(command) == 0
    printed = words_of(capsys.readouterr().out)
    shown = words_of(fenced(text("README.md"), "text")[block])
    assert len(shown) > 40
    assert not Counter(shown) - Counter(printed)


def test_figures_of_the_readme_are_those_of_the_evidence(text, root):
    verdicts = text("docs/evidence/README.md")
    readme = text("README.md")
    answers = {
        "Tests passed: NSM2, walking]": r"\(`walking`\) \| (.+?) \|",
        "Tests passed: NSM2]": r"as in the paper \| (.+?) \|",
        "walking, all contact models: targets met]": r"`walking` \| (.+?) \|",
        "Intervals of studies with a fixed number of runs that cover": r"2000 studies \| (.+?) \|",
        "evac run primary_school, whole command [s]": r"whole command \| (.+?) s \|",
    }
    for question, answer in answers.items():
        (row,) = (line for line in verdicts.splitlines() if question in line)
        assert re.search(answer, readme)[1] == row.split(" | ")[1], question
    with open(root / "docs/evidence/scaling/peers.csv", newline="", encoding="utf-8") as file:
        measured = {(one["start"], one["program"]): one for one in csv.DictReader(file) if one["people"] == "1000"}
    rows = re.findall(r"^\| (.+) \| ([\d,]+) \| ([\d,]+) \|$", readme, re.MULTILINE)
    assert len(rows) == 8
    for program, *times in rows:
        for start, time in zip(("free", "dense"), times, strict=True):
            assert time == f"{float(measured[start, program]['ns per person-step']):,.0f}"


def test_python_of_the_readme_is_ten_lines_and_runs(text, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (block,) = fenced(text("README.md"), "python")
    assert len([line for line in block.splitlines() if line.strip()]) == 10
    exec(compile(block, "README.md", "exec"), {})
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines[:3]] == ["dem", "nsm1", "nsm2"]
    assert 0.0 < float(re.fullmatch(r"mean speed in the room (\S+) m/s", lines[3])[1]) < 2.0


def test_python_of_the_guides_to_what_was_recorded_runs(text, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    evac.run(evac.load("classroom", {"simulation.duration": 6.0, "output.animation": True}), "classroom-result")
    pages = {"pictures": 2, "trajectory": 1, "reports": 1}
    for document, blocks in ((f"docs/{page}.md", number) for page, number in pages.items()):
        found = fenced(text(document), "python")
        assert len(found) == blocks
        for block in found:
            exec(compile(block, document, "exec"), {})
    for name in ("paraview", "pedpy_door"):
        runpy.run_path(str(ROOT / f"docs/examples/scripts/{name}.py"))
    assert min((tmp_path / f"{name}.png").stat().st_size for name in ("classroom", "people")) > 0
    said = capsys.readouterr().out
    frames, inside = re.search(r"(\d+) frames; (\d+) people are inside at 5.0 s", said).groups()
    assert (int(frames), int(inside)) == (13, len(evac.read_trajectory("classroom-result")[10]["person"]))
    greatest, passed = re.findall(r"(\S+) people pe|(\d+) people passed", said)[-2:]
    assert 2.0 < float(greatest[0]) < 12.0
    assert 25 <= int(passed[1]) <= 30


def test_python_of_the_guide_to_design_flows_runs(text, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    evac.run(evac.load("primary_school", {"output.animation": False, "output.replay": False}), "primary_school-result")
    (block,) = fenced(text("docs/design_flows.md"), "python")
    exec(compile(block, "design_flows.md", "exec"), {})
    *places, time = capsys.readouterr().out.splitlines()
    assert [line.split()[:2] for line in places] == [["exit", "main_door"], ["stair", "lower"], ["stair", "upper"]]
    assert float(time.split()[-2]) > 59.0


def test_the_scripts_that_close_a_stair_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    scripts = ROOT / "docs/examples/scripts"
    case = evac.load("primary_school", {"simulation.duration": 11.0}, plugin_files=[scripts / "closing.py"])
    assert [(change.time, change.kind, change.what) for change in evac.run(case).changes] == [(10.0, "close", "upper")]
    runpy.run_path(str(scripts / "close_stair.py"))
    results = evac.read_results("upper-closed")
    assert results.evacuated == results.number_of_people
    first, emptied, last = results.changes
    assert [(change.time, change.kind) for change in (first, last)] == [(10.0, "close"), (40.0, "open")]
    assert emptied.kind == "close"  # behind the last of those who were on it


def test_python_of_the_guides_to_studies_and_the_start_runs(text, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("evac.study.api.cores", lambda: 1)
    main(["new", "my_building"])
    blocks = [*fenced(text("docs/start.md"), "python"), *fenced(text("docs/studies.md"), "python")]
    *blocks, cluster = blocks
    assert "SLURM" in cluster
    for block in blocks:  # with fewer runs
        exec(compile(block.replace(", 20, ", ", 4, ").replace("runs=5", "runs=2"), "studies.md", "exec"), {})
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines[-4:]] == ["0.8", "1.0", "1.2", "1.6"]


def test_python_of_the_guide_to_results_runs(text, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (block,) = fenced(text("docs/results.md"), "python")
    exec(compile(block, "results.md", "exec"), {})
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("everybody out 30 ")
    assert "'time', 'person'" in lines[-1]


def test_python_of_the_guide_to_embedding_runs_with_the_bits_that_it_promises(text, capsys):
    names = {}
    for block in fenced(text("docs/embedding.md"), "python"):
        exec(compile(block, "embedding.md", "exec"), names)
    runpy.run_path(str(ROOT / "docs/examples/scripts/intervening.py"))
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("interrupted ")
    assert lines[2] == str(["'door' closed at 3 s", "'door' opened at 9 s"])
    events = [{"time": time, "kind": kind, "target": "door"} for time, kind in ((3.0, "close"), (9.0, "open"))]
    assert re.fullmatch(r"21 out, \d+ by west; the guest after \d\.\d s", lines[3])
    with_events, stepped = evac.run(names["case"].change({"event": events})), names["simulation"].results()
    np.testing.assert_array_equal(with_events.crowd.exit_time, stepped.crowd.exit_time)
    assert with_events.changes == stepped.changes


def test_runs_in_threads_are_those_of_one_after_the_other():
    cases = [evac.load("square_room", {"simulation.seed": seed}) for seed in range(4)]
    alone = [evac.run(case).crowd.exit_time for case in cases]
    with ThreadPoolExecutor(4) as pool:
        np.testing.assert_array_equal([results.crowd.exit_time for results in pool.map(evac.run, cases)], alone)


def test_the_plan_of_the_guide_is_evacuated(text, capsys):
    (block,) = fenced(text("docs/plans.md"), "python")
    exec(compile(block, "two_storeys.py", "exec"), {})
    assert capsys.readouterr().out == "20 of 20 out\n"


def test_the_plan_file_of_the_guide_is_read(text, root, tmp_path):
    shutil.copy(root / "docs/examples/house.plan.toml", tmp_path)
    (shown,) = fenced(text("docs/plans.md"), "toml")
    assert all(table in text("docs/examples/house.plan.toml") for table in shown.strip().split("\n\n"))
    rooms = "POLYGON ((0 0, 9 0, 9 6, 0 6, 0 0))\nPOLYGON ((9 0, 14 0, 14 6, 9 6, 9 0))"
    (tmp_path / "ground.wkt").write_text(rooms, encoding="utf-8")
    building = evac.read_building(tmp_path / "house.plan.toml")
    assert [level.name for level in building.levels if level.kind == "floor"] == ["ground", "first", "second"]
    assert len(building.portals) == 4
    (ground,) = (level for level in building.levels if level.name == "ground")
    assert [ground.polygon.contains(Point(9.0, y)) for y in (1.9, 2.1, 2.9, 3.1)] == [False, True, True, False]
    areas = {area.name: area.polygon.area for area in building.areas}
    assert areas == {name: pytest.approx(6.95 * 8.0 + 0.05 - 0.5) for name in ("office", "second office")}


def test_the_bare_building_of_the_guide_is_evacuated(text, root):
    example = root / "docs/examples/split_level"
    assert fenced(text("docs/meshes.md"), "toml")[1] in (example / "case.toml").read_text(encoding="utf-8")
    results = evac.run(evac.load(example))
    assert results.evacuated == results.number_of_people == 10
    assert [level.kind for level in results.building.levels] == ["floor", "flight", "floor"]
    assert len(results.building.portals) == 2
    flight = results.building.levels[1]
    assert flight.slope == pytest.approx(np.arctan(0.5))


def test_the_presets_of_the_guide_are_taken(text, tmp_path):
    shutil.copy(ROOT / "docs/examples/split_level/split_level.obj", tmp_path)
    case = text("docs/examples/split_level/case.toml")
    (presets,) = fenced(text("docs/case.md"), "toml")
    (tmp_path / "case.toml").write_text(f"{case}\n{presets}", encoding="utf-8")
    simulation = Simulation(evac.load(tmp_path))
    rows = {group.name: group.rows for group in simulation.population.groups}
    crowd = simulation.population.crowd
    assert {name: len(members) for name, members in rows.items()} == {"people": 10, "class_a": 6, "class_b": 4}
    assert (crowd.radius[[*rows["class_a"], *rows["class_b"]]] == 0.18).all()
    assert (crowd.speed[rows["class_b"], 0] == 0.7).all()
    assert (crowd.speed[rows["class_a"], 0] >= 0.9).all()


def test_the_document_of_results_names_every_key_and_column(text):
    case = evac.load("square_room", {"simulation.duration": 0.5})
    summary = Simulation(case).run().summary()
    assert re.findall(r"^\| `(\w+)`", table("summary"), re.MULTILINE) == list(summary)
    named = set(re.findall(r"`(\w+)`", text("docs/results.md") + filled(text("docs/summary.md"))))
    assert {*summary, *summary["contact"], *PEOPLE_COLUMNS, *EXPOSURE_COLUMNS, *EGRESS_COLUMNS} <= named
