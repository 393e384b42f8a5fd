"""A share of the attacks, and everything that once went wrong; ``python -m tests.attacks --all`` runs all of them."""

import os

import pytest

from tests.attacks.families import FAMILIES

if not hasattr(os, "fork"):
    pytest.skip("signals and limits of POSIX", allow_module_level=True)

CASES = [
    pytest.param(family, case, id=f"{name}-{k}")
    for name, family in FAMILIES.items()
    for k, case in enumerate(family.cases(family.share, 1))
]


@pytest.mark.filterwarnings("ignore")  # numpy's, of numbers that are then refused
@pytest.mark.parametrize(("family", "case"), CASES)
def test_attack(family, case, tmp_path):
    family.run(case, tmp_path)
