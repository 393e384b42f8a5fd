"""Errors for kernels that cannot be compiled: one line each, with the reason that numba states and its place."""

import dis
import os
import re

from evac.base.errors import PluginError, fault
from evac.jit.digest import kernels_in
from evac.jit.kernels import Entry

#: Beginnings of lines of numba's messages that name no reason.
_FRAMES = ("Failed in ", "During: ", "File ")

#: Beginning of the reason if a kernel returns values of different types; numba names one of the lines by chance.
UNLIKE = "Can't unify return type"

#: Remedies for frequent reasons, by their beginnings, and for others.
_REMEDIES = {
    "Unsupported constraint encountered: raise": "kernels raise no exceptions, return a number instead",
    "Untyped global name": "decorate the functions that it calls with evac.jit.inner, and use numbers as constants",
    "NameError": "correct the name",
    UNLIKE: "return the same numbers in every case",
    "": "use only numbers, tuples, structs, arrays and math, see docs/plugins_contact.md, section 'Kernels'",
}


def refused(entry: Entry, error: Exception) -> PluginError:
    """Return the error for a kernel that numba cannot compile, with the line of the kernel if it is known."""
    lines = [line.strip() for line in re.sub(r"\x1b\[\d*m", "", str(error)).splitlines()]
    reasons = [line for line in lines if line and not line.startswith(_FRAMES)]
    reason = " ".join(reasons[: 2 if reasons and reasons[0].endswith(":") else 1]) or type(error).__name__
    remedy = next(remedy for start, remedy in _REMEDIES.items() if reason.startswith(start))
    return fault(f"kernel {entry.title}", f"cannot be compiled: {reason}", remedy, _place(entry, lines, reason))


def _place(entry: Entry, lines: list[str], reason: str) -> tuple[str, int]:
    """Return file and line of the mistake: as stated by numba, or where the word that it names is used."""
    own = {kernel.function.__code__.co_filename for kernel in kernels_in(entry)}
    for line in lines if not reason.startswith(UNLIKE) else ():
        match = re.match(r'File "(.+)", line (\d+)', line)
        if match and (file := os.path.realpath(match[1])) in own:  # numba states paths relative to the current folder
            return file, int(match[2])
    code = entry.function.__code__
    word = re.search(r"name '(\w+)'|<built-in function (\w+)>", reason)
    uses = (use for use in dis.get_instructions(code) if word and use.argval in (word[1], word[2]))
    place = next((use.positions.lineno for use in uses if use.positions and use.positions.lineno), None)
    return code.co_filename, place or code.co_firstlineno
