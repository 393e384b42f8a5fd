"""A lock of the operating system on a file, which is released when the process that holds it ends for any reason.

The package filelock (4.2.11) does not serve: it leaves its file beside the result, does not name the process that holds
the lock, takes a file of somebody else as a lock, and uses a lock that outlives a killed process where there are none.
"""

import json
import os
import socket
import stat
import sys
import time
import warnings
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Self

from evac.base.errors import FolderWarning, ResultError
from evac.folder.files import writing

#: Byte that is locked on systems that lock ranges of bytes: after the content, so that others can read the file.
_BYTE = 1 << 30


class FileLock:
    """An exclusive lock on a file; a context manager.

    The file contains the process that holds the lock. It is removed when the lock is released; a file left by a killed
    process does not block others.
    """

    def __init__(self, path: Path, what: str, advice: str) -> None:
        self.path = path
        self._what = what
        self._advice = advice
        self._file = -1

    def __enter__(self) -> Self:
        self.acquire()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.release()

    def acquire(self) -> None:
        """Acquire the lock."""
        while self._file < 0:
            with writing("the lock", self.path):
                self.path.parent.mkdir(parents=True, exist_ok=True)
                file = os.open(self.path, os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0), 0o644)
            try:
                is_file = stat.S_ISREG(os.fstat(file).st_mode)
                if is_file:
                    self._lock(file)
                if not is_file or not _is_lock(file):
                    raise ResultError(f"{self.path}: is not a lock of evac, which needs this name; move it away")
                if _is_at(file, self.path):  # otherwise the previous holder has removed it meanwhile
                    self._file = file
                    self._sign()
            finally:
                if self._file != file:
                    os.close(file)

    def release(self) -> None:
        """Remove the file and release the lock, if it is held."""
        if self._file < 0:
            return
        file, self._file = self._file, -1
        if os.name == "nt":  # Windows cannot remove an open file
            os.close(file)
            _remove(self.path)
        else:
            if _is_at(file, self.path):
                _remove(self.path)
            with suppress(OSError):  # a plugin may have closed it
                os.close(file)

    def _lock(self, file: int) -> None:
        try:
            _lock_now(file)
        except BlockingIOError:
            raise ResultError(f"{self._what} by {self._holder()}; {self._advice}") from None
        except OSError as error:
            warnings.warn(
                f"{self.path}: the file system does not support locks ({error.strerror}); make sure that no other run "
                "writes here",
                FolderWarning,
                stacklevel=4,
            )

    def _sign(self) -> None:
        """Write the holder of the lock to the file."""
        holder = {"process": os.getpid(), "host": socket.gethostname(), "since": time.strftime("%Y-%m-%d %H:%M:%S")}
        with writing("the lock", self.path):
            os.ftruncate(self._file, 0)
            os.write(self._file, json.dumps(holder).encode())

    def _holder(self) -> str:
        """Return a description of the holder of the lock."""
        try:
            holder = json.loads(self.path.read_text(encoding="utf-8"))
            return f"process {int(holder['process'])} on {holder['host']} since {holder['since']}"
        except (OSError, ValueError, KeyError, TypeError):
            return "another process"


def _is_at(file: int, path: Path) -> bool:
    """Return whether an open file is still the file at a path."""
    try:
        return os.path.samestat(os.fstat(file), os.stat(path))
    except OSError:
        return False


def _is_lock(file: int) -> bool:
    """Return whether an open file is empty, or was written by `FileLock`."""
    content = os.pread(file, 4096, 0) if hasattr(os, "pread") else b""
    try:
        return not content or "process" in json.loads(content)
    except (ValueError, TypeError, RecursionError):
        return False


def _remove(path: Path) -> None:
    with suppress(OSError):  # a file that is left does not block others
        path.unlink(missing_ok=True)


if sys.platform == "win32":
    import msvcrt

    def _lock_now(file: int) -> None:
        """Lock an open file, or raise BlockingIOError."""
        os.lseek(file, _BYTE, os.SEEK_SET)
        try:
            msvcrt.locking(file, msvcrt.LK_NBLCK, 1)
        except PermissionError as error:
            raise BlockingIOError from error
        finally:
            os.lseek(file, 0, os.SEEK_SET)

else:
    import fcntl

    def _lock_now(file: int) -> None:
        """Lock an open file, or raise BlockingIOError."""
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
