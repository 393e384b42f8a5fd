"""The plan that an import writes, and the edits that users have made in it since an earlier import."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from evac.base.errors import BuildingError
from evac.building.model.findings import Finding
from evac.building.model.names import numbered
from evac.building.plan.plantable import SECTIONS
from evac.case.toml import toml_lines, toml_value

#: An item of a plan, or all pieces of one stair: its list and its name.
Key = tuple[str, str]
#: Lists whose items nothing in a plan refers to by name.
RENAMED = ("doors", "exits", "areas", "obstacles")
#: A plan as a table, see `evac.building.plan.plantable`.
Table = Mapping[str, Any]

HEAD = """# Written by evac import: the building of case.toml, in metres. Importing again to this folder keeps what you
# change, add or delete here (storeys, stairs, doors, exits, areas, obstacles), by its name.
# A wall is put into a room by an obstacle, and taken away by a polygon over it in its storey.
"""


def plan_text(table: Table, comments: Sequence[str] = (), head: str = HEAD) -> str:
    """Return a plan as TOML, followed by comments."""
    lines = [head, *toml_lines({key: value for key, value in table.items() if key not in SECTIONS})]
    for section in SECTIONS:
        for item in table.get(section, ()):
            lines += ["", f"[[{section}]]"]
            for key, value in item.items():
                if key in ("polygon", "polygons") and isinstance(value, list) and len(value) > 1:
                    lines += [f"{key} = [", *(f"{toml_value(one)}," for one in value), "]"]
                else:
                    lines += toml_lines({key: value})
    return "\n".join([*lines, *(f"# {line}" for line in comments), ""])


def comments_of(text: str) -> list[str]:
    """Return the comments of a plan that users or earlier imports have written, without their marks."""
    lines = [line for line in text.splitlines() if line.startswith("#") and line not in HEAD.splitlines()]
    return [line.removeprefix("#").removeprefix(" ") for line in lines]


def with_former_names(imported: Table, former: Table) -> dict[str, Any]:
    """Return an imported plan in which what has not moved keeps its name, although importers number what they find."""
    table = dict(imported)
    for section in RENAMED:
        names = {_shape(item): item.get("name") for item in former.get(section, ())}
        items = [(item, names.get(_shape(item))) for item in imported.get(section, ())]
        taken = {name for _, name in items if name}
        for number, (item, name) in enumerate(items):
            own = name or numbered(item["name"], taken)
            taken.add(own)
            items[number] = item | {"name": own}, name
        if items:
            table[section] = [item for item, _ in items]
    return table


def with_edits(
    imported: Table, former: Table, edited: Table, check: Callable[[Table], None]
) -> tuple[dict[str, Any], list[str], list[Finding]]:
    """Return an imported plan with the edits of an earlier one."""
    new, old, own = (_items(table) for table in (imported, former, edited))
    changed = [key for key in {**old, **own} if own.get(key) != old.get(key) and own.get(key) != new.get(key)]
    merged = own | {
        key: _merged(own[key], old[key], new[key]) for key in changed if key in own and key in old & new.keys()
    }
    whole, failed = _fitting(new, merged, changed, check)
    while failed:  # what does not fit before others, such as a storey that goes before its stairs, is tried after them
        tried = len(failed)
        whole, failed = _fitting(whole, merged, [*failed], check)
        if len(failed) == tried:
            break
    lines, told = list[str](), list[Finding]()
    for key in changed:
        verb = _verb(key, own, old)
        if key in failed:
            text = f"{verb}, which no longer fits and is left out: {failed[key]}"
            told.append(Finding("warning", text))
            written = plan_text(_table({key: own[key]} if key in own else {}), head="").splitlines()
            lines += ["", text, *written[1:]]
            continue
        more = ""
        if key not in new:
            more = ", although the file no longer has it" if key in old else ""
        elif new[key] != old.get(key):
            is_merged = merged.get(key) != own.get(key)
            more = ", with what else the file has changed" if is_merged else ", although the file has another one now"
        told.append(Finding("assumed", f"{verb}, and this is kept{more}"))
    return _table(whole), lines, told


def _fitting(
    items: dict[Key, list[Any]], own: Mapping[Key, list[Any]], keys: Sequence[Key], check: Callable[[Table], None]
) -> tuple[dict[Key, list[Any]], dict[Key, BuildingError]]:
    """Return items with those edits with which they can be built, and why the others do not fit."""
    rest = {key: value for key, value in items.items() if key not in keys or key in own}
    trial = rest | {key: own[key] for key in keys if key in own}
    try:
        check(_table(trial))
        return trial, {}
    except BuildingError as error:
        if len(keys) < 2:
            return items, {key: error for key in keys}
    items, failed = _fitting(items, own, keys[: len(keys) // 2], check)
    items, others = _fitting(items, own, keys[len(keys) // 2 :], check)
    return items, failed | others


def _merged(own: list[Any], old: list[Any], new: list[Any]) -> list[Any]:
    """Return an item as the user has changed it; of a storey, polygons and keys that only the file has changed too."""
    if not all(isinstance(one, Mapping) and "polygons" in one for one in (own[0], old[0], new[0])):
        return own
    mine, before, now = own[0], old[0], new[0]
    storey = {key: now.get(key) if mine.get(key) == before.get(key) else mine.get(key) for key in {**now, **mine}}
    polygons, gone = mine["polygons"], [one for one in before["polygons"] if one not in mine["polygons"]]
    if all(one in now["polygons"] for one in gone):
        polygons = [one for one in now["polygons"] if one not in gone]
        polygons += [one for one in mine["polygons"] if one not in (*before["polygons"], *polygons)]
    return [{key: value for key, value in (storey | {"polygons": polygons}).items() if value is not None}]


def _shape(item: Mapping[str, Any]) -> str:
    """Return what an item is apart from its name."""
    return repr(sorted((key, value) for key, value in item.items() if key != "name"))


def _items(table: Table) -> dict[Key, list[Any]]:
    """Return the items of a plan by their lists and names."""
    items: dict[Key, list[Any]] = {(key, ""): [value] for key, value in table.items() if key not in SECTIONS}
    for section in SECTIONS:
        for item in table.get(section, ()):
            items.setdefault((section, str(item.get("name") or item.get("stair") or "")), []).append(item)
    return items


def _table(items: Mapping[Key, list[Any]]) -> dict[str, Any]:
    """Return the plan of some items."""
    table: dict[str, Any] = {}
    for (section, _), own in items.items():
        table[section] = [*table.get(section, []), *own] if section in SECTIONS else own[0]
    return table


def _verb(key: Key, own: Mapping[Key, Any], old: Mapping[Key, Any]) -> str:
    what = f"{key[0].removesuffix('s')} {key[1]!r}" if key[1] else key[0]
    done = "added" if key not in old else "deleted" if key not in own else "changed"
    return f"{what} was {done} in the plan"
