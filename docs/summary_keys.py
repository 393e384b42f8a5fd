"""Write the keys of summary.json, from their declarations, into its page: ``python docs/summary_keys.py``."""

import re
from pathlib import Path

from pydantic import ConfigDict, TypeAdapter

from evac.results.results import DERIVED, Results

#: Line before the table of keys, and the heading after it.
FIRST, NEXT = "| key | meaning |\n|---|---|\n", "\n## contact\n"


def keys() -> str:
    """Return the rows of the table of keys, in the order of the file."""
    Results.__pydantic_config__ = ConfigDict(use_attribute_docstrings=True)
    fields = TypeAdapter(Results).json_schema(mode="serialization")["properties"]
    meanings = {"title": fields["title"]["description"]}
    meanings |= {value.key: value.func.__doc__ for value in DERIVED.values()}
    meanings |= {key: field["description"] for key, field in fields.items()}
    return "".join(f"| `{key}` | {_linked(text)} |\n" for key, text in meanings.items())


def _linked(text: str) -> str:
    return re.sub(r"docs/(\w+\.md)", r"[\1](\1)", " ".join(text.split())).removesuffix(".")


if __name__ == "__main__":
    page = Path(__file__).with_name("summary.md")
    before, _, after = page.read_text(encoding="utf-8").partition(FIRST)
    page.write_text(before + FIRST + keys() + NEXT + after.partition(NEXT)[2], encoding="utf-8")
