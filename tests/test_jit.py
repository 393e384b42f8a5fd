"""Compilation: what kernels are built from."""

import importlib
import shutil
from pathlib import Path

import pytest

from evac import jit
from evac.jit import fused, kernel


@kernel
def fused_from_outside(a, b, c):
    return fused(a, b, c)


def test_a_fused_product_is_rounded_once():
    # 1 - 2^-60 has no double of its own: a product rounded by itself is 1, and the sum zero.
    assert fused_from_outside(1.0 + 2.0**-30, 1.0 - 2.0**-30, -1.0) == -(2.0**-60)
    assert fused_from_outside(3.0, 4.0, 5.0) == 17.0


@pytest.mark.parametrize(
    ("source", "compiled"),
    [
        ("jit.py", True),
        ("lanes.py", True),
        ("physics/momentum.py", True),
        ("physics/bundles.py", True),
        ("physics/rows.py", True),
        ("directions/descent.py", True),  # holds a bundle
        ("physics/overlaps.py", False),
        ("building/checks.py", False),
        ("directions/build.py", False),
    ],
)
def test_kernels_are_compiled_anew_where_what_they_are_built_from_changes(source, compiled, monkeypatch, tmp_path):
    core = tmp_path / "evac"
    shutil.copytree(Path(jit.__file__).parent, core, ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(jit, "_CORE", core)
    digests = []
    for text in ("", "\n# another source"):
        with (core / source).open("a") as file:
            file.write(text)
        monkeypatch.setattr(jit, "_digests", {})
        monkeypatch.setattr(jit, "_imported", {})
        digests.append(jit._digest(core / "physics" / "momentum.py"))
    assert (digests[0] != digests[1]) == compiled


def test_modules_that_a_plugin_imports_from_its_own_folder_count(monkeypatch, tmp_path):
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "laws_of_mine.py").write_text("STIFFNESS = 1.0\n")
    plugin = tmp_path / "plugin_of_mine.py"
    plugin.write_text("import os\nimport numpy\nfrom laws_of_mine import STIFFNESS\nfrom . import relative\n")
    (tmp_path / "relative.py").write_text("")
    importlib.import_module("laws_of_mine")  # as it is when the plugin is loaded

    assert set(jit._imports(plugin)) == {tmp_path / "laws_of_mine.py", tmp_path / "relative.py"}
