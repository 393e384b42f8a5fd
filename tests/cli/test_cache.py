"""evac cache, and what other commands say about kernels."""

import pytest

from evac.cli import main
from evac.jit import store
from evac.jit.store import versions


@pytest.fixture(autouse=True)
def folder(monkeypatch, tmp_path):
    monkeypatch.setenv("EVAC_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setattr(store, "_warned", set())
    return tmp_path / "cache" / "kernels"


def _facts(text):
    return {line[:18].strip(): line[18:].strip() for line in text.splitlines()}


def test_an_empty_cache_is_shown(capsys, folder):
    assert main(["cache"]) == 0
    facts = _facts(capsys.readouterr().out)
    assert facts["folder"] == str(folder)
    assert facts["compiled kernels"] == "0"
    assert facts["compiled by"] == versions().rpartition(",")[0]
    assert not folder.exists()


def test_kernels_are_counted_and_cleared(capsys, folder):
    folder.mkdir(parents=True, mode=0o700)
    (folder / "double-1.kernel").write_bytes(b"machine code")
    assert main(["cache"]) == 0
    assert _facts(capsys.readouterr().out)["compiled kernels"] == "1"
    assert main(["cache", "clear"]) == 0
    assert _facts(capsys.readouterr().out)["compiled kernels"] == "0"
    assert not folder.exists()
