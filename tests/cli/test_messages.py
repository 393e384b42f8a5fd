"""Standard streams that fail, errors that nobody expects, and what becomes of warnings."""

import errno
import os
import subprocess
import sys
import warnings
from pathlib import Path

import pytest

from evac.base.errors import CacheWarning
from evac.cli.main import INTERNAL_ERROR, main


@pytest.fixture(autouse=True)
def crashes(monkeypatch, tmp_path):
    """The folder of temporary files; the current folder is another one."""
    for name in ("here", "temporary"):
        (tmp_path / name).mkdir()
    monkeypatch.chdir(tmp_path / "here")
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "temporary"))
    return tmp_path / "temporary"


RUN = ["run", "square_room", "--out", "result", "--set", "simulation.duration=0.3", "output.replay=false"]


@pytest.mark.parametrize(("words", "status"), [(["list"], 0), (RUN, 3)])
def test_a_closed_pipe_ends_quietly_and_stops_no_run(words, status):
    read, write = os.pipe()
    os.close(read)
    command = [sys.executable, "-P", "-m", "evac", *words]
    done = subprocess.run(command, stdout=write, stderr=subprocess.PIPE, text=True, check=False)
    assert words is RUN or subprocess.run(command, stdout=write, stderr=write, check=False).returncode == status
    os.close(write)
    assert done.returncode == status
    assert "Traceback" not in done.stderr
    assert "incomplete" not in done.stderr
    assert Path("result", "people.csv").is_file() == (words is RUN)


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="this system has no device that is always full")
def test_lost_output_is_told():
    with open("/dev/full", "w") as full:
        command = [sys.executable, "-P", "-m", "evac", "list"]
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert os.strerror(errno.ENOSPC) in line


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (ZeroDivisionError("no number"), "no number"),
        (SystemExit(0), "SystemExit"),
        (BaseException("odd"), "odd"),
        (MemoryError("146 TiB"), "directions.spacing"),
    ],
)
def test_an_unexpected_error_is_one_line_and_a_file(error, words, monkeypatch, capsys, crashes):
    monkeypatch.setenv("EVAC_TOKEN", "a-token-that-nobody-may-see")

    def fail(arguments):
        raise error

    monkeypatch.setattr("evac.cli.cases.execute_list", fail)
    assert main(["list"]) == INTERNAL_ERROR == 70
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("evac: ")
    assert words in line
    (path,) = crashes.iterdir()
    assert str(path) in line
    report = path.read_text(encoding="utf-8")
    for part in ("evac 0.", "Traceback", "in fail"):
        assert part in report
    assert "a-token" not in report
    assert path.stat().st_mode & 0o077 == 0


def test_a_failing_plugin_leaves_its_traceback(capsys, crashes):
    Path("evil.py").write_text("def deep():\n    return 1 / 0\n\ndeep()\n")
    assert main(["list", "--plugin", "evil.py"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "ZeroDivisionError" in line
    assert "evil.py, line 2" in line
    (path,) = crashes.iterdir()
    assert str(path) in line
    assert "in deep" in path.read_text(encoding="utf-8")


def test_warnings_of_evac_and_of_plugin_files_are_shown_alone(monkeypatch, capsys):
    monkeypatch.setattr(sys, "warnoptions", [])
    Path("noisy.py").write_text("import warnings\nwarnings.warn('from the plugin')\n")

    def warn_and_fail(arguments):
        from evac.contract.registry import Registry

        warnings.simplefilter("always")
        warnings.warn("from a library", RuntimeWarning, stacklevel=1)
        warnings.warn("from the cache", CacheWarning, stacklevel=1)
        Registry(["noisy.py"])

    monkeypatch.setattr("evac.cli.cases.execute_list", warn_and_fail)
    assert main(["list"]) == 2
    said = capsys.readouterr().err
    assert "warning: from the cache\n" in said
    assert "noisy.py, line 2: UserWarning: from the plugin\n" in said
    assert "library" not in said
