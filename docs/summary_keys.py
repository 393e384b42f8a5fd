"""The keys of summary.json, from their declarations."""

import re

from pydantic import ConfigDict, TypeAdapter

from evac.results.results import DERIVED, Results


def keys() -> str:
    """Return the table of keys, in the order of the file."""
    Results.__pydantic_config__ = ConfigDict(use_attribute_docstrings=True)
    fields = TypeAdapter(Results).json_schema(mode="serialization")["properties"]
    meanings = {"title": fields["title"]["description"]}
    meanings |= {value.key: value.func.__doc__ for value in DERIVED.values()}
    meanings |= {key: field["description"] for key, field in fields.items()}
    rows = [f"| `{key}` | {_linked(text)} |" for key, text in meanings.items()]
    return "\n".join(["| key | meaning |", "|---|---|", *rows])


def _linked(text: str) -> str:
    return re.sub(r"docs/(\w+\.md)", r"[\1](\1)", " ".join(text.split())).removesuffix(".")
