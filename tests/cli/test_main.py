"""The parser, errors, and what is imported."""

import subprocess
import sys

import pytest

from evac.cli.main import COMMANDS, main, parser
from evac.errors import SimulationError


def test_help_names_every_command(capsys):
    with pytest.raises(SystemExit, match="0"):
        main(["--help"])
    out = capsys.readouterr().out
    assert all(f"    {name}" in out for name in COMMANDS)


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_help(command, capsys):
    with pytest.raises(SystemExit, match="0"):
        main([command, "--help"])
    assert f"evac {command}" in capsys.readouterr().out


def test_wrong_words_give_status_2(capsys):
    for words in ([], ["fly"], ["export", "r"], ["run", "square_room", "--seed", "x"]):
        with pytest.raises(SystemExit, match="2"):
            main(words)
    assert "usage" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("error", "status", "message"),
    [(SimulationError("no step"), 2, "evac: no step\n"), (KeyboardInterrupt(), 130, "evac: interrupted\n")],
)
def test_status_of_errors(error, status, message, monkeypatch, capsys):
    def fail(arguments):
        raise error

    monkeypatch.setattr("evac.cli.catalogue.execute", fail)
    assert main(["list"]) == status
    assert capsys.readouterr().err == message


def test_an_unexpected_error_keeps_its_traceback(monkeypatch):
    def fail(arguments):
        raise ZeroDivisionError

    monkeypatch.setattr("evac.cli.catalogue.execute", fail)
    with pytest.raises(ZeroDivisionError):
        main(["list"])


def test_overrides_gather():
    arguments = parser().parse_args(["run", "c", "--set", "a=1", "b=2", "--set", "d=3"])
    assert arguments.overrides == ["a=1", "b=2", "d=3"]


@pytest.mark.parametrize(
    ("code", "absent"),
    [
        ("import evac", ("numpy", "numba", "scipy", "pyvista", "matplotlib", "pydantic", "rich")),
        (
            "from evac.cli import main; main(['list'])",
            ("numba", "scipy", "pyvista", "matplotlib", "shapely", "pydantic"),
        ),
        (
            "from evac.cli import main; main(['run', 'square_room', '--set', 'output.animation=false', "
            "'output.picture=false', 'simulation.duration=1'])",
            ("pyvista", "matplotlib", "vtkmodules"),
        ),
        ("from evac.cli import main; main(['run', 'square_room'])", ("pyvista",)),
    ],
)
def test_nothing_is_imported_before_it_is_needed(code, absent, tmp_path):
    check = f"{code}; import sys; print('imported:', *(set({absent!r}) & set(sys.modules)))"
    process = subprocess.run([sys.executable, "-c", check], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert process.stdout.splitlines()[-1] == "imported:"
