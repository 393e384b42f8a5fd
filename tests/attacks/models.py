"""Attacks on building models: IFC files that are cut, garbled, or changed in their numbers, references and lines."""

import math
import random
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from evac.base.errors import BuildingError
from evac.simulation.assembly import read_building
from tests.ifcfiles import IfcFile, steps

FOREIGN = Path(__file__).parents[3] / "shared" / "data" / "foreign"
#: The files that are spoilt: one that is made, and real ones if they are there.
FILES = ("made", "ISO-Test-1-IFC2x3.ifc", "TallBuilding.ifc")
NUMBERS = ("0.", "-1.", "1E30", "1.E-9", "NAN", "-0.", "1E400", "4711.", "")


@dataclass(frozen=True)
class Case:
    """One change of one file, which a number determines."""

    file: str
    change: str
    seed: int

    def __str__(self) -> str:
        return f"{self.file}-{self.change}-{self.seed}"


#: What once went wrong.
CRASHERS: tuple[Case, ...] = ()


def cases(number: int, seed: int) -> Iterator[Case]:
    """Yield the crashers, then cases that the seed determines; each change in turn."""
    yield from CRASHERS
    generator = random.Random(seed)
    for k in range(number):
        file = FILES[k // len(CHANGES) % len(FILES)]
        yield Case(file, list(CHANGES)[k % len(CHANGES)], generator.randrange(10**6))


def run(case: Case, folder: Path) -> str:
    """Read a spoilt model: it makes a building whose levels have ground, or is refused with the name of the file."""
    generator = random.Random(f"{case}")
    path = folder / "model.ifc"
    path.write_text(CHANGES[case.change](_text(case.file), generator), encoding="latin-1")
    try:
        building = read_building(path, need_exit=False)
    except BuildingError as error:
        if "model.ifc" not in str(error):
            raise AssertionError(f"the message does not name the file: {error}") from error
        return "refused"
    assert all(level.polygon.area > 0.0 for level in building.levels)
    return "read"


@cache
def _text(file: str) -> str:
    if file != "made" and (FOREIGN / file).is_file():
        return (FOREIGN / file).read_text(encoding="latin-1")
    return made_model()


def made_model() -> str:
    """Return a model of two storeys with rooms, doors, and a straight and a winding stair and a ramp."""
    ifc = IfcFile()
    for k in range(2):
        z = 3.0 * k
        ifc.storey(f"L{k}", z)
        slab = ifc.box("IFCSLAB", "S", (0, 0, z - 0.2), (10, 6, z), predefined="FLOOR")
        ifc.opening((5, 1, z - 0.3), (9.5, 2.4, z + 0.1), wall=slab if k else None)
        wall = ifc.box("IFCWALL", "W", (0, 3, z), (10, 3.2, z + 3))
        ifc.opening((2, 3, z), (3, 3.2, z + 2.1), wall=wall, door="inner")
        ifc.space("front", [(0, 0), (10, 0), (10, 3), (0, 3)], z)
        ifc.space("back", [(0, 3.2), (10, 3.2), (10, 6), (0, 6)], z)
    ifc.opening((0, 1, 0), (0.2, 2, 2.1), door="main")
    solids = steps(ifc, (5, 1.7), (1, 0), 0.0, width=1.2, going=0.28, riser=3 / 17, count=16)
    ifc.body("IFCSTAIRFLIGHT", "up", *solids, tail=",$,17,16,0.17,0.28,.STRAIGHT.")
    ring = [[(20 + r * math.cos(t), 3 + r * math.sin(t)) for r, t in turn(k)] for k in range(12)]
    treads = [ifc.extruded(outline, 3 / 13 * k, 3 / 13) for k, outline in enumerate(ring)]
    ifc.body("IFCSTAIR", "round", *treads, tail=",$,.SPIRAL_STAIR.")
    ramp = ifc.lying([(10, -0.2), (13, 0.1), (13, 0.3), (10, 0.0)], 3.0, 1.5)
    ifc.body("IFCRAMP", "ramp", ramp, tail=",$,.STRAIGHT_RUN_RAMP.")
    for low, high in (((13, 0, 0.1), (22, 3, 0.3)), ((20.2, 3, 2.8), (22, 5, 3.0))):
        ifc.box("IFCSLAB", "P", low, high, predefined="FLOOR")
    return ifc.text()


def turn(k: int) -> list[tuple[float, float]]:
    """Return radius and angle of the corners of a tread of a spiral stair."""
    a, b = (math.radians(30 * s) for s in (k, k + 1))
    return [(0.2, a), (1.4, a), (1.4, b), (0.2, b)]


def _cut(text: str, generator: random.Random) -> str:
    return text[: generator.randrange(len(text))]


def _garbled(text: str, generator: random.Random) -> str:
    content = bytearray(text, "latin-1")
    for _ in range(generator.choice((1, 10, 100, 1000))):
        content[generator.randrange(len(content))] = generator.randrange(256)
    return content.decode("latin-1")


def _lines(text: str, generator: random.Random) -> str:
    """Leave out, repeat or exchange lines."""
    lines = text.splitlines()
    for _ in range(generator.choice((1, 5, 50))):
        if len(lines) < 2:
            break
        i, j = generator.randrange(len(lines)), generator.randrange(len(lines))
        what = generator.randrange(3)
        if what == 0:
            del lines[i]
        elif what == 1:
            lines.insert(j, lines[i])
        else:
            lines[i], lines[j] = lines[j], lines[i]
    return "\n".join(lines)


def _numbers(text: str, generator: random.Random) -> str:
    """Put odd numbers in the place of some."""
    many = generator.choice((1, 5, 50))
    found = list(re.finditer(r"-?\d+\.\d*(E-?\d+)?", text))
    for match in sorted(generator.sample(found, min(many, len(found))), key=lambda one: -one.start()):
        text = text[: match.start()] + generator.choice(NUMBERS) + text[match.end() :]
    return text


def _jitter(text: str, generator: random.Random) -> str:
    """Move every number that has a point by up to 1 mm or 1 cm."""
    size = generator.choice((0.001, 0.01, 0.1))
    return re.sub(
        r"(?<=[(,])-?\d+\.\d*(?=[,)])",
        lambda match: repr(round(float(match[0]) + generator.uniform(-size, size), 6)),
        text,
    )


def _references(text: str, generator: random.Random) -> str:
    """Let references point elsewhere, also in circles."""
    many = generator.choice((1, 5, 50))
    found = list(re.finditer(r"(?<=[(,])#\d+", text))
    for match in sorted(generator.sample(found, min(many, len(found))), key=lambda one: -one.start()):
        text = text[: match.start()] + generator.choice(found)[0] + text[match.end() :]
    return text


def _classes(text: str, generator: random.Random) -> str:
    """Turn elements into others."""
    names = ("IFCSPACE", "IFCSLAB", "IFCWALL", "IFCDOOR", "IFCSTAIRFLIGHT", "IFCOPENINGELEMENT", "IFCCOLUMN", "IFCROOF")
    found = list(re.finditer("|".join(rf"(?<==){name}(?=\()" for name in names), text))
    for match in sorted(generator.sample(found, min(3, len(found))), key=lambda one: -one.start()):
        text = text[: match.start()] + generator.choice(names) + text[match.end() :]
    return text


CHANGES = {
    "cut": _cut,
    "garbled": _garbled,
    "lines": _lines,
    "numbers": _numbers,
    "jitter": _jitter,
    "references": _references,
    "classes": _classes,
}
