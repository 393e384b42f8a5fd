"""Buildings go through the page and come back to the byte."""

import shutil

import pytest

from tests.editor.round_trips import ROOT, taken_through, written
from tests.editor.test_page import Page


@pytest.mark.parametrize("name", ["new", "classroom", 0, pytest.param(1, marks=pytest.mark.slow)])
def test_a_building_comes_back_to_the_byte(browser, serve, house, tmp_path, name):
    folder = house if name == "new" else tmp_path / "case"
    if name == "classroom":
        shutil.copytree(ROOT / "buildings" / name, folder)
    elif name != "new":
        written(name, folder)
    page = Page(browser, serve(folder))
    assert taken_through(page, 7) > 10
    page.close()
    assert browser.errors == []
