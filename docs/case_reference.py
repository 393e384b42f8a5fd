"""The reference of case.toml, generated from the schema."""

import types
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic.fields import FieldInfo

from evac.base.distributions import FAMILIES, Distribution
from evac.base.keys import Factor, Table, table_of
from evac.base.toml import toml_value
from evac.case.case import Case
from evac.case.schema import DESCRIPTION, GroupSettings, PeopleSettings, shipped_presets
from evac.people.starts import load_table

#: Meaning of the numbers of a distribution where it is often mistaken.
NOTES = {
    "lognormal": (
        " of the natural logarithm of the value, not of the value itself: the median is exp(mu), and the mean is "
        "exp(mu + sigma² / 2). Or mean and standard deviation of the value: "
        "`{ lognormal = { mean = 60.0, deviation = 20.0 } }`"
    )
}

#: Names of the types of single values.
WORDS: dict[Any, str] = {
    float: "number",
    int: "whole number",
    bool: "true or false",
    str: "text",
    Distribution: "number or distribution",
    Factor: "number or distribution",
}


def reference() -> str:
    """Return every key of case.toml with its type, unit, default and meaning, as Markdown, by table."""
    return (
        "\n\n".join(
            [_table(Case, "", "At the top of the file"), *_tables(Case, ""), _distributions(), _presets(), _loads()]
        )
        + "\n"
    )


def _tables(table: type[Table], path: str) -> list[str]:
    """Return the descriptions of all tables within a table."""
    parts = []
    for name, field in table.model_fields.items():
        inner, kind = table_of(field.annotation), get_origin(field.annotation)
        if inner is not None:
            place = f"{path}{name}"
            title = f"`[[{place}]]`" if kind is tuple else f"`[{place}.NAME]`" if kind is dict else f"`[{place}]`"
            parts += [_table(inner, place, title), *_tables(inner, f"{place}.")]
    return parts


def _table(table: type[Table], path: str, title: str) -> str:
    fields = {name: field for name, field in table.model_fields.items() if table_of(field.annotation) is None}
    if table is GroupSettings:
        fields = {name: field for name, field in fields.items() if name not in PeopleSettings.model_fields}
    rows = [_row(field.alias or name, field) for name, field in fields.items()]
    if table is GroupSettings:
        rows.append("| `radius`, ... |  |  |  | every key of `[presets.NAME]` below |")
    if path == "contact":
        rows.append("| `NAME` | table |  | none | parameters of contact model NAME, in use or not |")
    if path == "smoke":
        rows.append("| `NAME` | table |  | none | parameters of law NAME, in use or not |")
    if path == "conditions":
        rows.append("| ... |  |  |  | parameters of the source |")
    head = "| key | type | unit | default | meaning |\n|---|---|---|---|---|"
    return f"### {title}\n\n" + "\n".join([head, *rows])


def _row(name: str, field: FieldInfo) -> str:
    extra = field.json_schema_extra
    unit = extra.get("unit", "") if isinstance(extra, dict) else ""
    doc = (field.description or "").replace("|", "\\|")
    return f"| `{name}` | {_type(field.annotation)} | {unit} | {_default(field)} | {doc} |"


def _type(annotation: Any) -> str:
    """Return the name of a type for users."""
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return _type(arguments[0])
    if origin is Literal:
        return " or ".join(f"`{toml_value(word)}`" for word in arguments)
    if origin in (Union, types.UnionType):
        words = [_type(argument) for argument in arguments if argument is not type(None)]
        return " or ".join(dict.fromkeys(words))
    if origin is tuple and arguments[-1] is Ellipsis:
        return f"list of {_type(arguments[0])}"
    if origin is tuple:
        return f"[{', '.join(_type(argument) for argument in arguments)}]"
    if origin is dict:
        return "table"
    return WORDS[annotation]


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "required"
    value = field.default
    if isinstance(value, Distribution):
        value = value.to_value()
    return "none" if value is None else f"`{toml_value(value)}`"


def _presets() -> str:
    rows = []
    for name, preset in shipped_presets().items():
        given = ", ".join(f"{key} = {toml_value(value)}" for key, value in preset.items() if key not in DESCRIPTION)
        rows.append(f"| `{name}` | {preset['about']} | `{given}` | {preset['source']} |")
    return (
        "### Shipped presets\n\nValues that a preset does not state are the defaults above. Speeds on stairs are "
        "along the slope; those that the source gives in plan are converted for 30 degrees. Values of IMO, RiMEA, "
        "Fruin and Boyce et al. are quoted from secondary sources: check them against the edition that your project "
        "follows.\n\n"
        "| name | people | values | source |\n|---|---|---|---|\n" + "\n".join(rows)
    )


def _loads() -> str:
    rows = [f"| `{use}` | {row.get('ground', 'nobody')} | {row['source']} |" for use, row in load_table().items()]
    return (
        "### Loads of uses\n\nPeople in rooms of a use (`people.use`, and areas whose group has neither `number` nor "
        "`density`). ADB is Approved Document B (England), volume 2, 2019, table D1, and NFPA is NFPA 101, 2009: check "
        "the values against the code that your project follows.\n\n"
        "| use | m2 per person | source |\n|---|---|---|\n" + "\n".join(rows)
    )


def _distributions() -> str:
    rows = [f"| `{name}` | {', '.join(numbers)}{NOTES.get(name, '')} |" for name, numbers in FAMILIES.items()]
    return (
        "### Distributions\n\nA number, or a table with exactly one of these, such as `{ uniform = [0.2, 0.25] }`. "
        "With `minimum` and `maximum`, values outside are drawn again. The values of `list` are used in order, "
        "one for each person.\n\n| name | numbers |\n|---|---|\n" + "\n".join(rows)
    )
