"""A lock is for one at a time, names who holds it, and ends with its process."""

import fcntl
import os
import re
import subprocess
import sys

import pytest

from evac.base.errors import FolderWarning, ResultError
from evac.folder.resultfolder import holder_here, locked

HOLD = """
import sys, time
from pathlib import Path
from evac.folder.resultfolder import locked
with locked(Path(sys.argv[1]), "r"):
    print("held", flush=True)
    time.sleep(60)
"""


def test_is_for_one_at_a_time_and_leaves_no_file(tmp_path):
    path = tmp_path / "new" / "r.lock"
    with locked(path, "r"):
        for _ in range(2):
            with (
                pytest.raises(ResultError, match=rf"^r: .*process {os.getpid()} on .*; wait .*folder"),
                locked(path, "r"),
            ):
                pass
        path.write_bytes(b"")  # as the holder leaves it for a moment
        with pytest.raises(ResultError, match="another process"), locked(path, "r"):
            pass
    assert not path.exists()
    with locked(path, "r"):
        pass


def test_ends_with_its_process_however_that_ends(tmp_path):
    path = tmp_path / "r.lock"
    process = subprocess.Popen([sys.executable, "-c", HOLD, str(path)], stdout=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "held\n"
    with pytest.raises(ResultError, match=f"process {process.pid} on "), locked(path, "r"):
        pass
    process.kill()
    process.communicate()
    assert path.is_file()
    with locked(path, "r"):
        pass
    assert not path.exists()


def test_a_file_system_without_locks_is_warned_of(tmp_path, monkeypatch):
    def none(file, operation):
        raise OSError(38, "Function not implemented")

    monkeypatch.setattr(fcntl, "flock", none)
    with pytest.warns(FolderWarning, match=r"r\.lock: .*Function not implemented"), locked(tmp_path / "r.lock", "r"):
        pass
    assert list(tmp_path.iterdir()) == []


CONTENTS = ("precious", "[1]", "7", "{}", "[" * 100_000, "link", "pipe")


@pytest.mark.parametrize("content", CONTENTS, ids=lambda content: content[:9])
def test_what_is_no_lock_is_left_alone(tmp_path, content):
    path, thesis = tmp_path / "r.lock", tmp_path / "thesis.txt"
    thesis.write_text(content)
    if content == "pipe":
        os.mkfifo(path)
    elif content == "link":
        path.symlink_to(thesis)
    else:
        path.write_text(content)
    before = path.lstat()
    with pytest.raises(ResultError, match=re.escape(f"{path}: ")), locked(path, "r"):
        pass
    assert (path.lstat().st_ino, path.lstat().st_mode) == (before.st_ino, before.st_mode)
    assert content == "pipe" or path.read_text() == content
    assert holder_here(path) is None
