"""Buildings as people write them, taken through the page of `evac edit`: opened, saved, edited, undone."""

import random
from pathlib import Path

ROOT = Path(__file__).parents[2]
CASE = """\
title = "Generated"

[building]
mesh = "a.plan.toml"  # beside this file

[[people]]
name = "all"
level = "s0"
number = {number}

[contact]
model = "nsm2"

[simulation]
duration = 60.0  # [s]
"""

#: A function of the page that makes random edits.
EDITS = (Path(__file__).parent / "edits.js").read_text("utf-8").partition("\n")[2]


def building(seed):
    """Return a plan file as somebody may have written it by hand."""
    draw = random.Random(seed)

    def number(value):
        return draw.choice([f"{value:g}", f"{value:.1f}", f"{value:.2f}", f"{value:.3f}"])

    def ring(x1, y1, x2, y2):
        corners = [(x1, y1), (x2, y1), (x2, y2), (x1, y2)]
        if draw.random() < 0.3:
            return '"POLYGON ((' + ", ".join(f"{x:g} {y:g}" for x, y in [*corners, corners[0]]) + '))"'
        gap = draw.choice([", ", ",", ",\n    "])
        return "[" + gap.join(f"[{number(x)}, {number(y)}]" for x, y in corners) + draw.choice(["]", ",]"])

    def comment():
        return draw.choice(["", "", "  # as measured", "   # [m], see 'A-101'"])

    def head(name, *lines):
        above = draw.choice(["", "", "# What follows was drawn first.\n"])
        pairs = "".join(f"{line}{comment()}\n" if "\n" not in line else f"{line}\n" for line in lines)
        return f"{above}[[{name}]]{comment()}\n{pairs}" + "\n" * draw.randint(1, 2)

    columns, storeys, wide, deep = (
        draw.randint(1, 4),
        draw.randint(1, 3),
        draw.choice([3.0, 4.5]),
        draw.choice([3.0, 6.0]),
    )
    parts = [draw.choice(["# A generated building.\n\n", "", "headroom = 2.1 # clear\n\n"])]
    rest = []
    for k in range(storeys):
        own = [f'name = "s{k}"', f"z = {number(3.0 * k)}"]
        if k and draw.random() < 0.4:
            parts.append(head("storeys", *own, f'like = "s{k - 1}"'))
            continue
        parts.append(head("storeys", *own, *draw.choice([[], ["wall = 0.10"]])))
        on = f"storey = 's{k}'"
        for c in range(columns):
            use = draw.choice([[], ['use = "office"'], [f"people = {draw.randint(1, 5)}"]])
            shape = ring(c * wide, 2.0, (c + 1) * wide, 2.0 + deep)
            rest.append(head("rooms", f'name = "r{c}"', on, f"polygon = {shape}", *use))
            tie = f"{{ rooms = ['r{c}', \"corridor\"], at = {number(wide / 2)}, width = 0.9 }}"
            line = f"[[{number(c * wide + 1)}, 2], [{number(c * wide + 2)}, 2.00]]"
            rest.append(head("doors", f'name = "d{c}"', on, f"segment = {draw.choice([tie, line])}"))
        rest.append(head("rooms", 'name = "corridor"', on, f"polygon = {ring(0.0, 0.0, columns * wide, 2.0)}"))
        if draw.random() < 0.5:
            rest.append(head("areas", f'name = "a{k}"', on, f"polygon = {ring(0.2, 0.2, 1.0, 1.0)}"))
        if draw.random() < 0.5:
            rest.append(head("obstacles", 'name = "desk"', on, f"polygon = {ring(1.0, 3.0, 1.8, 3.5)}"))
    rest.append(head("exits", 'name = "way out"', "storey = 's0'", "segment = [[0, 0.50], [0.0, 1.5]]"))
    if storeys > 1:
        foot = ["foot = [1, 1]", "width = 1.2", "direction = [1, 0]", "rise = 0.17", "going = 0.28"]
        rest.append(head("shafts", 'name = "stair"', "lower = 's0'", f'upper = "s{storeys - 1}"', *foot))
    draw.shuffle(rest)
    text = "".join([*parts, *rest])
    return text.replace("\n", "\r\n") if draw.random() < 0.2 else text


def written(seed, folder):
    """Write a generated case to a folder."""
    folder.mkdir(parents=True)
    (folder / "a.plan.toml").write_bytes(building(seed).encode())
    (folder / "case.toml").write_text(CASE.format(number=5))
    return folder


def taken_through(page, seed):
    """Open a case of the page, save it, edit it, save and read it again, undo all, and save; raise where it differs."""
    session = page.server.session
    files = {session.file, session.case_file}
    first, table = {file: file.read_bytes() for file in files}, page.plan

    def save():
        assert page.browser.run("editor.act.save()"), page.text("#banner-text")
        return {file: file.read_bytes() for file in files}

    assert save() == first
    steps = page.run(f"({EDITS})({seed})")
    edited = page.plan
    page.run("while (editor.store.past.length) editor.store.undo()")
    check_same(page.plan, table)
    assert save() == first
    page.run("while (editor.store.future.length) editor.store.redo()")
    save()
    check_same(session.document()["table"], edited)
    page.run("while (editor.store.past.length) editor.store.undo()")
    save()
    check_same(session.document()["table"], table)
    return steps


def check_same(found, wanted):
    """Check that tables are the same; name the sections that differ."""
    assert [key for key in {*found, *wanted} if found.get(key) != wanted.get(key)] == [], (found, wanted)
