"""Attacks on `evac import`: small inputs of every format that are spoilt, also those that an import has written."""

import json
import random
from functools import cache
from io import StringIO
from pathlib import Path

from evac import Plan
from evac.building.plan.plantable import table_of
from evac.importing.documents import plan_text
from tests.attacks.commands import call
from tests.attacks.models import CHANGES, FOREIGN, made_model
from tests.attacks.seeded import Case, in_turn
from tests.building.test_indoormaps import osm
from tests.plugins.test_drawings import double_lines
from tests.plugins.test_import_fds import DECK

#: Changes of every format, and of building models alone.
EVERY = ("cut", "garbled", "lines", "numbers", "jitter")
#: Files made by others, if they are there.
OTHERS = ("ISO-Corner.dxf", "office_rooms.wkt", "imdf_unit.geojson", "nav_test.obj", "aknz_evac.wkt")
OBJECT = """g floor
v 0.0 0.0 0.0
v 8.0 0.0 0.0
v 8.0 6.0 0.0
v 0.0 6.0 0.0
v 12.0 0.0 2.0
v 12.0 6.0 2.0
v 16.0 0.0 2.0
v 16.0 6.0 2.0
f 1 2 3 4
g stair
f 2 5 6 3
g upper
f 5 7 8 6
"""


def run(case: Case, folder: Path) -> str:
    """Import a spoilt file twice, the second time with edits: there is a case, or one line tells why there is none."""
    change, _, name = case.kind.partition(" ")
    generator = random.Random(f"{case}")
    path = folder / name
    path.write_text(CHANGES[change](_text(name), generator), encoding="latin-1")
    words = ["import", str(path), "--out", str(folder / "case"), "--people", "5", "--exit", "1"]
    status, _ = call(words)
    plan = folder / "case" / "building.plan.toml"
    if not plan.exists():
        return "refused" if status else "imported as a mesh"
    plan.write_text(CHANGES[generator.choice(EVERY)](plan.read_text(encoding="latin-1"), generator), encoding="latin-1")
    again, _ = call([*words, "--partial"])
    return f"{'incomplete' if status else 'imported'}, {'edits refused' if again else 'again'}"


@cache
def _text(name: str) -> str:
    """Return the text of a file before it is spoilt."""
    if name in OTHERS:
        return (FOREIGN / name).read_text(encoding="latin-1")
    if name == "made.ifc":
        return made_model()
    if name == "made.obj":
        return OBJECT
    if name == "made.geojson":
        return _features()
    if name == "indoor.geojson":
        return osm()
    if name == "made.fds":
        return DECK
    if name == "made.dxf":
        drawing = StringIO()
        double_lines("mm", None, "A-WALL", "A-DOOR").document.write(drawing)
        return drawing.getvalue()
    return plan_text(table_of(_plan()))


def _plan() -> Plan:
    """Return two storeys with a stair, a door, an exit, an area and an obstacle."""
    plan = Plan()
    plan.storey("ground", [[[0, 0], [8, 0], [8, 6], [0, 6]], [[8.2, 0], [12, 0], [12, 6], [8.2, 6]]])
    plan.storey("first", [[0, 0], [12, 0], [12, 6], [0, 6]], z=3.0)
    plan.door("door", "ground", [(8.1, 2.0), (8.1, 3.0)])
    plan.stair("stair", "ground", [(1.0, 1.0), (1.0, 2.2)], "first", length=5.5, direction=(1, 0))
    plan.exit("main", "ground", [(0.0, 3.0), (0.0, 4.2)])
    plan.area("office", "first", [[8, 1], [12, 1], [12, 5], [8, 5]])
    plan.obstacle("table", "first", [[9.5, 2.0], [10.5, 2.0], [10.5, 4.0], [9.5, 4.0]])
    return plan


def _features() -> str:
    """Return two rooms with a door and an exit."""
    shapes = (
        ("storey", "Polygon", [[[0.0, 0.0], [8.0, 0.0], [8.0, 6.0], [0.0, 6.0], [0.0, 0.0]]]),
        ("storey", "Polygon", [[[8.2, 0.0], [12.0, 0.0], [12.0, 6.0], [8.2, 6.0], [8.2, 0.0]]]),
        ("door", "LineString", [[8.1, 2.0], [8.1, 3.0]]),
        ("exit", "LineString", [[0.0, 3.0], [0.0, 4.2]]),
        ("area", "Polygon", [[[9.0, 1.0], [11.0, 1.0], [11.0, 5.0], [9.0, 1.0]]]),
    )
    features = [
        {"type": "Feature", "properties": {"kind": kind}, "geometry": {"type": of, "coordinates": coordinates}}
        for kind, of, coordinates in shapes
    ]
    return json.dumps({"type": "FeatureCollection", "features": features}, indent=1)


#: What once went wrong.
CRASHERS: tuple[Case, ...] = ()

FILES = (
    "made.ifc",
    "made.obj",
    "made.geojson",
    "made.plan.toml",
    "indoor.geojson",
    "made.fds",
    "made.dxf",
    *(name for name in OTHERS if (FOREIGN / name).is_file()),
)
KINDS = [f"{change} {name}" for name in FILES for change in (CHANGES if name == "made.ifc" else EVERY)]
cases = in_turn(KINDS, CRASHERS)
