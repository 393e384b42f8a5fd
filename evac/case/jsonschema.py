"""JSON schemas of case.toml and of plan files, by which text editors complete and check their keys."""

import inspect
import math
import re
import types
from collections.abc import Mapping, Sequence
from typing import Any, get_args, get_origin

from evac.base.parameters import Configurable, Parameter
from evac.building.plan.plan import Plan
from evac.building.plan.plantable import SECTIONS
from evac.case.case import Case
from evac.contract.registry import Registry

#: The draft of JSON schema in which they are written.
DRAFT = "http://json-schema.org/draft-07/schema#"

#: Tables of case.toml whose keys are names of plugins, as in the registry.
TABLES = ("behaviours", "forces", "recorders", "dispatchers", "importers")

#: JSON types of the types of Python, the first that fits.
TYPES: Mapping[type, str] = {bool: "boolean", int: "integer", float: "number", str: "string"}

Schema = dict[str, Any]


def case_schema(registry: Registry) -> Schema:
    """Return the schema of case.toml: the keys, types, ranges and words that evac accepts, also for plugins."""
    schema = Case.model_json_schema()
    definitions = {name: _without_names(one) for name, one in schema.pop("$defs").items()}
    plan = {key: value for key, value in plan_schema().items() if key != "$schema"}
    definitions["BuildingSettings"]["properties"]["plan"] = plan
    models = registry.contact_models
    definitions["ContactSettings"]["properties"] |= {name: _parameters(cls) for name, cls in models.items()}
    definitions["ContactSettings"]["additionalProperties"] = False
    definitions["ContactSettings"]["properties"]["model"]["enum"] = sorted(models)
    smoke, sources = definitions["SmokeSettings"], definitions["ConditionSettings"]
    smoke["properties"]["law"]["enum"] = sorted(registry.smoke_laws)
    smoke["properties"] |= {name: _parameters(cls) for name, cls in registry.smoke_laws.items()}
    smoke["additionalProperties"] = False
    sources["properties"]["source"]["enum"] = sorted(registry.condition_sources)
    for cls in registry.condition_sources.values():
        sources["properties"] |= _parameters(cls)["properties"]
    sources["additionalProperties"] = False
    own = {name: _parameters(cls, cls.group_keys) for name, cls in registry.behaviours.items()}
    for groups in ("GroupSettings", "PeopleSettings"):
        definitions[groups]["properties"]["behaviours"] |= _table(own)
    properties = _without_names(schema)["properties"]
    for section in TABLES:
        classes: Mapping[str, type[Configurable]] = getattr(registry, section)
        plugins = {name: {"anyOf": [{"type": "boolean"}, _parameters(cls)]} for name, cls in classes.items()}
        properties[section] = {"description": properties[section]["description"], **_table(plugins)}
    return {"$schema": DRAFT, **_table(properties, schema["required"]), "definitions": definitions}


def plan_schema() -> Schema:
    """Return the schema of plan files, whose keys are the arguments of the methods of `Plan`."""
    properties: Schema = {
        "headroom": {"type": "number", "description": "clear height that people need [m]"},
        "north": {"type": "number", "description": "direction in plan, counterclockwise from y [degrees]"},
    }
    for section in SECTIONS:
        method = getattr(Plan, section.removesuffix("s"))
        given = [one for one in inspect.signature(method).parameters.values() if one.name != "self"]
        meanings = _meanings(inspect.getdoc(method) or "")
        keys = {one.name: {**_type_of(one.annotation), **meanings.get(one.name, {})} for one in given}
        item = _table(keys, [one.name for one in given if one.default is inspect.Parameter.empty])
        properties[section] = {"type": "array", "description": meanings[""]["description"], "items": item}
    return {"$schema": DRAFT, **_table(properties)}


def _table(properties: Mapping[str, Schema], required: Sequence[str] = ()) -> Schema:
    """Return the schema of a table without other keys."""
    table = {"type": "object", "properties": dict(properties), "additionalProperties": False}
    return table | ({"required": list(required)} if required else {})


#: A distribution of case.toml.
_DISTRIBUTION = {"$ref": "#/definitions/Distribution"}


def _parameters(cls: type[Configurable], keys: Sequence[str] | None = None) -> Schema:
    """Return the schema of the table of a plugin, or of the keys that groups may set, which need not be parameters."""
    description = (inspect.getdoc(cls) or "").partition("\n")[0]
    known = {name: _parameter(one) for name, one in cls.declared().items()}
    return {
        "description": description,
        **_table(known if keys is None else {name: known.get(name, {}) for name in keys}),
    }


def _parameter(parameter: Parameter) -> Schema:
    unit = f" [{parameter.unit}]" if parameter.unit else ""
    told = {"description": parameter.doc + unit}
    words: Schema = {"enum": list(parameter.choices)} if parameter.choices else {}
    default = parameter.default
    if parameter.distribution:
        return told | _DISTRIBUTION
    if isinstance(default, dict):
        return told | {"type": "object"}
    if isinstance(default, tuple):
        return told | {"type": "array", "items": {"type": "string", **words}}
    bounds = {"minimum": parameter.minimum, "exclusiveMinimum": parameter.above, "maximum": parameter.maximum}
    given = {name: bound for name, bound in bounds.items() if bound is not None}
    if parameter.infinite:
        given.pop("maximum", None)
    told |= {"default": default} if _is_plain(default) else {}
    return told | _type_of(type(default)) | words | given


def _type_of(annotation: Any) -> Schema:
    """Return the schema of a type of Python: of an argument of `Plan`, or of the default of a parameter."""
    options = get_args(annotation) if isinstance(annotation, types.UnionType) else (annotation,)
    found: list[str] = []
    for option in options:
        if option in TYPES:
            found.append(TYPES[option])
        elif issubclass(origin := get_origin(option) or option, Mapping):
            found.append("object")
        elif issubclass(origin, Sequence):
            found.append("array")
    return {"type": found[0] if len(found) == 1 else found} if found else {}


def _meanings(doc: str) -> dict[str, Schema]:
    """Return the meaning of each parameter of a docstring in the style of NumPy; "": that of the whole."""
    summary, _, rest = doc.partition("\n")
    found: dict[str, Schema] = {"": {"description": summary}}
    names: list[str] = []
    for line in rest.partition("----------\n")[2].partition("\n\n")[0].splitlines():
        if not line.startswith(" "):
            given, _, kind = line.partition(" :")
            names = given.split(", ")
            words = re.findall(r'"([^"]+)"', kind)
            unit = "".join(re.findall(r" (\[[^\]]+\])", kind))
            for name in names:
                found[name] = {"description": unit} | ({"enum": words} if words else {})
        else:
            for name in names:
                found[name]["description"] = f"{found[name]['description']} {line.strip()}".strip()
    return found


def _without_names(schema: Schema) -> Schema:
    """Return a schema of pydantic in the draft, as a text editor shows it: units in descriptions, no titles."""

    def simple(value: Any) -> Any:
        if isinstance(value, list):
            return [simple(one) for one in value]
        if not isinstance(value, dict):
            return value.replace("#/$defs/", "#/definitions/") if isinstance(value, str) else value
        unit = value.get("unit")
        kept = {
            "items" if key == "prefixItems" else key: simple(one)
            for key, one in value.items()
            if not (key in ("title", "unit") and isinstance(one, str)) and not (key == "default" and not _is_plain(one))
        }
        if unit and "description" in kept and isinstance(unit, str):
            kept["description"] += f" [{unit}]"
        return kept

    found: Schema = simple(schema)
    return found


def _is_plain(value: Any) -> bool:
    """Return whether JSON has the value, which has no infinite numbers."""
    return isinstance(value, str) or (isinstance(value, bool | int | float) and math.isfinite(value))
