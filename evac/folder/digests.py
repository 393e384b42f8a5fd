"""Digests of files and data, by which runs, studies and imports are told from others; what differs between two."""

import errno
import hashlib
import json
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from evac.base.errors import EvacError, ResultError
from evac.folder.files import writing

#: Bytes that are read at once.
CHUNK = 1 << 20


def digest_of_file(path: Path) -> str:
    """Return the SHA-256 of a file as hexadecimal text."""
    try:
        if not path.is_file() and path.exists():
            raise OSError(errno.EINVAL, "not a file")
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise EvacError(f"{path}: cannot be read: {error.strerror}; check the path") from error


def digest_of_data(content: Any) -> str:
    """Return the SHA-256 of plain data, whatever the order of the keys, as hexadecimal text."""
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def differences(before: Any, now: Any, *key: str) -> Iterator[tuple[tuple[str, ...], Any, Any]]:
    """Yield the keys, and the two values, of everything in which plain data differ; None stands for a missing value."""
    if isinstance(before, Mapping) and isinstance(now, Mapping):
        for name in dict.fromkeys([*before, *now]):
            yield from differences(before.get(name), now.get(name), *key, name)
    elif isinstance(before, list) and isinstance(now, list) and len(before) == len(now):
        for index, values in enumerate(zip(before, now, strict=True)):
            yield from differences(*values, *key, str(index))
    elif before != now:
        yield key, before, now


class RunningDigest:
    """The SHA-256 of the beginning of a file that grows; bytes that were read before are not read again.

    Attributes
    ----------
    length : int
        Number of bytes so far.
    """

    def __init__(self) -> None:
        self._hash = hashlib.sha256()
        self.length = 0

    def extend(self, path: Path, length: int) -> str:
        """Return the digest of the first `length` bytes of a file as hexadecimal text."""
        if length < self.length:  # written anew
            self._hash, self.length = hashlib.sha256(), 0
        with writing("its digest", path):
            descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0))
            with open(descriptor, "rb") as file:
                file.seek(self.length)
                while self.length < length:
                    data = file.read(min(CHUNK, length - self.length))
                    if not data:
                        raise ResultError(f"{path}: has {self.length} bytes, not {length}; run the case again")
                    self._hash.update(data)
                    self.length += len(data)
        return self._hash.hexdigest()
