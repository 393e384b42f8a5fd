"""Former names of modules are refused with the present ones, which exist."""

import importlib
import importlib.util

import pytest

import evac
from evac.base.moved import MOVED


@pytest.mark.parametrize("name", MOVED)
def test_a_former_name_is_refused_with_the_present_one(name):
    with pytest.raises(ModuleNotFoundError) as caught:
        importlib.import_module(name)
    present = [word.rstrip(",") for word in str(caught.value).split() if word.startswith("evac.")][1:]
    assert present
    assert all(importlib.util.find_spec(one) for one in present)


def test_modules_that_never_existed_are_not_found():
    assert evac.__name__ == "evac"
    with pytest.raises(ModuleNotFoundError, match="No module named"):
        importlib.import_module("evac.nothing")
