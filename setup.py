"""The packages: everything below evac, and two folders that are installed as evac_plugins and evac_buildings."""

import shutil

from setuptools import find_packages, setup
from setuptools.command.build_py import build_py


class CleanBuild(build_py):
    """A build that does not take over modules of an earlier one, which may have been removed or renamed since."""

    def run(self):
        """Build into an empty folder."""
        shutil.rmtree(self.build_lib, ignore_errors=True)
        super().run()


setup(
    packages=[*find_packages(include=["evac", "evac.*"]), "evac_plugins", "evac_buildings"],
    cmdclass={"build_py": CleanBuild},
)
