"""Standard output and standard error that never raise: if closed, full, without a reader, or with a small encoding."""

import errno
import io
import os
import shutil
import sys
import textwrap
from contextlib import suppress
from typing import Any, TextIO


class Lenient(io.TextIOWrapper):
    """A text stream that a plugin cannot close; once writing has failed, its descriptor leads to the null device.

    Attributes
    ----------
    failure : OSError or None
        Why writing failed first.
    """

    failure: OSError | None = None

    def write(self, text: str, /) -> int:
        """Write a text; return its length."""
        try:
            return super().write(text)
        except OSError as error:
            self._give_up(error)
        return len(text)

    def flush(self) -> None:
        """Flush, as far as that is possible."""
        try:
            super().flush()
        except OSError as error:
            self._give_up(error)

    def close(self) -> None:
        """Flush only."""
        self.flush()

    def _give_up(self, error: OSError) -> None:
        self.failure = self.failure or error
        with suppress(OSError):
            null = os.open(os.devnull, os.O_WRONLY)
            if null != self.fileno():  # a closed descriptor may be opened again by this
                os.dup2(null, self.fileno())
                os.close(null)


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
    sys.stdout, sys.stderr = guarded(sys.stdout, 1), guarded(sys.stderr, 2)


def guarded(stream: TextIO | None, number: int) -> TextIO:
    """Return a stream that never raises and writes to the target of `stream`, or to a descriptor if it is None."""
    if stream is not None and not isinstance(stream, io.TextIOWrapper):
        return stream  # already replaced by other code
    raw: Any = io.FileIO(number, "w", closefd=False)
    encoding, by_line = "utf-8", number == 2
    if stream is not None:
        stream.flush()
        raw, encoding = getattr(stream.buffer, "raw", stream.buffer), stream.encoding
        by_line |= stream.line_buffering
    with suppress(OSError, AttributeError):  # Windows has no such pipes
        os.set_blocking(raw.fileno(), True)
    return Lenient(io.BufferedWriter(raw), encoding, errors="backslashreplace", line_buffering=by_line)


def warn_lost_output() -> None:
    """Flush standard output; warn if it could not be written, unless its reader closed the pipe."""
    for stream in (sys.stdout, sys.stderr):
        with suppress(ValueError, AttributeError):  # a plugin may have closed or replaced it
            stream.flush()
    failure = getattr(sys.stdout, "failure", None)
    if failure is not None and failure.errno != errno.EPIPE:
        what = f"standard output could not be written ({failure.strerror}) and is incomplete"
        notify(f"warning: {what}; files are not affected")


def wrapped(line: str, stream: TextIO, lines: int | None = None, indent: int = 2) -> str:
    """Return a line divided between words for the terminal of a stream, cut to so many lines; as it is for others."""
    if not stream.isatty():
        return line
    return textwrap.fill(
        line,
        shutil.get_terminal_size().columns,
        subsequent_indent=" " * indent,
        break_long_words=False,
        break_on_hyphens=False,
        max_lines=lines,
        placeholder=" ...",
    )


def note(line: str) -> None:
    """Print a line to standard error, divided between words if that is a terminal."""
    print(wrapped(line, sys.stderr), file=sys.stderr, flush=True)


def notify(line: str) -> None:
    """Write a line to standard error without buffering, which is safe in signal handlers; failures are ignored."""
    with suppress(OSError, ValueError, AttributeError):
        os.write(sys.stderr.fileno(), f"{line}\n".encode())
