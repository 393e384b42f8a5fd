"""A law of the speed in smoke."""

from evac import SmokeLaw


class Half(SmokeLaw):
    """Half the speed in smoke that can be seen."""

    name = "half"

    def speed(self, desired, extinction):
        """Return the speeds [m/s]."""
        return desired * (1.0 - 0.5 * (extinction > 0.1))


evac_interface = 3
