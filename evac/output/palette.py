"""Colours of all outputs: of groups, of what stands in a building, and of continuous quantities."""

from collections.abc import Sequence

#: Okabe and Ito's colours, which colour-blind people tell apart; black is kept for lines and text.
OKABE_ITO = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#f0e442")

#: People of no group.
NO_GROUP = "#8a939e"

EXIT, CLOSED = "#12a150", "#c0392b"

#: Colour map of each quantity. All are perceptually uniform, safe for the colour-blind, and seen on light and dark.
MAPS = {"speed": "viridis", "density": "plasma", "contact force": "plasma", "waiting time": "cividis"}

#: Colours at equal distances along each map, of which the others are interpolated (those of matplotlib).
STOPS = {
    "viridis": ["#440154", "#472d7b", "#3b528b", "#2c728e", "#21918c", "#28ae80", "#5ec962", "#addc30", "#fde725"],
    "cividis": ["#00224e", "#1a386f", "#434e6c", "#61656f", "#7d7c78", "#9b9476", "#bcae6c", "#dec958", "#fee838"],
    "plasma": ["#0d0887", "#4c02a1", "#7e03a8", "#aa2395", "#cc4778", "#e66c5c", "#f89540", "#fdc527", "#f0f921"],
}


def group_colours(count: int) -> list[str]:
    """Return the colour of each group, by its row: the same in every output.

    The first seven are `OKABE_ITO`; then these again darker, then lighter. Beyond 21 they repeat.

    Parameters
    ----------
    count : int
        Number of groups.

    Returns
    -------
    list of str
        ``"#rrggbb"``.
    """
    shades = [*OKABE_ITO, *(_mixed(one, "#000000", 0.42) for one in OKABE_ITO)]
    shades += [_mixed(one, "#ffffff", 0.5) for one in OKABE_ITO]
    return [shades[k % len(shades)] for k in range(count)]


def _mixed(colour: str, other: str, share: float) -> str:
    """Return a colour mixed with a share of another."""
    mixed = [round((1.0 - share) * a + share * b) for a, b in zip(_parts(colour), _parts(other), strict=True)]
    return "#{:02x}{:02x}{:02x}".format(*mixed)


def _parts(colour: str) -> Sequence[int]:
    return [int(colour[k : k + 2], 16) for k in (1, 3, 5)]
