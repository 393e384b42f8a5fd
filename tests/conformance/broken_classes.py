"""Classes that are no plugins, and plugins with invalid declarations."""

import sys
from types import ModuleType

from evac.base.errors import PluginError
from evac.base.parameters import Configurable, Parameter
from tests.conformance.broken import Broken, odd, raising
from tests.conformance.broken_behaviours import Slower
from tests.conformance.broken_contact_models import Bounce


def forgets(self, **values):
    """Do not set the parameters."""


def refuses(self, **values):
    """Refuse large values."""
    super(Bounce, self).__init__(**values)
    if self.stiffness > 1.3e5:
        raise PluginError("too stiff")


def module():
    """Return the name of a module with hooks of another version of the interface."""
    made = ModuleType("module_of_1")
    made.evac_contact_models = list
    made.evac_interface = 1
    sys.modules[made.__name__] = made
    return made.__name__


def declaring(*given, **named):
    """Return a contact model with a parameter `softness`."""
    return odd(Bounce, softness=Parameter(*given, **named))


CONTRACT, SOFTNESS, MODULE = (
    ("check_contract", "the class"),
    ("check_construction", "the parameter softness"),
    "the module",
)
MADE = ("check_construction", "the class with its defaults")

BROKEN = [
    Broken(Bounce(), *CONTRACT, "is not a class; pass a class, such as Bounce"),
    Broken(odd(Configurable), *CONTRACT, "is not a plugin; derive it"),
    Broken(odd(Bounce, __doc__=" "), *CONTRACT, "no docstring; add one"),
    Broken(odd(Bounce, __module__=module()), "check_contract", MODULE, "version 1 .*; see .* adapt"),
    Broken(declaring(1.0, " "), *SOFTNESS, "no description; add doc"),
    Broken(declaring("a", "softness", choices=("b", "c")), *CONTRACT, "'a'; known: b, c.*; change its default"),
    Broken(odd(Bounce, step=Parameter(1.0, "step")), *CONTRACT, "the name of a method; rename"),
    Broken(odd(Bounce, __init__=forgets), *MADE, r"does not set the parameters; call super\(\)"),
    Broken(odd(Bounce, __init__=raising), *MADE, "partner", KeyError),
    Broken(
        odd(Bounce, __init__=refuses),
        "check_construction",
        "the class with stiffness = 200000.0",
        "too stiff; give other values",
        values={"stiffness": 2e5},
    ),
    Broken(
        Bounce,
        "check_construction",
        "the class with stiffness = -1.0",
        "must be greater than 0.0 kg/s2, got -1.0; give other values",
        values={"stiffness": -1.0},
    ),
    Broken(
        odd(Slower, name="route_choice"),
        "check_registration",
        "the class",
        "'route_choice' is provided .*; choose",
    ),
]
