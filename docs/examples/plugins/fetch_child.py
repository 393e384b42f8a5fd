"""Parents go to a room first, and leave with their child: a goal of one's own."""

import numpy as np

from evac import Behaviour, Parameter, Route


class FetchChild(Behaviour):
    """The people of the group "parents" go to a room, where each takes along one of the group "children"."""

    name = "fetch_child"
    reads = ("position", "level")
    writes = ("route", "start_time")
    saved = ("_fetched",)
    room = Parameter("playroom", "area in which the children wait")
    reach = Parameter(3.0, "distance at which a child sees its parent", unit="m", above=0.0)

    def routes(self):
        """Return the way to the room, for which directions are computed."""
        return (Route(area=self.room),)

    def prepare(self, scene):
        """Send the parents to the room, and let the children wait."""
        self._scene, rows = scene.scene, {group.name: group.rows for group in scene.groups}
        self._parent, self._child = rows["parents"], rows["children"]
        self._home, self._fetched = scene.crowd.route[self._parent].copy(), np.zeros(len(self._parent), np.uint8)
        self._scene.send(self._parent, self.routes()[0])
        scene.crowd.start_time[self._child] = np.inf

    def act(self, crowd, time):
        """Let parents whom their child sees leave with it."""
        apart = np.hypot(*(crowd.position[self._parent] - crowd.position[self._child]).T)
        there = (crowd.level[self._parent] == crowd.level[self._child]) & (apart < self.reach) & (self._fetched == 0)
        for k in np.flatnonzero(there):
            self._scene.send(self._parent[k], self._scene.fields.routes[self._home[k]])
        crowd.start_time[self._child[there]], self._fetched[there] = time, 1


evac_interface = 3
