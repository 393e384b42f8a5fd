import sys
import textwrap
from pathlib import Path

import pytest

from evac.base.errors import BuildingError, PluginError
from evac.contract.hooks import INTERFACE
from evac.contract.registry import RETURNED_BY, Registry, built_in
from evac.physics.contact.model import ContactModel

SPRING = """
    from evac.contract.hooks import hookimpl
    evac_interface = 3
    from evac.base.parameters import Parameter
    from evac.physics.contact.model import ContactModel

    class Spring(ContactModel):
        '''A spring.'''
        name = "spring"
        stiffness = Parameter(1.0, "stiffness", unit="N/m", above=0)

    @hookimpl
    def evac_contact_models():
        return [Spring]
"""


def written(folder, name, text):
    path = folder / name
    path.write_text(textwrap.dedent(text), encoding="utf-8")
    return path


def bare(*files):
    return Registry(files, builtins=())


def test_built_in_plugins_fill_every_table():
    registry = Registry()
    assert {"dem", "nsm1", "nsm2"} <= set(registry.contact_models)
    assert set(registry.solvers) >= {"accelerated_sweeps", "conjugate_faces", "gauss_seidel", "uzawa"}
    assert set(registry.forces) >= {"social"}
    assert {"response_time", "teacher_following", "route_choice"} <= set(registry.behaviours)
    assert "trajectory" in registry.recorders
    assert {"square_room", "classroom", "primary_school"} <= set(registry.cases)
    assert [row.plugin for row in registry.provenance[: len(built_in())]] == built_in()
    for kind in RETURNED_BY:
        for name in registry._tables[kind]:
            assert registry.get(kind, name) is registry._tables[kind][name]


def test_a_new_file_of_the_package_of_built_in_plugins_is_found(tmp_path, monkeypatch):
    (tmp_path / "evac_plugins").mkdir()
    written(tmp_path / "evac_plugins", "force_far.py", CLASSES)
    written(tmp_path / "evac_plugins", "behaviour_unread.py", "raise SystemExit")
    monkeypatch.setattr("evac_plugins.__path__", [str(tmp_path / "evac_plugins")])
    assert built_in() == ["evac_plugins.behaviour_unread", "evac_plugins.force_far"]
    assert list(Registry(builtins=built_in("force")).forces) == ["near", "far"]


def test_a_file_is_registered_and_described(tmp_path):
    path = written(tmp_path, "spring.py", SPRING)
    registry = bare(path)
    spring = registry.get("contact_model", "spring")
    assert spring(stiffness=2).stiffness == 2.0
    assert sys.modules[spring.__module__].__file__ == str(path)
    (row,) = registry.describe()
    assert (row["source"], row["origin"]) == ("file", str(path))
    assert len(row["version"]) == 16
    assert row["provides"] == [
        {
            "kind": "contact_model",
            "name": "spring",
            "doc": "A spring.",
            "parameters": {"stiffness": {"default": 1.0, "unit": "N/m", "range": "> 0", "doc": "stiffness"}},
        }
    ]


CLASSES = """
    from evac import Force, Recorder, hookimpl
    evac_interface = 3

    class Radial(Force):
        def cutoff(self):
            return 1.0

    class Near(Radial):
        name = "near"

    class Far(Near):
        name = "far"

    class Idle(Recorder):
        name = "idle"
        def record(self, simulation):
            pass

    Alias = Near
"""


def test_all_classes_that_a_module_defines_are_registered(tmp_path):
    registry = bare(written(tmp_path, "classes.py", CLASSES))
    assert list(registry.forces) == ["near", "far"]  # Radial is only their base, Force is imported
    assert list(registry.recorders) == ["idle"]


def test_a_hook_that_returns_classes_chooses_them(tmp_path):
    hook = "\n@hookimpl\ndef evac_{}():\n    return [{}]\n"
    path = written(tmp_path, "chosen.py", textwrap.dedent(CLASSES) + hook.format("forces", "Far"))
    assert (list(bare(path).forces), list(bare(path).recorders)) == (["far"], [])
    path = written(tmp_path, "metrics.py", textwrap.dedent(CLASSES) + hook.format("metrics", "").replace("[]", "{}"))
    assert (list(bare(path).forces), list(bare(path).recorders)) == (["near", "far"], ["idle"])


def test_a_package_has_the_classes_of_its_own_modules(tmp_path, monkeypatch):
    (tmp_path / "gathering").mkdir()
    written(tmp_path / "gathering", "models.py", CLASSES)
    written(tmp_path, "gathering/__init__.py", "from gathering.models import Far, Idle\nevac_interface = 3\n")
    monkeypatch.syspath_prepend(tmp_path)
    registry = Registry(builtins=("gathering",))
    assert (list(registry.forces), list(registry.recorders)) == (["far"], ["idle"])


@pytest.mark.parametrize("stated", [INTERFACE, 1])
def test_a_package_states_the_interface_of_its_modules(stated, tmp_path, monkeypatch):
    place = tmp_path / f"shared{stated}"
    place.mkdir()
    written(place, "__init__.py", f"evac_interface = {stated}\n")
    written(place, "models.py", CLASSES.replace("    evac_interface = 3\n", ""))
    monkeypatch.syspath_prepend(tmp_path)
    module = f"shared{stated}.models"
    if stated == INTERFACE:
        assert "far" in Registry(builtins=(module,)).forces
        return
    with pytest.raises(PluginError, match=rf"{module}.* version 1 .* {INTERFACE}"):
        Registry(builtins=(module,))


def test_a_file_named_twice_is_registered_once(tmp_path):
    path = written(tmp_path, "spring.py", SPRING)
    registry = bare(path, path)
    registry.add_file(path)
    assert len(registry.provenance) == len(Registry(plugin_files=[path], builtins=()).provenance) == 1
    assert bare(path).contact_models["spring"] is registry.contact_models["spring"]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("from evac.contract.hooks import hookimpl\n@hookimpl\ndef evac_forces():\n    return 'social'\n",
         ["evac_forces() returns 'social'"]),
        ("from evac import Behaviour\nclass A(Behaviour):\n    name = 'a'\n    def act(self, crowd, time):\n"
         "        pass\nevac_behaviours = [A]\n",
         ["evac_behaviours is an object of class list", "line 7", "@hookimpl"]),
        ("evac_prepare = 'now'\n", ["evac_prepare is an object of class str", "line 2"]),
        ("from evac.contract.hooks import hookimpl\n@hookimpl\ndef evac_forces(scene):\n    return []\n",
         ["scene", "see evac.contract.hooks"]),
        ("from evac import hookimpl\n@hookimpl(wrapper=True)\ndef evac_finish():\n    yield\n",
         ["evac_finish is a hook wrapper"]),
        ("gravity = 9.81\n", ["defines no plugin", "ContactModel", "evac_contact_models"]),
        ("from evac import ContactModel\n", ["defines no plugin"]),
        ("from evac.contract.hooks import hookimpl\n@hookimpl\ndef evac_forces():\n    return 1 / 0\n",
         ["evac_forces(): ZeroDivisionError: division by zero"]),
        ("from evac.contract.hooks import hookimpl\n@hookimpl\ndef evac_forces():\n    return [int]\n",
         ["evac_forces() returns int", "derive it from evac.Force"]),
        ("from evac import Behaviour, hookimpl\n"
         "class A(Behaviour):\n    name = 'a'\n@hookimpl\ndef evac_forces():\n    return [A]\n",
         ["evac_forces() returns", "derive it from evac.Force"]),
        ("from evac import ContactModel, hookimpl\n"
         "class A(ContactModel):\n    name = 'model'\n@hookimpl\ndef evac_contact_models():\n    return [A]\n",
         ["A.name is 'model', a key of its section"]),
        ("from evac.contract.hooks import hookimpl\n@hookimpl\ndef evac_building_cases():\n    return ['/nowhere']\n",
         ["/nowhere", "case.toml"]),
    ],
)  # fmt: skip
def test_a_broken_plugin_is_refused_by_name(tmp_path, text, words):
    path = written(tmp_path, "broken.py", "evac_interface = 3\n" + text)
    with pytest.raises(PluginError) as caught:
        bare(path)
    for word in [str(path), *words]:
        assert word in str(caught.value)


IMPORTER = """
    from evac import Importer, hookimpl

    evac_interface = 3

    class {name}(Importer):
        '''Nothing.'''
        name = "{word}"
        suffixes = (".plan", ".plan.txt")

        def read(self, path):
            raise ValueError("nothing")

    @hookimpl
    def evac_importers():
        return [{name}]
"""


def test_the_importer_registered_last_reads_a_file(tmp_path):
    one, other = (
        written(tmp_path, f"{word}.py", IMPORTER.format(name=word.title(), word=word)) for word in ("one", "other")
    )
    registry = bare(one, other)
    assert registry.importer_for(Path("House.PLAN.TXT")) is registry.importers["other"]
    assert registry.importer_for(Path("house.plan"), without=["other"]) is registry.importers["one"]
    with pytest.raises(BuildingError, match=r"house\.dxf: .*'\.dxf'.*\.plan, \.plan\.txt"):
        registry.importer_for(Path("house.dxf"))


def test_a_plugin_provides_all_of_its_classes_and_cases(tmp_path, registry):
    assert ([*registry.contact_models], [*registry.behaviours]) == (["soft", "hard"], ["wait", "follow"])
    folders = [tmp_path / name for name in ("hall", "tower")]
    for folder in folders:
        folder.mkdir()
        (folder / "case.toml").touch()
    text = "from evac import hookimpl\nevac_interface = 3\n@hookimpl\ndef evac_building_cases():\n    return "
    path = written(tmp_path, "cases.py", f"{text}{[str(folder) for folder in folders]}\n")
    assert bare(path).cases == dict(zip(("hall", "tower"), folders, strict=True))


def test_one_name_claimed_twice_names_both(tmp_path):
    first, second = written(tmp_path, "first.py", SPRING), written(tmp_path, "second.py", SPRING)
    with pytest.raises(PluginError) as caught:
        bare(first, second)
    message = str(caught.value)
    assert "contact model 'spring'" in message
    assert str(first) in message
    assert str(second) in message


def test_an_unknown_name_gets_the_closest_one(tmp_path):
    registry = bare(written(tmp_path, "spring.py", SPRING))
    with pytest.raises(PluginError, match=r"'sprig'.*'spring'"):
        registry.get("contact_model", "sprig")


def test_an_installed_plugin_is_registered_with_its_distribution(tmp_path, monkeypatch):
    written(tmp_path, "installed_spring.py", SPRING)

    def install(folder, module):
        info = folder / "evac_spring-2.5.dist-info"
        info.mkdir(parents=True)
        (info / "METADATA").write_text("Metadata-Version: 2.1\nName: evac-spring\nVersion: 2.5\n", encoding="utf-8")
        (info / "entry_points.txt").write_text(f"[evac]\nspring = {module}\n", encoding="utf-8")
        monkeypatch.syspath_prepend(folder)

    install(tmp_path, "installed_spring")
    registry = bare()
    (row,) = registry.provenance
    assert (row.plugin, row.source, row.origin, row.version) == (
        "installed_spring",
        "distribution",
        "evac-spring",
        "2.5",
    )
    assert "spring" in registry.contact_models
    install(tmp_path / "later", "no_such_module")
    with pytest.raises(PluginError, match=r"no_such_module .* evac-spring"):
        bare()


def test_a_class_is_registered_by_itself():
    class Spring(ContactModel):
        """A spring."""

        name = "spring"

    registry = bare()
    registry.add_class(Spring)
    registry.add_class(Spring)
    (row,) = registry.describe()
    assert (row["source"], row["origin"]) == ("class", __name__)
    assert [item["name"] for item in row["provides"]] == ["spring"]
    (provider,) = registry.providers([Spring()])
    assert "Spring" in provider
    with pytest.raises(PluginError, match="contact model 'spring'"):
        registry.add_class(type("Other", (ContactModel,), {"name": "spring"}))
    with pytest.raises(PluginError, match=r"int.*ContactModel"):
        registry.add_class(int)
