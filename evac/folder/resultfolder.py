"""Result folders: written under another name with a lock, and renamed when everything is written.

For a folder ``RESULT`` there may be, in the same parent folder,

- ``RESULT.running``: the files of a run that has not ended, or of one that was killed while it replaced ``RESULT``;
- ``RESULT.lock``: locked while a run or another command writes, see `locked`.

The next process that opens the folder cleans up after a killed one.
"""

import errno
import json
import os
import shutil
import socket
import time
import warnings
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path, PurePath
from typing import Any, Self

from evac.base.errors import FolderWarning, ResultError, usable_path
from evac.folder import files

NO_LOCKS = (errno.ENOSYS, errno.ENOLCK, errno.EOPNOTSUPP)  #: Errors of file systems that have no locks.
PATIENCE = 0.2  #: Time in which a lock that its last holder is releasing becomes free [s].


@contextmanager
def locked(path: Path, what: str) -> Iterator[None]:
    """Hold a lock of the operating system on a file, which is removed at the end; one of a killed process is free."""
    from filelock import FileLock, Timeout  # which takes 30 ms

    lock = FileLock(path, timeout=PATIENCE, fallback_to_soft=False, on_acquired=_sign)
    with files.writing("the lock", path):
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
        holder = json.loads(files.content_of(path))
        with path.open("rb") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)  # succeeds on what a killed process has left
            except BlockingIOError:
                return int(holder["process"]) if holder["host"] == socket.gethostname() else None
    return None


def _holder(path: Path) -> str | None:
    """Return a description of the process that has written a lock file; None for a file of somebody else."""
    try:
        if not (content := files.content_of(path)):
            return "another process"
        holder = json.loads(content)
        return f"process {int(holder['process'])} on {holder['host']} since {holder['since']}"
    except PermissionError:  # Windows lets nobody read a file that is locked
        return "another process"
    except (OSError, ValueError, LookupError, TypeError, RecursionError):
        return None


CASE_NAME = "case.toml"  #: Name of the file of a case in its folder.

#: Suffix added to the name of a file by other programs if a run has written a file with the same name.
EARLIER = ".earlier"


class ResultFolder:
    """A result folder that is being written: `path`, and `running`, to which a run writes; a context with its lock."""

    def __init__(self, path: str | Path) -> None:
        self.path = usable_path(path, ResultError)
        self._place = self.path.resolve()  # the target of a link is replaced, not the link
        self.running = running_beside(self.path)

    def __enter__(self) -> Self:
        self._check_place()
        with ExitStack() as entered:
            entered.enter_context(locked(self._place.with_name(f"{self._place.name}.lock"), str(self.path)))
            found = files.read_manifest(self.running)
            if os.path.lexists(self.running) and not is_empty(self.running) and found.result != self._place.name:
                raise ResultError(f"{self.running}: is not of a run into {self.path}, which needs this name; move it")
            if found.state == files.COMPLETE:  # its process was killed
                with files.writing("the results", self.path):
                    self._replace()
            check_folder(self.path)
            self._held = entered.pop_all()
        return self

    def __exit__(self, *error: object) -> None:
        self._held.close()

    @property
    def is_left_over(self) -> bool:
        """Whether a killed run, or one that failed while an earlier result existed, has left its folder."""
        return self.running.exists()

    def start(self) -> None:
        """Create ``RESULT.running``; files left in it by an earlier run are removed."""
        with files.writing("the results", self.running):
            self.running.mkdir(parents=True, exist_ok=True)
            self._clear()
            files.mark(self.running, files.RUNNING, self._place.name)

    def reopen(self, source: Path) -> None:
        """Rename the folder of a run that is resumed to ``RESULT.running``."""
        with files.writing("the results", self.running):
            if not self.running.exists() or not self.running.samefile(source):
                if self.running.exists():  # of another run, which cannot be resumed
                    self._clear()
                    carry_over(self.running, self._place)
                os.rename(self._place, self.running)
            files.mark(self.running, files.RUNNING, self._place.name)

    def put_back(self, source: Path) -> None:
        """Undo `reopen` with the same argument, for a run that cannot be resumed."""
        if not source.exists():
            files.mark(self.running, files.COMPLETE, self._place.name)
            os.rename(self.running, self._place)

    def check(self) -> None:
        """Check that ``RESULT.running`` is still the folder of this run."""
        if not (self.running / files.MANIFEST_NAME).is_file():
            raise ResultError(
                f"{self.running}: the folder was removed during the run, with all its files; run the case again, and "
                "do not change the folder until it has ended"
            )

    def publish(self) -> Path:
        """Replace ``RESULT`` by ``RESULT.running``, keeping files in ``RESULT`` that evac has not written."""
        self.check()
        with files.writing("the results", self.path):
            for path in sorted(self.running.iterdir()):  # not the frames of an animation, which can be written again
                if path.is_file():
                    files.sync(path)
            files.mark(self.running, files.COMPLETE, self._place.name)
            files.sync(self.running / files.MANIFEST_NAME)
            files.sync(self.running)
            self._replace()
        return self.path

    def publish_if_new(self) -> Path:
        """Publish the files of an unfinished run as ``RESULT``, unless there is an earlier result."""
        return self.running if files.read_manifest(self.path).state else self.publish()

    def discard(self) -> None:
        """Remove the files of evac and plugins in ``RESULT.running``, and the folder if it is then empty."""
        with files.writing("the results", self.running):
            if self.running.exists():
                self._clear()
                _remove_if_empty(self.running)

    def _replace(self) -> None:
        """Put ``RESULT.running``, which is complete, in the place of ``RESULT``; if killed, the next command does."""
        if self._place.exists():
            remove_written(self._place)
            carry_over(self._place, self.running)
        os.rename(self.running, self._place)
        files.sync(self._place.parent)

    def _clear(self) -> None:
        """Remove the files of an earlier run in ``RESULT.running``, but not the runs of a stopped study."""
        if (self.running / files.RUNS_STREAM_NAME).is_file():
            raise ResultError(
                f"{self.running}: contains the runs of a stopped study; resume it with --resume or resume=True, choose "
                "another folder, or remove this one"
            )
        remove_written(self.running)
        (self.running / files.MANIFEST_NAME).unlink(missing_ok=True)

    def _check_place(self) -> None:
        """Raise an error for folders that cannot be replaced by renaming."""
        if self.path.parts[:1] == ("~",):
            raise ResultError(f"{self.path}: ~ stands for the home folder in a shell only; write it in full")
        if os.path.ismount(self._place):
            raise ResultError(f"{self.path}: is the root of a file system; choose a folder in it")
        if self._place == Path.cwd() or self._place in Path.cwd().parents:
            raise ResultError(
                f"{self.path}: is or contains the current folder, but results replace their folder; choose a folder in "
                "it"
            )


def running_beside(path: str | Path) -> Path:
    """Return the folder in which a run writes until it has ended: ``RESULT.running``."""
    place = usable_path(path, ResultError)
    if place.is_symlink() or not place.name or place.name == "..":
        place = place.resolve()
    if not place.name:
        raise ResultError(f"{path}: is the root of a file system; choose a folder in it")
    return place.with_name(f"{place.name}.running")


def find_result(path: Path) -> Path:
    """Return what to read: `path`, or ``RESULT.running`` if a run is writing or was killed while it replaced `path`."""
    running = running_beside(path)
    found = files.read_manifest(running)
    is_whole = found.state == files.COMPLETE and f"{found.result}.running" == running.name
    return running if is_whole or (not path.exists() and running.is_dir()) else path


def check_result(path: Path) -> None:
    """Check that a path to read results from exists and is not that of a case."""
    is_case = (
        path.suffix == ".toml"
        if path.is_file()
        else (path / CASE_NAME).is_file() and not files.read_manifest(path).state
    )
    if path.exists() and not is_case:
        return
    stem = path.parent.resolve().name if path.name == CASE_NAME else path.resolve().name.removesuffix(".toml")
    results = [place for place in (path.with_name(f"{stem}-result"), Path(f"{stem}-result")) if place.is_dir()]
    what = " is a case, not a result" if is_case else ": no such file or folder"
    hint = f"did you mean {results[0]}?" if results else "give the result folder of a run"
    if is_case and not results:
        hint = f"run it first: evac run {path}"
    raise ResultError(f"{path}{what}; {hint}")


def check_folder(folder: Path) -> None:
    """Check that a folder is missing, empty or a result folder of evac."""
    if not folder.exists():
        return
    if not folder.is_dir():
        raise ResultError(f"{folder}: not a folder; choose another one for the results")
    if not files.read_manifest(folder).state and not is_empty(folder):
        raise ResultError(
            f"{folder}: contains files, but is not a result folder of evac (it has no {files.MANIFEST_NAME}); choose a "
            "new or empty folder for the results"
        )


def remove_written(folder: Path, keep: Iterable[str] = ()) -> None:
    """Remove the files that the manifest of a folder lists; links are neither followed nor removed."""
    kept = set(keep)
    for name in files.read_manifest(folder).files:
        path = folder / name
        if name in kept or not is_within(name) or is_link(folder, name):
            continue
        if path.is_file():
            path.unlink()
        elif path.name.startswith(files.TEMPORARY) and path.is_dir():  # the draft of a killed export
            shutil.rmtree(path)
        for parent in path.parents[: len(PurePath(name).parts) - 1]:
            _remove_if_empty(parent)


def carry_over(source: Path, target: Path, manifest: str = files.MANIFEST_NAME) -> None:
    """Move all files of a folder to another one, adding `EARLIER` to names that exist, and remove the folder."""
    for path in sorted(source.iterdir()):
        if path.name == manifest:
            continue  # the last to go, because it says what the folder is
        new = target / path.name
        if _is_folder(path) and _is_folder(new):
            carry_over(path, new, "")
            continue
        while os.path.lexists(new):
            new = new.with_name(new.name + EARLIER)
        os.rename(path, new)
    if manifest:
        (source / manifest).unlink(missing_ok=True)
    source.rmdir()


def _is_folder(path: Path) -> bool:
    return path.is_dir() and not path.is_symlink()


def is_empty(folder: Path) -> bool:
    """Return whether a folder has nothing but a manifest into which a killed process has written nothing."""
    there = list(folder.iterdir()) if folder.is_dir() else []
    return _is_folder(folder) and all(path.name == files.MANIFEST_NAME and not path.lstat().st_size for path in there)


def _remove_if_empty(folder: Path) -> None:
    with suppress(OSError):  # it contains other files, or does not exist
        folder.rmdir()


def is_within(name: Any) -> bool:
    """Return whether a relative path from a file stays within its folder."""
    return isinstance(name, str) and bool(name) and not Path(name).is_absolute() and ".." not in Path(name).parts


def is_link(folder: Path, name: str) -> bool:
    """Return whether a file named relative to a folder is a link, or lies in a linked folder within it."""
    parts = Path(name).parts
    return any(folder.joinpath(*parts[: count + 1]).is_symlink() for count in range(len(parts)))
