"""Changes of TOML files: what is not changed stays as it is, to the byte."""

import copy
import random
import tomllib
from pathlib import Path

import pytest

from evac.editor.patching import patched, scanned

ROOT = Path(__file__).parents[2]
FILES = sorted(path for folder in ("evac", "buildings") for path in (ROOT / folder).rglob("*.toml"))
MIXED = """\
# A house.
headroom = 2.1  # m

[[storeys]]
name = 'ground'   # literal
polygons = [
    [[0, 0], [8, 0], [8, 8], [0, 8]],  # the hall
    [[8.20, 0], [14, 0],
     [14, 8], [8.2, 8]],
    "POLYGON ((0 9, 1 9, 1 10, 0 10, 0 9))"
]
[storeys.options]
layers.walls = "W"

# The way between both rooms,
# which is kept.
[[doors]]
name = "a"
storey = "ground"
segment = { rooms = ["hall", "shop"], at = 2.5, width = 1.0 } # tied

[[storeys]]
name = "first"
z = 3.20
like = "ground"

[[doors]]
name = "b"
storey = "ground"
segment = [[8.1, 2], [8.1, 3.0]]
"""


def changed_lines(before, after):
    return set(after.splitlines()) ^ set(before.splitlines())


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_a_file_without_a_change_comes_back_to_the_byte(path):
    text = path.read_bytes().decode()
    assert patched(text, tomllib.loads(text)) == text


def test_only_what_changes_is_written():
    plan = tomllib.loads(MIXED)
    plan["doors"][0]["segment"]["at"] = 3.5
    plan["storeys"][0]["polygons"][0][1] = [9, 0]
    plan["storeys"][1]["z"] = 3.4
    after = patched(MIXED, plan)
    assert tomllib.loads(after) == plan
    assert changed_lines(MIXED, after) == {
        "    [[0, 0], [8, 0], [8, 8], [0, 8]],  # the hall",
        "    [[0, 0], [9, 0], [8, 8], [0, 8]],  # the hall",
        'segment = { rooms = ["hall", "shop"], at = 2.5, width = 1.0 } # tied',
        'segment = { rooms = ["hall", "shop"], at = 3.5, width = 1.0 } # tied',
        "z = 3.20",
        "z = 3.4",
    }


def test_rows_and_keys_are_added_and_removed():
    plan = tomllib.loads(MIXED)
    del plan["doors"][0]
    plan["doors"].append({"name": "c", "storey": "first", "segment": [[0, 1], [0, 2]]})
    plan["exits"] = [{"name": "main", "storey": "ground", "segment": [[0, 1], [0, 2]]}]
    plan["storeys"][0]["wall"] = 0.2
    del plan["storeys"][1]["like"]
    plan["storeys"][0]["polygons"].append([[0, 0], [1, 0], [1, 1]])
    after = patched(MIXED, plan)
    assert tomllib.loads(after) == plan
    assert "which is kept" not in after  # it was about the door
    assert "# the hall" in after
    assert after.endswith('[[exits]]\nname = "main"\nstorey = "ground"\nsegment = [[0, 1], [0, 2]]\n')


def test_the_plan_of_a_case_is_changed_in_its_place():
    text = (ROOT / "buildings/office_fire/case.toml").read_text()
    case = tomllib.loads(text)
    plan = case["building"]["plan"]
    plan["obstacles"].pop()
    plan["exits"][0]["segment"][0] = [-9, 4]
    plan["doors"] = [{"name": "d", "storey": "hall", "segment": [[1, 1], [1, 2]]}]
    after = patched(text, case)
    assert tomllib.loads(after) == case
    assert len(changed_lines(text, after)) == 1 + 2 + 2


def test_tables_are_added_with_their_heads():
    case = tomllib.loads("[behaviours.walking]\n[simulation]\nseed = 1  # the first\n")
    case["behaviours"]["rest"] = {"speed": 0.5}
    case["event"] = [{"name": "a", "time": 3}]
    case["forces"] = {"social": {}}
    after = patched("[behaviours.walking]\n[simulation]\nseed = 1  # the first\n", case)
    assert tomllib.loads(after) == case
    assert after.splitlines() == [
        *("[behaviours.walking]", "", "[behaviours.rest]", "speed = 0.5", "[simulation]", "seed = 1  # the first"),
        *("", "[[event]]", 'name = "a"', "time = 3", "", "[forces.social]"),
    ]


@pytest.mark.parametrize("text", [MIXED, MIXED.replace("\n", "\r\n"), "\ufeff" + MIXED], ids=["plain", "crlf", "bom"])
@pytest.mark.parametrize("seed", range(6))
def test_random_edits_and_their_undo_come_back_to_the_byte(text, seed):
    draw = random.Random(seed)
    first = now = tomllib.loads(text.removeprefix("\ufeff"))
    for _ in range(50):
        now = copy.deepcopy(now)
        edit(now, draw)
        now = {key: rows for key, rows in now.items() if rows != []}
        assert tomllib.loads(patched(text, now).removeprefix("\ufeff")) == now
    assert patched(text, first) == text


def edit(plan, draw):
    """Change a plan somewhere."""
    section = draw.choice(["storeys", "doors", "exits"])
    rows = plan.setdefault(section, [])
    what = draw.choice(["add", "remove", "rename", "move", "key", "item"])
    row = draw.choice(rows) if rows else None
    if what == "add" or row is None:
        rows.insert(draw.randint(0, len(rows)), {"name": f"n{draw.random():.6f}", "storey": "ground"})
    elif what == "remove":
        rows.remove(row)
    elif what == "rename":
        row["name"] = f'n "{draw.random():.3f}"'
    elif what == "move":
        row["segment"] = [[draw.randint(0, 9), 1.5], [1, draw.randint(0, 9)]]
    elif what == "key":
        row["z"] = draw.randint(0, 9)
        row.pop(draw.choice(["like", "segment", "polygons"]), None)
    else:
        polygons = row.setdefault("polygons", [])
        polygons.insert(draw.randint(0, len(polygons)), [[0, 0], [draw.randint(1, 9), 0], [1, 1]])
        if len(polygons) > 2:
            del polygons[draw.randint(0, len(polygons) - 1)]


def test_what_cannot_be_changed_in_the_text_is_refused():
    with pytest.raises(ValueError, match="by hand"):
        patched("a.b = 1\n", {"a": {"b": 1, "c": 2}})


def test_comments_above_a_head_belong_to_it():
    span = scanned(MIXED).parts["doors"].items[0]
    assert MIXED[span.first :].startswith("# The way")
