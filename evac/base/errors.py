"""The exceptions of evac: one root, one class for each kind of cause."""

import errno
import inspect
import os
import re
import shlex
import stat
import sys
import threading
import traceback
import unicodedata
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from operator import attrgetter
from pathlib import Path
from typing import Any, TypeVar

T = TypeVar("T")

#: Characters of an error's text that are shown, and of a line of a file.
LONGEST = 1000
LONGEST_QUOTED = 120

MOST_NAMED = 20  #: Greatest number of people whom a message names.

#: Categories of Unicode that break lines, control terminals, or cannot be written: controls, surrogates, separators.
_CONTROL = frozenset({"Cc", "Cs", "Zl", "Zp"})


class EvacError(Exception):
    """Root of the exceptions of evac."""


class BuildingError(EvacError):
    """A building file or the building read from it cannot be used; names the file and the place.

    Attributes
    ----------
    findings : tuple of Finding
        All errors, if they are about items of a plan or places of a building; each is a line of the text.
    building : Building or None
        The building of what is right in the plan.
    """

    findings: tuple[Any, ...] = ()
    building: Any = None


class ScenarioError(EvacError):
    """A case.toml or an override is wrong; names the file, the dotted key and how to fix it."""


class PluginError(EvacError):
    """A plugin cannot be found, loaded or configured, or breaks its contract.

    Attributes
    ----------
    file : str
        Plugin file that is at fault, which the text of the error advises to check; empty if there is none.
    """

    file = ""

    def __str__(self) -> str:
        text = super().__str__()
        return f"{text}; check it with: evac plugins --check {shlex.quote(self.file)}" if self.file else text


class SimulationError(EvacError):
    """A run cannot continue; names time, people, place and what to change."""


class ResultError(EvacError):
    """A result folder or a trajectory file cannot be read or written."""


class EvacWarning(UserWarning):
    """Root of the Python warnings of evac."""


class RunWarning(EvacWarning):
    """A warning that the results contain, too: about building, people, people left inside, or quality."""


class ProcessWarning(EvacWarning):
    """A study cannot use other processes; it takes longer, and nothing else is affected."""


class FolderWarning(EvacWarning):
    """A result folder is less protected than it should be: it cannot be locked, or a checkpoint cannot be written."""


class CacheWarning(EvacWarning):
    """Compiled kernels cannot be read or kept; they are compiled again, and nothing else is affected."""


def counted(number: int, singular: str, several: str = "") -> str:
    """Return a number with its noun in the singular or plural; the plural is `one` with an s if not given."""
    return f"{number} {singular if number == 1 else several or singular + 's'}"


def some_of(people: Sequence[int]) -> str:
    """Return the numbers of people as text, the first `MOST_NAMED` of them, in words that tell them from counts."""
    first = ", ".join(map(str, people[:MOST_NAMED])) + (", ..." if len(people) > MOST_NAMED else "")
    return f"number{'s' * (len(people) > 1)} {first}"


def in_order(things: Iterable[T], name: Callable[[T], str] = attrgetter("name")) -> list[T]:
    """Return things in the order of their names as people expect it, north 2 before north 10, to list them."""
    words = re.compile(r"(\D*)(\d*)").findall
    return sorted(
        things, key=lambda thing: [(word, int(digits or 0)) for word, digits in words(name(thing).casefold())]
    )


def quoted_line(text: str, error: str) -> str:
    """Return the line of a TOML text that a parser's error names, with a hint if the mistake is a frequent one."""
    match = re.search(r"at line (\d+)", error)
    lines = text.split("\n")
    if not match or int(match[1]) > len(lines):
        return "; correct the file"
    line = lines[int(match[1]) - 1].strip()
    quoted = f": {line[:LONGEST_QUOTED]}{'...' if len(line) > LONGEST_QUOTED else ''}"
    bare = re.fullmatch(r"([\w.-]+)\s*=\s*([A-Za-z][^\"'#\[\]{}]*?)\s*", line)
    if bare and bare[2].lower() in ("true", "false"):
        return f"{quoted}; write {bare[1]} = {bare[2].lower()}"
    if bare:
        return f'{quoted}; text needs quotes: {bare[1]} = "{bare[2]}"'
    if re.search(r'"[^"]*\\', line):
        return f"{quoted}; a backslash has a special meaning within double quotes: use forward slashes or single quotes"
    return f"{quoted}; correct the file there"


def is_one_line(text: str) -> bool:
    """Return whether a text contains neither line breaks nor other control characters, nor what XML cannot contain."""
    return text.isprintable() or not any(
        unicodedata.category(sign) in _CONTROL or sign in "\ufffe\uffff" for sign in text
    )


def escaped(text: str) -> str:
    """Return a text in which line breaks and control characters are escaped as in Python."""
    return text if is_one_line(text) else "".join(sign if is_one_line(sign) else repr(sign)[1:-1] for sign in text)


def text_of(item: object) -> str:
    """Return the text of an error or a path in one line of at most `LONGEST` characters and an ellipsis."""
    try:
        text = " ".join(str(item).split()).encode("utf-8", "backslashreplace").decode()
    except Exception:
        text = "(its text cannot be shown)"
    return text if len(text) <= LONGEST else f"{text[:LONGEST]} ..."


def usable_path(given: str | Path, kind: type[EvacError]) -> Path:
    """Return a path from outside, whose file need not exist; an error of a class if a question about it raises."""
    if not isinstance(given, str | os.PathLike):
        raise kind(f"{text_of(repr(given))} is of type {type(given).__name__}; give a path")
    path = Path(given)
    try:
        str(path.absolute()).encode()
        path.stat()
    except (FileNotFoundError, NotADirectoryError, PermissionError):
        pass
    except UnicodeEncodeError:
        raise kind(f"{text_of(escaped(str(path.absolute())))}: not in UTF-8; rename the file or folder") from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise kind(f"{text_of(escaped(str(path)))}: {reason}; check the path") from None
    return path


def check_regular(path: Path) -> None:
    """Raise an OSError for a pipe or a device, whose reading might not end."""
    if not stat.S_ISREG(path.stat().st_mode):
        raise OSError(errno.EINVAL, "not a file")


def in_one_line(error: BaseException) -> str:
    """Return class and text of an error in one line, shortened as by `text_of`."""
    text = text_of(error)
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


def place_of(source: Any, attribute: str = "") -> str:
    """Return file and line of an exception, of code, of the class of an object, or of an attribute in its body."""
    file, line = (
        _place_of_error(source) if isinstance(source, BaseException) else _place_of_code(_code_of(source), attribute)
    )
    return f"{file}, line {line}" if file else "no file"


def _place_of_error(error: BaseException, file: str = "") -> tuple[str, int]:
    """Return the place of an exception, in a certain file if it passed through that."""
    if isinstance(error, SyntaxError) and error.filename:
        return error.filename, error.lineno or 1
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if not frame.filename.startswith("<")]
    inside = [frame for frame in frames if file and frame.filename == file]
    outside = [frame for frame in frames if not _is_own(frame.filename)]
    return next(((frame.filename, frame.lineno or 1) for frame in reversed(inside or outside or frames)), ("", 0))


def _place_of_code(source: Any, attribute: str = "") -> tuple[str, int]:
    """Return the place of a function, a kernel, a module or a class, or of an attribute that is set in its body."""
    source = inspect.unwrap(source) if callable(source) else source
    with suppress(OSError, TypeError):
        lines, first = inspect.getsourcelines(source)
        wanted = re.compile(rf"\s*(def {attribute}\(|{attribute}\b[^=(]*=)")
        stated = (k for k, line in enumerate(lines) if attribute and wanted.match(line))
        return inspect.getsourcefile(source) or "", max(first, 1) + next(stated, 0)  # a module starts at line 0
    module = source if inspect.ismodule(source) else sys.modules.get(getattr(source, "__module__", ""))
    return getattr(module, "__file__", None) or "", 1


def _is_own(file: str) -> bool:
    """Return whether a file belongs to evac or to its own plugins."""
    own = (getattr(sys.modules.get(name), "__file__", None) for name in ("evac", "evac_plugins"))
    return any(origin and Path(origin).parent in Path(file).parents for origin in own)


def is_foreign(plugin: Any) -> bool:
    """Return whether a plugin, given as a class or an object of the class, is not part of evac."""
    return not _is_own(getattr(sys.modules.get(_code_of(plugin).__module__), "__file__", None) or "")


def fault(what: str, wrong: str, remedy: str, source: Any, attribute: str = "") -> PluginError:
    """Return the error for a mistake in a plugin, with its file and line, and the advice to check the file."""
    file, line = source if isinstance(source, tuple) else _place_of_code(_code_of(source), attribute)
    what = what.replace(file, Path(file).name) if file else what  # the path follows
    error = PluginError(f"{what}: {wrong} ({file}, line {line}); {remedy}" if file else f"{what}: {wrong}; {remedy}")
    error.file = "" if _is_own(file) else file
    return error


def _code_of(plugin: Any) -> Any:
    """Return the class of an object of a plugin class, and other code itself."""
    is_code = isinstance(plugin, type) or inspect.ismodule(plugin) or hasattr(plugin, "__wrapped__")
    return plugin if is_code or inspect.isroutine(plugin) else type(plugin)


class plugin_code:  # noqa: N801
    """Run code of a plugin; an exception that is not an EvacError becomes a PluginError with plugin, file and line.

    This includes SystemExit, but not KeyboardInterrupt, which comes from the user. Standard streams that the plugin has
    replaced are restored, which is an error too; other threads than the main one do not check this. `read_only` is the
    remedy if the plugin has written to a read-only array. Unlike a generator, it costs little at each tick.
    """

    __slots__ = ("_plugin", "_read_only", "_streams", "_what")

    def __init__(self, what: str, plugin: Any, read_only: str = "") -> None:
        self._what, self._plugin, self._read_only = what, plugin, read_only

    def __enter__(self) -> None:
        self._streams = sys.stdout, sys.stderr

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, _: object) -> None:
        is_replaced, plugin = False, self._plugin
        if sys.stdout is not self._streams[0] or sys.stderr is not self._streams[1]:
            is_replaced = threading.current_thread() is threading.main_thread()
        if is_replaced:
            sys.stdout, sys.stderr = self._streams
        if error is None and is_replaced:
            own = (str(plugin), 1) if isinstance(plugin, Path) else plugin
            remedy = "restore it, as contextlib.redirect_stdout does"
            raise fault(self._what, "replaces sys.stdout or sys.stderr", remedy, own)
        if error is None or isinstance(error, EvacError | KeyboardInterrupt | GeneratorExit):
            return
        text = f"SyntaxError: {error.msg}" if isinstance(error, SyntaxError) else in_one_line(error)
        advice = "let the plugin raise an exception instead" if isinstance(error, SystemExit) else "correct the plugin"
        remedy = f"{advice}, or remove it"
        trace = traceback.extract_tb(error.__traceback__)
        if trace and _is_own(trace[-1].filename) and "; " in text:  # evac has raised it, and states the remedy
            text, _, remedy = text.rpartition("; ")
        if self._read_only and isinstance(error, ValueError) and "read-only" in text:
            remedy = self._read_only
        own = (str(plugin), 1) if isinstance(plugin, Path) else _place_of_code(_code_of(plugin))
        place = _place_of_error(error, own[0])
        raise fault(self._what, text, remedy, own if _is_own(place[0]) else place) from error


@contextmanager
def noting(lines: Iterable[str]) -> Iterator[None]:
    """Add warnings that may explain an error raised within to it, as notes."""
    try:
        yield
    except EvacError as error:
        for line in lines:
            error.add_note(f"warning: {line}")
        raise


def warn(lines: Iterable[str], stacklevel: int = 3) -> None:
    """Issue each line as a `RunWarning`, by default about the line that called the function which calls this one."""
    for line in lines:
        warnings.warn(line, RunWarning, stacklevel=stacklevel)


@contextmanager
def naming(source: object) -> Iterator[None]:
    """Put the name of a file before a ScenarioError that does not name it yet."""
    try:
        yield
    except ScenarioError as error:
        if str(source) in str(error):
            raise
        raise ScenarioError(f"{source}: {error}") from error
