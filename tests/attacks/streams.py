"""Attacks on streams and exit statuses: closed, full and small streams; plugins that raise what they must not.

`stream_cases` and `plugin_cases` yield cases, `run_stream` and `run_plugin` run one and raise AssertionError where it
does not do what is promised: the status is that of the undisturbed command, no traceback is shown, and a crash file is
where the message says that it is.
"""

import os
import random
import re
import subprocess
import sys
import textwrap
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

#: A room of which everybody is out soon, or nobody.
CASE = """\
title = "A {word} room"
[building]
mesh = "room.obj"
[[building.exits]]
name = "door"
segment = [[1.0, 0.0], [3.0, 0.0]]
level = "floor z=0.00"
[simulation]
duration = {duration}
[output]
picture = false
animation = false
[[people]]
name = "all"
positions = [[1.0, 2.5], [2.0, 2.0], [3.0, 2.5]]
level = "floor z=0.00"
[contact]
model = "{model}"
{tables}
"""

ROOM = "v 0 0 0\nv 4 0 0\nv 4 4 0\nv 0 4 0\nf 1 2 3 4\n"

#: What a run of the room writes.
FILES = ("egress.csv", "people.csv", "summary.json", "trajectory.evac")

SECONDS = 60.0


def write_case(
    folder: Path, *, word: str = "small", duration: float = 20.0, model: str = "nsm2", tables: str = ""
) -> Path:
    """Write a case of three people in a square room to a folder, and return its path."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "room.obj").write_text(ROOM)
    path = folder / "case.toml"
    path.write_text(CASE.format(word=word, duration=duration, model=model, tables=tables), encoding="utf-8")
    return path


def call(command: str, folder: Path, **variables: str) -> "subprocess.CompletedProcess[bytes]":
    """Call a command line of a shell in which $EVAC is evac."""
    environment = {key: value for key, value in os.environ.items() if not key.startswith(("LC_", "LANG", "PYTHONIO"))}
    environment |= {"EVAC": f"{sys.executable} -P -m evac", **variables}
    command = f"set -o pipefail; {command}"
    return subprocess.run(
        ["bash", "-c", command], cwd=folder, env=environment, capture_output=True, timeout=SECONDS, check=False
    )


# Streams


@dataclass(frozen=True)
class StreamCase:
    """A command with streams that cannot be used.

    Attributes
    ----------
    words : str
        Of the command.
    status : int
        That it has with streams as they should be.
    streams : str
        Redirections.
    variables : tuple of (str, str)
        Of the environment.
    """

    words: str
    status: int
    streams: str
    variables: tuple[tuple[str, str], ...] = ()

    def __str__(self) -> str:
        return " ".join([*(f"{name}={value}" for name, value in self.variables), self.words, self.streams])


STREAMS = (
    ">&-",
    "2>&-",
    ">&- 2>&-",
    "<&- >&- 2>&-",
    "> /dev/full",
    "2> /dev/full",
    "> /dev/full 2>&1",
    "| head -1",
    "| true",
    "2>&1 | true",
    "> /dev/full 2>&-",
)

ALPHABETS = (
    (("PYTHONIOENCODING", "ascii"),),
    (("LC_ALL", "C"), ("PYTHONUTF8", "0"), ("PYTHONCOERCECLOCALE", "0")),
    (("PYTHONIOENCODING", "cp437:strict"), ("TERM", "dumb")),
    (("FORCE_COLOR", "1"), ("COLUMNS", "1")),
    (("PYTHONUNBUFFERED", "1"),),
)

#: Commands on the cases that `run_stream` writes, and their statuses.
COMMANDS = (
    ("run out.toml --out r", 0),
    ("run stays.toml --out r", 3),
    ("run none.toml --out r", 2),
    ("check out.toml", 0),
    ("list", 0),
    ("plugins", 0),
    ("explain out.toml", 0),
    ("cache", 0),
    ("verify", 0),
    ("--help", 0),
    ("run --help", 0),
    ("fly", 2),
    ("repeat out.toml --runs 2 --jobs 1 --out r", 0),
)


def stream_cases(number: int | None = None, seed: int = 1) -> Iterator[StreamCase]:
    """Yield all cases, or `number` of them that the seed chooses."""
    cases = [StreamCase(words, status, streams) for words, status in COMMANDS for streams in STREAMS]
    cases += [StreamCase(words, status, "", names) for words, status in COMMANDS for names in ALPHABETS]
    cases += [StreamCase(words, status, "> /dev/full", names) for words, status in COMMANDS for names in ALPHABETS]
    yield from cases if number is None else random.Random(seed).sample(cases, number)


def run_stream(case: StreamCase, folder: Path) -> None:
    """Run one case in an empty folder."""
    write_case(folder, word="größer als 東京 😀").rename(folder / "out.toml")
    write_case(folder, duration=0.2).rename(folder / "stays.toml")
    done = call(f"$EVAC {case.words} {case.streams}", folder, **dict(case.variables))
    assert done.returncode == case.status, (case, done)
    _check_quiet(done.stdout + done.stderr)
    if case.words.startswith("run") and case.status in (0, 3) and "--help" not in case.words:
        missing = [name for name in FILES if not (folder / "r" / name).is_file()]
        assert not missing, (case, missing)
        _check_whole(folder / "r" / "trajectory.evac")
    assert b"details are in" not in done.stdout + done.stderr, case


def _check_quiet(said: bytes) -> None:
    for word in (b"Traceback", b"Exception ignored", b"BrokenPipe", b"Errno"):
        assert word not in said, said.decode(errors="replace")


def _check_whole(path: Path) -> None:
    """Look whether anything has been written into a trajectory by others."""
    from evac.trajectory.trajectory import read_trajectory

    assert not read_trajectory(path).warnings, path


# Plugins

RAISES = {
    "exit 0": ("raise SystemExit(0)", 2),
    "exit text": ("raise SystemExit('bye')", 2),
    "sys.exit": ("import sys; sys.exit()", 2),
    "exit()": ("exit()", 2),
    "bare": ("raise Odd", 2),
    "no text": ("raise Mute", 2),
    "lines": ("raise ValueError('one\\n\\ntwo\\n' * 9999)", 2),
    "memory": ("raise MemoryError", 2),
    "huge": ("__import__('numpy').empty(2**60)", 2),
    "recursion": ("deeper()", 2),
    "cancelled": ("raise __import__('asyncio').CancelledError", 2),
    "bytes": ("raise OSError(28, '\\udcff')", 2),
    "key": ("raise KeyError", 2),
    "assertion": ("raise AssertionError", 2),
    "stop": ("raise StopIteration", 2),
    "group": ("raise BaseExceptionGroup('g', [SystemExit(0)])", 2),
    "interrupt": ("raise KeyboardInterrupt", 130),
}

#: Of these an importer says that the file cannot be read, which is no fault of the plugin.
FILE_ERRORS = ("lines", "huge", "bytes")

#: Where a plugin raises; the tables of the case that call it there.
SITES = {
    "import": "",
    "evac_behaviours": "",
    "evac_configure": "",
    "evac_prepare": "",
    "evac_finish": "",
    "behaviour.__init__": "[behaviours.evil]",
    "behaviour.prepare": "[behaviours.evil]",
    "behaviour.act": "[behaviours.evil]",
    "behaviour.routes": "[behaviours.evil]",
    "behaviour.is_needed": "[behaviours.evil]",
    "behaviour.acts_at_ticks": "[behaviours.evil]",
    "behaviour.writes": "[behaviours.evil]",
    "behaviour.reads": "[behaviours.evil]",
    "recorder.__init__": "",
    "recorder.start": "",
    "recorder.record": "",
    "recorder.finish": "",
    "force.__init__": "[forces.evil]",
    "force.is_needed": "[forces.evil]",
    "force.cutoff": "[forces.evil]",
    "force.packed": "[forces.evil]",
    "contact.__init__": "",
    "contact.check_scene": "",
    "contact.promised_overlap": "",
    "contact.parts": "",
    "contact.step": "",
    "contact.traits": "",
    "importer.__init__": "",
    "importer.read": "",
}

PLUGIN = """\
import numpy as np
from evac.people.behaviour import Behaviour
from evac.building.importer import Importer
from evac.contract.hooks import hookimpl
from evac.jit import pair_force
from evac.trajectory.recorder import Recorder
from evac.physics.contact.model import ContactModel
from evac.physics.force import Force

evac_interface = 3
SITE = {site!r}


class Odd(BaseException):
    pass


class Mute(Exception):
    def __str__(self):
        raise ValueError


def deeper():
    deeper()


def reach(site):
    if site == SITE:
        {raises}


reach("import")


@hookimpl
def evac_behaviours():
    reach("evac_behaviours")
    return {classes}
"""

HOOK = """\


@hookimpl
def {hook}():
    reach("{hook}")
"""

CLASS = """\


class Evil(dict({bases})["{kind}"]):
    name = "evil"
{body}


@hookimpl
def evac_{plural}():
    return [Evil]
"""

BASES = "behaviour=Behaviour, recorder=Recorder, force=Force, contact=ContactModel, importer=Importer"
PLURALS = {
    "recorder": "recorders",
    "force": "forces",
    "contact": "contact_models",
    "importer": "importers",
    "behaviour": "behaviours",
}

#: What a class of each kind needs besides the method that raises.
NEEDED = {
    "behaviour": "def act(self, crowd, time):\n    pass\n",
    "recorder": "def record(self, simulation):\n    pass\n",
    "force": "def cutoff(self):\n    return 0.1\n\n"
    "@staticmethod\n@pair_force\ndef pair(gap, nx, ny, vx, vy, ex, ey, parameters):\n    return 0.0, 0.0\n",
    "contact": "def step(self, contacts, h):\n    return np.zeros(contacts.velocity.shape)\n",
    "importer": "suffixes = ('.obj',)\n\ndef read(self, path):\n    raise ValueError('nothing')\n",
}


@dataclass(frozen=True)
class PluginCase:
    """A plugin that raises `what` (a key of `RAISES`) at `site` (a key of `SITES`)."""

    site: str
    what: str

    def __str__(self) -> str:
        return f"{self.what} in {self.site}"


def plugin_cases(number: int | None = None, seed: int = 1) -> Iterator[PluginCase]:
    """Yield all cases, or `number` of them that the seed chooses."""
    cases = [PluginCase(site, what) for site in SITES for what in RAISES]
    yield from cases if number is None else random.Random(seed).sample(cases, number)


def plugin_text(case: PluginCase) -> str:
    """Return the file of the plugin."""
    kind, _, method = case.site.partition(".")
    text = PLUGIN.format(site=case.site, raises=RAISES[case.what][0], classes="[]")
    if not method:
        return text + (HOOK.format(hook=kind) if kind in ("evac_configure", "evac_prepare", "evac_finish") else "")
    body = NEEDED[kind]
    first = f'def {method}(self, *given, **named):\n    reach("{case.site}")\n'
    if method in ("writes", "reads"):
        first = f"@property\n{first}    return ()\n"
    elif method == "__init__":
        first += "    super().__init__(*given, **named)\n"
    else:
        first += "    return 0.1\n"
    text = text[: text.index("\n\n@hookimpl\ndef evac_behaviours")] if kind == "behaviour" else text
    body = textwrap.indent(f"{body}\n{first}", "    ")
    return text + CLASS.format(bases=BASES, kind=kind, body=body, plural=PLURALS[kind])


PLUGIN_COMMAND = "run case.toml --plugin evil.py --out r"


def write_plugin(case: PluginCase, folder: Path) -> None:
    """Write the plugin, and a case that uses it."""
    model = "evil" if case.site.startswith("contact") else "nsm2"
    write_case(folder, model=model, tables=SITES[case.site])
    (folder / "evil.py").write_text(plugin_text(case))


def run_plugin(case: PluginCase, folder: Path) -> None:
    """Run one case in an empty folder, in a process of its own."""
    write_plugin(case, folder)
    done = call(f"$EVAC {PLUGIN_COMMAND}", folder)
    check_plugin(case, folder, done.returncode, done.stderr.decode())


def check_plugin(case: PluginCase, folder: Path, status: int, said: str) -> None:
    """Check what a run with the plugin has come to."""
    assert status == RAISES[case.what][1], (case, status, said)
    _check_quiet(said.replace("[Errno", "").encode(errors="replace"))
    lines = [line for line in said.splitlines() if line.startswith("evac: ")]
    assert len(lines) == 1, (case, said)
    assert len(said) < 4000, (case, len(said))
    if case.site == "importer.read" and case.what in FILE_ERRORS:
        assert "room.obj" in lines[0], (case, said)
    elif status == 2:
        assert "evil" in lines[0], (case, said)
        (crash,) = re.findall(r"details are in (\S+\.txt)", said)
        report = Path(crash).read_text(encoding="utf-8")
        assert "evil.py" in report, (case, report)
