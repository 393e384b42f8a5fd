"""The documentation site: every public name is described, and every recipe runs."""

import fnmatch
import re
import shutil
import tomllib
from pathlib import Path

import pytest

import evac
from evac.case.loading import load_case
from evac.contract.registry import Registry
from evac.simulation.simulation import Simulation
from tests.docs.conftest import MARK, filled, table

#: Described names that are not at the top of the package: what users get from public functions.
PARTS = {"Scene", "LevelField", "Level", "Portal", "Exit", "Door", "Area", "Place", "Page"}
PARTS |= {"Population", "Crowd", "Outside"}


def fenced(text, kind):
    return re.findall(rf"^```{kind}\n(.*?)^```", text, re.MULTILINE | re.DOTALL)


UPSTAIRS, *RECIPES = [
    block
    for page in sorted((Path(__file__).parents[2] / "docs").glob("recipes*.md"))
    for block in fenced(page.read_text(encoding="utf-8"), "toml")
]


def test_every_public_name_is_in_the_reference(root):
    text = "".join(page.read_text(encoding="utf-8") for page in (root / "docs").glob("api*.md"))
    described = set(re.findall(r"auto(?:function|class|data|exception):: [\w.]+\.(\w+)", text))
    errors = {name for name in evac.__all__ if name.endswith(("Error", "Warning"))}
    assert "automodule:: evac.base.errors" in text
    assert described - PARTS | errors == set(evac.__all__)


def test_every_key_and_plugin_is_described_on_a_page_once(root):
    pages = [page.read_text(encoding="utf-8") for page in sorted((root / "docs").glob("*.md"))]
    registry = Registry()
    kinds = {f"{item['kind']}s" for entry in registry.describe() for item in entry["provides"]} - {"cases", "exporters"}
    assert sorted(name for page in pages for name in MARK.findall(page)) == sorted(
        {"case", "summary", "commands", "hooks", "checks", "quantities", "import", "map", "render", "report", *kinds}
    )
    for kind in kinds:
        for name, plugin in getattr(registry, kind).items():
            assert f"### {name}\n" in table(kind)
            assert all(f"| `{one}` |" in table(kind) for one in plugin.declared())
    assert not MARK.search(filled("\n".join(pages)))


def test_every_page_is_in_the_contents(root):
    contents = "\n".join(fenced((root / "docs/index.md").read_text(encoding="utf-8"), r"\{toctree\}"))
    pages = {path.relative_to(root / "docs").with_suffix("").as_posix() for path in (root / "docs").rglob("*.md")}
    listed = [fnmatch.filter(pages, name) for name in re.findall(r"^[\w/*]+$", contents, re.MULTILINE)]
    assert all(listed)
    assert sorted(page for names in listed for page in names) == sorted(pages - {"index"})


@pytest.fixture
def split_level(root, tmp_path):
    """Return the case of the guide and a folder that has its mesh."""
    example = root / "docs/examples/split_level"
    shutil.copy(example / "split_level.obj", tmp_path)
    return tmp_path, tomllib.loads((example / "case.toml").read_text(encoding="utf-8"))


def merged(case, recipe):
    """Add a recipe to a case: its tables, and instead of the groups of the case its own."""
    result = dict(case)
    for key, value in recipe.items():
        if key == "building":
            lists = {name: case[key][name] + value.get(name, []) for name in ("exits", "areas")}
            result[key] = case[key] | value | lists
        else:
            result[key] = case.get(key, {}) | value if isinstance(value, dict) else value
    return result


@pytest.mark.parametrize("text", RECIPES, ids=range(len(RECIPES)))
def test_recipes_are_taken(text, split_level, monkeypatch):
    folder, case = split_level
    monkeypatch.chdir(folder)
    recipe = tomllib.loads(text)
    if "balcony" in text and "building.exits" not in text:
        case = merged(case, tomllib.loads(UPSTAIRS))
    if "event" in recipe:
        case["people"][0]["speed"] = 0.15  # so that somebody is there at the times of the events
    simulation = Simulation(load_case(merged(case, recipe)))
    if "event" in recipe:
        events = [(one["kind"], one.get("target", "")) for one in recipe["event"]]
        assert [(change.kind, change.what) for change in simulation.run().changes] == events
    simulation.advance_tick()
    named = {one["name"] for one in recipe.get("people", ())}
    assert named <= {group.name for group in simulation.population.groups}
    used = {behaviour.name for behaviour, _ in simulation.behaviours}
    assert set(recipe.get("behaviours", {})) - {"route_choice"} <= used
