"""Problems of a case, one line each: dotted key, fault, how to fix it."""

import reprlib
from dataclasses import dataclass
from typing import Any, get_args, get_origin

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from evac.base.parameters import did_you_mean
from evac.building.model.names import repaired
from evac.case.case import Case
from evac.case.keys import Section

#: Path to a value of case.toml: names of tables, indexes of lists.
Key = tuple[str | int, ...]

#: Greatest number of characters of a value that is repeated as an example.
LONGEST_EXAMPLE = 80

#: Greatest number of problems that are collected for a case.
MOST_PROBLEMS = 1_000


@dataclass(frozen=True)
class Problem:
    """A fault: its key, its description with a fix, and whether it is a name that a plugin could provide."""

    key: Key
    text: str
    is_unknown_name: bool = False


def dotted(key: Key, table: Any) -> str:
    """Return a key in the form of an override; items of a list by name if the name is unique."""
    words: list[str] = []
    here = table
    for step in key:
        word = str(step)
        if isinstance(step, int) and isinstance(here, list):
            names = [item.get("name") for item in here if isinstance(item, dict)]
            name = here[step].get("name") if step < len(here) and isinstance(here[step], dict) else None
            if isinstance(name, str) and name == repaired(name) != "" and "." not in name and names.count(name) == 1:
                word = name
        words.append(word)
        try:
            here = here[step]
        except (KeyError, IndexError, TypeError):
            here = None
    return ".".join(words)


def problems_of(error: ValidationError) -> list[Problem]:
    """Convert the errors of pydantic to problems in the terms of case.toml."""
    found = error.errors(include_url=False, include_context=True)
    parents = {other["loc"][:length] for other in found for length in range(len(other["loc"]))}
    return [_problem(details) for details in found[:MOST_PROBLEMS] if not _is_repeat(details, parents)]


def _is_repeat(details: ErrorDetails, parents: set[Key]) -> bool:
    """Return whether a list is reported as too short only because items of it are not valid."""
    return details["type"] == "too_short" and details["loc"] in parents


def _problem(details: ErrorDetails) -> Problem:
    key = details["loc"]
    kind = details["type"]
    got = reprlib.repr(details["input"])
    context = details.get("ctx", {})
    if kind == "extra_forbidden":
        return Problem(key, f"unknown key; {_known_key(key)}")
    if kind == "missing":
        return Problem(key, f"missing; give {_meaning(key)}")
    if kind == "case":
        return Problem((*key, context["key"]), context["text"])
    if kind == "value_error":
        return Problem(key, str(context["error"]))
    if kind in ("model_type", "dict_type", "model_attributes_type"):
        return Problem(key, f"must be a table, got {got}")
    if kind == "tuple_type":
        hint = ""
        if isinstance(details["input"], dict):
            hint = "; write its header in double brackets: [[...]]"
        elif isinstance(details["input"], str) and len(details["input"]) <= LONGEST_EXAMPLE:
            hint = f'; write {key[-1]} = ["{details["input"]}"]'
        return Problem(key, f"must be a list, got {got}{hint}")
    text = details["msg"].replace("Input should be", "must be").replace(" after validation", "")
    text = text.replace("Tuple should have", "must have").replace("String should have", "must have")
    if kind == "literal_error" and isinstance(details["input"], str):
        words = [word.strip("'") for word in context["expected"].replace(" or ", ", ").split(", ")]
        return Problem(key, f"{text}, got {got}; {did_you_mean(details['input'], words)}")
    return Problem(key, f"{text}, got {got}")


def _known_key(key: Key) -> str:
    """Return a hint for an unknown key: the closest key of the section, or another section with this key."""
    section = section_at(key[:-1])
    known = list(section.model_fields) if section else []
    word = str(key[-1])
    for name, field in Case.model_fields.items():
        other = section_of(field.annotation)
        if word not in known and other is not None and other is not section and word in other.model_fields:
            return f"it belongs to {name}: did you mean '{name}.{word}'?"
    return did_you_mean(word, known)


def _meaning(key: Key) -> str:
    section = section_at(key[:-1])
    field = section.model_fields.get(str(key[-1])) if section else None
    return (field.description if field else None) or "a value"


def section_at(key: Key) -> type[Section] | None:
    """Return the section of the schema that contains a key."""
    section: type[Section] | None = Case
    is_name = False  # of a table in a section of named tables, such as presets
    for step in key:
        if isinstance(step, str) and not is_name:
            field = section.model_fields.get(step) if section else None
            section = section_of(field.annotation) if field else None
            is_name = field is not None and get_origin(field.annotation) is dict
        else:
            is_name = False
    return section


def section_of(annotation: Any) -> type[Section] | None:
    """Return the section that is the type of a field or of the items of a list."""
    if isinstance(annotation, type) and issubclass(annotation, Section):
        return annotation
    return next((found for part in get_args(annotation) if (found := section_of(part)) is not None), None)
