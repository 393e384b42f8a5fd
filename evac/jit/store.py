"""Object code on disk: one file for each kernel and what it was compiled from, with a checksum."""

import hashlib
import os
import shutil
import tempfile
import warnings
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

_MAGIC = b"evac kernel 1\n"

#: Kept for each kernel and processor: those used last.
KEPT = 4


def cache_root() -> Path | None:
    """Return the folder that holds compiled kernels: ``EVAC_CACHE_DIR``, or the user's; None without a home."""
    chosen = os.environ.get("EVAC_CACHE_DIR")
    if chosen:
        return Path(chosen)
    base = os.environ.get("XDG_CACHE_HOME") or os.environ.get("LOCALAPPDATA")
    with suppress(RuntimeError):
        return (Path(base) if base else Path.home() / ".cache") / "evac"
    return None


@dataclass(frozen=True)
class Store:
    """A folder of object code.

    Attributes
    ----------
    folder : Path
    """

    folder: Path

    def path(self, name: str, digest: str) -> Path:
        """Return where the code of a kernel is kept."""
        return self.folder / f"{name}-{digest}.kernel"

    def read(self, name: str, digest: str) -> bytes | None:
        """Return object code, or None where there is none; a damaged file is removed."""
        path = self.path(name, digest)
        try:
            content = path.read_bytes()
        except OSError:
            return None
        start = len(_MAGIC) + 32
        if (
            content[: len(_MAGIC)] == _MAGIC
            and hashlib.sha256(content[start:]).digest() == content[len(_MAGIC) : start]
        ):
            with suppress(OSError):
                os.utime(path)
            return content[start:]
        warnings.warn(f"{path}: the compiled kernel is damaged; it is compiled again", stacklevel=2)
        with suppress(OSError):
            path.unlink()
        return None

    def write(self, name: str, digest: str, code: bytes) -> bool:
        """Keep object code and remove older of the same kernel; return whether that was possible."""
        path = self.path(name, digest)
        try:
            self.folder.mkdir(parents=True, exist_ok=True, mode=0o700)
            handle, temporary = tempfile.mkstemp(dir=self.folder, suffix=".part")
            try:
                with os.fdopen(handle, "wb") as file:
                    file.write(_MAGIC + hashlib.sha256(code).digest() + code)
                os.replace(temporary, path)
            except BaseException:
                with suppress(OSError):
                    os.unlink(temporary)
                raise
        except OSError as error:
            _warn_once(
                f"{self.folder}: compiled kernels cannot be kept ({error.strerror}); the next run compiles again"
            )
            return False
        self._prune(name)
        return True

    def _prune(self, name: str) -> None:
        """Remove the older files of a kernel."""
        with suppress(OSError):
            same = [path for path in self.folder.glob(f"{name}-*.kernel") if len(path.stem) == len(name) + 21]
            for path in sorted(same, key=lambda path: path.stat().st_mtime, reverse=True)[KEPT:]:
                path.unlink()

    def entries(self) -> list[Path]:
        """Return the files of all kernels."""
        return sorted(self.folder.glob("*.kernel"))

    def clear(self) -> None:
        """Remove the folder."""
        shutil.rmtree(self.folder, ignore_errors=True)


_warned: set[str] = set()


def _warn_once(message: str) -> None:
    if message not in _warned:
        _warned.add(message)
        warnings.warn(message, stacklevel=3)
