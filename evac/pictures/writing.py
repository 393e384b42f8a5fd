"""Text in all pictures, in the font that comes with matplotlib; legends and scales drawn with Pillow."""

import math
import re
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from functools import cache
from pathlib import Path

import matplotlib.style
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ft2font import FT2Font
from matplotlib.text import Text
from PIL import Image, ImageDraw, ImageFont

from evac.base.arrays import FloatArray
from evac.folder.files import replacing
from evac.pictures import palette
from evac.pictures.palette import Scale

WHITE = (255, 255, 255)

#: The font shipped with matplotlib, which covers most alphabets, and its bold face.
FONTS = tuple(str(Path(matplotlib.get_data_path(), "fonts", "ttf", f"DejaVuSans{face}.ttf")) for face in ("", "-Bold"))

WORD = re.compile(r"""[^\s"'.,:;()\[\]]+""")  #: What is a number, or is not, as a whole.


@cache
def font(size: int, is_bold: bool = False) -> ImageFont.FreeTypeFont:
    """Return the font of pictures."""
    return ImageFont.truetype(FONTS[is_bold], size)


@cache
def _letters() -> frozenset[int]:
    """Return the code points that the font has in both faces."""
    return frozenset(FT2Font(FONTS[0]).get_charmap()) & frozenset(FT2Font(FONTS[1]).get_charmap())


def legible(text: str, names: list[str]) -> str:
    """Return a text with numbers for words that the font cannot write, such as [1]; they are added to `names`."""

    def numbered(word: re.Match[str]) -> str:
        if _letters().issuperset(map(ord, word[0])):
            return word[0]
        if word[0] not in names:
            names.append(word[0])
        return f"[{names.index(word[0]) + 1}]"

    return WORD.sub(numbered, text)


@contextmanager
def legible_figure(figure: Artist, names: list[str] | None = None) -> Iterator[list[str]]:
    """Make the texts of a figure legible while it is drawn, see `legible`; yield the words that are numbers then."""
    names = list[str]() if names is None else names
    changed = [(text, text.get_text(), legible(text.get_text(), names)) for text in _texts(figure)]
    changed = [(text, words, shown) for text, words, shown in changed if shown != words]
    for text, _, shown in changed:
        text.set_text(shown)
    try:
        yield names
    finally:
        for text, words, shown in changed:
            if text.get_text() == shown:
                text.set_text(words)


def _texts(artist: Artist) -> Iterator[Text]:
    """Yield the texts of a figure or a part of it, but for those at ticks, which take long and are set when drawn."""
    if isinstance(artist, Text):
        yield artist
    for part in [artist.label] if isinstance(artist, Axis) else artist.get_children():
        yield from _texts(part)


def listed(names: Sequence[str]) -> list[str]:
    """Return the words that are numbers in a picture, each after its number."""
    return [f"[{number}] {name}" for number, name in enumerate(names, 1)]


def as_shipped() -> AbstractContextManager[None]:
    """Draw with the settings that come with matplotlib, not those of the user or of the current folder."""
    return matplotlib.style.context("default")


def save(figure: Figure, path: Path, what: str = "the picture") -> None:
    """Write a picture, and beside it the list of words that are numbers in it."""
    with replacing(path, what) as new, legible_figure(figure) as names:
        figure.savefig(new)
    save_names(names, path)


def save_names(names: Sequence[str], path: Path) -> None:
    """Write the list of words that are numbers in a picture to a file beside it, if there are any."""
    if names:
        with replacing(path.with_name(f"{path.name}.txt"), "the names in the picture") as new:
            new.write_text("".join(f"{line}\n" for line in listed(names)), encoding="utf-8")


class Pen:
    """Draws text and scales into a picture; lengths are in pixels, font sizes scale with the picture."""

    def __init__(self, image: Image.Image, letters: int = 0) -> None:
        self.draw = ImageDraw.Draw(image)
        self.width, self.height = image.size
        self.unit = letters or max(8, round(min(image.width / 1.33, image.height) / 52))  # font size

    def title(self, words: str) -> None:
        """Write the title, in a smaller font or shortened if it is long."""
        size = round(1.25 * self.unit)
        while size > 0.85 * self.unit and font(size, True).getlength(words) > 0.96 * self.width:
            size -= 1
        while len(words) > 8 and font(size, True).getlength(words) > 0.96 * self.width:
            words = words[:-5].rstrip() + " ..."
        self.draw.text((self.unit, 0.9 * self.unit), words, palette.TEXT, font(size, True))

    def clock(self, words: str) -> None:
        """Write the line below the title."""
        self.draw.text((self.unit, 2.7 * self.unit), words, palette.TEXT, font(round(1.05 * self.unit)))

    def label(self, words: str, place: FloatArray, anchor: str, colour: str) -> None:
        """Write a text within the picture, with a white outline so that it is legible on any background."""
        letters = font(round(0.95 * self.unit), True)
        x1, y1, x2, y2 = self.draw.textbbox(tuple(place), words, letters, anchor)
        x = place[0] + max(4 - x1, 0) - max(x2 - self.width + 4, 0)
        y = place[1] + max(4 - y1, 0) - max(y2 - self.height + 4, 0)
        rim = max(2, self.unit // 6)
        self.draw.text((x, y), words, colour, letters, anchor, stroke_width=rim, stroke_fill=WHITE)

    def outline(self, corners: FloatArray, colour: str) -> None:
        """Draw a closed line."""
        points = [tuple(corner) for corner in corners.tolist()]
        self.draw.line([*points, points[0]], colour, max(2, self.unit // 6), "curve")

    def legend(self, side: tuple[int, int, int, int], groups: Sequence[tuple[str, palette.Look]]) -> None:
        """Draw a legend of names beside bars with the colours of head, body and belt."""
        left, top, right, bottom = side
        line = min(1.7 * self.unit, (bottom - top) / max(len(groups), 1))
        letters = font(max(7, round(min(0.95 * self.unit, 0.8 * line))))
        y = 0.5 * (top + bottom) - 0.5 * line * len(groups)
        dot = 0.34 * line
        for name, (body, head, belt) in groups:
            y += line
            for colour, upper, lower in ((body, -1.2, 1.2), (head, -1.2, -0.5), (belt, 0.1, 0.6)):
                self.draw.rectangle((left, y + upper * dot, left + 1.4 * dot, y + lower * dot), colour)
            self.draw.rectangle((left, y - 1.2 * dot, left + 1.4 * dot, y + 1.2 * dot), outline=palette.TEXT)
            shown = name
            while len(shown) > 4 and letters.getlength(shown) > right - left - 3 * dot:
                shown = shown[:-2] + "…"
            self.draw.text((left + 3 * dot, y), shown, palette.TEXT, letters, "lm")

    def colour_bar(self, side: tuple[int, int, int, int], scale: Scale, top: float) -> None:
        """Draw the colour bar of a scale that ends at `top`."""
        colours = (255.0 * scale.ramp()).round().astype(np.uint8)
        left, upper, _, lower = side
        tall = min(lower - upper, 20 * self.unit)
        high = (upper + lower + tall) // 2 - tall
        for k in range(tall):
            colour = tuple(colours[round((1.0 - k / max(tall - 1, 1)) * (len(colours) - 1))].tolist())
            self.draw.line([(left, high + k), (left + 1.2 * self.unit, high + k)], colour)
        letters = font(round(0.95 * self.unit))
        lowest = math.inf
        for share, text in scale.ticks(top):
            y = high + tall * (1.0 - share)
            self.draw.line([(left + 1.2 * self.unit, y), (left + 1.5 * self.unit, y)], palette.TEXT)
            if y <= lowest - self.unit:  # of levels of service that are close together, some have no room
                self.draw.text((left + 1.8 * self.unit, y), text, palette.TEXT, letters, "lm")
                lowest = y
        if scale.below:
            y = high + tall + 1.5 * self.unit
            self.draw.rectangle((left, y, left + 1.2 * self.unit, y + self.unit), palette.NOTHING)
            self.draw.text((left + 1.8 * self.unit, y + 0.5 * self.unit), scale.below, palette.TEXT, letters, "lm")
        for k, line in enumerate([*([f"[{scale.unit}]"] if scale.unit else []), scale.label]):
            self.draw.text((left, high - (0.8 + 1.3 * k) * self.unit), line, palette.TEXT, letters, "ls")

    def scale_bar(self, scale: float, north: FloatArray | None) -> None:
        """Draw a scale bar of a round length at `scale` pixels per metre, and an arrow along `north` if it is known."""
        length = round_length(9.0 * self.unit / scale)
        x, y, up = 1.2 * self.unit, self.height - 1.3 * self.unit, 0.3 * self.unit
        end = x + length * scale
        wide = max(2, self.unit // 7)
        self.draw.line([(x, y), (end, y)], palette.TEXT, wide)
        for tip in (x, end):
            self.draw.line([(tip, y - up), (tip, y + up)], palette.TEXT, wide)
        letters = font(round(0.95 * self.unit))
        self.draw.text((end + 0.6 * self.unit, y), f"{length:g} m", palette.TEXT, letters, "lm")
        if north is not None:
            middle, along = np.array([end + 6.5 * self.unit, y]), 1.1 * self.unit * north
            point, across = middle + along, 0.35 * np.array([-along[1], along[0]])
            self.draw.line([tuple(middle - along), tuple(point - 0.5 * along)], palette.TEXT, wide)
            head = [tuple(point), tuple(point - 0.8 * along + across), tuple(point - 0.8 * along - across)]
            self.draw.polygon(head, palette.TEXT)
            self.draw.text((middle[0] + 1.4 * self.unit, y), "N", palette.TEXT, letters, "lm")

    def swatches(self, words: str, steps: Sequence[tuple[str, tuple[int, ...]]]) -> None:
        """Draw fields of colours, each with its text, at the lower right, and words above them."""
        wide, letters = 2.6 * self.unit, font(round(0.95 * self.unit))
        left, y = self.width - self.unit - wide * len(steps), self.height - 2.6 * self.unit
        self.draw.text((self.width - self.unit, y - 0.4 * self.unit), words, palette.TEXT, letters, "rs")
        for k, (text, colour) in enumerate(steps):
            x = left + k * wide
            self.draw.rectangle((x, y, x + wide, y + self.unit), colour)
            self.draw.text((x + 0.5 * wide, y + 1.2 * self.unit), text, palette.TEXT, letters, "ma")


def round_length(value: float) -> float:
    """Return 1, 2 or 5 times a power of ten, the one nearest to a value on a logarithmic scale.

    >>> round_length(3.4), round_length(0.9), round_length(24.0)
    (5.0, 1.0, 20.0)
    """
    power = 10.0 ** math.floor(math.log10(value))
    return min((power * step for step in (1.0, 2.0, 5.0, 10.0)), key=lambda length: abs(math.log(length / value)))
