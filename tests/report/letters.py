"""Sizes of the letters of figures that are saved."""

from contextlib import contextmanager
from unittest.mock import patch

from matplotlib.figure import Figure
from matplotlib.text import Text

#: Width of the text of a printed page, A4 without its margins [inches].
COLUMN = (210 / 25.4) - 2 * 60 / 96


@contextmanager
def noted_letters():
    """Yield a list with the least size of the letters of each figure as it is printed [points]."""
    found, save = [], Figure.savefig

    def noted(figure, *arguments, **options):
        texts = [text for text in figure.findobj(Text) if text.get_visible() and text.get_text().strip()]
        shrink = min(1.0, COLUMN / figure.get_figwidth())
        found.append(shrink * min(text.get_fontsize() for text in texts))
        return save(figure, *arguments, **options)

    with patch.object(Figure, "savefig", noted):
        yield found
