"""Where a vehicle has its home, and its local frame about the ground below its start.

Units and axes: metres; north-east-down. Heights and LOCAL_POSITION_NED count from home.
"""

from __future__ import annotations

from dataclasses import replace

from sitl_sim.autopilot.board import Board
from sitl_sim.autopilot.navigation import Navigation, Vector


class Home:
    """The home of one vehicle.

    Args:
        board: Keeps it in degrees, for whoever tells or reads it.
        navigation: The vehicle's navigation solution at the start.
        down_m: How far below the scenario's home it is then.

    Attributes:
        origin_ned_m: It, and the origin of the local frame, about the scenario's home: the ground below the start.
        error_m: How far below the ground the estimator had it.
    """

    def __init__(self, board: Board, navigation: Navigation, down_m: float) -> None:
        self._board = board
        self.origin_ned_m: Vector = (board.spec.start_ned_m[0], board.spec.start_ned_m[1], 0.0)
        self.error_m = 0.0
        self.set(navigation, down_m)

    def set(self, navigation: Navigation, down_m: float = 0.0) -> None:
        """Heights count from where the estimator believes the ground now, as on the real ones: by how many metres the
        receiver is off at the start is not told as a height.

        Args:
            navigation: The vehicle's navigation solution.
            down_m: Of the vehicle.
        """
        error_m = navigation.position_ned_m[2] - down_m
        home = self._board.own_home
        self._board.own_home = replace(home, altitude_m=home.altitude_m + self.error_m - error_m)
        self.error_m = error_m

    def local(self, navigation: Navigation) -> Vector:
        """Where the vehicle believes to be, as LOCAL_POSITION_NED tells it."""
        north, east, down = self.about_origin(navigation.position_ned_m)
        return north, east, down - self.error_m

    def about_origin(self, place_ned_m: Vector) -> Vector:
        """A place about the scenario's home, in the local frame."""
        origin = self.origin_ned_m
        return place_ned_m[0] - origin[0], place_ned_m[1] - origin[1], place_ned_m[2] - origin[2]
