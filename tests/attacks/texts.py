"""Attacks on the text of a case.toml: encodings, damage, sizes."""

import random
from collections.abc import Callable
from pathlib import Path

from tests.attacks.commands import CASE, call, write_case
from tests.attacks.seeded import Case, in_turn

TEXT = CASE.replace("MODEL", "nsm2")


def run(case: Case, folder: Path) -> str:
    """Run a small case with another text: it runs, or is refused with a message that names the file."""
    path = write_case(folder)
    path.write_bytes(CHANGES[case.kind](random.Random(f"{case}")))
    status, said = call(["run", str(path), "--out", str(folder / "result")])
    assert status != 2 or "case.toml" in said or "room.obj" in said, said[-2000:]
    return "refused" if status == 2 else "ran"


def _encoded(encoding: str, mark: bytes = b"") -> Callable[[random.Random], bytes]:
    return lambda generator: mark + TEXT.replace("Everything", "Prüfung").encode(encoding)


def _bits(generator: random.Random) -> bytes:
    content = bytearray(TEXT.encode())
    for _ in range(generator.choice((1, 1, 2, 8, 100))):
        content[generator.randrange(len(content))] ^= 1 << generator.randrange(8)
    return bytes(content)


def _cut(generator: random.Random) -> bytes:
    return TEXT.encode()[: generator.randrange(len(TEXT))]


def _inserted(generator: random.Random) -> bytes:
    odd = (
        b"\0",
        b"\x07",
        b"\xff",
        b"\xc3",
        b"\xed\xa0\x80",
        b"\r",
        b'"""',
        b"'''",
        b"#",
        b"[",
        b"]]",
        b"=",
        b"\xe2\x80\xa8",
    )
    at = generator.randrange(len(TEXT))
    return TEXT[:at].encode() + generator.choice(odd) * generator.choice((1, 1, 3, 1000)) + TEXT[at:].encode()


def _lines(generator: random.Random) -> bytes:
    """Leave out, repeat or exchange lines."""
    lines = TEXT.splitlines()
    for _ in range(generator.choice((1, 1, 2, 5))):
        i, j = generator.randrange(len(lines)), generator.randrange(len(lines))
        what = generator.randrange(3)
        if what == 0:
            del lines[i]
        elif what == 1:
            lines.insert(j, lines[i])
        else:
            lines[i], lines[j] = lines[j], lines[i]
    return "\n".join(lines).encode()


def _garbage(generator: random.Random) -> bytes:
    return generator.randbytes(generator.choice((0, 1, 2, 10, 1000, 10**5)))


def _names(generator: random.Random) -> bytes:
    """Put a name that is long or odd in the place of another one."""
    name = generator.choice(
        ("x" * 200, "x" * 5000, " ", "a.b", "0", "-1", "é" * 150, "'", "\\t", "\\u0000", "\\U0001F6B6", "nan")
    )
    old = generator.choice(('"door"', '"room"', '"drawn"', '"put"', '"table"', '"slow"', '"Everything"'))
    return TEXT.replace(old, f'"{name}"').encode()


def _number(generator: random.Random) -> bytes:
    """Put a number beyond all in the place of one."""
    numbers = (
        "9" * 400,
        "9" * 5000,
        "1e400",
        "-1e400",
        "1e-400",
        "0x" + "f" * 300,
        "1_000",
        "1__0",
        "+inf",
        "1.",
        ".5",
        "0o17",
    )
    old = generator.choice(("0.1\n", "5\n", "0.3\n", "1.5]", "2.5]", "0.0\n", "= 1\n"))
    return TEXT.replace(old, f"{generator.choice(numbers)}{old[-1]}", 1).encode()


def _repeated(what: Callable[[int], str], number: int) -> Callable[[random.Random], bytes]:
    return lambda generator: (TEXT + "\n" + "".join(what(k) for k in range(number))).encode()


def _nested(generator: random.Random) -> bytes:
    depth = generator.choice((30, 200, 900, 5000, 10**5))
    return f"x = {'[' * depth}{']' * depth}\n{TEXT}".encode()


def _nested_tables(generator: random.Random) -> bytes:
    depth = generator.choice((30, 200, 900, 5000))
    return f"x = {'{ a = ' * depth}1{' }' * depth}\n{TEXT}".encode()


def _dotted(generator: random.Random) -> bytes:
    return f"{'.'.join('a' * generator.choice((30, 900, 5000)))} = 1\n{TEXT}".encode()


def _long_line(generator: random.Random) -> bytes:
    return TEXT.replace("Everything", "x" * generator.choice((4_000, 4_001, 10**6))).encode()


CHANGES: dict[str, Callable[[random.Random], bytes]] = {
    "byte order mark": _encoded("utf-8-sig"),
    "utf-16": _encoded("utf-16"),
    "utf-16 without mark": _encoded("utf-16-le"),
    "utf-16 big": _encoded("utf-16-be", b"\xfe\xff"),
    "utf-32": _encoded("utf-32"),
    "latin-1": _encoded("latin-1"),
    "utf-7": _encoded("utf-7"),
    "ebcdic": _encoded("cp500"),
    "two marks": _encoded("utf-8-sig", b"\xef\xbb\xbf"),
    "carriage returns": lambda generator: TEXT.replace("\n", generator.choice(("\r", "\r\n", "\n\r"))).encode(),
    "bits": _bits,
    "cut": _cut,
    "inserted": _inserted,
    "lines": _lines,
    "garbage": _garbage,
    "names": _names,
    "number": _number,
    "nested deeply": _nested,
    "tables nested deeply": _nested_tables,
    "dotted deeply": _dotted,
    "long word": _long_line,
    "many unknown keys": _repeated(lambda k: f"unknown{k} = {k}\n", 100_000),
    "many unknown tables": _repeated(lambda k: f"[unknown{k}]\n", 20_000),
    "many groups": _repeated(lambda k: f'[[people]]\nname = "g{k}"\nnumber = 1\narea = "room"\n', 2_000),
    "many bad groups": _repeated(lambda k: f"[[people]]\nname = {k}\n", 50_000),
    "many groups of one name": _repeated(lambda k: '[[people]]\nname = "g"\nnumber = 1\narea = "room"\n', 20_000),
    "many exits": _repeated(lambda k: f'[[building.exits]]\nname = "e{k}"\nsegment = [[0, 1], [0, 2]]\nz = 0\n', 3_000),
    "many presets": _repeated(lambda k: f"[presets.p{k}]\nspeed = 1.0\n", 9_000),
    "comment": lambda generator: (TEXT + "# " + "x" * generator.choice((100, 10**6, 9 * 10**6))).encode(),
}


#: Cases of a number and a seed.
cases = in_turn(CHANGES, (Case("nested deeply", 0), Case("dotted deeply", 0), Case("many unknown keys", 0)))
