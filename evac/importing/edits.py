"""The plan that an import writes, and the edits that users have made in it since an earlier import."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from evac.base.errors import BuildingError
from evac.building.model.findings import Finding
from evac.building.plan.plantable import SECTIONS
from evac.case.toml import toml_lines, toml_value

#: An item of a plan, or all pieces of one stair: its list and its name.
Key = tuple[str, str]
#: A plan as a table, see `evac.building.plan.plantable`.
Table = Mapping[str, Any]

HEAD = """# Written by evac import: the building of case.toml, in metres. Importing again to this folder keeps what you
# change, add or delete here (storeys, stairs, doors, exits, areas, obstacles), by its name.
# A wall is put into a room by an obstacle, and taken away by a polygon over it in its storey.
"""


def plan_text(table: Table, dropped: Sequence[str] = (), head: str = HEAD) -> str:
    """Return a plan as TOML; lines that were dropped follow as comments."""
    lines = [head, *toml_lines({key: value for key, value in table.items() if key not in SECTIONS})]
    for section in SECTIONS:
        for item in table.get(section, ()):
            lines += ["", f"[[{section}]]"]
            for key, value in item.items():
                if key in ("polygon", "polygons") and len(value) > 1:
                    lines += [f"{key} = [", *(f"{toml_value(one)}," for one in value), "]"]
                else:
                    lines += toml_lines({key: value})
    return "\n".join([*lines, *(f"# {line}" for line in dropped), ""])


def with_edits(
    imported: Table, former: Table, edited: Table, check: Callable[[Table], None]
) -> tuple[dict[str, Any], list[str], list[Finding]]:
    """Return an imported plan with the edits of an earlier one.

    Parameters
    ----------
    imported : table
        The plan as it is imported now.
    former, edited : table
        The plan as it was imported before, and as the user has left it.
    check : callable
        Raises BuildingError where a plan cannot be built.

    Returns
    -------
    table
    list of str
        Lines of the edits that no longer fit.
    list of Finding
        What was kept, and what was not.
    """
    new, old, own = (_items(table) for table in (imported, former, edited))
    changed = [key for key in {**old, **own} if own.get(key) != old.get(key) and own.get(key) != new.get(key)]
    told = [_told(key, own, old, new) for key in changed]
    whole = _edited(new, own, changed)
    try:
        check(_table(whole))
        return _table(whole), [], told
    except BuildingError:
        pass
    kept, lines, told = new, list[str](), list[Finding]()
    for key in changed:
        trial = _edited(kept, own, [key])
        try:
            check(_table(trial))
        except BuildingError as error:
            text = f"{_verb(key, own, old)}, which no longer fits and is left out: {error}"
            told.append(Finding("warning", text))
            lines += [
                "",
                text,
                *plan_text(_table({key: own[key]} if key in own else {})).splitlines()[HEAD.count("\n") :],
            ]
            continue
        kept = trial
        told.append(_told(key, own, old, new))
    return _table(kept), lines, told


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


def _edited(items: Mapping[Key, list[Any]], own: Mapping[Key, list[Any]], keys: Sequence[Key]) -> dict[Key, list[Any]]:
    """Return items with some of them replaced, added or deleted."""
    rest = {key: value for key, value in items.items() if key not in keys or key in own}
    return rest | {key: own[key] for key in keys if key in own}


def _verb(key: Key, own: Mapping[Key, Any], old: Mapping[Key, Any]) -> str:
    what = f"{key[0].removesuffix('s')} {key[1]!r}" if key[1] else key[0]
    done = "added" if key not in old else "deleted" if key not in own else "changed"
    return f"{what} was {done} in the plan"


def _told(key: Key, own: Mapping[Key, Any], old: Mapping[Key, Any], new: Mapping[Key, Any]) -> Finding:
    """Return the finding of an edit that is kept."""
    also = "" if new.get(key) == old.get(key) else ", although the file has another one now"
    return Finding("assumed", f"{_verb(key, own, old)}, and this is kept{also}")
