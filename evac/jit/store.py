"""Object code on disk: one file for each kernel and what it was compiled from, with a checksum.

The checksum finds damage, not intent: whoever can write a file here can execute code in the process that loads it. So
the folder is made for its owner alone, and nothing is loaded from one that others may write to.
"""

import errno
import hashlib
import os
import re
import stat
import tempfile
import time
import warnings
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from evac.errors import CacheWarning

#: How files of this format begin; those of others begin with the first word as well.
_MAGIC = b"evac kernel 1\n"
_ANY_MAGIC = b"evac kernel "

#: Files kept of one kernel: those used last.
KEPT = 8

#: Files that nothing has used for so long are removed [s].
UNUSED = 90 * 86400.0

#: Files that are written belong to an interrupted process if they are older [s].
_ABANDONED = 3600.0


def cache_root() -> Path | None:
    """Return the folder that holds compiled kernels: ``EVAC_CACHE_DIR``, or the user's; None without a home."""
    chosen = os.environ.get("EVAC_CACHE_DIR")
    if chosen:
        return Path(chosen).absolute()
    for name in ("XDG_CACHE_HOME", "LOCALAPPDATA"):
        base = Path(os.environ.get(name, ""))
        if base.is_absolute():
            return base / "evac"
    with suppress(RuntimeError):
        home = Path.home()
        # An empty HOME would mean the current folder, which may be anybody's.
        return home / ".cache" / "evac" if home.is_absolute() else None
    return None


def user_store() -> "Store | None":
    """Return the store of this user; None without a home."""
    root = cache_root()
    return Store(root / "kernels") if root else None


#: Folders that something has been warned of.
_warned: set[tuple[Path, str]] = set()


@dataclass(frozen=True)
class Store:
    """A folder of object code.

    Attributes
    ----------
    folder : Path
    is_shipped : bool
        Part of an installed wheel: nothing in it is changed.
    """

    folder: Path
    is_shipped: bool = False

    def path(self, name: str, digest: str) -> Path:
        """Return where the code of a kernel is kept."""
        return self.folder / f"{name}-{digest}.kernel"

    def read(self, name: str, digest: str) -> bytes | None:
        """Return object code, or None where there is none; a damaged file is removed, with one warning."""
        path = self.path(name, digest)
        try:
            if not self.is_shipped and exposure(self.folder):
                return None  # what is compiled then cannot be kept, which is warned of
            problem = "" if self.is_shipped else exposure(path)
            content = b"" if problem else path.read_bytes()
        except (FileNotFoundError, NotADirectoryError):
            return None
        except OSError as error:
            self.warn("access", f"{path}: cannot be read ({error.strerror}); what cannot be read is compiled again")
            return None
        start = len(_MAGIC) + 32
        code = content[start:]
        if content[:start] == _MAGIC + _checksum(digest, code):
            self._note_use(path)
            return code
        if content.startswith(_ANY_MAGIC) and not content.startswith(_MAGIC):
            return None  # of another format
        if not self.is_shipped:
            with suppress(OSError):
                path.unlink()
        problem = problem or "is damaged"
        self.warn("damaged", f"{path}: {problem}; it is compiled again, as is everything else that is damaged")
        return None

    def write(self, name: str, digest: str, code: bytes) -> None:
        """Keep object code and remove older of the same kernel.

        Raises
        ------
        OSError
            If that is not possible, or others may write to the folder; a file is there as a whole or not at all.
        """
        self.folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        problem = exposure(self.folder)
        if problem:
            raise PermissionError(errno.EPERM, problem)
        handle, temporary = tempfile.mkstemp(dir=self.folder, suffix=".part")
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(_MAGIC + _checksum(digest, code) + code)
            os.replace(temporary, self.path(name, digest))
        except BaseException:
            with suppress(OSError):
                os.unlink(temporary)
            raise
        same = [path for path in self._files(f"{name}-*.kernel") if len(path.stem) == len(name) + 21]
        _remove(sorted(same, key=_age)[KEPT:])

    def entries(self) -> list[Path]:
        """Return the files of all kernels; none of a folder that cannot be read."""
        return sorted(self._files("*.kernel"))

    def _files(self, pattern: str) -> list[Path]:
        try:
            return list(self.folder.glob(pattern))
        except OSError:
            return []

    def warn(self, what: str, message: str) -> None:
        """Warn of something that concerns the folder, once."""
        if (self.folder, what) not in _warned:
            _warned.add((self.folder, what))
            warnings.warn(message, CacheWarning, stacklevel=3)

    def _note_use(self, path: Path) -> None:
        """Keep a file that is used from being removed as old."""
        if not self.is_shipped:
            with suppress(OSError):  # a folder that can only be read
                if _age(path) > 86400.0:
                    os.utime(path)

    def prune(self) -> None:
        """Remove what nothing has used for long, what interrupted processes left, and former caches."""
        _remove(path for path in self.entries() if _age(path) > UNUSED)
        _remove(path for path in self._files("*.part") if _age(path) > _ABANDONED)
        with suppress(OSError):
            for folder in self.folder.parent.iterdir():
                _remove_former(folder)

    def clear(self) -> None:
        """Remove all kernels and former caches; other files are left alone."""
        _remove([*self.entries(), *self._files("*.part")])
        with suppress(OSError):
            self.folder.rmdir()
        self.prune()


def exposure(path: Path) -> str:
    """Return why others than this user and root could have written a folder or file; empty if they could not.

    Systems without owners and modes, as Windows, protect the folder by where it is: in the user's profile.

    Raises
    ------
    OSError
        It is not there, or cannot be looked at.
    """
    if not hasattr(os, "geteuid"):
        return ""
    found = path.stat()
    if found.st_uid not in (os.geteuid(), 0):
        return f"belongs to another user (number {found.st_uid})"
    if found.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        return f"may be written by others (mode {stat.S_IMODE(found.st_mode):o}); chmod go-w {path}"
    if not (stat.S_ISDIR(found.st_mode) or stat.S_ISREG(found.st_mode)):
        return "is no regular file"
    return ""


def _checksum(digest: str, code: bytes) -> bytes:
    return hashlib.sha256(digest.encode() + code).digest()


def _age(path: Path) -> float:
    """Return the time since a file was last used, to a day [s]; none for one that is gone."""
    try:
        return time.time() - path.stat().st_mtime
    except OSError:
        return 0.0


def _remove(paths: Iterator[Path] | list[Path]) -> None:
    for path in paths:
        with suppress(OSError):
            path.unlink()


def _remove_former(folder: Path) -> None:
    """Remove a folder of the cache that numba kept for evac: 16 hexadecimal digits, and indices and code within."""
    if not re.fullmatch("[0-9a-f]{16}", folder.name) or folder.is_symlink() or not folder.is_dir():
        return
    inside = sorted(folder.rglob("*"), reverse=True)  # files before their folders
    if all(path.is_dir() or path.suffix in (".nbi", ".nbc") for path in inside):
        for path in [*inside, folder]:
            path.rmdir() if path.is_dir() else path.unlink()
