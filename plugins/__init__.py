"""The built-in plugins of evac, registered exactly as a third party's."""
