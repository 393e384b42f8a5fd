"""Object code on disk: one file for each kernel and what it was compiled from, with a checksum."""

import hashlib
import os
import re
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
    base = os.environ.get("XDG_CACHE_HOME") or os.environ.get("LOCALAPPDATA")
    with suppress(RuntimeError):
        return (Path(base) if base else Path.home() / ".cache") / "evac"
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
            content = path.read_bytes()
            if not self.is_shipped and time.time() - path.stat().st_mtime > 86400.0:
                os.utime(path)  # it is used
        except (FileNotFoundError, NotADirectoryError):
            return None
        except OSError as error:
            self.warn("read", f"{path}: cannot be read ({error.strerror}); what cannot be read is compiled again")
            return None
        start = len(_MAGIC) + 32
        code = content[start:]
        if content[:start] == _MAGIC + _checksum(digest, code):
            return code
        if content.startswith(_ANY_MAGIC) and not content.startswith(_MAGIC):
            return None  # of another format
        if not self.is_shipped:
            with suppress(OSError):
                path.unlink()
        self.warn("damaged", f"{path}: damaged; it is compiled again, as is everything else that is damaged")
        return None

    def write(self, name: str, digest: str, code: bytes) -> None:
        """Keep object code and remove older of the same kernel.

        Raises
        ------
        OSError
            If that is not possible; a file is there as a whole or not at all.
        """
        self.folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        handle, temporary = tempfile.mkstemp(dir=self.folder, suffix=".part")
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(_MAGIC + _checksum(digest, code) + code)
            os.replace(temporary, self.path(name, digest))
        except BaseException:
            with suppress(OSError):
                os.unlink(temporary)
            raise
        same = [path for path in self.folder.glob(f"{name}-*.kernel") if len(path.stem) == len(name) + 21]
        _remove(sorted(same, key=_age)[KEPT:])

    def entries(self) -> list[Path]:
        """Return the files of all kernels."""
        return sorted(self.folder.glob("*.kernel"))

    def warn(self, what: str, message: str) -> None:
        """Warn of something that concerns the folder, once."""
        if (self.folder, what) not in _warned:
            _warned.add((self.folder, what))
            warnings.warn(message, CacheWarning, stacklevel=3)

    def prune(self) -> None:
        """Remove what nothing has used for long, what interrupted processes left, and former caches."""
        _remove(path for path in self.entries() if _age(path) > UNUSED)
        _remove(path for path in self.folder.glob("*.part") if _age(path) > _ABANDONED)
        with suppress(OSError):
            for folder in self.folder.parent.iterdir():
                _remove_former(folder)

    def clear(self) -> None:
        """Remove all kernels and former caches; other files are left alone."""
        _remove([*self.entries(), *self.folder.glob("*.part")])
        with suppress(OSError):
            self.folder.rmdir()
        self.prune()


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
