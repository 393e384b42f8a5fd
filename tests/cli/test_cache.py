"""evac cache, and what other commands say about kernels."""

import os

import pytest

from evac.cli import main, plugins
from evac.jit import store
from evac.jit.store import versions

PLUGIN = """
from evac.contract.hooks import hookimpl
from evac.jit import kernel

evac_interface = 3

@kernel
def double(x: float) -> float:
    return 2.0 * x + {offset}

@hookimpl
def evac_finish(simulation, results, error):
    pass
"""


@pytest.fixture(autouse=True)
def folder(monkeypatch, tmp_path):
    monkeypatch.setenv("EVAC_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setattr(store, "_warned", set())
    return tmp_path / "cache" / "kernels"


@pytest.fixture
def plugin(monkeypatch, tmp_path):
    """A file with one kernel, the only one that there is to compile."""
    path = tmp_path / "doubling.py"
    path.write_text(PLUGIN.format(offset=float(os.getpid())))
    every = plugins.all_entries
    monkeypatch.setattr(plugins, "all_entries", lambda: [entry for entry in every() if "doubling" in entry.label])
    return str(path)


def _facts(text):
    return {line[:18].strip(): line[18:].strip() for line in text.splitlines()}


def test_an_empty_cache_is_shown(capsys, folder):
    assert main(["cache"]) == 0
    facts = _facts(capsys.readouterr().out)
    assert facts["folder"] == str(folder)
    assert facts["compiled kernels"] == "0"
    assert facts["compiled by"] == versions().rpartition(",")[0]
    assert not folder.exists()


def test_kernels_are_compiled_beforehand_and_cleared(capsys, folder, plugin):
    assert main(["cache", "compile", "--plugin", plugin]) == 0
    shown = capsys.readouterr()
    assert _facts(shown.out)["compiled kernels"] == "1"
    assert "compiling 1 kernel," in shown.err
    assert [path.name.partition("-")[0].rpartition(".")[2] for path in folder.iterdir()] == ["double"]
    assert main(["cache", "clear"]) == 0
    assert _facts(capsys.readouterr().out)["compiled kernels"] == "0"
    assert not folder.exists()
