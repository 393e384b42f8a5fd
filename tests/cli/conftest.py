"""A finished run, and a command line to call."""

import pytest

from evac.cli import main


@pytest.fixture
def evac(tmp_path, monkeypatch):
    """Call the command line in an empty folder."""
    monkeypatch.chdir(tmp_path)

    def call(*words: object) -> int:
        return main([str(word) for word in words])

    return call


@pytest.fixture(scope="session")
def result(tmp_path_factory):
    """Result folder of the square room."""
    folder = tmp_path_factory.mktemp("run") / "result"
    assert main(["run", "square_room", "--out", str(folder)]) == 0
    return folder
