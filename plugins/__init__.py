"""The built-in plugins of evac, which are registered in the same way as third-party plugins."""
