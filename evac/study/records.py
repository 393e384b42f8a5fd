"""Records of an Arrow stream with a checksum each, which is verified before Arrow reads them.

A record is an Arrow message in its encapsulated form: four bytes FF, the length of the metadata, the metadata, and the
body. `sealed` appends a seal to the metadata, where readers of Arrow expect padding: the length of the record, and a
digest of the record and its place in the stream. Without it, a changed byte could be read as another number, or crash
Arrow.
"""

from hashlib import blake2b
from typing import BinaryIO

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


def read_sealed(file: BinaryIO, place: int, end: int) -> bytes | None:
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
    found = blake2b(head, digest_size=DIGEST, salt=place.to_bytes(16, "little"))
    found.update(body)
    return found.digest()
