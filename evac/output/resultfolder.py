"""Result folders: written beside their place under a lock, and put there as a whole once everything is written.

Of a folder ``RESULT`` there are, beside it,

- ``RESULT.running``: what a run writes, from its first step on;
- ``RESULT.lock``: locked while a run or another command writes, see `FileLock`;
- ``RESULT.replaced``: for a moment, the earlier result while it gives way.

What a killed process has left is put right by the next one that takes the folder.
"""

import json
import os
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path, PurePath
from types import TracebackType
from typing import Any, Self

from evac.errors import ResultError
from evac.output.files import (
    BUILDING_FOLDER,
    CHECKPOINT_NAME,
    EXPORT_FOLDER,
    FRAMES_FOLDER,
    PLUGIN_FILES,
    SUMMARY_NAME,
    TRAJECTORY_NAME,
    WRITTEN,
    sync_file,
    sync_folder,
    writing,
)
from evac.output.layout import is_trajectory
from evac.output.lock import FileLock

#: What is appended to the name of a file of others that stands where a run has written one.
EARLIER = ".earlier"


class ResultFolder:
    """The one owner of a result folder; a context manager that holds its lock.

    Parameters
    ----------
    path : str or Path
        New, empty, or the result folder of an earlier run.

    Attributes
    ----------
    path : Path
        As it was given.
    running : Path
        Where a run writes.

    Raises
    ------
    ResultError
        On entering: another process writes there; it is somebody else's folder, or cannot be replaced.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self._place = self.path.resolve()  # of a link: what it leads to is replaced, not the link
        self.running = running_beside(self.path)
        self._replaced = self._place.with_name(f"{self._place.name}.replaced")
        self._made: os.stat_result | None = None
        self._handle = -1  # on the folder, so that another one cannot get its number
        self._lock = FileLock(
            self._place.with_name(f"{self._place.name}.lock"),
            f"{self.path}: is being written",
            "wait for its end, or choose another folder (--out)",
        )

    def __enter__(self) -> Self:
        self._check_place()
        self._lock.acquire()
        try:
            self.repair()
            check_folder(self.path)
            if self.running.exists() and not self.running.is_dir():
                raise ResultError(f"{self.running}: not a folder, and results are written there; move it away")
        except BaseException:
            self._lock.release()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._handle >= 0:
            os.close(self._handle)
            self._handle = -1
        self._lock.release()

    @property
    def is_left_over(self) -> bool:
        """Whether a run that was killed, or has failed beside an earlier result, has left its folder."""
        return self.running.exists()

    def start(self) -> None:
        """Make ``RESULT.running``; what an earlier run has left in it goes.

        Raises
        ------
        ResultError
            It cannot be made or written.
        """
        with writing("the results", self.running):
            self.running.mkdir(parents=True, exist_ok=True)
            remove_written(self.running)
            self._hold()

    def reopen(self, source: Path, keep: Iterable[str]) -> None:
        """Take the folder of a run that is to go on, and make it ``RESULT.running``.

        Parameters
        ----------
        source : Path
            ``RESULT.running``, or ``RESULT`` after a stop.
        keep : iterable of str
            Names of the files to go on with; what else evac has written there goes.

        Raises
        ------
        ResultError
            It cannot be renamed or written.
        """
        with writing("the results", self.running):
            if not self.running.exists() or not self.running.samefile(source):
                if self.running.exists():  # of another run, which cannot go on
                    remove_written(self.running)
                    carry_over(self.running, self._place)
                os.rename(self._place, self.running)
            remove_written(self.running, keep)
            self._hold()

    def check(self) -> None:
        """See that ``RESULT.running`` is still the folder that this run has made.

        Raises
        ------
        ResultError
            It has been removed or replaced.
        """
        try:
            is_there = self._made is not None and os.path.samestat(self.running.stat(), self._made)
        except OSError:
            is_there = False
        if not is_there:
            raise ResultError(
                f"{self.running}: the folder has been removed during the run, with all that was written; run the case "
                "again, and leave the folder alone until it has ended"
            )

    def publish(self) -> Path:
        """Put ``RESULT.running`` in the place of ``RESULT``, with files there that evac has not written.

        Returns
        -------
        Path
            ``RESULT``.

        Raises
        ------
        ResultError
            The folder has been removed, or cannot be renamed; then the earlier result is still there.
        """
        self.check()
        with writing("the results", self.path):
            for path in sorted(self.running.iterdir()):  # the frames of an animation can be made again
                if path.is_file():
                    sync_file(path)
            sync_folder(self.running)
            if self._place.exists():
                os.rename(self._place, self._replaced)
            self._finish_replacement()
        return self.path

    def publish_if_new(self) -> Path:
        """Put what a run has left that did not come to its end in the place of ``RESULT``, unless a result is there.

        Returns
        -------
        Path
            Where it is: ``RESULT``, or ``RESULT.running`` beside an earlier result.
        """
        return self.running if _is_result(self.path) else self.publish()

    def discard(self, plugin_files: Iterable[str] = ()) -> None:
        """Remove what evac and plugins have written to ``RESULT.running``, and the folder where it is empty then."""
        with writing("the results", self.running):
            if self.running.exists():
                for name in plugin_files:
                    (self.running / name).unlink(missing_ok=True)
                remove_written(self.running)
                _remove_if_empty(self.running)

    def repair(self) -> None:
        """Finish a replacement that a killed process has begun."""
        if self._replaced.exists():
            with writing("the results", self.path):
                if not self._place.exists() and not self.running.exists():
                    os.rename(self._replaced, self._place)
                else:
                    self._finish_replacement()

    def _hold(self) -> None:
        """Note which folder this run has made."""
        self._made = self.running.stat()
        if os.name != "nt":  # where folders cannot be opened, and numbers are not given again
            self._handle = os.open(self.running, os.O_RDONLY)

    def _finish_replacement(self) -> None:
        """Rename the new result to its place; carry over files of others, and remove the earlier result."""
        if not self._place.exists():
            os.rename(self.running, self._place)
            sync_folder(self._place.parent)
        if self._replaced.exists():
            remove_written(self._replaced)
            carry_over(self._replaced, self._place)

    def _check_place(self) -> None:
        """Refuse places that cannot be replaced by renaming."""
        if os.path.ismount(self._place):
            raise ResultError(f"{self.path}: is where a file system begins; name a folder in it (--out)")
        if self._place == Path.cwd() or self._place in Path.cwd().parents:
            raise ResultError(
                f"{self.path}: is the current folder or holds it, and results replace their folder; name a folder in "
                "it (--out)"
            )


def running_beside(path: str | Path) -> Path:
    """Return the folder in which a run writes until it has ended: ``RESULT.running``."""
    place = Path(path)
    if place.is_symlink() or not place.name or place.name == "..":
        place = place.resolve()
    if not place.name:
        raise ResultError(f"{path}: is where a file system begins; name a folder in it")
    return place.with_name(f"{place.name}.running")


def find_result(path: Path) -> Path:
    """Return the folder or file to read: `path`, or where nothing is there, the folder of the run that writes it."""
    running = running_beside(path)
    return running if not path.exists() and running.is_dir() else path


def check_folder(folder: Path) -> None:
    """Refuse a folder that holds files and is no result folder of evac.

    Raises
    ------
    ResultError
        Naming the folder and how to go on.
    """
    if not folder.exists():
        return
    if not folder.is_dir():
        raise ResultError(f"{folder}: not a folder; choose another one for the results (--out)")
    if not _is_result(folder) and any(folder.iterdir()):
        raise ResultError(
            f"{folder}: holds files and is no result folder of evac (neither its {SUMMARY_NAME} nor its "
            f"{TRAJECTORY_NAME} is there); choose a new or empty folder for the results (--out)"
        )


def files_of_others(folder: Path) -> set[str]:
    """Return the files in a folder that are none of those that evac writes itself, relative to it."""
    written = set(_written(folder))
    others = (path for path in folder.rglob("*") if path not in written and not _is_folder(path))
    return {path.relative_to(folder).as_posix() for path in others}


def is_written(name: str) -> bool:
    """Return whether a name, relative to a result folder, is one of the files that evac writes itself."""
    return any(
        PurePath(name).match(pattern) and len(PurePath(name).parts) == pattern.count("/") + 1 for pattern in WRITTEN
    )


def remove_written(folder: Path, keep: Iterable[str] = ()) -> None:
    """Remove what a run has written to a folder: files of evac, and those of plugins that its summary lists.

    Parameters
    ----------
    folder : Path
    keep : iterable of str
        Names of files that stay, relative to the folder.
    """
    kept = {folder / name for name in keep}
    listed = _summary(folder).get(PLUGIN_FILES)
    of_plugins = [folder / name for name in listed if is_within(name)] if isinstance(listed, list) else []
    for path in (*(path for path in of_plugins if path.is_file()), *_written(folder)):
        if path not in kept:
            path.unlink()
    ours = [folder / name for name in (FRAMES_FOLDER, BUILDING_FOLDER)]
    exports = [*(folder / EXPORT_FOLDER).glob("*/"), folder / EXPORT_FOLDER]
    for parent in dict.fromkeys([*(path.parent for path in of_plugins), *ours, *exports]):
        if parent != folder:
            _remove_if_empty(parent)


def carry_over(source: Path, target: Path) -> None:
    """Move all that is in a folder to another one, and remove it; where a name is taken, `EARLIER` is added."""
    for path in sorted(source.iterdir()):
        new = target / path.name
        if _is_folder(path) and _is_folder(new):
            carry_over(path, new)
            continue
        while os.path.lexists(new):
            new = new.with_name(new.name + EARLIER)
        os.rename(path, new)
    source.rmdir()


def _written(folder: Path) -> Iterator[Path]:
    for pattern in WRITTEN:
        yield from (path for path in folder.glob(pattern) if not _is_folder(path))


def _is_folder(path: Path) -> bool:
    return path.is_dir() and not path.is_symlink()


def _remove_if_empty(folder: Path) -> None:
    with suppress(OSError):  # it holds files of others, or is not there
        folder.rmdir()


def is_within(name: Any) -> bool:
    """Return whether a name that a file lists leads to a place within the folder of that file."""
    return isinstance(name, str) and bool(name) and not Path(name).is_absolute() and ".." not in Path(name).parts


def _is_result(folder: Path) -> bool:
    """Say whether a folder holds a trajectory, a checkpoint or a summary that evac has written."""
    if (folder / CHECKPOINT_NAME).is_file() or is_trajectory(folder / TRAJECTORY_NAME):
        return True
    versions = _summary(folder).get("versions")
    return isinstance(versions, dict) and "evac" in versions


def _summary(folder: Path) -> dict[str, Any]:
    """Return the summary of a result folder, empty where there is none."""
    try:
        summary = json.loads((folder / SUMMARY_NAME).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return summary if isinstance(summary, dict) else {}
