"""Result folders: written under another name with a lock, and renamed when everything is written.

For a folder ``RESULT`` there may be, in the same parent folder,

- ``RESULT.running``: the files of a run that has not ended;
- ``RESULT.lock``: locked while a run or another command writes, see `FileLock`;
- ``RESULT.replaced``: for a short time, the earlier result while it is being replaced.

The next process that opens the folder cleans up after a killed one.
"""

import os
import shutil
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path, PurePath
from types import TracebackType
from typing import Any, Self

from evac.base.errors import ResultError, usable_path
from evac.folder.files import (
    RUNS_PARQUET_NAME,
    RUNS_STREAM_NAME,
    sync_file,
    sync_folder,
    writing,
)
from evac.folder.lock import FileLock
from evac.folder.manifest import COMPLETE, MANIFEST_NAME, REPLACED, RUNNING, TEMPORARY, mark, read_manifest

#: Name of the file of a case in its folder.
CASE_NAME = "case.toml"

#: Suffix added to the name of a file by other programs if a run has written a file with the same name.
EARLIER = ".earlier"


class ResultFolder:
    """A result folder that is being written; a context manager that holds its lock.

    Attributes
    ----------
    path : Path
        The given path.
    running : Path
        Folder to which a run writes.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = usable_path(path, ResultError)
        self._place = self.path.resolve()  # the target of a link is replaced, not the link
        self.running = running_beside(self.path)
        self._replaced = self._place.with_name(f"{self._place.name}.replaced")
        self._made: os.stat_result | None = None
        self._handle = -1  # open descriptor of the folder, so that its inode number is not reused
        self._lock = FileLock(
            self._place.with_name(f"{self._place.name}.lock"),
            f"{self.path}: is being written",
            "wait until it has ended, or choose another folder (--out)",
        )

    def __enter__(self) -> Self:
        self._check_place()
        self._lock.acquire()
        try:
            self._check_beside()
            self.repair()
            check_folder(self.path)
        except BaseException:
            self._lock.release()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._handle >= 0:
            with suppress(OSError):  # a plugin may have closed it
                os.close(self._handle)
            self._handle = -1
        self._lock.release()

    @property
    def is_left_over(self) -> bool:
        """Whether a killed run, or one that failed while an earlier result existed, has left its folder."""
        return self.running.exists()

    def start(self) -> None:
        """Create ``RESULT.running``; files left in it by an earlier run are removed."""
        with writing("the results", self.running):
            self.running.mkdir(parents=True, exist_ok=True)
            self._check_no_study()
            remove_written(self.running)
            (self.running / MANIFEST_NAME).unlink(missing_ok=True)
            mark(self.running, RUNNING, self._place.name)
            self._hold()

    def reopen(self, source: Path) -> None:
        """Rename the folder of a run that is resumed to ``RESULT.running``."""
        with writing("the results", self.running):
            if not self.running.exists() or not self.running.samefile(source):
                if self.running.exists():  # of another run, which cannot be resumed
                    self._check_no_study()
                    remove_written(self.running)
                    carry_over(self.running, self._place)
                os.rename(self._place, self.running)
            mark(self.running, RUNNING, self._place.name)
            self._hold()

    def put_back(self, source: Path) -> None:
        """Undo `reopen` with the same argument, for a run that cannot be resumed."""
        if not source.exists():
            mark(self.running, COMPLETE, self._place.name)
            os.rename(self.running, self._place)

    def check(self) -> None:
        """Check that ``RESULT.running`` is still the folder created by this run."""
        try:
            is_there = self._made is not None and os.path.samestat(self.running.stat(), self._made)
        except OSError:
            is_there = False
        if not is_there:
            raise ResultError(
                f"{self.running}: the folder was removed during the run, with all its files; run the case again, and "
                "do not change the folder until it has ended"
            )

    def publish(self) -> Path:
        """Replace ``RESULT`` by ``RESULT.running``, keeping files in ``RESULT`` that evac has not written."""
        self.check()
        with writing("the results", self.path):
            for path in sorted(self.running.iterdir()):  # not the frames of an animation, which can be written again
                if path.is_file():
                    sync_file(path)
            sync_folder(self.running)
            if self._place.exists():
                mark(self._place, REPLACED, self._place.name)
                os.rename(self._place, self._replaced)
            self._finish_replacement()
        return self.path

    def publish_if_new(self) -> Path:
        """Publish the files of an unfinished run as ``RESULT``, unless there is an earlier result."""
        return self.running if read_manifest(self.path).state else self.publish()

    def discard(self) -> None:
        """Remove the files of evac and plugins in ``RESULT.running``, and the folder if it is then empty."""
        with writing("the results", self.running):
            if self.running.exists():
                remove_written(self.running)
                (self.running / MANIFEST_NAME).unlink(missing_ok=True)
                _remove_if_empty(self.running)

    def repair(self) -> None:
        """Finish a replacement begun by a killed process."""
        if self._replaced.exists():
            with writing("the results", self.path):
                if not self._place.exists() and not self.running.exists():
                    os.rename(self._replaced, self._place)
                else:
                    self._finish_replacement()

    def _hold(self) -> None:
        """Record the identity of the folder created by this run."""
        self._made = self.running.stat()
        if os.name != "nt":  # Windows cannot open folders, and does not reuse their numbers
            self._handle = os.open(self.running, os.O_RDONLY)

    def _finish_replacement(self) -> None:
        """Rename the new result, move other files of the earlier result to it, and remove the earlier result."""
        if not self._place.exists():
            os.rename(self.running, self._place)
            sync_folder(self._place.parent)
            mark(self._place, COMPLETE, self._place.name)
        if self._replaced.exists():
            remove_written(self._replaced)
            carry_over(self._replaced, self._place)

    def _check_no_study(self) -> None:
        """Refuse to remove the runs of a stopped study."""
        if any((self.running / name).is_file() for name in (RUNS_STREAM_NAME, RUNS_PARQUET_NAME)):
            raise ResultError(
                f"{self.running}: contains the runs of a stopped study; resume it (--resume), choose another folder "
                "(--out), or remove this one"
            )

    def _check_beside(self) -> None:
        """Refuse folders beside the result whose names are those of a run, but that are results themselves."""
        for folder, state in ((self.running, RUNNING), (self._replaced, REPLACED)):
            found = read_manifest(folder)
            is_own = is_empty(folder) or (found.state, found.result) == (state, self._place.name)
            if os.path.lexists(folder) and not is_own:
                raise ResultError(
                    f"{folder}: is not a folder that this run may use, but it needs the name; move it away"
                )

    def _check_place(self) -> None:
        """Raise an error for folders that cannot be replaced by renaming."""
        if self.path.parts[:1] == ("~",):
            raise ResultError(f"{self.path}: ~ stands for the home folder in a shell only; write it in full (--out)")
        if os.path.ismount(self._place):
            raise ResultError(f"{self.path}: is the root of a file system; choose a folder in it (--out)")
        if self._place == Path.cwd() or self._place in Path.cwd().parents:
            raise ResultError(
                f"{self.path}: is or contains the current folder, but results replace their folder; choose a folder in "
                "it (--out)"
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
    """Return the folder or file to read: `path`, or if it does not exist, the folder of the run that is writing it."""
    running = running_beside(path)
    return running if not path.exists() and running.is_dir() else path


def check_result(path: Path) -> None:
    """Check that a path to read results from exists and is not that of a case."""
    is_case = (
        path.suffix == ".toml" if path.is_file() else (path / CASE_NAME).is_file() and not read_manifest(path).state
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
        raise ResultError(f"{folder}: not a folder; choose another one for the results (--out)")
    if not read_manifest(folder).state and not is_empty(folder):
        raise ResultError(
            f"{folder}: contains files, but is not a result folder of evac (it has no {MANIFEST_NAME}); choose a new "
            "or empty folder for the results (--out)"
        )


def remove_written(folder: Path, keep: Iterable[str] = ()) -> None:
    """Remove the files that the manifest of a folder lists; links are neither followed nor removed."""
    kept = set(keep)
    listed = [name for name in read_manifest(folder).files if is_within(name) and not is_link(folder, name)]
    for name in listed:
        path = folder / name
        if name not in kept and path.is_file():
            path.unlink()
        elif path.name.startswith(TEMPORARY) and path.is_dir():  # the draft of a killed export
            shutil.rmtree(path)
    parents = {folder / parent for name in listed for parent in PurePath(name).parents} - {folder}
    for parent in sorted(parents, key=lambda parent: -len(parent.parts)):
        _remove_if_empty(parent)


def carry_over(source: Path, target: Path) -> None:
    """Move all files of a folder to another one, adding `EARLIER` to names that exist, and remove the folder."""
    for path in sorted(source.iterdir()):
        if path.name == MANIFEST_NAME:
            continue  # the last to go, because it says what the folder is
        new = target / path.name
        if _is_folder(path) and _is_folder(new):
            carry_over(path, new)
            continue
        while os.path.lexists(new):
            new = new.with_name(new.name + EARLIER)
        os.rename(path, new)
    (source / MANIFEST_NAME).unlink(missing_ok=True)
    source.rmdir()


def _is_folder(path: Path) -> bool:
    return path.is_dir() and not path.is_symlink()


def is_empty(folder: Path) -> bool:
    """Return whether a folder has nothing but a manifest into which a killed process has written nothing."""
    there = list(folder.iterdir()) if folder.is_dir() else []
    return _is_folder(folder) and all(path.name == MANIFEST_NAME and not path.lstat().st_size for path in there)


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
