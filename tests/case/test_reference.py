import pytest

from evac.base.distributions import KINDS
from evac.base.keys import section_of
from evac.case.case import Case
from evac.case.reference import reference


def sections(section=Case):
    yield section
    for field in section.model_fields.values():
        inner = section_of(field.annotation)
        if inner is not None:
            yield from sections(inner)


def test_every_key_stands_in_the_reference_with_its_meaning():
    text = reference()
    for section in sections():
        for name, field in section.model_fields.items():
            if section_of(field.annotation) is None:
                rows = [row for row in text.splitlines() if row.startswith(f"| `{name}` |")]
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
    assert line in reference().splitlines()


def test_every_distribution_is_listed():
    for name, numbers in KINDS.items():
        assert f"| `{name}` | {', '.join(numbers)}" in reference()


def test_every_quantity_has_a_unit():
    text = reference()
    for name in ("weld", "spacing", "mass", "tau", "speed", "tick", "every", "positions"):
        (row,) = [row for row in text.splitlines() if row.startswith(f"| `{name}` |")]
        assert row.split("|")[3].strip(), name
