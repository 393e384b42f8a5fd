"""Each plugin passes the checks that evac applies to its own."""

import crowding
import dem_numpy
import hertz
import jacobi
import keep_right
import personal_space
import positions
import rooms
import spring_damper
import tangential_spring

from evac.conformance import check_plugin


def test_plugins_hold_to_the_contract():
    """Check each class in small scenes and in a shipped case."""
    check_plugin(crowding.Crowding)
    check_plugin(personal_space.PersonalSpace)
    check_plugin(keep_right.KeepRight)
    check_plugin(dem_numpy.DemNumpy)
    check_plugin(hertz.Hertz)
    check_plugin(tangential_spring.TangentialSpring)
    check_plugin(spring_damper.SpringDamper)
    check_plugin(jacobi.Jacobi)
    check_plugin(rooms.RoomsImporter)
    check_plugin(positions.PositionsExporter)
