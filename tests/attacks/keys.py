"""Attacks on single keys: every key of the schema and of the plugins, with values that nobody expects."""

import random
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import get_args, get_origin

from evac.base.keys import Table, table_of
from evac.case.case import Case as EvacCase
from evac.contract.registry import Registry
from tests.attacks.commands import MODELS, call, write_case


@dataclass(frozen=True)
class Case:
    """One key with one value, as ``--set`` takes it."""

    key: str
    value: str
    model: str = "nsm2"

    def __str__(self) -> str:
        value = self.value if len(self.value) <= 60 else f"{self.value[:57]}... ({len(self.value)} characters)"
        return f"{self.key}={value} ({self.model})"


NUMBERS = (
    *("0", "1", "-1", "2", "3", "7", "100", "1000", "65536", "2147483647", "2147483648", "4294967296"),
    *("9223372036854775807", "-9223372036854775808", "9223372036854775808", "1" + "0" * 400, "-1" + "0" * 400),
    *("-0.0", "0.1", "0.5", "0.001", "1e-6", "1e-9", "1e-12", "1e-100", "1e-300", "5e-324", "2.5", "9.9", "10.0"),
    *("1e3", "1e6", "1e9", "1e12", "1e15", "1e16", "1e100", "1e154", "1e300", "1.7976931348623157e308", "-1e300"),
    *("inf", "-inf", "nan", "0.30000000000000004", "0x7fffffff"),
)
WORDS = (
    *(
        '""',
        '"x"',
        '" "',
        '"."',
        '".."',
        '"/"',
        '"../.."',
        '"/dev/zero"',
        '"/dev/null"',
        '"/proc/self/mem"',
        '"case.toml"',
    ),
    *(r'"\u0000"', r'"a\u0000b"', r'"\n"', r'"\u001b[31m"', '"[red]x[/red]"', '"%s%n"', '"{0}"', '"é"', '"\U0001f6b6"'),
    *('"' + "x" * 199 + '"', '"' + "x" * 5000 + '"', '"' + "x/" * 1500 + '"', '"true"', '"1"', '"nan"', "'it''s'"),
    *('"room"', '"door"', '"drawn"', '"dem"', '"fastest"', '"floor z=0.00"'),
)
OTHERS = (
    *(
        "true",
        "false",
        "[]",
        "{}",
        "[[]]",
        "[{}]",
        "[0]",
        "[0, 0]",
        "[[0, 0]]",
        "[[0, 0], [0, 0]]",
        "[nan, inf]",
        '["x"]',
    ),
    *("[[1e300, 1e300], [-1e300, 1e300], [0, 0]]", "[[nan, 0], [1, 1]]", "[[1, 2], [3]]", "[[0,0],[1,0],[0,1],[1,1]]"),
    *("[[5e-324, 0], [0, 5e-324], [0, 0]]", "[[1, 1], [2, 1], [2, 2]]", "{ x = 1 }", '{ "" = 1 }', "{ a.b.c = 1 }"),
    *(
        "1979-05-27T07:32:00Z",
        "1979-05-27",
        "07:32:00",
        "[" * 15 + "]" * 15,
        "[" * 100 + "]" * 100,
        "[" * 5000 + "]" * 5000,
    ),
    *("{ a = " * 60 + "1" + " }" * 60, "[" + "0.5, " * 100_000 + "]", "[" + "[0.0, 0.0], " * 20_000 + "]"),
    "{ " + ", ".join(f"k{k} = {k}" for k in range(20_000)) + " }",
)
DISTRIBUTIONS = (
    *(
        "{ uniform = [0, 1] }",
        "{ uniform = [1, 0] }",
        "{ uniform = [-1e300, 1e300] }",
        "{ uniform = [5e-324, 1e-323] }",
    ),
    *(
        "{ normal = [0, 1e300] }",
        "{ normal = [1e300, 5e-324] }",
        "{ normal = [1, 1], minimum = 0.1 }",
        "{ normal = [1] }",
    ),
    *("{ lognormal = [1000, 1] }", "{ lognormal = [0, 40] }", "{ lognormal = [0, 1] }", "{ lognormal = [-800, 1e-9] }"),
    *(
        "{ weibull = [1e-9, 1] }",
        "{ weibull = [1e300, 1] }",
        "{ weibull = [1, 1e300] }",
        "{ weibull = [0.01, 1e-300] }",
    ),
    *("{ gamma = [1e300, 1e300] }", "{ gamma = [1e-300, 1e-300] }", "{ gamma = [2, 3], maximum = 1e-9 }"),
    *("{ constant = nan }", "{ constant = 1e300 }", "{ constant = [1] }", "{ list = [] }", "{ list = [1, 2] }"),
    *(
        "{ list = [1, 2, 3, 4, 5], minimum = 2 }",
        "{ factor = 2 }",
        "{ factor = { constant = 1e300 } }",
        "{ factor = {} }",
    ),
    *("{ minimum = 1, maximum = 0 }", "{ uniform = [0, 1], minimum = 0.999999999 }", "{ factor = { factor = 1 } }"),
)
VALUES = NUMBERS + WORDS + OTHERS + DISTRIBUTIONS

#: What once went wrong.
CRASHERS: tuple[Case, ...] = (
    Case("people.put.name", "[]"),
    Case("people.put.name", "[[0, 0], [0, 0]]"),
    Case("directions.clearance", "1e12"),
    Case("directions.clearance", "100"),
    Case("directions.spacing", "5e-324"),
    Case("simulation.step", "5e-324"),
    Case("people.drawn.number", "1000000"),
    Case("people.drawn.mass", "1" + "0" * 400),
    Case("contact.dem.stiffness", "1" + "0" * 400, "dem"),
    Case("behaviours.route_choice.exits", "[" + "0.5, " * 100_000 + "]"),
    Case("behaviours.walking.chest_depth", "1e-6", "dem"),
)


def cases(number: int, seed: int) -> Iterator[Case]:
    """Yield the crashers, then cases that the seed determines."""
    yield from CRASHERS
    generator = random.Random(seed)
    for _ in range(number):
        yield Case(generator.choice(known_keys()), generator.choice(VALUES), generator.choice(MODELS))


@cache
def known_keys() -> tuple[str, ...]:
    """Return every key that a case can have, those of plugins included, and some that it cannot."""
    registry, found = Registry(), list(_keys_of(EvacCase, ""))
    kinds = ("contact_model", "force", "behaviour", "recorder", "importer")
    for kind, table in zip(kinds, ("contact", "forces", "behaviours", "recorders", "importers"), strict=True):
        for name, cls in registry._tables[kind].items():
            found += [f"{table}.{name}", *(f"{table}.{name}.{key}" for key in cls.declared())]
            found += [f"people.drawn.behaviours.{name}.{key}" for key in getattr(cls, "group_keys", ())]
    return (*found, "contact.nowhere", "people.nobody.name", "people.7", "building.exits.door.nothing", "nothing")


def _keys_of(table: type[Table], before: str) -> Iterator[str]:
    """Yield the keys of a table, those of its first item where it is a list."""
    items = {"people": ("drawn", "put"), "presets": ("slow",)}
    for name, field in table.model_fields.items():
        yield before + name
        inner = table_of(field.annotation)
        if inner is None:
            continue
        is_table = get_origin(field.annotation) is dict
        is_list = not is_table and any(
            get_origin(part) is tuple for part in (field.annotation, *get_args(field.annotation))
        )
        for item in items.get(name, ("0",)) if is_table or is_list else ("",):
            yield from _keys_of(inner, f"{before}{name}.{item}." if item else f"{before}{name}.")


def run(case: Case, folder: Path) -> str:
    """Run a small case with one key changed: it runs, or is refused with a message that names the key."""
    path = write_case(folder, case.model)
    status, said = call(["run", str(path), "--out", str(folder / "result"), "--set", f"{case.key}={case.value}"])
    if status != 2:
        return "ran"
    words = [word for word in case.key.split(".") if not word.isdigit()][-2:]
    words += ["forces"] * case.key.startswith("forces.")  # a step that fails names them together
    # What a preset or another name spoils is wrong with a group; a file that cannot be used is named itself.
    words += ["people"] * (case.key.startswith(("presets", "people.")) or case.key.endswith(".name")) + [
        case.value.strip('"')
    ] * case.key.startswith("building.mesh")
    assert any(word in said for word in words), said[-2000:]
    return "refused"
