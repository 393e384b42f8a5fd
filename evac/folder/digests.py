"""Running digests of the files that recorders append to."""

import hashlib
import os
from pathlib import Path

from evac.base.errors import ResultError
from evac.folder.files import writing

#: Bytes that are read at once.
CHUNK = 1 << 20


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
        """Return the digest of the first `length` bytes of a file as hexadecimal text.

        Raises
        ------
        ResultError
            The file cannot be read, is a link, or is shorter.
        """
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
