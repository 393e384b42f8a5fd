import gc
import multiprocessing.process
import textwrap

import pytest

from evac.contract.registry import Registry

#: The building of three storeys and its results, for all rooms that show or measure runs.
pytest_plugins = ["tests.three_storeys"]

PLUGIN = """
    from evac.contract.hooks import hookimpl
    evac_interface = 3
    from evac import Behaviour, ContactModel, Force, Importer, Parameter

    class Soft(ContactModel):
        name = "soft"
        stiffness = Parameter(1000.0, "stiffness", unit="N/m", above=0)

    class Hard(ContactModel):
        name = "hard"
        solver = Parameter("cg", "solver", choices=("cg", "gauss_seidel"))

    class Push(Force):
        name = "push"
        strength = Parameter(2000.0, "strength", unit="N", minimum=0)

        def cutoff(self):
            return 1.0

    class Wait(Behaviour):
        name = "wait"
        group_keys = ("time", "leader")
        time = Parameter({"uniform": [0.0, 10.0]}, "time", unit="s", minimum=0, distribution=True)
        shared = Parameter(False, "shared")
        def prepare(self, scene):
            pass

    class Follow(Behaviour):
        name = "follow"
        group_keys = ("leader",)
        def prepare(self, scene):
            pass

    class Drawn(Importer):
        name = "drawn"
        suffixes = (".obj", ".msh")
        unit = Parameter("m", "unit of lengths", choices=("m", "mm"))

        def read(self, path):
            raise ValueError("nothing is drawn")

    @hookimpl
    def evac_contact_models():
        return [Soft, Hard]

    @hookimpl
    def evac_forces():
        return [Push]

    @hookimpl
    def evac_behaviours():
        return [Wait, Follow]

    @hookimpl
    def evac_importers():
        return [Drawn]
"""


@pytest.hookimpl(wrapper=True)
def pytest_collection():
    """Search no garbage among what modules own, which is most of what a process has."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.enable()
        gc.freeze()


@pytest.fixture(scope="session", autouse=True)
def unsynced():
    """Leave files in memory: no test survives the end of its machine, and those of the calls replace them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("os.fsync", lambda descriptor: None)
        yield


@pytest.fixture
def unpictured(monkeypatch):
    """Leave the pictures of imported levels empty, where nobody looks at them."""
    monkeypatch.setattr("evac.pictures.annotated.draw_levels", lambda building, path, *_: path.touch())


@pytest.fixture
def started(monkeypatch):
    """The worker processes that are started."""
    started, start = [], multiprocessing.process.BaseProcess.start

    def start_noted(process):
        start(process)
        started.append(process)

    monkeypatch.setattr(multiprocessing.process.BaseProcess, "start", start_noted)
    return started


@pytest.fixture(scope="session")
def registry(tmp_path_factory):
    """Plugins of each kind that are configured and do nothing, and no others."""
    path = tmp_path_factory.mktemp("plugin") / "fakes.py"
    path.write_text(textwrap.dedent(PLUGIN), encoding="utf-8")
    return Registry([path], builtins=())
