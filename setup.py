"""The packages: everything below evac, and two folders that are installed as evac_plugins and evac_buildings."""

from setuptools import find_packages, setup

setup(packages=[*find_packages(include=["evac", "evac.*"]), "evac_plugins", "evac_buildings"])
