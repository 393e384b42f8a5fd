"""Digests: what a kernel is compiled from changes them, and nothing else does."""

import importlib.util
import os
import subprocess
import sys
import textwrap
from types import ModuleType

import pytest

from evac.jit import store
from evac.jit.store import digest_of

SOURCE = '''
    """A module of kernels."""

    import math

    import numpy as np

    from evac.jit import AddressCall, Floats, Struct, inner, kernel, pair_force

    LIMIT = 2.5
    UNUSED = 1
    TABLE = np.arange(2000.0)


    class Deep(Struct):
        """A struct within one."""

        size: int


    class Own(Struct):
        """What the kernel reads."""

        weight: float
        deep: Deep


    call_part = AddressCall([Own, float], (float,))


    def plain(x):
        return x + 1.0


    @inner
    def lower(x, power=2):
        """Documentation."""
        return x**power


    @inner
    def middle(x):
        return lower(x) + LIMIT


    @kernel
    def entry(own: Own, values: Floats, address: int) -> float:
        """Documentation."""
        total = own.weight * own.deep.size
        for i in range(len(values)):
            total += middle(values[i])  # a comment
        return call_part(address, own, total) + math.sin(total)


    @kernel
    def other(x: float) -> float:
        return 3.0 * x


    def made(factor):
        @pair_force
        def force(gap, nx, ny, vx, vy, ex, ey, parameters):
            return factor * nx, factor * ny

        return force


    push = made(4.0)
'''


@pytest.fixture
def module_of(tmp_path, monkeypatch):
    """Import a text as a module of the same name, afresh."""
    path = tmp_path / "kernels_of_a_test.py"

    def load(text=SOURCE):
        path.write_text(textwrap.dedent(text), encoding="utf-8")
        spec = importlib.util.spec_from_file_location("kernels_of_a_test", path)
        module = importlib.util.module_from_spec(spec)
        monkeypatch.setitem(sys.modules, "kernels_of_a_test", module)
        exec(compile(path.read_text(encoding="utf-8"), path, "exec"), module.__dict__)
        return module

    return load


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("LIMIT = 2.5", "LIMIT = 2.6"),
        ("return x**power", "return power**x"),
        ("power=2", "power=3"),
        ("lower(x) + LIMIT", "lower(x) - LIMIT"),
        ("total += middle", "total -= middle"),
        ("own.weight * own", "own.weight + own"),
        ("math.sin(total)", "math.cos(total)"),
        ("weight: float", "weight: int"),
        ("weight: float", "more: float\n        weight: float"),
        ("size: int", "size: float"),
        ("values: Floats", "values: Floats, more: int"),
        ("call_part = AddressCall([Own, float], (float,))", "call_part = AddressCall([Own, float], (int,))"),
        ("Own, float], (float", "Own, int], (float"),
    ],
)
def test_what_a_kernel_is_compiled_from_changes_its_digest(module_of, old, new):
    assert SOURCE.count(old) >= 1
    before, changed = module_of(), module_of(SOURCE.replace(old, new))
    assert digest_of(before.entry, "cpu") != digest_of(changed.entry, "cpu")
    assert digest_of(before.other, "cpu") == digest_of(changed.other, "cpu")


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("# a comment", "# another comment"),
        ('"""Documentation."""', '"""Another text,\n\n    of several lines.\n    """'),
        ('"""What the kernel reads."""', '"""What it reads."""'),
        ("UNUSED = 1", "UNUSED = 2"),
        ("3.0 * x", "4.0 * x"),
        ("return x + 1.0", "return x + 2.0"),
        ("import math", "import math\n\n\n"),
        ("made(4.0)", "made(5.0)"),
    ],
)
def test_what_it_is_not_compiled_from_does_not(module_of, old, new):
    assert SOURCE.count(old) >= 1
    assert digest_of(module_of().entry, "cpu") == digest_of(module_of(SOURCE.replace(old, new)).entry, "cpu")


HELPERS = '''
    import numba
    import numpy as np
    from evac.jit import kernel

    STEP = 1.0
    TABLE = np.zeros(2000)
    TABLE[1000] = 1.0


    @numba.njit(fastmath=False)
    def deeper(x):
        """Documentation."""
        return x + STEP


    @numba.njit
    def helper(x):
        found = [deeper(x) * k for k in range(3)]
        return found[1] + TABLE[1000]


    @kernel
    def entry(x: float) -> float:
        return helper(x)
'''


@pytest.mark.parametrize(
    ("old", "new", "is_other"),
    [
        ("x + STEP", "x - STEP", True),
        ("STEP = 1.0", "STEP = 2.0", True),
        ("fastmath=False", "fastmath=True", True),
        ("deeper(x) * k", "deeper(x) + k", True),
        ("found[1]", "found[2]", True),
        ("TABLE[1000] = 1.0", "TABLE[1000] = 2.0", True),
        ('"""Documentation."""', '"""Others."""', False),
    ],
)
def test_functions_of_numba_count_with_all_that_they_name(module_of, old, new, is_other):
    assert HELPERS.count(old) >= 1
    digests = [digest_of(module_of(text).entry, "cpu") for text in (HELPERS, HELPERS.replace(old, new))]
    assert (digests[0] != digests[1]) == is_other


def test_processor_and_versions_count(module_of, monkeypatch):
    entry = module_of().entry
    found = digest_of(entry, "cpu")
    assert digest_of(entry, "another") != found
    monkeypatch.setattr(store, "versions", lambda: "of another compiler")
    assert digest_of(entry, "cpu") != found


def test_every_process_has_the_same_digests():
    """Whatever the hashes of its strings are: files of one process are found by another one."""
    script = """
from evac.jit.store import digest_of, versions
from evac.physics import stepping, force
from evac_plugins import contact_dem, contact_nsm1, force_social
entries = [stepping.advance, force.add_forces, contact_dem.spring, contact_nsm1.project, force_social.social]
print(*(digest_of(entry, "cpu") for entry in entries))
"""
    found = {
        subprocess.run(
            [sys.executable, "-c", script],
            env=os.environ | {"PYTHONHASHSEED": seed},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for seed in ("1", "2")
    }
    assert len(found) == 1
    assert len(set(found.pop().split())) == 5


CONSTANTS = """
    from enum import IntEnum

    import inner_of_a_test.constants
    from evac.jit import kernel


    class Side(IntEnum):
        LEFT = 1
        RIGHT = 2


    @kernel
    def entry(x: float) -> float:
        return x + inner_of_a_test.constants.SHIFT + Side.RIGHT
"""


@pytest.mark.parametrize(("shift", "right", "is_other"), [(1.0, 2, False), (1.5, 2, True), (1.0, 3, True)])
def test_constants_in_modules_and_enumerations_count(module_of, monkeypatch, shift, right, is_other):
    package, constants = ModuleType("inner_of_a_test"), ModuleType("inner_of_a_test.constants")
    package.__file__ = constants.__file__ = "somewhere"
    package.constants = constants
    for module in (package, constants):
        monkeypatch.setitem(sys.modules, module.__name__, module)
    digests = []
    for value, text in ((1.0, CONSTANTS), (shift, CONSTANTS.replace("RIGHT = 2", f"RIGHT = {right}"))):
        constants.SHIFT = value
        digests.append(digest_of(module_of(text).entry, "cpu"))
    assert (digests[0] != digests[1]) == is_other
