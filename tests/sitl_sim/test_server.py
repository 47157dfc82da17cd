"""The fleet on real loopback sockets, with the clients that people use."""

from __future__ import annotations

import asyncio
import logging
import os
import resource
import socket
from dataclasses import replace
from typing import Any

import pytest

from ridlink.errors import ConfigError, LinkError
from ridlink.mavlink.codec import CRC_EXTRAS, Encoder, Message, decode_message
from ridlink.mavlink.frames import Frame, parse_datagram
from ridlink.scenario import Scenario, VehicleSpec, built_in
from sitl_sim.autopilot import Start
from sitl_sim.cli.notices import STOOD_STILL_MS, Notices
from sitl_sim.fleet_config import FleetConfig
from sitl_sim.server import FleetServer
from sitl_sim.vehicle import TICK_S
from tests.loopback import free_port
from tests.sitl_sim.fleets import ANY_PORT, PATIENCE_S, Client, fly, fly_both_autopilots, run, run_client


def two_apart(distance_m: float, **details: Any) -> Scenario:
    """Two vehicles beside each other that fly north in parallel."""
    paths = [((0.0, east, -50.0), (500.0, east, -50.0)) for east in (0.0, distance_m)]
    return Scenario("two", 60.0, tuple(VehicleSpec(start, goal, **details) for start, goal in paths))


# --- the clients that people use --------------------------------------------------------------------------------------


def test_mavutil_arms_takes_off_flies_and_lands() -> None:
    async def act(server: FleetServer) -> None:
        flavour = server.config.autopilot
        seen = await run_client("fly", flavour, f"127.0.0.1:{server.ports.vehicles[0]}")
        assert seen["results"] == {"176": 0, "400": 0, "22": 0, "21": 0}
        disarmed_in = "LAND" if flavour == "ardupilot" else "OFFBOARD"  # where PX4 was before it landed
        assert seen["mode"] == disarmed_in and seen["height"] > 1.5 and seen["speed"] > 2.0
        assert seen["parameter"] == (["RTL_ALT", 1500.0] if flavour == "ardupilot" else ["RTL_RETURN_ALT", 30.0])
        assert seen["packet_loss"] == 0

    fly_both_autopilots(act)


def test_mavutil_fetches_parameters_obeys_its_masks_and_writes_missions() -> None:
    async def act(server: FleetServer) -> None:
        flavour = server.config.autopilot
        seen = await run_client("plan", flavour, f"127.0.0.1:{server.ports.vehicles[0]}")
        assert seen["parameters"] == (14 if flavour == "ardupilot" else 16) and seen["set"] == 45.0
        assert seen["moved"] == [[0x0DC7, 2, 0], [0x05C7, 2, 0], [0x0FC7, 2, 0]]
        assert seen["mission"] == [0, [16, 16, 178, 21], 0]

    fly_both_autopilots(act, Start.AIRBORNE)


def test_a_fleet_may_have_vehicles_of_both_autopilots() -> None:
    first, second = two_apart(100.0).vehicles
    scenario = Scenario("mixed", 60.0, (first, replace(second, autopilot="ardupilot")))
    told: list[tuple[int, int]] = []

    async def act(server: FleetServer) -> None:
        for port in server.ports.vehicles:
            client = await Client.open(port)
            client.send("HEARTBEAT", type=6, autopilot=8)
            heartbeat = await client.one("HEARTBEAT")
            told.append((heartbeat.autopilot, heartbeat.custom_mode))

    fly(scenario, act, start=Start.AIRBORNE)
    assert told == [(12, 6 << 16), (3, 4)], "PX4 in OFFBOARD, ArduPilot in GUIDED"
    with pytest.raises(ConfigError, match="vehicle 2 has the autopilot ardupilot: in an ideal fleet nobody has"):
        FleetServer(scenario, FleetConfig(autopilot="ideal", **ANY_PORT))


def test_stock_listener_on_the_air_hears_every_vehicle() -> None:
    async def act(server: FleetServer) -> None:
        seen = await run_client("listen", f"127.0.0.1:{server.ports.air}", "8")
        assert seen["dialect"] == "common"
        assert set(seen["heard"]) == {str(system_id) for system_id in range(1, 9)}
        for latitude, longitude, status in seen["heard"].values():
            assert abs(latitude / 1e7 - 47.397742) < 0.002 and abs(longitude / 1e7 - 8.545594) < 0.002
            assert status == 2

    fly(built_in("circle8"), act, start=Start.AIRBORNE)


# --- the air ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("distance_m", "heard"), [(300.0, True), (500.0, False)])
def test_a_vehicle_hears_its_neighbours_within_range_and_never_itself(distance_m: float, heard: bool) -> None:
    async def act(server: FleetServer) -> None:
        observer, daemon = await Client.open(server.ports.air), await Client.open(server.ports.air, 1, 196)
        await observer.until(lambda got: [source for source, _ in got if source == 2][10:])
        if heard:
            await daemon.one("RIDLINK_SEPARATION")
        assert {source for source, _ in daemon.heard} == ({2} if heard else set())

    fly(two_apart(distance_m), act, start=Start.AIRBORNE)


def test_neighbours_learn_who_avoids_and_what_it_was_told() -> None:
    async def act(server: FleetServer) -> None:
        observer = await Client.open(server.ports.air)
        daemon = await Client.open(server.ports.vehicles[0], 1, 196)

        def steers(message: Message) -> bool:
            if message.name == "RIDLINK_SEPARATION":
                return bool(message.flags == 15 and message.commanded_vy == 250)
            return False

        async def stream() -> None:
            while True:
                daemon.send("SET_POSITION_TARGET_LOCAL_NED", target_system=1, target_component=1, coordinate_frame=1,
                            type_mask=0x0DC7, vy=2.5)  # fmt: skip
                await daemon.anything()

        streaming = asyncio.create_task(stream())
        await observer.one("RIDLINK_SEPARATION", steers)
        streaming.cancel()
        assert {source for source, message in observer.heard if steers(message)} == {1}
        assert server.snapshot()["vehicles"][0]["avoiding"] is True

    fly(two_apart(100.0), act, start=Start.AIRBORNE)


def test_vehicles_outside_the_emulator_take_part_in_an_air_of_their_own() -> None:
    async def act(server: FleetServer) -> None:
        one, other = await Client.open(server.ports.air, 101, 1), await Client.open(server.ports.air, 102, 1)
        while not any(message.name == "OPEN_DRONE_ID_LOCATION" for _, message in other.heard):
            one.send("OPEN_DRONE_ID_LOCATION", latitude=473977420, longitude=85455940, altitude_geodetic=500.0)
            one.send("OPEN_DRONE_ID_LOCATION", latitude=473977420, longitude=85455940, altitude_geodetic=500.0)
            other.send("HEARTBEAT", type=18, autopilot=8)
            await other.one("OPEN_DRONE_ID_LOCATION")
        assert {source for source, _ in other.heard} == {101}

    server = fly(built_in("circle8", 0), act)
    assert server.ports.vehicles == ()


def test_slow_technologies_slow_the_updates_down() -> None:
    async def act(server: FleetServer) -> None:
        observer = await Client.open(server.ports.air)
        update = await observer.one("RIDLINK_SEPARATION")
        assert update.update_interval == 1000

    fly(two_apart(100.0), act, start=Start.AIRBORNE, technology="bt4")


# --- missions ---------------------------------------------------------------------------------------------------------


def test_mission_of_a_fleet_from_the_ground_begins_when_everybody_obeys() -> None:
    def climb(client: Client, system_id: int) -> None:
        velocity = {"coordinate_frame": 1, "type_mask": 0x0DC7, "vz": -1.0}
        client.send("SET_POSITION_TARGET_LOCAL_NED", target_system=system_id, **velocity)

    async def lift_off(client: Client, system_id: int) -> None:
        await client.one("HEARTBEAT")
        client.send("COMMAND_LONG", target_system=system_id, command=400, param1=1.0)
        climb(client, system_id)
        client.send("COMMAND_LONG", target_system=system_id, command=176, param1=1.0, param2=6.0)
        await client.one("EXTENDED_SYS_STATE", lambda message: message.landed_state == 2)

    async def act(server: FleetServer) -> None:
        first, second = [await Client.open(port) for port in server.ports.vehicles]
        await lift_off(first, 1)
        assert not server.mission_begun
        lifting = asyncio.create_task(lift_off(second, 2))
        while not server.mission_begun:
            climb(first, 1)
            await first.anything()
        await lifting

    server = fly(two_apart(100.0), act)
    assert server.world.mission_time_s < server.world.time_s


def test_holding_fleet_waits_for_its_owner_and_then_even_the_uncooperative_set_out() -> None:
    async def act(server: FleetServer) -> None:
        observer = await Client.open(server.ports.air)
        still = await observer.one("OPEN_DRONE_ID_LOCATION", lambda message: message.speed_horizontal == 0)
        assert still.status == 2
        assert server.snapshot()["mission_time_s"] is None
        server.begin_mission()
        await observer.one("OPEN_DRONE_ID_LOCATION", lambda message: message.speed_horizontal > 500)

    scenario = Scenario(
        "mixed",
        60.0,
        (
            VehicleSpec((0.0, 0.0, -50.0), (500.0, 0.0, -50.0), sigma_m=0.0),
            VehicleSpec((0.0, 100.0, -50.0), (500.0, 100.0, -50.0), sigma_m=0.0, cooperative=False),
        ),
    )
    fly(scenario, act, start=Start.HOLDING, autopilot="ideal")


# --- ports ------------------------------------------------------------------------------------------------------------


def test_companion_gets_telemetry_without_having_asked() -> None:
    loop_port = free_port()

    async def act(server: FleetServer) -> None:
        loop = asyncio.get_running_loop()
        _, companion = await loop.create_datagram_endpoint(
            lambda: Client(255, 190), local_addr=("127.0.0.1", loop_port)
        )
        heartbeat = await companion.one("HEARTBEAT")
        assert heartbeat.autopilot == 12

    fly(built_in("circle8", 1), act, companion_port=loop_port)


def test_port_in_use_is_named_and_nothing_stays_open() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        server = FleetServer(built_in("circle8", 2), FleetConfig(vehicle_port=0, companion_port=0, air_port=port))
        with pytest.raises(LinkError, match=f"UDP port {port}: another simulation"):
            asyncio.run(server.start())
        with pytest.raises(RuntimeError):
            _ = server.ports


def test_a_fleet_of_more_vehicles_than_sockets_is_not_told_of_another_simulation() -> None:
    config = FleetConfig(vehicle_port=0, companion_port=0, air_port=0)
    most, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (len(os.listdir("/proc/self/fd")) + 50, hard))
    try:
        with pytest.raises(LinkError, match=r"udpin:127.0.0.1:0: Too many open files; 'ulimit -n' says how many"):
            asyncio.run(FleetServer(built_in("circle8", 100), config).start())
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (most, hard))


def test_a_ground_station_that_cannot_be_keeps_no_port() -> None:
    async def test() -> None:
        config = FleetConfig(vehicle_port=0, companion_port=0, air_port=0, ground_station="serial:/dev/null:57600")
        server = FleetServer(built_in("circle8", 2), config)
        with pytest.raises(LinkError, match="no serial device"):
            await server.start()
        for port in (*server.ports.vehicles, server.ports.air):
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as again:
                again.bind(("127.0.0.1", port))

    asyncio.run(test())


def test_ports_are_free_again_after_closing() -> None:
    async def nothing(_: FleetServer) -> None:
        return None

    server = fly(built_in("circle8", 2), nothing)
    for port in (*server.ports.vehicles, server.ports.air):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as again:
            again.bind(("127.0.0.1", port))


@pytest.mark.parametrize(
    ("count", "config", "complaint"),
    [
        (41, {}, "overlap"),
        (3, {"vehicle_port": 14648, "companion_port": 0}, "overlap"),
        (8, {"vehicle_port": 65530}, "65528"),
        (1, {"seed": -1}, "seed"),
        (1, {"sigma_m": float("nan")}, "sigma"),
        (1, {"autopilot": "betaflight"}, "px4, ardupilot, ideal"),
        (1, {"gnss": "perfect"}, "gauss-markov"),
        (1, {"technology": "pigeon"}, "wifi-beacon"),
        (1, {"loss": 1.5}, "loss"),
    ],
)
def test_wrong_configurations_are_refused_in_one_line(count: int, config: dict[str, Any], complaint: str) -> None:
    with pytest.raises(ConfigError, match=complaint) as refusal:
        FleetServer(built_in("circle8", count), FleetConfig(**config))
    assert "\n" not in str(refusal.value)


# --- what goes wrong --------------------------------------------------------------------------------------------------


def test_a_stall_is_caught_up_for_a_quarter_of_a_second_only() -> None:
    server = FleetServer(built_in("circle8", 1), FleetConfig(**ANY_PORT))
    server._flown_until_s = 100.0
    server._fly(100.1)
    assert server.world.time_s == pytest.approx(0.1)
    server._fly(110.1)
    assert server.world.time_s == pytest.approx(0.34)  # whole ticks of 20 ms
    assert server.counters["slipped_ms"] == pytest.approx(9750, abs=1)
    server._fly(110.2)
    assert server.world.time_s == pytest.approx(0.44, abs=0.021)


@pytest.mark.parametrize(("speedup", "how"), [(1.0, "for this fleet"), (50.0, "to fly this fleet 50 times as fast")])
def test_a_machine_that_is_too_slow_is_told_of_once(speedup: float, how: str) -> None:
    async def act(server: FleetServer) -> None:
        notices = Notices(server)
        server.counters["slipped_ms"] = STOOD_STILL_MS
        assert notices.fresh() == []
        server.counters["slipped_ms"] += 1
        (line,) = notices.fresh()
        assert f"too slow {how}:" in line
        assert notices.fresh() == []

    fly(built_in("circle8", 1), act, speedup=speedup)


def test_a_failing_vehicle_is_counted_and_logged_once_a_second_and_the_others_fly_on(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    server = FleetServer(two_apart(100.0), FleetConfig(**ANY_PORT, start=Start.AIRBORNE))

    def fail(now_s: float) -> Any:
        raise ZeroDivisionError("made up")

    async def act(_: FleetServer) -> None:
        healthy = await Client.open(server.ports.vehicles[1])
        monkeypatch.setattr(server.autopilots[0], "tick", fail)
        await healthy.until(lambda heard: [m for _, m in heard if m.name == "GLOBAL_POSITION_INT"][8:])

    with caplog.at_level(logging.ERROR, "sitl_sim.server"):
        asyncio.run(run(server, act))
    assert server.counters["error"] > 10
    assert 1 <= len(caplog.records) <= 3
    assert "vehicle 1" in caplog.text and "made up" in caplog.text


def test_garbage_on_every_port_changes_nothing() -> None:
    async def act(server: FleetServer) -> None:
        vehicle, observer = await Client.open(server.ports.vehicles[0]), await Client.open(server.ports.air)
        for client in (vehicle, observer):
            for noise in (b"", b"\xfd", b"\xfe" * 300, bytes(range(256)) * 200):
                client.transport.sendto(noise)
        vehicle.send("COMMAND_LONG", target_system=1, command=400, param1=1.0)
        await vehicle.one("COMMAND_ACK")
        await observer.one("OPEN_DRONE_ID_LOCATION")

    server = fly(two_apart(100.0), act)
    assert server.autopilots[0].counters["bad_frame"] > 0


# --- time, ground stations, buses, ghosts -----------------------------------------------------------------------------


def test_a_fleet_flies_ten_times_as_fast_and_says_so_in_system_time() -> None:
    async def act(server: FleetServer) -> None:
        loop, begun_s = asyncio.get_running_loop(), server.clock.now_s()
        real_s = loop.time()
        client = await Client.open(server.ports.vehicles[0])
        first = await client.one("SYSTEM_TIME")
        last = await client.one("SYSTEM_TIME", lambda m: m.time_boot_ms - first.time_boot_ms >= 5_000)
        passed_s = server.clock.now_s() - begun_s
        assert passed_s == pytest.approx(10.0 * (loop.time() - real_s), abs=2.0)
        flown_s, utc_s = (
            (last.time_boot_ms - first.time_boot_ms) / 1e3,
            (last.time_unix_usec - first.time_unix_usec) / 1e6,
        )
        # UTC goes on while the fleet of a busy machine stands, and is read a little after the tick that it belongs to
        assert flown_s - 1.0 <= utc_s <= passed_s

    fly(built_in("circle8", 1), act, start=Start.AIRBORNE, speedup=10.0)


def test_in_lockstep_two_fleets_of_one_seed_say_the_same_bytes() -> None:
    def said(seed: int) -> list[bytes]:
        heard: list[bytes] = []
        config = FleetConfig(start=Start.AIRBORNE, speedup=0.0, seed=seed, **ANY_PORT)
        server = FleetServer(two_apart(50.0), config, utc_clock=lambda: 1e9)

        def keep(datagram: bytes, _: object = None) -> None:
            heard.append(datagram)

        async def act(server: FleetServer) -> None:
            hello = Encoder(255, 190).encode("HEARTBEAT", type=6)
            for link, autopilot in zip(server._vehicle_links, server.autopilots, strict=True):
                autopilot.receive(hello, ("127.0.0.1", 9), server.clock.now_s())
                link.send = keep  # type: ignore[method-assign]
            server.advance(3.0)
            assert server.world.time_s == pytest.approx(3.0)

        asyncio.run(run(server, act))
        return heard

    once = said(1)
    assert len(once) > 40 and once == said(1)
    assert once != said(2)


def test_in_lockstep_steps_shorter_than_a_tick_add_up() -> None:
    async def act(server: FleetServer) -> None:
        for _ in range(10):
            server.advance(0.01)
        assert server.world.time_s == pytest.approx(0.1)
        server.advance(0.05)
        server.advance(0.05)
        assert (server.world.time_s, server.clock.now_s()) == pytest.approx((0.2, 0.2))
        with pytest.raises(ValueError, match="not negative"):
            server.advance(-1.0)

    asyncio.run(run(FleetServer(two_apart(50.0), FleetConfig(speedup=0.0, **ANY_PORT)), act))


def test_in_lockstep_receivers_on_board_listen_from_the_first_tick() -> None:
    async def act(server: FleetServer) -> None:
        server.advance(TICK_S)
        assert sorted(server.air.listeners.subscribers.values()) == [1, 2]

    config = FleetConfig(start=Start.AIRBORNE, speedup=0.0, rid_on_bus=True, **ANY_PORT)
    asyncio.run(run(FleetServer(two_apart(50.0), config), act))


def test_a_fleet_in_real_time_is_not_advanced_by_hand() -> None:
    with pytest.raises(RuntimeError, match="lockstep"):
        FleetServer(built_in("circle8", 1), FleetConfig(**ANY_PORT)).advance(1.0)


def test_a_ground_station_is_shown_the_traffic_around_vehicle_1() -> None:
    async def act(server: FleetServer) -> None:
        await asyncio.wait_for(shown.wait(), PATIENCE_S)

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ground:
        ground.bind(("127.0.0.1", 0))
        ground.setblocking(False)
        shown = asyncio.Event()
        seen: list[Any] = []

        def read() -> None:
            for frame in parse_datagram(ground.recv(2048), CRC_EXTRAS):
                assert isinstance(frame, Frame)
                seen.append((frame.sysid, frame.compid, decode_message(frame).name))
                if seen[-1][2] == "ADSB_VEHICLE":
                    shown.set()

        async def listen(server: FleetServer) -> None:
            asyncio.get_running_loop().add_reader(ground, read)
            await act(server)
            asyncio.get_running_loop().remove_reader(ground)

        fly(two_apart(50.0), listen, start=Start.AIRBORNE, ground_station=f"udpout:127.0.0.1:{ground.getsockname()[1]}")
    assert (1, 156, "ADSB_VEHICLE") in seen


def test_a_vehicle_hears_the_others_on_its_own_bus() -> None:
    async def act(server: FleetServer) -> None:
        client = await Client.open(server.ports.vehicles[0])
        message = await client.one("OPEN_DRONE_ID_LOCATION", lambda m: any(m.id_or_mac))
        assert message.id_or_mac[5] == 2

    fly(two_apart(50.0), act, start=Start.AIRBORNE, rid_on_bus=True)


def test_a_ghost_is_heard_around_its_transmitter_and_a_silent_vehicle_nowhere() -> None:
    real, silent = two_apart(50.0).vehicles
    far = (9000.0, 0.0, -50.0)
    ghost = replace(real, start_ned_m=far, ghost=True, cooperative=False, transmitter_ned_m=(0.0, 30.0, 0.0))
    scenario = Scenario("haunted", 60.0, (real, replace(silent, silent=True), ghost))

    async def act(server: FleetServer) -> None:
        daemon = await Client.open(server.ports.air, 1, 196)
        await daemon.until(lambda heard: [m for _, m in heard if m.name == "OPEN_DRONE_ID_LOCATION"][15:])
        assert {source for source, _ in daemon.heard} == {3}
        mute = await Client.open(server.ports.vehicles[2])
        await daemon.until(lambda heard: len(heard) > 60)
        assert mute.heard == []

    fly(scenario, act, start=Start.AIRBORNE)
