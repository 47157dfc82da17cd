"""The daemon: two links, an engine, and a loop that runs on a fixed time grid.

The engine decides on a fixed grid of a monotonic clock. Missed ticks are not made up for: after a stall, the next
decision uses what is known then, and the grid continues.
"""

from __future__ import annotations

import asyncio
import gc
import time
from collections import Counter
from collections.abc import Callable
from typing import Any

from ridlink.daemon.config import DaemonConfig
from ridlink.daemon.events import Events, EventSink
from ridlink.daemon.figures import figures
from ridlink.daemon.input_log import FromAir, FromVehicle
from ridlink.daemon.module_words import ModuleWords
from ridlink.daemon.recordings import Recordings
from ridlink.daemon.steady_utc import SteadyUtc
from ridlink.daemon.summary import Pace, Summary
from ridlink.daemon.telling import Telling
from ridlink.daemon.vehicle_link import open_vehicle_link
from ridlink.daemon.warming import warm_up_unless
from ridlink.daemon.watchdog import Watchdog
from ridlink.engine import Engine, StepOutput
from ridlink.errors import RidlinkError
from ridlink.links import Address, Link, open_link
from ridlink.mavlink.signing import SignatureCause
from ridlink.metrics import AVOID_METRICS, MetricsServer
from ridlink.own_ship.requests import steers
from ridlink.periodic import Periodic

STOP_SPACING_S = 0.05
"""Time between the last setpoints: a burst would be lost as a whole."""

FATAL_STEPS = 3
"""A step that fails sends nothing. After this many failures in a row the daemon ends, so that the autopilot does not
wait longer."""


class DecisionError(RidlinkError):
    """Several decisions in a row failed; the vehicle was commanded to stop."""


class AvoidDaemon:
    """One daemon; several may run in one loop.

    Args:
        config: Its configuration.
        on_event: Called with a dictionary for every change of state, once a second, for every warning, and if the
            recording ends early, or a transmitter module says something new; keys `event`, `t`, ... .

    Attributes:
        engine: The engine.
        vehicle_address: Local end of the vehicle link, once `run` has opened it.
        remote_id_address: Local end of the Remote ID link.
        ready: Set once both links are open and decisions can be made.
    """

    def __init__(self, config: DaemonConfig, *, on_event: EventSink | None = None) -> None:
        self.config = config
        self.engine = Engine(config.engine)
        self.engine.warm = False
        self.ready = asyncio.Event()
        self.vehicle_address: Address | None = None
        self.remote_id_address: Address | None = None
        self._vehicle: Link | None = None
        self._air: Link | None = None
        self._transmitter: Link | None = None
        self._recordings = Recordings(config)
        self._counters: Counter[str] = Counter()
        self._events = Events(on_event, self._counters)
        self._module = ModuleWords(self._events)
        self._telling = Telling(self.engine, self._events, self._module, self.rejects)
        self._broadcasts = 0
        self._pace = Pace()
        self._failed_in_a_row = 0
        self._utc = SteadyUtc(time.monotonic())
        self._hold = False
        self._metrics: MetricsServer | None = None
        self._metrics_due = Periodic(1.0)

    async def run(self, stop: asyncio.Event) -> Summary:
        """Fly until `stop` is set; then send three zero setpoints and close the links.

        Args:
            stop: Set it to end.

        Raises:
            LinkError: If a link cannot be opened.
            ConfigError: If the key of the vehicle link, or its clock, cannot be used.
            OSError: If a recording, or the key, cannot be opened.
            DecisionError: If decisions kept failing.
        """
        # Open the links first: a PX4 in OFFBOARD that lost the daemon waits a second for zero velocity, kernels load
        # longer.
        warm = asyncio.create_task(warm_up_unless(stop, self.config.engine.solver))
        try:
            self._vehicle = await open_vehicle_link(self.config.vehicle, self._from_vehicle, self.config.signing)
            self._air = await open_link(self.config.remote_id, self._from_air)
            if self.config.broadcast_to is not None:
                self._transmitter = await open_link(self.config.broadcast_to, self._from_module)
            if self.config.metrics is not None:
                self._metrics = MetricsServer(self.config.metrics, AVOID_METRICS)
            self.vehicle_address, self.remote_id_address = self._vehicle.local_address, self._air.local_address
            self._recordings.open()  # after the links: if a port is in use, the log of another daemon must not be lost
            try:
                await self._keep_time(stop, warm)
            finally:
                await self._end()
        finally:
            warm.cancel()
            for link in (self._vehicle, self._air, self._transmitter):
                if link is not None:
                    link.close()
            if self._metrics is not None:
                await asyncio.to_thread(self._metrics.close)
            await self._recordings.close()
        if self.engine.fatal:
            raise DecisionError(f"decisions failed: {self.engine.last_error}; the vehicle was told to stop")
        return self.summary()

    @property
    def metrics_port(self) -> int | None:
        """Port of the metrics; None while they are not served."""
        return None if self._metrics is None else self._metrics.port

    # --- time -----------------------------------------------------------------------------------------------------

    async def _keep_time(self, stop: asyncio.Event, warm: asyncio.Task[None]) -> None:
        await self._tick_until(warm)
        if warm.done():
            warm.result()
        if stop.is_set():  # no decision follows, so the kernels need not be loaded
            return
        self.engine.warm = True
        # All present objects live until the end, so exclude the compiled kernels and the dialect from garbage
        # collection.
        gc.freeze()
        gc.enable()
        self.ready.set()
        watchdog = Watchdog(self._stalled)
        watchdog.start()
        stopped = asyncio.ensure_future(stop.wait())
        try:
            await self._tick_until(stopped, watchdog.beat)
        finally:
            stopped.cancel()
            watchdog.stop()

    async def _tick_until(self, over: asyncio.Future[Any], alive: Callable[[], None] = lambda: None) -> None:
        period = self.config.period_s
        due = time.monotonic()
        while not over.done() and not self.engine.fatal:
            alive()
            self._tick()
            due += period
            late = time.monotonic() - due
            if late >= 0.0:
                missed = int(late / period) + 1
                self._counters["missed_tick"] += missed
                due += missed * period
            await asyncio.wait({over}, timeout=due - time.monotonic())

    def _stalled(self, stack: str) -> None:
        """Called from the watchdog's thread: hold when the loop continues, and keep the stack of the stall."""
        self._hold = True
        self._telling.stalled(stack)

    def _tick(self) -> None:
        self._pace.begin()
        now_s = time.monotonic()
        self._utc.check(now_s)
        utc_s = self._utc.at(now_s)
        hold, self._hold = self._hold, False
        if hold:  # counted here, since the watchdog's thread must not change what the loop may be reading
            self._counters["loop_stalled"] += 1
            self.engine.hold_next()
        self._recordings.step(now_s, hold, self.engine.warm, utc_s)
        try:
            output = self.engine.step(now_s, utc_s=utc_s)
        except Exception as error:
            self._counters["step_failed"] += 1
            self._failed_in_a_row += 1
            if self._failed_in_a_row >= FATAL_STEPS:
                raise DecisionError(f"steps failed: {type(error).__name__}: {error}") from error
            return
        self._failed_in_a_row = 0
        took_s = self._pace.decided()
        self.engine.note_decision_time(took_s)
        self._send(output)
        is_setpoint = output.decision.commanded_ned_mps is not None and not self.config.engine.dry_run
        self._pace.sent(is_setpoint, time.monotonic())
        self._recordings.decided(output, self.engine.rung.reason, took_s)
        self._leave_figures(output)
        self._telling.tell(
            output,
            recording_error=self._recordings.wire_error,
            refused_signatures=self._refused_signatures(),
        )

    async def _end(self) -> None:
        now_s = time.monotonic()
        self._recordings.stop(now_s)
        for frame in self.engine.stop(now_s):
            self._to_vehicle(frame)
            await asyncio.sleep(STOP_SPACING_S)
        self._telling.tell_state()

    # --- bytes ----------------------------------------------------------------------------------------------------

    def _from_vehicle(self, data: bytes, address: Address) -> None:
        if (heard := self._heard(FromVehicle, data, address)) is not None:
            self.engine.receive_vehicle(data, heard.now_s, source=address, utc_s=heard.utc_s)

    def _from_air(self, data: bytes, address: Address) -> None:
        if (heard := self._heard(FromAir, data, address)) is not None:
            self.engine.receive_remote_id(data, heard.now_s, source=address, utc_s=heard.utc_s)

    def _from_module(self, data: bytes, _: Address) -> None:
        self._recordings.on_wire(data)
        self._module.receive(data, time.monotonic())

    def _heard(self, kind: type[FromVehicle | FromAir], data: bytes, address: Address) -> FromVehicle | FromAir | None:
        """Record a datagram with its times of receipt. None while links are still being opened, since the engine must
        not get inputs that cannot be recorded yet."""
        if not self._recordings.opened:
            return None
        now_s = time.monotonic()
        datagram = kind(now_s, self._utc.at(now_s), address, data)
        self._recordings.heard(datagram)
        return datagram

    def _send(self, output: StepOutput) -> None:
        for frame in output.to_vehicle:
            self._to_vehicle(frame)
        transmitter = self._transmitter or self._air
        # a module speaks only once it has heard of which vehicle it is
        for link, frames in ((self._air, output.to_air), (transmitter, output.to_transmitter)):
            for frame in frames:
                if link is not None:
                    link.send(frame)
                    self._recordings.on_wire(frame)
        for datagram in output.broadcasts:
            if transmitter is not None:
                self._broadcasts += transmitter.send(datagram)
                self._recordings.on_wire(datagram)
        for frame, address in output.replies:
            if self._vehicle is not None and isinstance(address, tuple):
                self._vehicle.send(frame, address)
                self._recordings.on_wire(frame)

    def _to_vehicle(self, frame: bytes) -> None:
        if self._vehicle is None:
            return
        if self.config.engine.dry_run and steers(frame):
            self._counters["dry_run_withheld"] += 1
            return
        address = self.engine.vehicle_source
        self._vehicle.send(frame, address if isinstance(address, tuple) else None)
        self._recordings.on_wire(frame)

    def _leave_figures(self, output: StepOutput) -> None:
        if self._metrics is None or not self._metrics_due.due(output.decision.time_s):
            return
        self._metrics.publish(
            figures(
                self.engine,
                output,
                pace=self._pace,
                broadcasts=self._broadcasts,
                events=self.rejects(),
            )
        )

    # --- figures --------------------------------------------------------------------------------------------------

    def _refused_signatures(self) -> list[str]:
        """Causes for which the vehicle link refused frames."""
        if self.config.signing is None or self._vehicle is None:
            return []
        return [cause for cause in SignatureCause if self._vehicle.counters[cause]]

    def summary(self) -> Summary:
        """Totals so far."""
        totals = self.engine.summary()
        return Summary(
            setpoints=totals.setpoints,
            reports_received=totals.reports_received,
            decision_ms=self._pace.decision_ms.summary(),
            decision_cpu_ms=self._pace.decision_cpu_ms.summary(),
            setpoint_gap_ms=self._pace.gap_ms.summary(),
            rejects=self.rejects(),
            tracks=totals.tracks,
            state=totals.state,
            infeasible_steps=totals.infeasible_steps,
            decision_log=self._recordings.decision_log,
        )

    def rejects(self) -> dict[str, int]:
        """Everything that was dropped, clamped, rejected or noticed so far, by cause."""
        rejects = self.engine.counters + self._counters + self._recordings.counters + self._module.counters
        for name, link in (("vehicle", self._vehicle), ("rid", self._air), ("transmitter", self._transmitter)):
            if link is not None:
                rejects.update({f"{name}_link_{cause}": count for cause, count in link.counters.items()})
        rejects["clock_stepped"] += self._utc.steps
        return {cause: count for cause, count in sorted(rejects.items()) if count}
