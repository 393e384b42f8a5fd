"""Digests of files and data, by which runs, studies and imports are told from others, and of records of Arrow streams.

A record is an Arrow message in its encapsulated form: four bytes FF, the length of the metadata, the metadata, and the
body. `sealed` appends a seal to the metadata, where readers of Arrow expect padding: the length of the record, and a
digest of the record and its place in the stream. Without it, a changed byte could be read as another number, or crash
Arrow.
"""

import hashlib
import json
import os
from collections.abc import Iterator, Mapping
from mmap import mmap
from pathlib import Path
from typing import Any, BinaryIO

from evac.base.errors import EvacError, ResultError, check_regular
from evac.folder.files import writing

CHUNK = 1 << 20  #: Bytes that are read at once.


def digest_of_file(path: Path) -> str:
    """Return the SHA-256 of a file as hexadecimal text."""
    try:
        check_regular(path)
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
    """The SHA-256 of the beginning of a file that grows; bytes that were read before are not read again."""

    def __init__(self) -> None:
        self._hash = hashlib.sha256()
        self.length = 0  # number of bytes so far

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


#: Four bytes with which a record begins, and the size of these and the length of the metadata.
MARK = b"\xff\xff\xff\xff"
PREFIX = 8

#: Sizes of the length and the digest in a seal; their sum is a multiple of 8, to which Arrow aligns bodies.
LENGTH, DIGEST = 8, 16
SEAL = LENGTH + DIGEST


def sealed(message: bytes, place: int) -> bytes:
    """Return an encapsulated Arrow message as a record that begins at a place in the stream [bytes]."""
    end = PREFIX + int.from_bytes(message[4:PREFIX], "little")
    length = len(message) + SEAL
    head = MARK + (end - PREFIX + SEAL).to_bytes(4, "little") + message[PREFIX:end] + length.to_bytes(LENGTH, "little")
    body = message[end:]
    return head + _digest(head, body, place) + body


def read_sealed(file: BinaryIO | mmap, place: int, end: int) -> bytes | None:
    """Return the record that begins at a place in a stream of `end` bytes; None if it is incomplete or damaged."""
    file.seek(place)
    prefix = file.read(PREFIX)
    size = int.from_bytes(prefix[4:], "little")
    if len(prefix) < PREFIX or prefix[:4] != MARK or not SEAL <= size <= end - place - PREFIX:
        return None
    metadata = file.read(size)
    head, seal = prefix + metadata[:-DIGEST], metadata[-DIGEST:]
    length = int.from_bytes(head[-LENGTH:], "little")
    if not PREFIX + size <= length <= end - place:
        return None
    body = file.read(length - PREFIX - size)
    return head + seal + body if seal == _digest(head, body, place) else None


def _digest(head: bytes, body: bytes, place: int) -> bytes:
    digest = hashlib.blake2b(head, digest_size=DIGEST, salt=place.to_bytes(16, "little"))
    digest.update(body)
    return digest.digest()
