"""Result folders: ownership, the names of files, checkpoint files."""
