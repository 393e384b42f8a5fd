"""Texts that programs would take for formulas are quoted in CSV files, and read back as they were."""

import csv

import pytest

import evac
from evac.folder.textfiles import cell_of, read_columns, text_of_cell


@pytest.mark.parametrize(
    "text", ["=cmd|'/C calc'!A0", "+1", "-1", "@SUM(A1)", "\t=1", "\r=1", "'a", "''", "hall", "", "a=b"]
)
def test_texts_come_back_and_none_is_a_formula(text):
    cell = cell_of(text)
    assert text_of_cell(cell) == text
    assert not cell.startswith(("=", "+", "-", "@", "\t", "\r"))


@pytest.mark.parametrize("value", [-1.5, 0, None, True])
def test_other_values_stay(value):
    assert cell_of(value) is value


def test_names_of_a_case_are_no_formulas_in_its_tables(tmp_path):
    changes = {"people.people.name": "=1+1", "simulation.duration": 0.1, "output.picture": False}
    evac.run(evac.load("square_room", changes), tmp_path / "r")
    with (tmp_path / "r" / "people.csv").open(newline="", encoding="utf-8") as file:
        assert {row["group"] for row in csv.DictReader(file)} == {"'=1+1"}
    assert set(read_columns(tmp_path / "r" / "people.csv", ("group",))["group"]) == {"=1+1"}
