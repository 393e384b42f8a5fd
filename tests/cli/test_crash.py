"""Errors that nobody expects: one line, a status of their own, a crash file; and what becomes of warnings."""

import os
import subprocess
import sys
import warnings
from pathlib import Path

import pytest

from evac.base.errors import CacheWarning, PluginError
from evac.cli import crash
from evac.cli.crash import INTERNAL_ERROR, crash_file
from evac.cli.main import main

SECRET = "a-token-that-nobody-may-see"


@pytest.fixture(autouse=True)
def crashes(monkeypatch, tmp_path):
    """The folder of crash files; the current folder is another one."""
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    monkeypatch.setenv("EVAC_CACHE_DIR", str(tmp_path))
    return tmp_path / "crashes"


def raising(error):
    def fail(arguments):
        raise error

    return fail


@pytest.mark.parametrize(
    "error",
    [
        ZeroDivisionError("no number"),
        RecursionError(),
        SystemExit(0),
        SystemExit("text"),
        BaseException("odd"),
        OSError(),
    ],
)
def test_an_unexpected_error_is_one_line_and_a_file(error, monkeypatch, capsys, crashes):
    monkeypatch.setenv("EVAC_TOKEN", SECRET)
    monkeypatch.setattr("evac.cli.cases.execute_list", raising(error))
    assert main(["list"]) == INTERNAL_ERROR == 70
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("evac: ")
    assert type(error).__name__ in line
    (path,) = crashes.iterdir()
    assert str(path) in line
    report = path.read_text(encoding="utf-8")
    for part in ("command: ", "evac 0.", "numpy ", "Traceback", "in fail"):
        assert part in report
    assert SECRET not in report
    assert path.stat().st_mode & 0o077 == 0


def test_lack_of_memory_says_what_needs_less(monkeypatch, capsys):
    monkeypatch.setattr("evac.cli.cases.execute_list", raising(MemoryError("146 TiB")))
    assert main(["list"]) == INTERNAL_ERROR
    (line,) = capsys.readouterr().err.splitlines()
    assert "memory" in line
    assert "directions.spacing" in line


def test_the_settings_of_the_case_are_in_the_file(monkeypatch, capsys, crashes):

    def fail(*given, **named):
        raise ZeroDivisionError

    monkeypatch.setattr("evac.simulation.simulation.Simulation", fail)
    assert main(["explain", "square_room", "--seed", "4711"]) == INTERNAL_ERROR
    (path,) = crashes.iterdir()
    assert '"seed": 4711' in path.read_text(encoding="utf-8")


def test_a_failing_plugin_leaves_its_traceback(capsys, crashes):
    Path("evil.py").write_text("def deep():\n    return 1 / 0\n\ndeep()\n")
    assert main(["list", "--plugin", "evil.py"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "ZeroDivisionError" in line
    assert "evil.py, line 2" in line
    (path,) = crashes.iterdir()
    assert str(path) in line
    assert "in deep" in path.read_text(encoding="utf-8")


def test_bad_input_leaves_no_file(monkeypatch, capsys, crashes):
    monkeypatch.setattr("evac.cli.cases.execute_list", raising(PluginError("not this one")))
    assert main(["list"]) == 2
    assert main(["check", "nothing.toml"]) == 2
    assert not crashes.exists()


def test_the_file_goes_elsewhere_or_nowhere(monkeypatch, tmp_path, crashes):
    """Root may write anywhere, so that the folder cannot be created instead of being protected."""
    crashes.write_text("not a folder")
    spare = tmp_path / "spare"
    spare.mkdir()
    monkeypatch.setattr(crash.tempfile, "gettempdir", lambda: str(spare))
    assert str(spare) in crash_file(ValueError())
    assert len(list(spare.iterdir())) == 1
    assert str(spare) in crash_file(ValueError())  # a second one of the same second
    assert len(list(spare.iterdir())) == 2
    monkeypatch.setattr(crash.tempfile, "gettempdir", lambda: str(tmp_path / "gone"))
    assert "could be written" in crash_file(ValueError())


def test_the_oldest_files_are_removed(crashes):
    crashes.mkdir()
    (crashes / "notes.txt").write_text("of the user")
    for k in range(crash.KEPT + 5):
        old = crashes / f"evac-crash-20200101-000000-{k}.txt"
        old.write_text("old")
        os.utime(old, (k, k))
    newest = crash_file(ValueError("new")).removeprefix("details are in ")
    left = {path.name for path in crashes.glob("evac-crash-*")}
    assert left == {Path(newest).name, *(f"evac-crash-20200101-000000-{k}.txt" for k in range(6, crash.KEPT + 5))}
    assert (crashes / "notes.txt").is_file()


def test_a_report_that_fails_is_no_second_crash(monkeypatch, crashes):

    def fail(*given):
        raise MemoryError

    monkeypatch.setattr(crash, "_report", fail)
    assert str(crashes) in crash_file(ValueError("the first"))
    (path,) = crashes.iterdir()
    assert "ValueError: the first" in path.read_text(encoding="utf-8")


def test_warnings_of_libraries_are_kept_for_crash_files(monkeypatch, capsys, crashes):
    monkeypatch.setattr(sys, "warnoptions", [])
    Path("noisy.py").write_text("import warnings\nwarnings.warn('from the plugin')\n")

    def warn_and_fail(arguments):
        from evac.contract.registry import Registry

        warnings.simplefilter("always")
        warnings.warn("from a library", RuntimeWarning, stacklevel=1)
        warnings.warn("from the cache", CacheWarning, stacklevel=1)
        try:
            Registry(["noisy.py"])
        finally:
            raise ZeroDivisionError

    monkeypatch.setattr("evac.cli.cases.execute_list", warn_and_fail)
    assert main(["list"]) == INTERNAL_ERROR
    said = capsys.readouterr().err
    assert "warning: from the cache\n" in said
    assert "noisy.py, line 2: UserWarning: from the plugin\n" in said
    assert "library" not in said
    (path,) = crashes.iterdir()
    assert "RuntimeWarning: from a library" in path.read_text(encoding="utf-8")


def test_threads_destructors_and_the_exit_change_no_status(crashes):
    Path("noise.py").write_text(
        "import atexit, sys, threading\n"
        "def fail():\n    raise ValueError('of a thread')\n"
        "class Evil:\n    def __del__(self):\n        raise ValueError('of a destructor')\n"
        "def leave():\n    raise SystemExit(9)\n"
        "def stumble():\n    raise ValueError('of the exit')\n"
        "thread = threading.Thread(target=fail)\nthread.start()\nthread.join()\n"
        "Evil()\nkept = Evil()\natexit.register(leave)\natexit.register(stumble)\n"
        "from evac.contract.hooks import hookimpl\nevac_interface = 3\n"
        "@hookimpl\ndef evac_behaviours():\n    return []\n"
    )
    command = [sys.executable, "-P", "-m", "evac", "list", "--plugin", "noise.py"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0
    assert "square_room" in done.stdout
    assert "Traceback" not in done.stderr
    for where in ("of a thread", "of a destructor", "of the exit"):
        assert where in done.stderr
    (path,) = crashes.iterdir()  # of the thread
    assert "in fail" in path.read_text(encoding="utf-8")


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="this system has no device that is always full")
def test_lost_output_is_told_where_it_can_be():
    with open("/dev/full", "w") as full:
        command = [sys.executable, "-P", "-m", "evac", "list"]
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 0
    (line,) = done.stderr.splitlines()
    assert "standard output" in line
