"""Pictures, films and maps of buildings and people."""
