import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image

from evac.pictures import palette
from evac.pictures.writing import Pen, legible, save


@pytest.mark.parametrize(
    ("text", "shown", "names"),
    [
        ("exit 'north' 1.20 m, Łódź, Αθήνα, Выход", "exit 'north' 1.20 m, Łódź, Αθήνα, Выход", []),
        ("level '1階' at (2.72, 1.40)", "level '[1]' at (2.72, 1.40)", ["1階"]),
        ("東口 1.20 m\n西口, 東口", "[1] 1.20 m\n[2], [1]", ["東口", "西口"]),
    ],
)
def test_words_that_the_font_lacks_are_numbers(text, shown, names):
    found = []
    assert legible(text, found) == shown
    assert found == names


def test_a_picture_has_the_list_of_its_numbers_beside_it(tmp_path):
    figures = [Figure((2.0, 1.0)) for _ in range(2)]
    for figure, words in zip(figures, ("東口: 階段", "[1]: [2]"), strict=True):
        figure.text(0.1, 0.5, words)
    pictures = [tmp_path / "names.png", tmp_path / "numbers.png"]
    for figure, path in zip(figures, pictures, strict=True):
        save(figure, path)  # without a warning about glyphs, which would be an error here
    assert (tmp_path / "names.png.txt").read_text(encoding="utf-8") == "[1] 東口\n[2] 階段\n"
    assert not (tmp_path / "numbers.png.txt").exists()
    one, other = (Image.open(path).tobytes() for path in pictures)
    assert one == other
    assert figures[0].texts[0].get_text() == "東口: 階段"


class Noted:
    """What a pen draws, instead of drawing it."""

    def __init__(self):
        self.calls = []

    def __getattr__(self, kind):
        return lambda *given, **_: self.calls.append((kind, *given))

    def of(self, kind):
        return [given for one, *given in self.calls if one == kind]


@pytest.mark.parametrize(("scale", "length"), [(20.0, 5.0), (7.0, 20.0), (200.0, 0.5)])
@pytest.mark.parametrize("north", [None, (0.0, -1.0), (0.6, 0.8)])
def test_the_scale_bar_is_as_long_as_it_says_and_the_arrow_points_north(scale, length, north):
    pen = Pen(Image.new("RGB", (1000, 800)))
    pen.draw = noted = Noted()
    pen.scale_bar(scale, None if north is None else np.array(north))
    lines = [np.array(points) for points, *_ in noted.of("line")]
    assert np.ptp(lines[0][:, 0]) == pytest.approx(length * scale)
    assert [np.ptp(tick[:, 0]) for tick in lines[1:3]] == [0.0, 0.0]
    texts = {words: place for place, words, *_ in noted.of("text")}
    assert f"{length:g} m" in texts
    assert ("N" in texts) == (north is not None)
    if north is None:
        assert len(lines) == 3
        assert not noted.of("polygon")
        return
    shaft, ((corners, colour),) = lines[3], noted.of("polygon")
    assert colour == palette.TEXT
    point, *others = np.array(corners)
    whole = point - shaft[0]
    assert whole == pytest.approx(2.2 * pen.unit * np.array(north))  # from end to end of the arrow
    assert (np.dot(np.array(others) - point, north) < 0.0).all()
    assert 0.0 < np.dot(shaft[1] - shaft[0], north) < np.dot(whole, north)
    assert np.mean(others, axis=0) == pytest.approx(point - 0.88 * pen.unit * np.array(north))


@pytest.mark.parametrize(
    ("place", "inside"),
    [((200, 100), True), ((-30, 100), False), ((420, 100), False), ((200, -9), False), ((200, 320), False)],
)
def test_labels_are_moved_into_the_picture(place, inside):
    image = Image.new("RGB", (400, 300))
    pen = Pen(image)
    draw, pen.draw = pen.draw, Noted()
    pen.draw.textbbox = draw.textbbox
    pen.label("a label", np.array(place, float), "mm", "black")
    ((at, words, _, letters, anchor),) = (given[:5] for given in pen.draw.of("text"))
    assert (at == place) == inside
    x1, y1, x2, y2 = draw.textbbox(at, words, letters, anchor)
    assert min(x1, y1) >= 4.0
    assert (x2 <= 396.0, y2 <= 296.0) == (True, True)
    moved = np.subtract(at, place) != 0.0
    assert moved.sum() == (0 if inside else 1)  # no farther than needed, and along the side
