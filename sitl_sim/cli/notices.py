"""Notices of ``ridlink sim`` on stderr during a flight, each once."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sitl_sim.verdict import Outcome

if TYPE_CHECKING:
    from sitl_sim.server import FleetServer

PLACELESS = 30
"""A notice is due after this many broadcasts without a position: more than come before a first LOCATION."""

STOOD_STILL_MS = 10_000
"""A notice is due if the fleet has lost more time than this: more than other programs take now and then."""

FATES = {Outcome.COLLIDED: "has collided", Outcome.HIT_OBSTACLE: "flew into an obstacle"}


class Notices:
    """Notices about a fleet.

    Args:
        server: The fleet.
    """

    def __init__(self, server: FleetServer) -> None:
        self._server = server
        self._said: set[str] = set()

    def fresh(self) -> list[str]:
        """Lines that have not been returned yet."""
        known = (*self._of_the_machine(), *self._of_the_air(), *self._of_vehicles())
        lines = [line for line in known if line not in self._said]
        self._said.update(lines)
        return lines

    def _of_the_machine(self) -> list[str]:
        if self._server.counters["slipped_ms"] <= STOOD_STILL_MS:
            return []
        speedup = self._server.config.speedup
        pace = "for this fleet" if speedup == 1.0 else f"to fly this fleet {speedup:g} times as fast"
        return [f"this machine is too slow {pace}: at times the vehicles stand still, and the clock goes on"]

    def _of_the_air(self) -> list[str]:
        counters, port = self._server.air.counters, self._server.ports.air
        lines = []
        if counters["malformed"]:
            lines.append(f"the air, {port}: something that is no MAVLink came, and goes no further")
        if counters["no_position"] >= PLACELESS:
            lines.append(
                f"the air, {port}: a sender has told no OPEN_DRONE_ID_LOCATION, its own or of whom it relays; "
                "observers alone hear it"
            )
        if counters["refused"]:
            lines.append(f"the air, {port}: too many speak there, and more are refused")
        return lines

    def _of_vehicles(self) -> list[str]:
        if not self._server.mission_begun:
            return []
        details = self._server.world.verdict().details
        return [f"vehicle {one.system_id} {FATES[one.outcome]}" for one in details if one.outcome in FATES]
