"""Typical mistakes in plugin files: each is a small change of a plugin that works, and what must be said about it."""

from typing import NamedTuple

from tests.conformance.sound import (
    BEHAVIOUR,
    BODY_FORCE,
    COMPILED_LAW,
    CONTACT,
    EXPORTER,
    IMPORTER,
    PAIR_FORCE,
    RECORDER,
    SOLVER,
)


class Mistake(NamedTuple):
    """A change of one of the plugins above, and what must be said about it.

    Attributes
    ----------
    plugin : str
        Source text of the plugin that works.
    old, new : str
        The text that is replaced.
    at : str
        Beginning of the line, or of the last of several, that must be named, without indentation.
    words : str
        Regular expression found in the message before file and line.
    remedy : str
        Regular expression found in the message after file and line.
    """

    plugin: str
    old: str
    new: str
    at: str
    words: str
    remedy: str

    @property
    def text(self) -> str:
        """Source text of the plugin with the mistake."""
        assert self.plugin.count(self.old) == 1
        return self.plugin.replace(self.old, self.new)

    @property
    def line(self) -> int:
        """Number of the line that must be named."""
        lines = [line.strip() for line in self.text.splitlines()]
        return max(k for k, line in enumerate(lines, start=1) if line.startswith(self.at))


ACT = "    def act(self, crowd, time):\n        crowd.speed_factor[:] *= self.factor\n"
DO = "crowd.speed_factor[:] *= self.factor"
CORRECT = "correct the plugin"
WRITE = "        np.savez(path, time=trajectory.time)\n        return [path]\n"
READS = (
    "    def read(self, path):\n        plan = Plan(path)\n"
    '        plan.storey("f", [box(0, 0, 5, 5)])\n        plan.exit("e", "f", [(0, 1), (0, 2)])\n        return plan\n'
)
RECORD = "simulation.population.crowd.position.mean()"
PAIR = "    return parameters[0] * nx, parameters[0] * ny\n"
SPRING = "    return -parameters[0] * gap\n"
PACKED = '    def cutoff(self):\n        """Return the gap."""\n        return 0.5\n'
SWEEP = "        sweep_up(problem)\n"
KERNELS = "section 'Kernels'"

MISTAKES = {
    # Files and classes
    "no_interface": Mistake(
        BEHAVIOUR, "evac_interface = 3\n", "", '"""A behaviour', "does not state", "write `evac_interface"
    ),
    "no_hookimpl": Mistake(BEHAVIOUR, "@hookimpl\n", "", "def evac_behaviours", "not marked", "@hookimpl"),
    "misspelt_hook": Mistake(
        BEHAVIOUR, "evac_behaviours", "evac_behaviors", "@hookimpl", "no hook 'evac_behaviors'", "'evac_behaviours'"
    ),
    "returns_an_object": Mistake(BEHAVIOUR, "[Slow]", "[Slow()]", "@hookimpl", "object of class Slow", "class itself"),
    "returns_nothing": Mistake(BEHAVIOUR, "return [Slow]", "[Slow]", "@hookimpl", "returns None", "return a list"),
    "no_name": Mistake(BEHAVIOUR, '    name = "tried"\n', "", "class Slow", "name is ''", "one word in lower case"),
    "default_out_of_range": Mistake(BEHAVIOUR, "(0.5", "(2.5", "factor =", "at most 1.0, got 2.5", "its default"),
    # Behaviours
    "act_signature": Mistake(BEHAVIOUR, "crowd, time", "crowd", "def act", r"act\(self, crowd\)", "crowd, time"),
    "no_act": Mistake(BEHAVIOUR, ACT, "    pass\n", "class Slow", "no effect", r"define act\(self, crowd, time\)"),
    "act_raises": Mistake(BEHAVIOUR, DO, "time > 0.15 and 1 / 0", "time", r"t = 0.200 s: .*division by zero", CORRECT),
    "act_exits": Mistake(BEHAVIOUR, DO, "raise SystemExit(0)", "raise", "SystemExit: 0", "raise an exception instead"),
    "writes_nan": Mistake(BEHAVIOUR, DO, "crowd.speed_factor[:] = np.nan", "def act", "wrote nan to", "must be finite"),
    "replaces_array": Mistake(
        BEHAVIOUR, DO, "crowd.speed_factor = 1.0", "crowd.", "speed_factor cannot be replaced", "write into the array"
    ),
    "undeclared_write": Mistake(
        BEHAVIOUR, DO, "crowd.extra_direction[:, 0] += 1", "crowd.", "is not declared", "add 'extra_direction'"
    ),
    "writes_what_it_reads": Mistake(BEHAVIOUR, DO, "crowd.position[:] += 1", "crowd.", "read-only", "add .* `writes`"),
    "undeclared_read": Mistake(
        BEHAVIOUR, DO, "crowd.speed_factor[crowd.level > 0] *= 0.5", "crowd.", "level is not declared", "add 'level'"
    ),
    "writes_position": Mistake(
        BEHAVIOUR, 'writes = ("', 'writes = ("position", "', "writes =", "cannot write", "known: .*speed_factor"
    ),
    "misspelt_array": Mistake(BEHAVIOUR, "position", "positions", "reads =", "'positions'", "did you mean 'position'"),
    "no_such_route": Mistake(
        BEHAVIOUR.replace('writes = ("', 'writes = ("route", "'),
        DO, "crowd.route[:] = 1", "def act", "wrote route 1", "must be from 0 to 0",
    ),
    # Forces
    "force_signature": Mistake(PAIR_FORCE, " ex, ey,", "", "@pair_force", "takes 6 arguments", "must take 8"),
    "force_returns_one": Mistake(PAIR_FORCE, ", parameters[0] * ny", "", "@pair_force", "returns float64", "64, f"),
    "force_undecorated": Mistake(PAIR_FORCE, "@pair_force\n", "", "def law", "must be a kernel", "decorate it"),
    "force_of_the_other_kind": Mistake(
        PAIR_FORCE, "@pair_force\ndef law(gap", "@body_force\ndef law(x, y, gap", "@body_force",
        r"must be a kernel \(float64", "decorate it",
    ),
    "force_allocates": Mistake(
        PAIR_FORCE, PAIR, "    return np.array([nx, ny])[0], 0.0\n", "return np", "numpy.array", KERNELS
    ),
    "force_nan": Mistake(
        PAIR_FORCE, PAIR, "    return math.sqrt(gap - 10.0), 0.0\n", "@pair_force", "force of .*nan", "finite numbers"
    ),
    "body_force_nan": Mistake(
        BODY_FORCE, "speed = math.sqrt(vx * vx", "speed = math.sqrt(-1.0 - vx * vx", "@body_force", "of .*nan", "finite"
    ),
    "force_misspelt_name": Mistake(
        PAIR_FORCE, PAIR, "    return strenght * nx, 0.0\n", "return strenght", "'strenght' is not defined", "the name"
    ),
    "force_no_cutoff": Mistake(PAIR_FORCE, PACKED, "", "class Repels", r"no cutoff\(\)", "add it"),
    "force_no_function": Mistake(PAIR_FORCE, "    pair = law\n", "", "class Repels", "names no function", "pair_force"),
    "packed_word": Mistake(
        PAIR_FORCE, PACKED, PACKED + "    def packed(self):\n        return [1.0, 'x']\n", "def packed",
        r"packed\(\) returns", "finite numbers in a float64 array",
    ),
    "cutoff_infinite": Mistake(PAIR_FORCE, "return 0.5", "return math.inf", "def cutoff", "returns inf", "finite"),
    # Contact laws
    "law_signature": Mistake(CONTACT, " reduced_mass,", "", "@pair_contact", "takes 3 arguments", "must take 4"),
    "law_returns_two": Mistake(CONTACT, SPRING, SPRING[:-1] + ", 0.0\n", "@pair_contact", "returns UniTuple", "float"),
    "law_attracts": Mistake(CONTACT, "-parameters[0]", "parameters[0]", "@pair_contact", "returns -.* N", "repulsive"),
    "law_nan": Mistake(
        CONTACT, SPRING, "    return parameters[0] * gap**1.5\n", "@pair_contact", "for the gap -", "a finite number"
    ),
    "law_nan_later": Mistake(
        CONTACT, SPRING, "    return -parameters[0] * gap * math.sqrt(0.5 - closing_speed)\n", "@pair_contact",
        "raises ValueError: .+ for the gap .* closing speed", "a finite number",
    ),
    "compiled_law_nan": Mistake(
        COMPILED_LAW, "state)\n    return", "state)\n    state.bodies.solved[0, 0] = h / 0.0\n    return", "@kernel",
        "sets the velocity .*inf.* of person", "must be finite",
    ),
    "law_raises": Mistake(
        CONTACT, SPRING, "    if gap < 0:\n        raise ValueError\n" + SPRING, "raise", "raise", "raise no exceptions"
    ),
    # Solvers
    "solver_unannotated": Mistake(
        SOLVER, "limit: int) -> int", "limit: int)", "@kernel", "no type annotation", "declare a kernel"
    ),
    "solver_returns_float": Mistake(
        SOLVER, "limit: int) -> int", "limit: int) -> float", "@kernel", r"not sweeps\(.*float64\)", "decorate it"
    ),
    "solver_function": Mistake(
        SOLVER.replace("@kernel", "def helper(p):\n    return p\n\n@kernel"), "made = 0", "made = helper(0)",
        "made = helper", "'helper'", "evac.jit.inner",
    ),
    # Recorders
    "record_raises": Mistake(RECORDER, RECORD, "self.rows.append(1)", "self.rows", "no attribute 'rows'", CORRECT),
    "record_writes": Mistake(
        RECORDER, RECORD, "simulation.population.crowd.position[:] += 1", "simulation", "read-only", "only read"
    ),
    # Importers
    "read_returns_nothing": Mistake(IMPORTER, "return plan", "pass", "def read", "returns None", "return a Plan"),
    "no_read": Mistake(IMPORTER, READS, "", "class Reads", r"no read\(\)", "add it"),
    "suffix_without_dot": Mistake(IMPORTER, '".zz"', '"zz"', "suffixes", r"\('zz',\)", "tuple of endings"),
    # Exporters
    "write_returns_nothing": Mistake(EXPORTER, "        return [path]\n", "", "def write", "None", "return the paths"),
    "write_writes_nothing": Mistake(
        EXPORTER, WRITE, "        return [path]\n", "def write", "no path of an existing file", "return the paths"
    ),
    "write_changes_data": Mistake(
        EXPORTER, WRITE, "        trajectory.radius[:] = 0\n" + WRITE, "trajectory", "read-only", "copy the arrays"
    ),
}  # fmt: skip

#: Solvers whose results are wrong: the run goes on with a stronger solver, and has a quality warning.
FALSE_SOLVERS = {
    "solves_nothing": SOLVER.replace(SWEEP, "        problem.residual = 0.0\n        return made\n"),
    "states_a_false_residual": SOLVER.replace(
        "    return made\n", "    problem.residual = 0.0\n    return made\n"
    ).replace("> tolerance", "> 1e3 * tolerance"),
    "returns_nan": SOLVER.replace(
        "    return made\n", "    problem.percussion[0] = 0.0 * problem.residual / 0.0\n    return made\n"
    ),
    "forgets_velocities": SOLVER.replace("    return made\n", "    problem.percussion[0] += 100.0\n    return made\n"),
}

#: Plugins that look odd and are valid.
VALID = {
    "behaviour": BEHAVIOUR,
    "pair_force": PAIR_FORCE,
    "body_force": BODY_FORCE,
    "contact": CONTACT,
    "compiled_law": COMPILED_LAW,
    "solver": SOLVER,
    "recorder": RECORDER,
    "importer": IMPORTER,
    "exporter": EXPORTER,
    "whole_numbers": PAIR_FORCE.replace(PAIR, "    return 0, 0\n"),
    "in_a_function": PAIR_FORCE.replace(
        "@pair_force\ndef law(gap, nx, ny, vx, vy, ex, ey, parameters):\n" + PAIR,
        "def make():\n    @pair_force\n    def law(gap, nx, ny, vx, vy, ex, ey, parameters):\n        return 0.0, 0.0\n"
        "    return law\nlaw = make()\n",
    ),
    "lambda": PAIR_FORCE.replace(
        "@pair_force\ndef law(gap, nx, ny, vx, vy, ex, ey, parameters):\n" + PAIR,
        "law = pair_force(lambda gap, nx, ny, vx, vy, ex, ey, parameters: (0.0, 0.0))\n",
    ),
    "prepares_only": BEHAVIOUR.replace(ACT, "    def prepare(self, scene):\n        scene.crowd.speed_factor[:] = 1\n"),
}
