"""Faults that nobody chose: mutants of the code, drawn by a seed over all rooms.

Operators are those of cosmic-ray that change arithmetic, comparisons, numbers and loops, and two more: a missing
statement, and a missing element of a tuple, list or call. Mutants that cannot be compiled are left out.
"""

import random
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.mutating import mutate_code
from cosmic_ray.operators.operator import Operator
from cosmic_ray.plugins import get_operator

from tests.faults import CHECKOUT

ARITHMETIC = ("Add_Sub", "Sub_Add", "Mul_Div", "Div_Mul", "Mod_Mul", "FloorDiv_Mul", "BitAnd_BitOr")
COMPARISONS = ("Eq_NotEq", "NotEq_Eq", "Lt_LtE", "Lt_Gt", "LtE_Lt", "LtE_GtE", "Gt_GtE", "Gt_Lt", "GtE_Gt", "GtE_LtE")
OTHERS = ("Is_IsNot", "IsNot_Is")
WORDS = (
    "ReplaceUnaryOperator_Delete_USub",
    "ReplaceUnaryOperator_Delete_Not",
    "ReplaceUnaryOperator_Delete_Invert",
    "AddNot",
    "ReplaceTrueWithFalse",
    "ReplaceFalseWithTrue",
    "ReplaceAndWithOr",
    "ReplaceOrWithAnd",
    "ReplaceBreakWithContinue",
    "ReplaceContinueWithBreak",
    "NumberReplacer",
    "ZeroIterationForLoop",
)
#: Statements whose absence is a mistake that someone could make.
STATEMENTS = ("expr_stmt", "atom_expr")


class MissingStatement(Operator):
    """An assignment or call, alone on its line, becomes ``pass``."""

    def mutation_positions(self, node: Any) -> Iterator[Any]:
        """Yield the place of a simple statement in a function."""
        if node.type == "simple_stmt" and node.children[0].type in STATEMENTS and _in_function(node):
            yield node.start_pos, node.end_pos

    def mutate(self, node: Any, index: int) -> Any:
        """Return the node with ``pass`` instead of the statement."""
        statement = get_ast("pass\n").children[0].children[0]
        statement.prefix = node.children[0].get_first_leaf().prefix
        node.children[0] = statement
        return node

    @classmethod
    def examples(cls) -> tuple[()]:
        """Return no examples."""
        return ()


class MissingElement(Operator):
    """The last of several elements of a tuple, list, set or call is missing."""

    def mutation_positions(self, node: Any) -> Iterator[Any]:
        """Yield the place of a list of elements."""
        is_list = node.type in ("testlist_comp", "arglist", "testlist_star_expr") and len(node.children) > 3
        if is_list and getattr(node.children[1], "value", "") == ",":
            yield node.start_pos, node.end_pos

    def mutate(self, node: Any, index: int) -> Any:
        """Return the node without its last element."""
        odd = len(node.children) % 2
        del node.children[-2 if odd else -3 :]
        return node

    @classmethod
    def examples(cls) -> tuple[()]:
        """Return no examples."""
        return ()


class Mutant(NamedTuple):
    """A fault at one place; `broken` is the whole content of `file` with it."""

    file: str
    line: int
    operator: str
    old: str
    new: str
    broken: str

    @property
    def name(self) -> str:
        """Its place and operator."""
        return f"{self.file}:{self.line} {self.operator}"

    def applied(self, sound: str) -> str:
        """Return the content of the file with the mistake."""
        return self.broken

    @property
    def tests(self) -> list[str]:
        """Tests of its room, those of its file first."""
        path = Path(self.file)
        if path.parts[0] == "plugins":
            files = sorted(CHECKOUT.glob(f"tests/plugins/test_{path.stem}*.py"))
            return [str(found.relative_to(CHECKOUT)) for found in files] or ["tests/plugins"]
        room = CHECKOUT / "tests" / (path.parts[1] if len(path.parts) > 2 else "test_api.py")
        own = sorted(room.rglob(f"test_{path.name}"))
        return [str(found.relative_to(CHECKOUT)) for found in [*own, room]]


def drawn(number: int, seed: int, rooms: list[str]) -> list[Mutant]:
    """Return different mutants, of files drawn in proportion to their lines; equivalent ones are not among them."""
    generator = random.Random(seed)
    paths = [path for path in _files() if not rooms or any(path.startswith(room) for room in rooms)]
    sources = {path: (CHECKOUT / path).read_text(encoding="utf-8") for path in paths}
    weights = [sources[path].count("\n") for path in paths]
    operators = {name: get_operator(f"core/{name}")() for name in _names()}
    operators |= {"MissingStatement": MissingStatement(), "MissingElement": MissingElement()}
    equivalent = read_equivalent()
    mutants: dict[tuple[str, str], Mutant] = {}
    known: dict[str, dict[str, list[tuple[int, int]]]] = {}
    while len(mutants) < number:
        path = generator.choices(paths, weights)[0]
        if path not in known:
            known[path] = _places(sources[path], operators)
        if not (places := known[path]):
            continue
        name = generator.choice(sorted(places))
        occurrence, line = generator.choice(places[name])
        broken = mutate_code(sources[path], operators[name], occurrence)
        if broken is None or not _compiles(broken) or (path, broken) in mutants:
            continue
        mutant = Mutant(path, line, name, *_difference(sources[path], broken), broken)
        if (mutant.file, mutant.old, mutant.new) not in equivalent:
            mutants[path, broken] = mutant
    return list(mutants.values())


def read_equivalent() -> dict[tuple[str, str, str], str]:
    """Return why mutants are set aside, by file, text and what replaces it."""
    with (Path(__file__).parent / "equivalent.toml").open("rb") as file:
        entries = tomllib.load(file)["mutant"]
    return {(entry["file"], entry["old"], entry["new"]): entry["reason"] for entry in entries}


def _names() -> list[str]:
    """Return the operators of cosmic-ray that are used."""
    binary = [f"ReplaceBinaryOperator_{name}" for name in ARITHMETIC]
    return [*binary, *(f"ReplaceComparisonOperator_{name}" for name in (*COMPARISONS, *OTHERS)), *WORDS]


def _files() -> list[str]:
    """Return all modules of the core and the plugins, without evidence."""
    paths = [*(CHECKOUT / "evac").rglob("*.py"), *(CHECKOUT / "plugins").glob("*.py")]
    names = sorted(path.relative_to(CHECKOUT).as_posix() for path in paths)
    return [name for name in names if not name.startswith("evac/evidence/")]


def _places(source: str, operators: dict[str, Operator]) -> dict[str, list[tuple[int, int]]]:
    """Return occurrence and line of all places of each operator in a source, outside annotations."""
    places: dict[str, list[tuple[int, int]]] = {}
    counts = dict.fromkeys(operators, 0)
    for node in ast_nodes(get_ast(source)):
        for name, operator in operators.items():
            for start, _ in operator.mutation_positions(node):
                if not _is_annotation(node):
                    places.setdefault(name, []).append((counts[name], start[0]))
                counts[name] += 1
    return places


def _is_annotation(node: Any) -> bool:
    """Return whether a node is in an annotation or a decorator, or parts the parameters of a function."""
    if node.type == "operator" and node.parent.type == "parameters":
        return True
    while node is not None:
        if node.type in ("annassign", "tfpdef", "decorator") or (node.type == "param" and node.annotation is not None):
            return True
        node = node.parent
    return False


def _in_function(node: Any) -> bool:
    """Return whether a node is in a function."""
    while node is not None and node.type != "funcdef":
        node = node.parent
    return node is not None


def _compiles(source: str) -> bool:
    """Return whether a source can be compiled."""
    try:
        compile(source, "mutant", "exec")
    except SyntaxError:
        return False
    return True


def _difference(sound: str, broken: str) -> tuple[str, str]:
    """Return the lines that differ, before and after."""
    before, after = sound.splitlines(), broken.splitlines()
    while before and after and before[0] == after[0]:
        del before[0], after[0]
    while before and after and before[-1] == after[-1]:
        del before[-1], after[-1]
    return "\n".join(before), "\n".join(after)
