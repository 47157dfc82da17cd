"""Vertical avoidance: leaving the height of a conflict that is hard to solve in the plane.

A neighbour is a cylinder: the disc of the pair, extended up and down by the vertical bound of the pair. The horizontal
velocity is decided first, as without this module. If that decision is bad (no admissible velocity, an overlap, a large
detour), or if a neighbour in conflict is leaving already, own-ship leaves the slab of height of the conflict. The
rules:

- the vehicle that will be higher in a moment climbs, the lower one descends; at equal heights the greater identity
  climbs. Both ends see the same heights, climb rates and identities, so they choose apart;
- all neighbours in conflict must give the same direction: between one above and one below own-ship does not leave;
- the slab can be left before the disc is entered. A neighbour that announces avoidance is counted on for half of the
    way; with any other, own-ship goes the whole way, against the climb that it reports;
- on that way there is no other cylinder, and no neighbour of unknown height at all;
- there is room for it in the band of heights.

The direction is held until the encounter is over, and two seconds more. Then own-ship returns to the altitude of its
goal, as far as that enters no cylinder that is not entered already.

Guaranteed, of reported positions: own-ship does not leave its band by this; from outside it comes no nearer to the
cylinder of a known neighbour in conflict than braking takes; it does not climb or descend to avoid while a neighbour of
unknown height is in conflict. Not guaranteed: that leaving is possible (in dense traffic it mostly is not, and with
vertical errors of tens of metres hardly ever in time), and that a neighbour that avoids also climbs. So the horizontal
decision stays in force against every neighbour not yet known to be apart: it holds the disc.

Heights in metres, positive upwards; own-ship is at zero; m/s, seconds.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Hashable, Sequence
from dataclasses import dataclass

GAIN_PER_S = 0.5
"""Vertical speed per metre to go: braking from 2 m/s then takes 1 m/s^2."""


@dataclass(frozen=True, slots=True)
class VerticalSettings:
    """Constants of vertical avoidance.

    Args:
        climb_mps: Fastest climb.
        descent_mps: Fastest descent. PX4 clips at 1.5 m/s.
        acceleration_mps2: Change of the vertical speed. ArduPilot takes 1 m/s^2, PX4 more.
        response_s: Delay before the vehicle moves.
        conflict_s: A neighbour is in conflict if its disc is entered within this time.
        look_s: A cylinder is in the way if its disc is entered within this time.
        foresee_s: Heights are compared this far ahead, so that a vehicle that already climbs or descends may go on.
        join_mps: If a neighbour in conflict that avoids climbs or descends this fast, own-ship goes the other way.
        equal_m: Heights nearer than this count as equal: both ends see them a tenth of a second apart and rounded.
        clearance_m: Height flown beyond the bound, so that the gate of the traffic picture opens and stays open.
        over_s: An encounter must be over for this long.
    """

    climb_mps: float = 2.0
    descent_mps: float = 1.5
    acceleration_mps2: float = 1.0
    response_s: float = 0.5
    conflict_s: float = 15.0
    look_s: float = 25.0
    foresee_s: float = 3.0
    join_mps: float = 0.7
    equal_m: float = 3.0
    clearance_m: float = 13.0
    over_s: float = 2.0


@dataclass(frozen=True, slots=True)
class Cylinder:
    """A neighbour as vertical avoidance sees it.

    Args:
        key: Identity, for the memory of the encounter.
        above_m: Height above own-ship, NaN if unknown.
        climb_mps: Climb rate, NaN if unknown.
        half_height_m: Vertical bound of the pair, infinite if unknown.
        entry_s: Time until its disc is entered; 0 inside, infinite if never.
        receding: Own-ship is past it, or flies along outside its disc.
        reciprocal: It takes its half of the avoidance.
        greater: Own-ship has the greater identity; None if they cannot be told apart.
    """

    key: Hashable
    above_m: float
    climb_mps: float
    half_height_m: float
    entry_s: float
    receding: bool
    reciprocal: bool
    greater: bool | None

    @property
    def known(self) -> bool:
        """Whether its height can be compared with the own one."""
        return math.isfinite(self.above_m) and math.isfinite(self.climb_mps) and math.isfinite(self.half_height_m)

    @property
    def level(self) -> bool:
        """Whether own-ship is in its slab."""
        return abs(self.above_m) < self.half_height_m


@dataclass(slots=True)
class _Hold:
    direction: int
    over_for_s: float = 0.0


class VerticalAvoidance:
    """Decides the climb rate of one own-ship, step by step.

    Attributes:
        settings: Constants.
        leaving: Direction in which a slab is being left or has been left: 1 up, -1 down, 0 none.
    """

    def __init__(self, settings: VerticalSettings | None = None) -> None:
        self.settings = settings or VerticalSettings()
        self._held: dict[Hashable, _Hold] = {}

    @property
    def leaving(self) -> int:
        """Direction of the slab that is being left or has been: 1 up, -1 down, 0 none."""
        return next((hold.direction for hold in self._held.values()), 0)

    @property
    def held(self) -> Collection[Hashable]:
        """Keys of neighbours whose slab is being left or has been: hand in their cylinders, however far they are."""
        return self._held.keys()

    def forget(self) -> None:
        """Forget all encounters: a new leg begins."""
        self._held.clear()

    def step(
        self,
        cylinders: Sequence[Cylinder],
        *,
        bad: bool,
        own_climb_mps: float,
        to_goal_m: float,
        room_m: tuple[float, float],
        last_mps: float,
        elapsed_s: float,
    ) -> float:
        """Climb rate to fly [m/s], positive upwards.

        Args:
            cylinders: Those entered within `look_s`, and those held.
            bad: The horizontal decision is infeasible, overlapped, or far from what was wanted.
            own_climb_mps: Own climb rate, as it is reported to others.
            to_goal_m: Height of the goal above own-ship.
            room_m: How far the band of heights reaches up and down from here; negative outside of it.
            last_mps: Climb rate commanded last.
            elapsed_s: Time since that command.
        """
        settings = self.settings
        self._let_go(cylinders, elapsed_s)
        blind = any(not each.known and each.entry_s <= settings.look_s for each in cylinders)
        conflicts = [c for c in cylinders if c.known and c.level and c.entry_s <= settings.conflict_s]
        joined = any(c.reciprocal and abs(c.climb_mps) >= settings.join_mps for c in conflicts)
        if (bad or joined) and conflicts and not blind:
            self._choose(conflicts, cylinders, own_climb_mps, room_m)
        direction = self.leaving
        if direction:
            missing = max(
                (
                    each.half_height_m + settings.clearance_m + direction * each.above_m
                    for each in cylinders
                    if each.key in self._held and each.known
                ),
                default=0.0,
            )
            wanted = direction * max(GAIN_PER_S * missing, 0.0)
        else:
            wanted = GAIN_PER_S * to_goal_m
        # Outside the band these limits cross zero: a height that drifts out is flown back.
        wanted = max(min(wanted, GAIN_PER_S * room_m[0]), -GAIN_PER_S * room_m[1])
        wanted = min(max(wanted, -settings.descent_mps), settings.climb_mps)
        if blind and (direction or any(not c.known and c.entry_s <= settings.conflict_s for c in cylinders)):
            wanted = 0.0
        wanted = self._stopped_at_cylinders(wanted, cylinders)
        slew = settings.acceleration_mps2 * elapsed_s
        return min(max(wanted, last_mps - slew), last_mps + slew)

    def _let_go(self, cylinders: Sequence[Cylinder], elapsed_s: float) -> None:
        """Forget encounters that are over, and neighbours that are gone."""
        here = {each.key: each for each in cylinders}
        for key, hold in list(self._held.items()):
            each = here.get(key)
            hold.over_for_s = hold.over_for_s + elapsed_s if each is None or each.receding else 0.0
            if hold.over_for_s >= self.settings.over_s:
                del self._held[key]

    def _choose(
        self,
        conflicts: Sequence[Cylinder],
        cylinders: Sequence[Cylinder],
        own_climb_mps: float,
        room_m: tuple[float, float],
    ) -> None:
        """Leave the slab of all conflicts, if all the rules allow it; a neighbour that is held stays held."""
        wishes = {hold.direction for hold in self._held.values()}
        new = [each for each in conflicts if each.key not in self._held]
        wishes |= {self._direction(each, own_climb_mps) for each in new}
        if not new or len(wishes) != 1 or 0 in wishes:
            return
        (direction,) = wishes
        if not all(self._in_time(each, direction) for each in new):
            return
        way = max(self._way_m(each, direction) for each in conflicts)
        room = room_m[0] if direction > 0 else room_m[1]
        keys = {each.key for each in conflicts}
        blocked = any(
            each.key not in keys
            and each.known
            and direction * each.above_m > 0.0
            and direction * each.above_m - each.half_height_m < way
            for each in cylinders
            if each.entry_s <= self.settings.look_s
        )
        if way <= room and not blocked:
            self._held.update({each.key: _Hold(direction) for each in new})

    def _direction(self, each: Cylinder, own_climb_mps: float) -> int:
        """Direction by the rule that both ends see alike: 1 own-ship climbs, -1 it descends, 0 no answer."""
        settings = self.settings
        later = each.above_m + (each.climb_mps - own_climb_mps) * settings.foresee_s
        if abs(later) > settings.equal_m:
            return -1 if later > 0.0 else 1
        if each.greater is None:
            return 0
        return 1 if each.greater else -1

    def _way_m(self, each: Cylinder, direction: int) -> float:
        """Height that own-ship itself must climb or descend to leave a slab [m]."""
        missing = max(each.half_height_m + direction * each.above_m, 0.0)
        return missing / 2.0 if each.reciprocal else missing

    def _in_time(self, each: Cylinder, direction: int) -> bool:
        """Whether a slab can be left before the disc is entered; inside the disc there is nothing to wait for."""
        if each.entry_s <= 0.0:
            return True
        settings = self.settings
        fastest = settings.climb_mps if direction > 0 else settings.descent_mps
        pursuing = 0.0 if each.reciprocal else max(direction * each.climb_mps, 0.0)
        if pursuing >= fastest:
            return False
        needed = self._way_m(each, direction) / (fastest - pursuing)
        return settings.response_s + fastest / (2.0 * settings.acceleration_mps2) + needed <= each.entry_s

    def _stopped_at_cylinders(self, wanted: float, cylinders: Sequence[Cylinder]) -> float:
        """Climb rate reduced so that it enters no cylinder from above or below."""
        if wanted == 0.0:
            return wanted
        towards = math.copysign(1.0, wanted)
        fastest = abs(wanted)
        for each in cylinders:
            ahead = towards * each.above_m
            if each.known and each.entry_s <= self.settings.look_s and ahead > 0.0 and not each.level:
                fastest = min(fastest, GAIN_PER_S * max(ahead - each.half_height_m, 0.0))
        return towards * fastest
