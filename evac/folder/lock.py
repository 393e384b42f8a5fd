"""The lock on a folder that is written: on a file beside it, which names the process that holds it."""

import errno
import json
import os
import socket
import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from evac.base.errors import FolderWarning, ResultError
from evac.folder.files import content_of, writing

#: Errors of file systems that have no locks.
NO_LOCKS = (errno.ENOSYS, errno.ENOLCK, errno.EOPNOTSUPP)

#: Time in which a lock that its last holder is releasing becomes free [s].
PATIENCE = 0.2


@contextmanager
def locked(path: Path, what: str) -> Iterator[None]:
    """Hold a lock of the operating system on a file, which is removed at the end; one of a killed process is free."""
    from filelock import FileLock, Timeout  # which takes 30 ms

    lock = FileLock(path, timeout=PATIENCE, fallback_to_soft=False, on_acquired=_sign)
    with writing("the lock", path):
        path.parent.mkdir(parents=True, exist_ok=True)
        if os.path.lexists(path) and (path.is_symlink() or _holder(path) is None):
            raise ResultError(f"{path}: is not a lock of evac, which needs this name; move it away")
        try:
            lock.acquire()
        except Timeout:
            holder = _holder(path) or "another process"
            message = f"{what}: is being written by {holder}; wait until it has ended, or choose another folder"
            raise ResultError(message) from None
        except OSError as error:
            if error.errno not in NO_LOCKS:
                raise
            text = f"{path}: the file system does not support locks ({error.strerror}); no other run may write here"
            warnings.warn(text, FolderWarning, stacklevel=5)
    try:
        yield
    finally:
        with suppress(OSError):  # Windows cannot remove an open file; the library does so as it releases the lock
            path.unlink()
        lock.release()


def _sign(file: int) -> None:
    """Write the holder of the lock to the file."""
    holder = {"process": os.getpid(), "host": socket.gethostname(), "since": time.strftime("%Y-%m-%d %H:%M:%S")}
    os.ftruncate(file, 0)
    os.write(file, json.dumps(holder).encode())


def holder_here(path: Path) -> int | None:
    """Return the process of this machine that holds a lock; None if nobody does, or it cannot be told."""
    if os.name != "posix":  # elsewhere, nobody reads a file that is locked
        return None
    import fcntl

    with suppress(OSError, ValueError, LookupError, TypeError, RecursionError):
        holder = json.loads(content_of(path))
        with path.open("rb") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)  # succeeds on what a killed process has left
            except BlockingIOError:
                return int(holder["process"]) if holder["host"] == socket.gethostname() else None
    return None


def _holder(path: Path) -> str | None:
    """Return a description of the process that has written a lock file; None for a file of somebody else."""
    try:
        if not (content := content_of(path)):
            return "another process"
        holder = json.loads(content)
        return f"process {int(holder['process'])} on {holder['host']} since {holder['since']}"
    except PermissionError:  # Windows lets nobody read a file that is locked
        return "another process"
    except (OSError, ValueError, LookupError, TypeError, RecursionError):
        return None
