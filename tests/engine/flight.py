"""One engine and one vehicle in virtual time: real MAVLink bytes in both directions, no socket, no clock."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ridlink.avoidance.settings import HalfplaneSettings
from ridlink.engine import Engine, EngineConfig, Goal, StepOutput
from ridlink.mavlink.codec import Encoder, Message
from tests.daemon.emulated import Emulated, at
from tests.daemon.invariants import messages

STEP_S = 0.1
IDEAL = HalfplaneSettings(response_time_s=0.0, smoothing=1.0)


def config(north_m: float = 200.0, **options: Any) -> EngineConfig:
    return EngineConfig(goal=Goal(*at(north_m)), **options)


class Flight:
    """One engine and one vehicle in virtual time, with others that may be heard."""

    def __init__(self, vehicle: Emulated | None = None, settings: EngineConfig | None = None) -> None:
        self.vehicle = vehicle or Emulated()
        self.engine = Engine(settings or config())
        self.others: list[Callable[[float], bytes]] = []
        self.telling = True
        self.now_s = 0.0
        self.utc_s: float | None = None
        self.outputs: list[StepOutput] = []

    def step(self, count: int = 1) -> StepOutput:
        for _ in range(count):
            if self.telling:
                self.engine.receive_vehicle(self.vehicle.telemetry(self.now_s), self.now_s, source="autopilot")
            for other in self.others:
                self.engine.receive_remote_id(other(self.now_s), self.now_s, source="air")
            output = self.engine.step(self.now_s, utc_s=self.utc_s)
            for frame in output.to_vehicle:
                self.vehicle.hear(frame)
            self.vehicle.advance(STEP_S)
            self.outputs.append(output)
            self.now_s += STEP_S
        return self.outputs[-1]

    def heard(self, name: str) -> list[Message]:
        return [message for message in self.vehicle.heard if message.name == name]

    def command(self, name: str, source: object = "autopilot", **fields: Any) -> int | None:
        """Result of a command to the engine; None if it is not answered."""
        sender = Encoder(255, 190)
        frame = sender.encode(name, **({"target_system": 1, "target_component": 196} | fields))
        self.engine.receive_vehicle(frame, self.now_s, source=source)
        replies = self.step().replies
        if not replies:
            return None
        ((ack, to),) = replies
        assert to == source
        (message,) = messages(ack)
        assert message.name == "COMMAND_ACK" and message.command == fields["command"]
        assert (message.target_system, message.target_component) == (255, 190)
        return int(message.result)


def intruder(north_m: float, east_m: float, velocity: tuple[float, float, float]) -> Emulated:
    made = Emulated(9, ned_m=(north_m, east_m, -50.0))
    made.velocity = np.array(velocity)
    return made


def reposition(**fields: Any) -> dict[str, Any]:
    latitude, longitude, altitude = at(30.0)
    given = {"command": 192, "frame": 5, "x": round(latitude * 1e7), "y": round(longitude * 1e7), "z": altitude}
    return given | fields
