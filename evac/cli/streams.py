"""Standard output and standard error that never fail: closed, full, without a reader, or of a small alphabet."""

import errno
import io
import os
import select
import sys
from contextlib import suppress
from typing import Any, TextIO


class _Lenient(io.RawIOBase):
    """Passes bytes on until the system refuses them, and throws away what comes then.

    Parameters
    ----------
    raw : raw stream
        Stays open when this one is closed.

    Attributes
    ----------
    failure : OSError, ValueError or None
        Why bytes were refused; a ValueError where somebody has closed the stream.
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
        """Return how many bytes were taken: some, or if any was refused, all."""
        while self.failure is None:
            try:
                taken = self._raw.write(data)
                if taken is not None:
                    return int(taken)
                select.select([], [self._raw], [])  # a pipe that does not block, and is full
            except (OSError, ValueError) as error:
                self.failure = error
        return len(data)


def guard_streams() -> None:
    """Replace the streams of this process by such as never raise, for the rest of its life.

    What a run does and its exit status must not depend on whether somebody can read what it prints. Characters that the
    encoding of a stream lacks are written as escapes. Where one of the descriptors 0 to 2 is closed it is opened on
    the null device: otherwise the first file that is opened would take its place, and get what libraries print.
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
    """Return a stream on what another one writes to; on the descriptor `number` where there is none."""
    if stream is None:
        return _text(_Lenient(io.FileIO(number, "w", closefd=False)), "utf-8", line_buffering=False)
    if not isinstance(stream, io.TextIOWrapper):
        return stream  # somebody else's replacement
    stream.flush()
    raw = _Lenient(getattr(stream.buffer, "raw", stream.buffer))
    return _text(raw, stream.encoding, line_buffering=stream.line_buffering or number == 2)


def _text(raw: _Lenient, encoding: str, *, line_buffering: bool) -> TextIO:
    buffered = io.BufferedWriter(raw)
    return io.TextIOWrapper(buffered, encoding, errors="backslashreplace", line_buffering=line_buffering)


def tell_lost_output() -> None:
    """Write what is left to be written; warn if standard output was refused, unless its reader has gone on purpose."""
    for stream in (sys.stdout, sys.stderr):
        with suppress(ValueError, AttributeError):  # a plugin may have closed or replaced it
            stream.flush()
    raw = getattr(getattr(sys.stdout, "buffer", None), "raw", None)
    failure = raw.failure if isinstance(raw, _Lenient) else None
    if isinstance(failure, OSError) and failure.errno != errno.EPIPE:
        notify(
            f"warning: standard output could not be written ({failure.strerror}), so that some of it is missing; "
            "files are not affected"
        )


def notify(line: str) -> None:
    """Write a line to standard error at once, as handlers of signals may; not being able to is no error."""
    with suppress(OSError, ValueError, AttributeError):
        os.write(sys.stderr.fileno(), f"{line}\n".encode())
