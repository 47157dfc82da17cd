"""Home and local frame of a vehicle.

Units and axes: metres; north-east-down. Home is the ground where the vehicle was armed, or below its start; heights
count from it. The origin of the local frame stays on the ground below the start, at the height of home.
"""

from __future__ import annotations

from dataclasses import replace

from ridlink.geodesy import Geodetic, geodetic_from_ned
from sitl_sim.autopilot.board import Board
from sitl_sim.autopilot.guidance import GoTo, SteeringEstimate
from sitl_sim.autopilot.navigation import Navigation, Vector
from sitl_sim.autopilot.speeds import Speeds


class Home:
    """The home of one vehicle.

    Args:
        board: Stores both in degrees for other parts.
        navigation: The vehicle's navigation solution at the start.
        down_m: Its down coordinate about the scenario's home at the start.

    Attributes:
        origin_ned_m: Origin of the local frame about the scenario's home.
        place_ned_m: Home about the scenario's home.
        error_m: Height error of the estimator at home, positive below the ground.
    """

    def __init__(self, board: Board, navigation: Navigation, down_m: float) -> None:
        self._board = board
        self.origin_ned_m: Vector = (board.spec.start_ned_m[0], board.spec.start_ned_m[1], 0.0)
        self.place_ned_m = self.origin_ned_m
        self.error_m = 0.0
        self.set(navigation, (*self.origin_ned_m[:2], down_m))

    def set(self, navigation: Navigation, here_ned_m: Vector) -> None:
        """Set home here. Heights count from the ground as the estimator has it now, as on the real ones, so a receiver
        error at the start does not show as a height.

        Args:
            navigation: The vehicle's navigation solution.
            here_ned_m: Its steering position, about the scenario's home.
        """
        north, east, down = here_ned_m
        error_m = navigation.position_ned_m[2] - down
        altitude_m = self._board.own_origin.altitude_m + self.error_m - error_m
        self._board.own_origin = replace(self._board.own_origin, altitude_m=altitude_m)
        latitude, longitude, _ = geodetic_from_ned((north, east, 0.0), self._board.scenario_home)
        self._board.own_home = Geodetic(float(latitude), float(longitude), altitude_m)
        self.place_ned_m, self.error_m = (north, east, 0.0), error_m

    def local(self, navigation: Navigation) -> Vector:
        """Estimated position, as in LOCAL_POSITION_NED."""
        north, east, down = self.about_origin(navigation.position_ned_m)
        return north, east, down - self.error_m

    def way(self, estimate: SteeringEstimate, speeds: Speeds) -> GoTo:
        """The way to above home, at this height."""
        return speeds.way_to((self.place_ned_m[0], self.place_ned_m[1], estimate.down_m))

    def about_origin(self, place_ned_m: Vector) -> Vector:
        """A position about the scenario's home, converted to the local frame."""
        origin = self.origin_ned_m
        return place_ned_m[0] - origin[0], place_ned_m[1] - origin[1], place_ned_m[2] - origin[2]
