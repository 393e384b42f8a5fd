"""Figures 2 and 3 of the paper reproduced: a disc that hits the ground, two people who walk into each other."""

from functools import cache
from typing import Any

import numpy as np

from evac.base.arrays import FloatArray
from evac.evidence.evidence import MODEL_COLOURS, Evidence, Row, new_figure
from evac.evidence.scenes import make_engine, make_model
from evac.evidence.verdicts import reported
from evac.physics.contact.model import ContactModel
from evac.physics.scenes import one_direction, room
from evac.physics.state import Crowd, World, make_crowd
from evac.physics.world import make_world

PLANE = (-10.0, -10.0, 10.0, 10.0)  # m
STEP = 0.01  # s, of both figures

#: Figure 2: a disc of this radius starts here with unit speed, 45 degrees downwards.
RADIUS = 0.22
START = 0.5

#: Figure 3: relaxation times, sideways offset of the two and their speed; the paper prints no numbers.
TAUS = (0.1, 0.25, 0.5)
OFFSET = 0.1
SPEED = 1.5
DURATION = 4.0
BACK = "back at 95 % of its velocity after [s]"


#: Time at which the disc of figure 2 touches the ground [s].
HIT = (START - RADIUS) * float(np.sqrt(2.0))


def draw_figure_2(evidence: Evidence) -> None:
    """Add the disc that hits the ground, NSM1 beside NSM2 (K_N = K_T = 0)."""
    rows = evidence.measured("figure2", lambda: _figure_2()[0])
    text = ", ".join(f"{row['gap after contact [mm]']:z.3f} mm ({row['model']})" for row in rows)
    evidence.verdict(reported("Gap after hitting the ground", text, "-", "Figure 2 of the paper"))
    formats = {key: "z.6f" for key in rows[0] if key != "model"}
    evidence.show("figure_2", __name__, rows=rows, formats=formats, draw=lambda: _figure_2()[1])


@cache
def _figure_2() -> tuple[list[Row], Any]:
    figure, axes = new_figure(9.0, 3.8, 1, 2)
    rows = []
    for name in ("NSM1 inertial", "NSM2"):
        position, velocity = _hit_ground(name)
        step = np.arange(len(position))
        axes[0].plot(position[:, 0], position[:, 1], ".-", color=MODEL_COLOURS[name], label=name)
        jump: Any = "mid" if name == "NSM2" else "pre"  # where between two steps the velocity changes
        axes[1].step(step * STEP, velocity[:, 1], ".-", where=jump, color=MODEL_COLOURS[name], label=name)
        before = int(HIT / STEP)
        rows.append(
            {
                "model": name,
                "y before contact [m]": position[before, 1],
                "y after contact [m]": position[before + 1, 1],
                "gap after contact [mm]": 1e3 * (position[before + 1, 1] - RADIUS),
                "u_y one step after [m/s]": velocity[before + 1, 1],
                "u_y two steps after [m/s]": velocity[before + 2, 1],
                "x at 0.8 s [m]": position[80, 0],
            }
        )
    axes[0].axhline(RADIUS, color="0.5", linewidth=0.8)
    axes[0].set(xlim=(0.72, 0.84), ylim=(0.2195, 0.2305), xlabel="x [m]", ylabel="y of the centre [m]")
    axes[1].axvline(HIT, color="0.5", linewidth=0.8)
    axes[1].set(xlim=(0.37, 0.43), xlabel="t [s]", ylabel="velocity along y [m/s]")
    axes[0].legend(frameon=False)
    return rows, figure


def draw_figure_3(evidence: Evidence) -> None:
    """Add two people who walk into each other, for several tau, under NSM2."""
    rows = evidence.measured("figure3", lambda: _figure_3()[0])
    text = ", ".join(f"{row[BACK]:.2f} s (tau {row['tau [s]']:g} s)" for row in rows)
    evidence.verdict(
        reported("NSM2: time to 95 % of the desired velocity after a hit", text, "-", "Figure 3 of the paper")
    )
    evidence.show("figure_3", __name__, rows=rows, draw=lambda: _figure_3()[1])


@cache
def _figure_3() -> tuple[list[Row], Any]:
    figure, axes = new_figure(9.0, 3.8, 1, 2)
    rows = []
    for tau, colour in zip(TAUS, ("#0072B2", "#D55E00", "#009E73"), strict=True):
        time, position, velocity = _meet(tau)
        for person, style in ((0, "-"), (1, "--")):
            label = f"tau = {tau} s" if person == 0 else None
            axes[0].plot(position[:, person, 0], position[:, person, 1], style, color=colour, label=label)
        axes[1].plot(time, velocity[:, 0, 0], "-", color=colour)
        struck = int(np.argmax(velocity[:, 0, 0] < 0.5 * SPEED))
        back = struck + int(np.argmax(velocity[struck:, 0, 0] > 0.95 * SPEED))
        rows.append(
            {
                "tau [s]": tau,
                "first hit [s]": time[struck],
                BACK: time[back] - time[struck],
                "drift sideways [m]": position[-1, 0, 1] - position[0, 0, 1],
            }
        )
    axes[0].set(xlabel="x [m]", ylabel="y [m]")
    axes[1].set(xlabel="t [s]", ylabel="velocity along x of the first [m/s]")
    axes[0].legend(frameon=False)
    return rows, figure


def _hit_ground(name: str) -> tuple[FloatArray, FloatArray]:
    ground = [[PLANE[0], 0.0, PLANE[2], 0.0]]
    crowd = make_crowd([[START, START]], [[np.sqrt(0.5), -np.sqrt(0.5)]], radius=RADIUS, tau=1e12, speed=0.0)
    model = make_model(name, normal_dissipation=0.0) if name == "NSM2" else make_model(name, gap_tolerance=1e-12)
    position, velocity = _walked(model, make_world(room(PLANE, ground), one_direction(PLANE)), crowd, 80)
    return position[:, 0], velocity[:, 0]


def _meet(tau: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    start = [[-1.5, 0.5 * OFFSET], [1.5, -0.5 * OFFSET]]
    crowd = make_crowd(start, [[SPEED, 0.0], [-SPEED, 0.0]], radius=0.25, tau=tau, speed=SPEED)
    crowd.route[1] = 1
    world, steps = make_world(room(PLANE), one_direction(PLANE, (1.0, 0.0), (-1.0, 0.0))), round(DURATION / STEP)
    return STEP * np.arange(steps + 1.0), *_walked(make_model("NSM2"), world, crowd, steps)


def _walked(model: ContactModel, world: World, crowd: Crowd, steps: int) -> tuple[FloatArray, FloatArray]:
    engine = make_engine(world, len(crowd.level))
    states = [(crowd.position.copy(), crowd.velocity.copy())]
    for step in range(steps):
        engine.advance(model, crowd, step, 1, STEP, False, False)
        states.append((crowd.position.copy(), crowd.velocity.copy()))
    position, velocity = map(np.array, zip(*states, strict=True))
    return position, velocity
