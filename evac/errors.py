"""The exceptions of evac: one root, one class for each kind of cause."""

import re
import traceback
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

#: Characters of an error's text that are shown, and of a line of a file.
LONGEST = 1000
LONGEST_QUOTED = 120


class EvacError(Exception):
    """Root of the exceptions of evac."""


class BuildingError(EvacError):
    """A building file or the building read from it cannot be used; names the file and the place."""


class ScenarioError(EvacError):
    """A case.toml or an override is wrong; names the file, the dotted key and how to fix it."""


class PluginError(EvacError):
    """A plugin cannot be found, loaded or configured, or breaks its contract."""


class SimulationError(EvacError):
    """A run cannot continue; names time, people, place and what to change."""


class ResultError(EvacError):
    """A result folder or a trajectory file cannot be read or written."""


class EvacWarning(UserWarning):
    """Root of the Python warnings of evac."""


class RunWarning(EvacWarning):
    """What the results of a run or a study say too: about building, people, people left inside, and quality."""


class ProcessWarning(EvacWarning):
    """A study cannot use other processes; it takes longer, and nothing else is affected."""


class FolderWarning(EvacWarning):
    """A result folder is less protected than it should be: it cannot be locked, or a checkpoint cannot be written."""


class CacheWarning(EvacWarning):
    """Compiled kernels cannot be read or kept; they are compiled again, and nothing else is affected."""


class ConformanceWarning(EvacWarning):
    """Lines of a plugin were not executed by `evac.conformance.check_plugin`, and are therefore not checked."""


def counted(number: int, one: str, several: str = "") -> str:
    """Return a number with its noun in the singular or plural; the plural is `one` with an s if not given."""
    return f"{number} {one if number == 1 else several or one + 's'}"


def quoted_line(text: str, error: str) -> str:
    """Return the line of a TOML text that a parser's error names, with a hint if the mistake is a frequent one."""
    found = re.search(r"at line (\d+)", error)
    lines = text.split("\n")
    if not found or int(found[1]) > len(lines):
        return "; correct the file"
    line = lines[int(found[1]) - 1].strip()
    quoted = f": {line[:LONGEST_QUOTED]}{'...' if len(line) > LONGEST_QUOTED else ''}"
    bare = re.fullmatch(r"([\w.-]+)\s*=\s*([A-Za-z][^\"'#\[\]{}]*?)\s*", line)
    if bare and bare[2].lower() in ("true", "false"):
        return f"{quoted}; write {bare[1]} = {bare[2].lower()}"
    if bare:
        return f'{quoted}; text needs quotes: {bare[1]} = "{bare[2]}"'
    if re.search(r'"[^"]*\\', line):
        return f"{quoted}; a backslash has a special meaning within double quotes: use forward slashes or single quotes"
    return f"{quoted}; correct the file there"


def text_of(error: BaseException) -> str:
    """Return the text of an error in one line of at most `LONGEST` characters and an ellipsis."""
    try:
        text = " ".join(str(error).split()).encode("utf-8", "backslashreplace").decode()
    except Exception:
        text = "(its text cannot be shown)"
    return text if len(text) <= LONGEST else f"{text[:LONGEST]} ..."


def in_one_line(error: BaseException) -> str:
    """Return class and text of an error in one line, shortened as by `text_of`."""
    text = text_of(error)
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


def place_of(error: BaseException) -> str:
    """Return file and line of the innermost frame of an exception outside of evac; within evac if there is none."""
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if not frame.filename.startswith("<")]
    outside = [frame for frame in frames if Path(__file__).parent not in Path(frame.filename).parents]
    return next((f"{frame.filename}, line {frame.lineno}" for frame in reversed(outside or frames)), "no file")


@contextmanager
def plugin_code(what: str) -> Iterator[None]:
    """Run code of a plugin; an exception that is not an EvacError becomes a PluginError with plugin, file and line.

    This includes SystemExit, since no plugin may end the process. A KeyboardInterrupt comes from the user and is
    passed on.
    """
    try:
        yield
    except (EvacError, KeyboardInterrupt, GeneratorExit):
        raise
    except BaseException as error:
        advice = "let the plugin raise an exception instead" if isinstance(error, SystemExit) else "correct the plugin"
        raise PluginError(f"{what}: {in_one_line(error)} ({place_of(error)}); {advice}, or remove it") from error


@contextmanager
def noting(lines: Iterable[str]) -> Iterator[None]:
    """Add warnings that may explain an error raised within to it, as notes."""
    try:
        yield
    except EvacError as error:
        note(error, lines)
        raise


def warn(lines: Iterable[str]) -> None:
    """Issue each line as a `RunWarning` about the line of code that called the function which calls this one."""
    for line in lines:
        warnings.warn(line, RunWarning, stacklevel=3)


def note(error: EvacError, lines: Iterable[str]) -> None:
    """Add warnings to an error as notes."""
    for line in lines:
        error.add_note(f"warning: {line}")


@contextmanager
def naming(source: object) -> Iterator[None]:
    """Put the name of a file before a ScenarioError that does not name it yet."""
    try:
        yield
    except ScenarioError as error:
        if str(source) in str(error):
            raise
        raise ScenarioError(f"{source}: {error}") from error
