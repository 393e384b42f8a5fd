"""What plugins rely on: the hooks, the registry, and what is required of plugin classes."""
