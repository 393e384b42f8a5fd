"""Portals, exits and stairs by name, their closing, and the levels from which exits can be reached."""

from collections.abc import Collection, Iterable, Sequence
from dataclasses import replace

import numpy as np

from evac.base.arrays import IndexArray
from evac.base.change import Change
from evac.base.errors import BuildingError
from evac.base.parameters import did_you_mean
from evac.building.geometry.components import connected_components
from evac.building.model.building import Area, Building, Exit
from evac.building.model.findings import Finding


def links_named(building: Building, name: str) -> frozenset[int]:
    """Return the links of an exit or portal with a given name, or the portals of a stair.

    Raises
    ------
    BuildingError
        No exit, portal or stair has this name.
    """
    links = {building.link_of(way) for way in building.exits if way.name == name}
    links |= {portal.index for portal in building.portals if portal.name == name}
    links |= {portal.index for level in building.stairs.get(name, ()) for portal in building.portals_of(level)}
    if not links:
        known = [way.name for way in building.exits] + [way.name for way in building.portals] + [*building.stairs]
        raise BuildingError(
            f"{building.source}: no exit, portal or stair is named {name!r}; {did_you_mean(name, known)}"
        )
    return frozenset(links)


def with_links(building: Building, name: str, is_open: bool) -> Building:
    """Return the building after an exit, a portal or a stair has been opened or closed; itself if it already is so.

    Raises
    ------
    BuildingError
        As `links_named`.
    """
    links = links_named(building, name)
    closed = building.closed - links if is_open else building.closed | links
    return building if closed == building.closed else replace(building, closed=closed)


def building_at(building: Building, changes: Iterable[Change], time: float) -> Building:
    """Return a building as it is at a time, with the links that changes until then have opened and closed.

    Parameters
    ----------
    building : Building
        The building at the start.
    changes : iterable of Change
        In the order in which they took effect; those that concern no links are skipped.
    time : float [s]
    """
    for change in changes:
        if change.time <= time and change.kind in ("open", "close"):
            building = with_links(building, change.what, change.kind == "open")
    return building


def states_of(building: Building, changes: Iterable[Change]) -> list[list[tuple[float, bool]]]:
    """Return when each link is open.

    Parameters
    ----------
    building, changes
        As for `building_at`.

    Returns
    -------
    list of list of (float, bool)
        For each link, portals first: whether it is open at the start, with time 0, and each time [s] at which that
        changes.
    """
    states = [[(0.0, link not in building.closed)] for link in range(building.n_links)]
    for change in changes:
        after = building_at(building, [change], change.time)
        for link in after.closed ^ building.closed:
            states[link].append((change.time, link not in after.closed))
        building = after
    return states


def close_links(building: Building, names: Sequence[str]) -> Building:
    """Return the building with exits, portals and stairs closed for the whole run; closed links are walls.

    Parameters
    ----------
    building : Building
    names : sequence of str
        Names of exits, portals or stairs; all portals of a stair are closed.

    Raises
    ------
    BuildingError
        No exit, portal or stair has this name.
    """
    closed, stairs = set(building.closed), set[int]()
    for name in names:
        try:
            closed |= links_named(building, name)
        except BuildingError as error:
            raise BuildingError(f"{error} (given as building.closed)") from None
        stairs |= set(building.stairs.get(name, ()))
    result = replace(building, closed=frozenset(closed))
    cut_off = [note for note in isolated_parts(result, stairs) if note not in building.findings]
    return replace(result, findings=(*building.findings, *cut_off))


def levels_reaching(building: Building, exits: Iterable[Exit | Area], barred: Collection[int] = ()) -> set[int]:
    """Return the levels from which one of some open exits or areas can be reached, without the portals `barred`."""
    part = _parts(building, barred)
    return set(np.flatnonzero(np.isin(part, [part[exit_.level] for exit_ in exits])).tolist())


def isolated_parts(building: Building, closed: Collection[int] = ()) -> tuple[Finding, ...]:
    """Warn of levels from which no exit can be reached, except the levels in `closed`."""
    part = _parts(building)
    open_levels = {way.level for way in building.exits if building.is_open(way)}
    notes = []
    for number in np.unique(part):
        members = np.flatnonzero(part == number).tolist()
        if open_levels.isdisjoint(members) and not set(members) <= set(closed):
            names = [building.levels[index].name for index in members]
            others = f" and its neighbours {', '.join(map(repr, names[1:]))}" if len(names) > 1 else ""
            text = f"no exit can be reached from {names[0]!r}{others}: people there cannot leave"
            x, y = building.levels[members[0]].polygon.representative_point().coords[0]
            notes.append(Finding("warning", text, names[0], (x, y)))
    return tuple(notes)


def _parts(building: Building, barred: Collection[int] = ()) -> IndexArray:
    """Return the part of the building that each level belongs to: open portals not `barred` join levels to parts."""
    pairs = [one.levels for one in building.portals if building.is_open(one) and one.index not in barred]
    return connected_components(len(building.levels), np.array(pairs, dtype=np.int64).reshape(-1, 2))
