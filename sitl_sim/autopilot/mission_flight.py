"""A mission in flight: the present item, its velocity, and the items that were reached.

The routine calls it once a tick while its mode is MISSION; it never changes a mode or arms by itself.

Positions are north-east-down about the scenario's home; heights count from the vehicle's own home.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum

from ridlink.geodesy import ned_from_geodetic
from sitl_sim.autopilot.board import Board
from sitl_sim.autopilot.guidance import Climb, Descend, GoTo, Guidance, Nose, SteeringEstimate, Velocity
from sitl_sim.autopilot.home import Home
from sitl_sim.autopilot.mission_items import NAVIGATION, Item, MissionItem
from sitl_sim.autopilot.speeds import Speeds

AT_ONCE = 64
"""Limit of items per tick; more mean an endless loop of jumps."""

_NO_MISSION, _NOT_STARTED, _ACTIVE, _PAUSED, _COMPLETE = 1, 2, 3, 4, 5
"""MISSION_STATE."""

_COME_DOWN = (Item.LAND, Item.RETURN_TO_LAUNCH)
"""Items that end on the ground."""

_OVERHEAD_M = 1.0
"""Distance to its point within which a landing descends."""


class End(Enum):
    """Reasons why there is no velocity to fly. The return home is another mode in PX4 alone."""

    FINISHED = "finished"
    RETURN = "return"


class MissionFlight:
    """The mission of one vehicle.

    Args:
        board: The flight controller. ArduPilot's item 0 is home, and it begins with item 1. An item 0 that is no
            placeholder for home is flown here: a real one would lose it, and so MAVSDK's mission plugin its first
            waypoint.
        home: Its home.
        speeds: Its speeds; DO_CHANGE_SPEED changes them.
        nose: Its heading.

    Attributes:
        plan: Its items.
        current: Sequence number of the present item.
        reached: Items that were reached and are not reported yet.
        is_flown: Whether the mode is MISSION; `is_paused`: whether it is paused there.
    """

    def __init__(self, board: Board, home: Home, speeds: Speeds, nose: Nose) -> None:
        self._board, self._home, self._speeds, self._nose = board, home, speeds, nose
        self.plan: tuple[MissionItem, ...] = ()
        self.current = 0
        self.reached: list[int] = []
        self.is_flown = self.is_paused = False
        self._first = 0
        self._begun = self._complete = self._held = False
        self._leg: Guidance | None = None
        self._until_s: float | None = None
        self._jumps: dict[int, int] = {}

    # --- the plan -----------------------------------------------------------------------------------------------------

    @property
    def exists(self) -> bool:
        """Whether there are items to fly."""
        return len(self.plan) > self._first

    @property
    def is_complete(self) -> bool:
        """Whether its last item has been flown."""
        return self.exists and self._complete

    @property
    def is_running(self) -> bool:
        """Whether it is flown and not over; a pause does not end it."""
        return self.is_flown and self.exists and not self._complete

    @property
    def returns(self) -> bool:
        """Whether the present item is the return home."""
        return self.exists and self.plan[self.current].command == Item.RETURN_TO_LAUNCH

    @property
    def begins_with_takeoff(self) -> bool:
        """Whether the first item that takes time is a take-off."""
        first = next((item for item in self.plan[self._first :] if item.command in NAVIGATION), None)
        return first is not None and first.command == Item.TAKEOFF

    def load(self, items: Sequence[MissionItem]) -> None:
        """Load a mission and start with its first item."""
        begins_with_home = bool(items) and not self._board.is_px4 and _is_home(items[0])
        if begins_with_home:
            items = [self._home_item(), *items[1:]]
        self._first = int(begins_with_home)
        self.plan = tuple(items)
        self._rewind()

    def replace(self, first: int, items: Sequence[MissionItem]) -> None:
        """Replace items from `first` on, and continue at the present item."""
        if not self.plan:
            return self.load(items)
        plan = [*self.plan[:first], *items, *self.plan[first + len(items) :]]
        if first == 0 and self._first:
            plan[0] = self._home_item()
        self.plan = tuple(plan)
        if first <= self.current < first + len(items):
            self._go_on_with(self.current)

    def home_moved(self) -> None:
        """Move the item for home to the present home."""
        if self._first:
            self.plan = (self._home_item(), *self.plan[1:])

    def item(self, seq: int) -> MissionItem | None:
        """The item with this number, None if there is none. ArduPilot has its home as item 0 of no mission, too."""
        if seq < len(self.plan):
            return self.plan[seq]
        return self._home_item() if seq == 0 and not self._board.is_px4 else None

    def _home_item(self) -> MissionItem:
        home = self._board.own_home
        x, y = round(home.latitude_deg * 1e7), round(home.longitude_deg * 1e7)
        return MissionItem(Item.WAYPOINT, 0, (0.0, 0.0, 0.0, 0.0), x, y, home.altitude_m)

    def _rewind(self) -> None:
        self._go_on_with(self._first if self.exists else 0)
        self._begun = self._complete = False
        self._jumps.clear()

    def _go_on_with(self, seq: int) -> None:
        self.current = seq
        self._leg = self._until_s = None
        self._held = False

    def set_current(self, seq: int) -> bool:
        """Continue with an item; False if there is none."""
        if not 0 <= seq < len(self.plan):
            return False
        self._go_on_with(max(seq, self._first) if self.exists else seq)
        self._complete = False
        return True

    def current_fields(self) -> dict[str, object]:
        """Fields of MISSION_CURRENT."""
        if not self.exists:
            state = _NO_MISSION
        elif self.is_complete:
            state = _COMPLETE
        elif self.is_flown and not self.is_paused:
            state = _ACTIVE
        else:
            state = _PAUSED if self._begun else _NOT_STARTED
        total = max(len(self.plan) - self._first, 0)
        return {"seq": self.current, "total": total, "mission_state": state, "mission_mode": 1 if self.is_flown else 2}

    def change_pace(self) -> None:
        """Take up the present speeds on the way that is flown."""
        if isinstance(self._leg, GoTo):
            self._leg = self._speeds.way_to(self._leg.target_ned_m)

    # --- in flight ----------------------------------------------------------------------------------------------------

    def begin(self) -> None:
        """Begin, or continue where it was left; a complete mission begins again.

        PX4 then flies at the speed of the last item for it before the present one; ArduPilot at that of its parameter.

        Source: MissionBase::on_activation of PX4, ModeAuto::init of ArduPilot.
        """
        if self._complete:
            self._rewind()
        before = reversed(self.plan[self._first : self.current] if self._board.is_px4 else ())
        if (item := next((each for each in before if each.command == Item.CHANGE_SPEED), None)) is not None:
            self._speeds.change(item.parameters[0], item.parameters[1])
        self._begun = True
        self._leg = None

    def landed(self) -> None:
        """Note that the vehicle touched the ground."""
        if not self._complete and self.plan and self.plan[self.current].command in _COME_DOWN:
            self._arrive()

    def step(self, estimate: SteeringEstimate, now_s: float, *, grounded: bool) -> Guidance | End:
        """The manoeuvre to fly now.

        Args:
            estimate: Its steering estimate.
            now_s: Monotonic time.
            grounded: Whether it is on the ground.
        """
        for _ in range(AT_ONCE):
            if self._complete or not self.exists:
                return End.FINISHED
            item = self.plan[self.current]
            if item.command not in NAVIGATION:
                self._do(item)
                continue
            if item.command == Item.RETURN_TO_LAUNCH and self._board.is_px4:
                self._arrive()
                return End.RETURN
            if self._leg is None:
                self._leg = self._leg_of(item, estimate, grounded)
            if not self._is_there(item, estimate) or not self._has_waited(item, now_s):
                return self._leg or Velocity()
            self._arrive()
        return Velocity()

    def _arrive(self) -> None:
        if not self._held:
            self.reached.append(self.current)
        if self.current + 1 < len(self.plan):
            self._go_on_with(self.current + 1)
        else:
            self._complete = True
            self._leg = None

    def _do(self, item: MissionItem) -> None:
        """Execute an item that takes no time."""
        match item.command:
            case Item.CHANGE_SPEED:
                self._speeds.change(item.parameters[0], item.parameters[1])
            case Item.CONDITION_YAW:
                yaw_deg, _, direction, relative = item.parameters
                self._nose.turn_degrees(yaw_deg, relative=relative == 1.0, direction=direction)
            case Item.JUMP:
                done, wanted = self._jumps.get(self.current, 0), item.parameters[1]
                if wanted < 0 or done < wanted:
                    self._jumps[self.current] = done + 1
                    self.reached.append(self.current)
                    self._go_on_with(max(int(item.parameters[0]), self._first))
                    return
        self._arrive()

    def _leg_of(self, item: MissionItem, estimate: SteeringEstimate, grounded: bool) -> Guidance | None:
        if item.command == Item.DELAY:
            return Velocity()
        if item.command == Item.TAKEOFF:
            return Climb(self._height_m(item), self._speeds.takeoff_mps)
        if grounded and item.command in _COME_DOWN:
            return Descend()
        if grounded and self._board.is_px4:  # first straight up to the height of the waypoint
            return Climb(max(self._height_m(item), self._board.parameters["MIS_TAKEOFF_ALT"]), self._speeds.takeoff_mps)
        if item.command == Item.RETURN_TO_LAUNCH:
            climb = Climb(self._speeds.return_height_m, self._speeds.climb_mps)
            return self._home.way(estimate, self._speeds) if climb.is_done(estimate) else climb
        if item.command == Item.LAND and item.latitude_longitude_deg is None:
            return Descend()
        if self._board.is_px4 and (yaw := item.parameter(4)) is not None:
            self._nose.turn_degrees(yaw)
        north, east, down = self.place_ned_m(item, estimate)
        return self._speeds.way_to((north, east, estimate.down_m if item.command == Item.LAND else down))

    def _is_there(self, item: MissionItem, estimate: SteeringEstimate) -> bool:
        match self._leg:
            case Climb() if self._leg.is_done(estimate):
                if item.command == Item.TAKEOFF:
                    return True
                self._leg = self._leg_of(item, estimate, grounded=False)
            case GoTo() if item.command in _COME_DOWN:
                if self._leg.distance_m(estimate) < _OVERHEAD_M:
                    self._leg = Descend(self._leg.target_ned_m[:2])
            case GoTo():
                radius_m = item.parameter(2) if item.command == Item.WAYPOINT else None
                return self._leg.distance_m(estimate) < max(radius_m or self._speeds.acceptance_radius_m, 0.2)
            case Velocity():
                return True
        return False

    def _has_waited(self, item: MissionItem, now_s: float) -> bool:
        if item.command == Item.LOITER_UNLIMITED:
            if not self._held:
                self._held = True
                self.reached.append(self.current)
            return False
        waits = item.command in (Item.WAYPOINT, Item.SPLINE_WAYPOINT, Item.LOITER_TIME, Item.DELAY)
        if self._until_s is None:
            self._until_s = now_s + (max(item.parameter(1) or 0.0, 0.0) if waits else 0.0)
        return now_s >= self._until_s

    def _height_m(self, item: MissionItem) -> float:
        return item.z - (self._board.own_home.altitude_m if item.is_above_sea else 0.0)

    def place_ned_m(self, item: MissionItem, estimate: SteeringEstimate) -> tuple[float, float, float]:
        """Where an item with a position is; without one it is where the vehicle is, at the height of the item."""
        where = item.latitude_longitude_deg
        if where is None:
            return estimate.north_m, estimate.east_m, -self._height_m(item)
        home = self._board.scenario_home
        north, east, _ = ned_from_geodetic(*where, home.altitude_m, home).tolist()
        return north, east, -self._height_m(item)


def _is_home(item: MissionItem) -> bool:
    """Whether an item 0 is the placeholder for home that clients of ArduPilot write."""
    return item.command == Item.WAYPOINT and (item.is_above_sea or item.latitude_longitude_deg is None)
