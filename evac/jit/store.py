"""Object code on disk: one file for each kernel and digest, with a checksum.

The checksum detects damage, not manipulation: anyone who can write a file here can execute code in the process that
loads it. Therefore, the folder is created for its owner only, and nothing is loaded from a folder that others can
write to.
"""

import errno
import hashlib
import os
import stat
import tempfile
import warnings
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from evac.base.errors import CacheWarning

#: First bytes of a file.
_MAGIC = b"evac kernel 1\n"


def cache_root() -> Path | None:
    """Return the cache folder: ``EVAC_CACHE_DIR``, or that of the user; None if there is no home folder."""
    chosen = os.environ.get("EVAC_CACHE_DIR")
    if chosen:
        return Path(chosen).absolute()
    for name in ("XDG_CACHE_HOME", "LOCALAPPDATA"):
        base = Path(os.environ.get(name, ""))
        if base.is_absolute():
            return base / "evac"
    with suppress(RuntimeError):
        home = Path.home()
        # An empty HOME would mean the current folder, which may belong to anyone.
        return home / ".cache" / "evac" if home.is_absolute() else None
    return None


def user_store() -> "Store | None":
    """Return the store of this user; None if there is no home folder."""
    root = cache_root()
    return Store(root / "kernels") if root else None


#: Warnings that have been issued.
_warned: set[tuple[Path, str]] = set()


@dataclass(frozen=True)
class Store:
    """A folder of object code."""

    folder: Path

    def path(self, name: str, digest: str) -> Path:
        """Return the path of the object code of a kernel."""
        return self.folder / f"{name}-{digest}.kernel"

    def read(self, name: str, digest: str) -> bytes | None:
        """Return object code, or None if there is none; a damaged file is removed, with one warning."""
        path = self.path(name, digest)
        try:
            if exposure(self.folder):
                return None  # the compiled code cannot be stored either, which causes a warning
            problem = exposure(path)
            content = b"" if problem else path.read_bytes()
        except (FileNotFoundError, NotADirectoryError):
            return None
        except OSError as error:
            self.warn("access", f"{path}: cannot be read ({error.strerror}); such kernels are compiled again")
            return None
        start = len(_MAGIC) + 32
        code = content[start:]
        if content[:start] == _MAGIC + _checksum(digest, code):
            return code
        with suppress(OSError):
            path.unlink()
        problem = problem or "is damaged"
        self.warn("damaged", f"{path}: {problem}; such kernels are compiled again")
        return None

    def write(self, name: str, digest: str, code: bytes) -> None:
        """Store object code."""
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

    def entries(self) -> list[Path]:
        """Return the files of all kernels; none if the folder cannot be read."""
        return sorted(self._files("*.kernel"))

    def _files(self, pattern: str) -> list[Path]:
        try:
            return list(self.folder.glob(pattern))
        except OSError:
            return []

    def warn(self, what: str, message: str) -> None:
        """Issue a warning about the folder, once for each kind of problem."""
        if (self.folder, what) not in _warned:
            _warned.add((self.folder, what))
            warnings.warn(message, CacheWarning, stacklevel=3)

    def clear(self) -> None:
        """Remove all kernels, and what interrupted processes have left of them; other files are kept."""
        for path in [*self.entries(), *self._files("*.part")]:
            with suppress(OSError):
                path.unlink()
        with suppress(OSError):
            self.folder.rmdir()


def exposure(path: Path) -> str:
    """Return why other users, except root, could have written a folder or file; empty if they could not."""
    if not hasattr(os, "geteuid"):
        return ""
    status = path.stat()
    if status.st_uid not in (os.geteuid(), 0):
        return f"belongs to another user (number {status.st_uid})"
    if status.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        return f"can be written by others (mode {stat.S_IMODE(status.st_mode):o}); run chmod go-w {path}"
    if not (stat.S_ISDIR(status.st_mode) or stat.S_ISREG(status.st_mode)):
        return "is not a regular file"
    return ""


def _checksum(digest: str, code: bytes) -> bytes:
    return hashlib.sha256(digest.encode() + code).digest()
