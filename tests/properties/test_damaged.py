"""Damaged files of every format: each is read, or refused with a message that names it, and nothing else is raised."""

import csv
import json
import math
import random
import re
import shutil
from functools import cache
from io import StringIO

import pytest

import evac
from evac.base.errors import EvacError, SimulationError
from evac.building.plan.plantable import plan_text, table_of
from evac.contract.registry import Registry, built_in
from evac.replay.writer import replay_trajectory
from evac.report.of_run import run_report
from evac.report.sections import PlaceSettings
from evac.simulation.simulation import Simulation
from tests.building.test_indoormaps import osm
from tests.ifcfiles import IfcFile, steps
from tests.plugins.test_import_crowds import GEOMETRY, scenario
from tests.plugins.test_import_dxf_drawings import double_lines
from tests.plugins.test_import_fds import DECK
from tests.properties.seeded import CASE, drawn, write_case

OBJECT = """g floor\nv 0.0 0.0 0.0\nv 8.0 0.0 0.0\nv 8.0 6.0 0.0\nv 0.0 6.0 0.0\nv 12.0 0.0 2.0\nv 12.0 6.0 2.0
v 16.0 0.0 2.0\nv 16.0 6.0 2.0\nf 1 2 3 4\ng stair\nf 2 5 6 3\ng upper\nf 5 7 8 6\n"""
WKT = (
    "GEOMETRYCOLLECTION (POLYGON ((0.0 0.0, 8.0 0.0, 8.0 6.0, 0.0 6.0, 0.0 0.0), (1.0 1.0, 2.0 1.0, 2.0 2.0, 1.0 1.0)))"
)
ODD_NUMBERS = ("0.", "-1.", "1E30", "1.E-9", "NAN", "-0.", "1E400", "4711.", "")


def plan():
    made = evac.Plan()
    made.storey("ground", [[[0, 0], [8, 0], [8, 6], [0, 6]], [[8.2, 0], [12, 0], [12, 6], [8.2, 6]]])
    made.storey("first", [[0, 0], [12, 0], [12, 6], [0, 6]], z=3.0)
    made.door("door", "ground", [(8.1, 2.0), (8.1, 3.0)])
    made.stair("stair", "ground", [(1.0, 1.0), (1.0, 2.2)], "first", length=5.5, direction=(1, 0))
    made.exit("main", "ground", [(0.0, 3.0), (0.0, 4.2)])
    made.area("office", "first", [[8, 1], [12, 1], [12, 5], [8, 5]])
    made.obstacle("table", "first", [[9.5, 2.0], [10.5, 2.0], [10.5, 4.0], [9.5, 4.0]])
    return plan_text(table_of(made))


def drawing():
    text = StringIO()
    double_lines("mm", None, "A-WALL", "A-DOOR").document.write(text)
    return text.getvalue()


def model():
    """Return a model of two storeys with rooms, doors, and a straight and a winding stair and a ramp."""
    ifc = IfcFile()
    for k in range(2):
        z = 3.0 * k
        ifc.storey(f"L{k}", z)
        slab = ifc.box("IFCSLAB", "S", (0, 0, z - 0.2), (10, 6, z), predefined="FLOOR")
        ifc.opening((5, 1, z - 0.3), (9.5, 2.4, z + 0.1), wall=slab if k else None)
        wall = ifc.box("IFCWALL", "W", (0, 3, z), (10, 3.2, z + 3))
        ifc.opening((2, 3, z), (3, 3.2, z + 2.1), wall=wall, door="inner")
        ifc.space("front", [(0, 0), (10, 0), (10, 3), (0, 3)], z)
    ifc.opening((0, 1, 0), (0.2, 2, 2.1), door="main")
    solids = steps(ifc, (5, 1.7), (1, 0), 0.0, width=1.2, going=0.28, riser=3 / 17, count=16)
    ifc.body("IFCSTAIRFLIGHT", "up", *solids, tail=",$,17,16,0.17,0.28,.STRAIGHT.")
    angles = [(math.radians(30 * k), math.radians(30 * (k + 1))) for k in range(12)]
    treads = [((0.2, a), (1.4, a), (1.4, b), (0.2, b)) for a, b in angles]
    rings = [[(20 + r * math.cos(t), 3 + r * math.sin(t)) for r, t in tread] for tread in treads]
    winding = [ifc.extruded(ring, 3 / 13 * k, 3 / 13) for k, ring in enumerate(rings)]
    ifc.body("IFCSTAIR", "round", *winding, tail=",$,.SPIRAL_STAIR.")
    ramp = ifc.lying([(10, -0.2), (13, 0.1), (13, 0.3), (10, 0.0)], 3.0, 1.5)
    ifc.body("IFCRAMP", "ramp", ramp, tail=",$,.STRAIGHT_RUN_RAMP.")
    return ifc.text()


#: A sound file of each format.
FILES = {
    "a.obj": lambda: OBJECT,
    "a.wkt": lambda: WKT,
    "a.msh": lambda: evac.load("square_room").mesh.read_text(encoding="latin-1"),
    "a.geojson": osm,
    "a.plan.toml": plan,
    "a.fds": lambda: DECK,
    "a.dxf": drawing,
    "a.ifc": model,
    "a.xml": lambda: GEOMETRY.replace("\u2212", "-"),
    "a.scenario": lambda: json.dumps(scenario()),
    "case.toml": lambda: CASE.replace("MODEL", "nsm2"),
}
sound = cache(lambda name: FILES[name]())


def cut(text, generator):
    return text[: generator.randrange(len(text))]


def garbled(text, generator):
    content = bytearray(text, "latin-1")
    for _ in range(generator.choice((1, 10, 100, 1000))):
        content[generator.randrange(len(content))] = generator.randrange(256)
    return content.decode("latin-1")


def lines(text, generator):
    """Leave out, repeat or exchange lines."""
    found = text.splitlines()
    for _ in range(generator.choice((1, 5, 50)) if len(found) > 1 else 0):
        i, j = generator.randrange(len(found)), generator.randrange(len(found))
        match generator.randrange(3):
            case 0 if len(found) > 2:
                del found[i]
            case 1:
                found.insert(j, found[i])
            case _:
                found[i], found[j] = found[j], found[i]
    return "\n".join(found)


def exchanged(pattern, other):
    """Return a change of some texts that a pattern finds to others."""

    def change(text, generator):
        found = list(re.finditer(pattern, text))
        some = generator.sample(found, min(generator.choice((1, 5, 50)), len(found)))
        for match in sorted(some, key=lambda one: -one.start()):
            text = text[: match.start()] + other(match[0], found, generator) + text[match.end() :]
        return text

    return change


DAMAGES = {
    "cut": cut,
    "garbled": garbled,
    "lines": lines,
    "numbers": exchanged(r"-?\d+\.\d*(E-?\d+)?", lambda _, __, generator: generator.choice(ODD_NUMBERS)),
    "jitter": exchanged(r"-?\d+\.\d+", lambda old, _, generator: repr(float(old) + generator.uniform(-0.1, 0.1))),
    "references": exchanged(r"(?<=[(,])#\d+", lambda _, found, generator: generator.choice(found)[0]),
    "classes": exchanged(r"(?<==)IFC[A-Z]+(?=\()", lambda _, found, generator: generator.choice(found)[0]),
    "words": exchanged(r'"\w+"', lambda _, __, generator: generator.choice(('"x"', '""', '"\\u0000"', "[[[", "1e400"))),
}
OF_MODELS = {"references", "classes"}
PAIRS = [(name, damage) for name in FILES for damage in DAMAGES if name == "a.ifc" or damage not in OF_MODELS]


def test_every_built_in_format_is_damaged():
    endings = {
        importer.name: importer.suffixes for importer in Registry(builtins=built_in("importer")).importers.values()
    }
    assert [name for name, own in endings.items() if not any(file.endswith(own) for file in FILES)] == []


@pytest.mark.filterwarnings("ignore")  # numpy's, of numbers that are then refused
@pytest.mark.parametrize("pair", PAIRS)
@drawn(1)
def test_a_damaged_file_is_read_or_refused_by_its_name(pair, seed, tmp_path_factory):
    (name, damage), tmp_path = pair, tmp_path_factory.mktemp("damaged")
    write_case(tmp_path)
    path = tmp_path / name
    path.write_text(DAMAGES[damage](sound(name), random.Random(seed)), encoding="latin-1", newline="")
    told = name
    try:
        if name == "case.toml":
            Simulation(evac.load(path)).run()
        else:
            levels = evac.read_building(path, need_exit=False).levels
            assert all(level.polygon.area > 0.0 for level in levels)
    except SimulationError:
        assert name == "case.toml"
    except EvacError as error:
        told = str(error)
    assert name in told or "room.obj" in told, told


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    folder = tmp_path_factory.mktemp("damaged")
    evac.run(evac.load(write_case(folder)), folder / "result", progress=False)
    return folder / "result"


def another_summary(text, generator):
    """Return a summary in which a value has another type."""
    summary = json.loads(text)
    key = generator.choice(list(summary))
    inner = summary[key] if isinstance(summary[key], dict) and summary[key] and generator.random() < 0.5 else summary
    odd = (None, -1, 1e308, "x", "\ud800", [], {}, [[]], {"a": [0]})
    inner[generator.choice(list(inner)) if inner is not summary else key] = generator.choice(odd)
    return json.dumps(summary)


def another_table(text, generator):
    """Return a table in which a cell is another one, or a row is missing, doubled or shorter."""
    rows = list(csv.reader(StringIO(text)))
    row, column = generator.randrange(len(rows)), generator.randrange(len(rows[0]))
    match generator.randrange(6):
        case 0:
            del rows[row]
        case 1:
            rows.insert(row, rows[-1])
        case 2:
            del rows[row][column]
        case _:
            rows[row][column] = generator.choice(("", "x", "-1", "nan", "inf", "1e999", "\x00", '"', "=1+1", "front"))
    return "\n".join(",".join(cells) for cells in rows)


EDITS = {"cut": cut, "garbled": garbled, "value": another_summary, "cell": another_table}


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("edit", [("summary.json", "value"), ("summary.json", "cut"), ("people.csv", "cell")])
@drawn(3)
def test_edited_tables_of_a_result_are_shown_or_refused_by_their_name(edit, seed, tmp_path_factory, result):
    (name, how), tmp_path = edit, tmp_path_factory.mktemp("edited")
    shutil.copytree(result, tmp_path / "r")
    path = tmp_path / "r" / name
    path.write_text(EDITS[how](path.read_text(), random.Random(seed)), encoding="utf-8", errors="surrogatepass")
    trajectory = evac.read_trajectory(tmp_path / "r")
    shows = (
        lambda: replay_trajectory(trajectory, tmp_path / "replay.html"),
        lambda: run_report(tmp_path / "r", places=PlaceSettings(4.0, maps=())),
    )
    for show in shows:
        told = name
        try:
            show()
        except EvacError as error:
            told = str(error)
        assert name in told, told
        assert "\n" not in told, told
