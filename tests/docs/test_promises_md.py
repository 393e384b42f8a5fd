"""Every guarantee is held by tests that are there."""

import ast
import re


def test_every_guarantee_is_held_by_tests_that_are_there(root):
    page, table = ((root / room / "promises.md").read_text(encoding="utf-8") for room in ("docs", "tests"))
    guarantees = re.findall(r"^- \*\*(\w+)\*\* ", page, re.MULTILINE)
    rows = re.findall(r"^\| ([A-Z]\d+) \| (.+) \|$", table, re.MULTILINE)
    assert guarantees == [name for name, _ in rows]
    assert len(rows) == len(set(guarantees)) > 60
    known = {}
    for name, tests in rows:
        named = re.findall(r"`(tests/[\w/]+\.py)::(\w+)`", tests)
        assert len(named) == tests.count("`") / 2 > 0, name
        for file, test in named:
            if file not in known:
                tree = ast.parse((root / file).read_text(encoding="utf-8"))
                known[file] = {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
            assert test in known[file], f"{file}::{test}"
