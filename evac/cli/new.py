"""evac new: write an example case with comments, a building of two storeys that can be run and changed."""

import argparse
from pathlib import Path

from evac.base.errors import ScenarioError

CASE = """\
# A case: a building, its people, and the models of their movement. Commands to try it:
#
#     evac check FOLDER --picture levels.png
#     evac run FOLDER
#
# docs/buildings.md has every key. Lengths are in metres, times in seconds.

title = "Two storeys and a stair"

[building]
mesh = "house.plan.toml"  # the plan in the same folder; a mesh or any other file that evac reads can be named, too

# Properties of people; each group can override them.
[presets.person]
speed = { normal = [1.34, 0.26], minimum = 0.5, maximum = 2.2 }
radius = { uniform = [0.2, 0.25] }

[[people]]
name = "visitors"
preset = "person"
level = "ground"  # a whole storey
number = 15

[[people]]
name = "staff"
preset = "person"
area = "office"  # an area of the plan
number = 10
speed_down = { factor = 0.6 }  # of their own speed on the flat

[contact]
model = "nsm2"

# People keep a distance to the person ahead. Without this behaviour they walk at full speed until bodies touch.
[behaviours.headway]

# Response (pre-movement) times in seconds.
[behaviours.response_time]
time = { uniform = [0.0, 10.0] }
per = "person"

[simulation]
duration = 300.0
seed = 1
"""

PLAN = """\
# A plan: the floor of each storey as polygons, and the stairs between storeys. Shapes are WKT, or lists of corners.
# A storey can also name a file (file = "ground.wkt") in WKT, GeoJSON, or any other format that is read as a plan.

[[storeys]]
name = "ground"
z = 0.0  # height of the floor
polygons = [
    "POLYGON ((0 0, 8 0, 8 8, 0 8, 0 0), (3 5, 3 6, 5 6, 5 5, 3 5))",  # a hall; the hole is a counter
    "POLYGON ((8.2 0, 14 0, 14 8, 8.2 8, 8.2 0))",  # a second room, behind a wall of 0.2 m
]

[[storeys]]
name = "first"
z = 3.2
polygons = "POLYGON ((0 0, 14 0, 14 8, 0 8, 0 0))"

# A door between two rooms: a segment along the wall, as long as the door is wide.
[[doors]]
name = "door"
storey = "ground"
segment = [[8.1, 2], [8.1, 3]]

# A straight stair: from its lower edge, 1.2 m wide, 5.5 m towards the east. The floor above it is cut open.
# With `turn = "left"`, or with an `upper_edge` beside the lower one, it is U-shaped.
[[stairs]]
name = "stair"
lower = "ground"
lower_edge = [[1, 0.8], [1, 2]]
upper = "first"
length = 5.5
direction = [1, 0]

# Exits lie on the outline of a floor.
[[exits]]
name = "main"
storey = "ground"
segment = [[0, 3.5], [0, 4.7]]

[[exits]]
name = "side"
storey = "ground"
segment = [[14, 6], [14, 7]]

# People start in areas; obstacles are cut out of the floor.
[[areas]]
name = "office"
storey = "first"
polygon = [[8, 3], [13.5, 3], [13.5, 7.5], [8, 7.5]]

[[obstacles]]
name = "table"
storey = "first"
polygon = [[10, 5], [12, 5], [12, 6], [10, 6]]
"""


def declare(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("folder", metavar="FOLDER", type=Path, help="new folder for case.toml and its plan")


def execute(arguments: argparse.Namespace) -> int:
    """Write the files; raise an error if the folder exists and is not empty."""
    folder: Path = arguments.folder
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise ScenarioError(f"{folder}: exists and is not empty; choose a new folder")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, text in (("case.toml", CASE), ("house.plan.toml", PLAN)):
            (folder / name).write_text(text, encoding="utf-8")
    except OSError as error:
        raise ScenarioError(f"{folder}: cannot be written: {error.strerror}; choose another folder") from error
    print(f"{folder / 'case.toml'} and house.plan.toml written; next: evac run {folder}")
    return 0
