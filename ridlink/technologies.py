"""What the ways of broadcasting Remote ID can do: one table for the emulator's air and for campaigns.

Units: seconds, metres; shares within 0 and 1.
"""

from __future__ import annotations

from dataclasses import dataclass

DEFAULT_RANGE_M = 400.0
"""Radio range unless set: how far each vehicle sees in the paper's simulation (k_size)."""


@dataclass(frozen=True, slots=True)
class Technology:
    """What a way of broadcasting Remote ID can do.

    Args:
        name: As ``--technology`` takes it.
        period_s: Shortest time between two updates of one sender; broadcasters never go below it.
        range_m: Distance up to which everything that is not lost is heard.
        latency_s: Time from sending to hearing, uniform between the two.
        loss: Share of broadcasts that a receiver in range misses, independently.
        source: Where the figures come from; "assumed" where nobody prints one.
    """

    name: str
    period_s: float
    range_m: float
    latency_s: tuple[float, float]
    loss: float
    source: str


TECHNOLOGIES: dict[str, Technology] = {
    technology.name: technology
    for technology in (
        Technology(
            "ideal", 0.0, DEFAULT_RANGE_M, (0.0, 0.0), 0.0, "range: k_size of the paper; no period, delay or loss"
        ),
        Technology(
            "bt4",
            1.0,
            300.0,
            (0.02, 0.3),
            0.1,
            "period: ASTM F3411 minimum for dynamic messages, BT4_RATE of ArduRemoteID; range: opendroneid.org says "
            "200 to 400 m; latency (several advertisements a report) and loss assumed",
        ),
        Technology(
            "bt5",
            1.0,
            1200.0,
            (0.02, 0.2),
            0.05,
            "period: ASTM F3411 minimum, BT5_RATE of ArduRemoteID; range: opendroneid.org says 4 times Bluetooth 4; "
            "latency and loss assumed",
        ),
        Technology(
            "wifi-beacon",
            0.1024,
            400.0,
            (0.0, 0.1024),
            0.1,
            "period: default beacon interval of IEEE 802.11, 100 TU; range: opendroneid.org, upper end; latency: a "
            "report waits for the next beacon; loss assumed",
        ),
        Technology(
            "wifi-nan",
            0.524288,
            400.0,
            (0.0, 0.524288),
            0.1,
            "period: Wi-Fi Aware discovery windows, 512 TU apart; range: opendroneid.org, upper end; latency: a report "
            "waits for the next window; loss assumed",
        ),
        Technology(
            "nr-sidelink",
            0.1,
            600.0,
            (0.01, 0.1),
            0.01,
            "period, range, latency: what 3GPP TS 22.125 asks of UAV-to-UAV broadcast (10 messages a second, 600 m, at "
            "most 100 ms); loss assumed",
        ),
    )
}
"""Technologies of the paper's comparison (whose figure is not part of its text), and an ideal one. Losses are those of
an uncrowded band."""
