"""Standard output and standard error that never raise: if closed, full, without a reader, or with a small encoding."""

import errno
import io
import os
import select
import sys
from contextlib import suppress
from typing import Any, TextIO


class _Lenient(io.RawIOBase):
    """Writes bytes to a raw stream until it fails, and discards later bytes.

    Parameters
    ----------
    raw : raw stream
        Stays open when this one is closed.

    Attributes
    ----------
    failure : OSError, ValueError or None
        Why writing failed; a ValueError if the stream was closed.
    """

    def __init__(self, raw: Any) -> None:
        self._raw = raw
        self.failure: OSError | ValueError | None = None

    def writable(self) -> bool:
        return True

    def fileno(self) -> int:
        return int(self._raw.fileno())

    def isatty(self) -> bool:
        return bool(self._raw.isatty())

    def write(self, data: Any) -> int:
        """Return how many bytes were written; all of them if writing has failed."""
        while self.failure is None:
            try:
                taken = self._raw.write(data)
                if taken is not None:
                    return int(taken)
                select.select([], [self._raw], [])  # a full non-blocking pipe
            except (OSError, ValueError) as error:
                self.failure = error
        return len(data)


def guard_streams() -> None:
    """Replace the standard streams of this process by streams that never raise.

    A run and its exit status must not depend on whether its output can be written. Characters that the encoding of a
    stream lacks are written as escapes. Closed descriptors from 0 to 2 are opened on the null device: otherwise the
    first file opened would get such a number and receive what libraries print.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            with suppress(OSError):
                opened = os.open(os.devnull, os.O_RDWR)  # the system gives the lowest number that is free
                os.set_inheritable(opened, True)
    sys.stdout, sys.stderr = _guarded(sys.stdout, 1), _guarded(sys.stderr, 2)


def _guarded(stream: TextIO | None, number: int) -> TextIO:
    """Return a stream that never raises and writes to the target of `stream`, or to a descriptor if it is None."""
    if stream is None:
        return _text(_Lenient(io.FileIO(number, "w", closefd=False)), "utf-8", line_buffering=False)
    if not isinstance(stream, io.TextIOWrapper):
        return stream  # already replaced by other code
    stream.flush()
    raw = _Lenient(getattr(stream.buffer, "raw", stream.buffer))
    return _text(raw, stream.encoding, line_buffering=stream.line_buffering or number == 2)


class _Text(io.TextIOWrapper):
    """A text stream that a plugin cannot close."""

    def close(self) -> None:
        """Flush only."""
        self.flush()


def _text(raw: _Lenient, encoding: str, *, line_buffering: bool) -> TextIO:
    buffered = io.BufferedWriter(raw)
    return _Text(buffered, encoding, errors="backslashreplace", line_buffering=line_buffering)


def warn_lost_output() -> None:
    """Flush standard output; warn if it could not be written, unless its reader closed the pipe."""
    for stream in (sys.stdout, sys.stderr):
        with suppress(ValueError, AttributeError):  # a plugin may have closed or replaced it
            stream.flush()
    raw = getattr(getattr(sys.stdout, "buffer", None), "raw", None)
    failure = raw.failure if isinstance(raw, _Lenient) else None
    if isinstance(failure, OSError) and failure.errno != errno.EPIPE:
        notify(
            f"warning: standard output could not be written ({failure.strerror}) and is incomplete; files are not "
            "affected"
        )


def notify(line: str) -> None:
    """Write a line to standard error without buffering, which is safe in signal handlers; failures are ignored."""
    with suppress(OSError, ValueError, AttributeError):
        os.write(sys.stderr.fileno(), f"{line}\n".encode())
