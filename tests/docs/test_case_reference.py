import pytest

from evac.base.distributions import FAMILIES
from evac.base.keys import table_of
from evac.case.case import Case
from tests.docs.conftest import table


def tables(table=Case):
    yield table
    for field in table.model_fields.values():
        inner = table_of(field.annotation)
        if inner is not None:
            yield from tables(inner)


def test_every_key_stands_in_the_reference_with_its_meaning():
    text = table("case")
    for declared in tables():
        for name, field in declared.model_fields.items():
            if table_of(field.annotation) is None:
                rows = [row for row in text.splitlines() if row.startswith(f"| `{field.alias or name}` |")]
                assert any(field.description in row for row in rows), name


@pytest.mark.parametrize(
    "line",
    [
        "### `[simulation]`",
        "### `[[building.exits]]`",
        "| `step` | number | s | `0.01` | time step h of the physics |",
        "| `radius` | number or distribution | m | `{ uniform = [0.2, 0.25] }` | body radius, at least 0.01 m |",
        "| `mesh` | text |  | none | file of the building, relative to case.toml; this or `plan` |",
        "| `order` | `1` or `2` |  | `2` | order of the fast marching scheme |",
    ],
)
def test_a_key_is_written_with_type_unit_and_default(line):
    assert line in table("case").splitlines()


def test_every_distribution_is_listed():
    for name, numbers in FAMILIES.items():
        assert f"| `{name}` | {', '.join(numbers)}" in table("case")


def test_every_quantity_has_a_unit():
    text = table("case")
    for name in ("weld", "spacing", "mass", "tau", "speed", "tick", "every", "positions"):
        row, *_ = [row for row in text.splitlines() if row.startswith(f"| `{name}` |")]
        assert row.split("|")[3].strip(), name
