"""The built-in plugins of evac, which are registered in the same way as third-party plugins."""

#: The version of the interface that all modules of the package were written for.
evac_interface = 3
