"""A lock is for one at a time, names who holds it, and ends with its process."""

import os
import re
import subprocess
import sys

import pytest

from evac.base.errors import FolderWarning, ResultError
from evac.folder import lock
from evac.folder.lock import FileLock

HOLD = """
import sys, time
from pathlib import Path
from evac.folder.lock import FileLock
FileLock(Path(sys.argv[1]), "held", "wait").acquire()
print("held", flush=True)
time.sleep(60)
"""


def locked(path):
    return FileLock(path, "r: is being written", "choose another")


def test_is_for_one_at_a_time_and_leaves_no_file(tmp_path):
    path = tmp_path / "new" / "r.lock"
    with locked(path):
        with pytest.raises(ResultError, match=re.escape(f"process {os.getpid()} on ")) as caught:
            locked(path).acquire()
        assert "choose another" in str(caught.value)
        assert path.is_file()
    assert not path.exists()
    with locked(path), pytest.raises(ResultError):
        locked(path).acquire()


def test_ends_with_its_process_however_that_ends(tmp_path):
    path = tmp_path / "r.lock"
    process = subprocess.Popen([sys.executable, "-c", HOLD, str(path)], stdout=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "held\n"
    with pytest.raises(ResultError, match=f"process {process.pid} on "):
        locked(path).acquire()
    process.kill()
    process.communicate()
    assert path.is_file()
    with locked(path):
        pass
    assert not path.exists()


def test_one_who_got_a_file_that_is_removed_meanwhile_tries_again(tmp_path, monkeypatch):
    path, real, calls = tmp_path / "r.lock", lock._lock_now, []

    def slow(file):
        if not calls:
            path.unlink()  # its last holder has gone between opening and locking
        calls.append(file)
        real(file)

    monkeypatch.setattr(lock, "_lock_now", slow)
    with locked(path):
        assert len(calls) == 2
        assert path.is_file()


def test_a_file_system_without_locks_is_warned_of(tmp_path, monkeypatch):
    def none(file):
        raise OSError(38, "Function not implemented")

    monkeypatch.setattr(lock, "_lock_now", none)
    with pytest.warns(FolderWarning, match=r"r\.lock: .*Function not implemented"), locked(tmp_path / "r.lock"):
        pass


@pytest.mark.parametrize("content", ["precious", "[1]", "7", "{}"])
def test_a_file_that_is_no_lock_is_left_alone(tmp_path, content):
    path = tmp_path / "r.lock"
    path.write_text(content)
    with pytest.raises(ResultError, match=r"r\.lock: "), FileLock(path, "r", "wait"):
        pass
    assert path.read_text() == content


def test_a_link_in_the_place_of_a_lock_is_not_followed(tmp_path):
    (tmp_path / "thesis.txt").write_text("precious")
    (tmp_path / "r.lock").symlink_to(tmp_path / "thesis.txt")
    with pytest.raises(ResultError, match=r"r\.lock"), FileLock(tmp_path / "r.lock", "r", "wait"):
        pass
    assert (tmp_path / "thesis.txt").read_text() == "precious"


def test_a_pipe_in_the_place_of_a_lock_is_left_alone(tmp_path):
    os.mkfifo(tmp_path / "r.lock")
    with pytest.raises(ResultError, match=r"r\.lock"), locked(tmp_path / "r.lock"):
        pass
    assert (tmp_path / "r.lock").is_fifo()
