"""The arrays of plugins that a checkpoint contains."""

import reprlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evac.base.errors import PluginError, plugin_code


def state_of(plugin: Any, what: str, prefix: str) -> dict[str, NDArray[Any]]:
    """Return copies of the arrays that `state` of a plugin returns.

    Parameters
    ----------
    plugin : Behaviour, ContactModel or Recorder
    what : str
        Kind and name of the plugin, for the message.
    prefix : str
        Put before their names.

    Raises
    ------
    PluginError
        It fails, or returns something else than a dictionary of arrays.
    """
    with plugin_code(f"{what}: state", plugin):
        state = plugin.state()
    if not isinstance(state, dict):
        raise PluginError(f"{what}: state() returns {reprlib.repr(state)}; return a dict of arrays")
    for key, value in state.items():
        if not isinstance(value, np.ndarray | np.generic):
            raise PluginError(
                f"{what}: state() returns {reprlib.repr(value)} for {key!r}; return arrays, np.array(...) makes one"
            )
    return {f"{prefix}{key}": np.array(value) for key, value in state.items()}
