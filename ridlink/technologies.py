"""Range, period, latency and loss of each technology that broadcasts Remote ID, for emulator, campaigns and figures.

Units: seconds, metres; shares within 0 and 1. A report arrives with the product of two probabilities:

- `link_share`: not lost over distance: ``(1 - loss) (1 - edge_loss (d / range)^4)`` within range and nothing beyond.
  At the range about half arrives in the open; the fourth power (assumed) keeps losses low in its near half.
- `collision_share`: not lost to other senders: ``exp(-crowding m)`` with m of them in range of the receiver. Unslotted
  access (ALOHA) loses a report to any sender that transmits within one airtime before or after it, hence twice the
  airtime by the period. Carrier sensing and reservation (Wi-Fi, NR) avoid most of these collisions.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

DEFAULT_RANGE_M = 400.0
"""Radio range unless set: how far each vehicle sees in the paper's simulation (k_size)."""

EDGE_POWER = 4.0

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Technology:
    """Figures of one technology that broadcasts Remote ID.

    Args:
        name: As ``--technology`` takes it.
        label: Its name in figures; empty if it is in none of them.
        period_s: Shortest time between two updates of one sender.
        range_m: Distance up to which anything is heard.
        latency_s: Time from sending to reception, uniform between the two.
        loss: Share of broadcasts that a receiver close by misses, independently.
        edge_loss: Additional share lost at the end of the range.
        crowding: Probability that one more sender in range destroys a report.
        source: Where the figures come from; "assumed" for those that no source gives.
    """

    name: str
    label: str
    period_s: float
    range_m: float
    latency_s: tuple[float, float]
    loss: float
    edge_loss: float
    crowding: float
    source: str

    def link_share(self, distance_m: npt.ArrayLike, range_m: float | None = None) -> FloatArray:
        """Share of broadcasts that arrive over a distance, if nobody else sends; shape as ``distance_m``.

        Args:
            distance_m: Between sender and receiver.
            range_m: Another range than the technology's.
        """
        ratio = np.asarray(distance_m, dtype=np.float64) / (self.range_m if range_m is None else range_m)
        return np.where(ratio <= 1.0, (1.0 - self.loss) * (1.0 - self.edge_loss * ratio**EDGE_POWER), 0.0)

    def collision_share(self, others: npt.ArrayLike) -> FloatArray:
        """Share of broadcasts that do not collide; shape as ``others``.

        Args:
            others: Number of other senders in range of the receiver.
        """
        return np.exp(-self.crowding * np.asarray(others, dtype=np.float64))


TECHNOLOGIES: dict[str, Technology] = {
    technology.name: technology
    for technology in (
        Technology(
            name="ideal",
            label="",
            period_s=0.0,
            range_m=DEFAULT_RANGE_M,
            latency_s=(0.0, 0.0),
            loss=0.0,
            edge_loss=0.0,
            crowding=0.0,
            source="range: k_size of the paper; no period, delay or loss",
        ),
        Technology(
            name="bt4",
            label="Bluetooth 4",
            period_s=1.0,
            range_m=300.0,
            latency_s=(0.02, 0.3),
            loss=0.1,
            edge_loss=0.5,
            crowding=0.003,
            source="period: ASTM F3411 minimum for dynamic messages, BT4_RATE of ArduRemoteID; range: opendroneid.org, "
            "200 to 400 m; crowding: four advertisements of 0.376 ms on each channel; latency (several advertisements "
            "a report) and losses assumed",
        ),
        Technology(
            name="bt5",
            label="Bluetooth 5 long range",
            period_s=1.0,
            range_m=1200.0,
            latency_s=(0.02, 0.2),
            loss=0.05,
            edge_loss=0.5,
            crowding=0.006,
            source="period: ASTM F3411 minimum, BT5_RATE of ArduRemoteID; range: opendroneid.org, 4 times Bluetooth 4; "
            "crowding: about 3 ms of coded advertising on each primary channel; latency and losses assumed",
        ),
        Technology(
            name="wifi-beacon",
            label="Wi-Fi beacon (SSID)",
            period_s=0.1024,
            range_m=400.0,
            latency_s=(0.0, 0.1024),
            loss=0.1,
            edge_loss=0.5,
            crowding=0.01,
            source="period: default beacon interval of IEEE 802.11, 100 TU; range: opendroneid.org, upper end; "
            "latency: a report waits for the next beacon; crowding: 2.6 ms at 1 Mbit/s, four fifths of it avoided by "
            "carrier sensing (assumed); losses assumed",
        ),
        Technology(
            name="wifi-nan",
            label="Wi-Fi NAN",
            period_s=0.524288,
            range_m=400.0,
            latency_s=(0.0, 0.524288),
            loss=0.1,
            edge_loss=0.5,
            crowding=0.012,
            source="period: Wi-Fi Aware discovery windows, 512 TU apart; range: opendroneid.org, upper end; latency: a "
            "report waits for the next window; crowding: 0.5 ms at 6 Mbit/s, all within windows of 16 TU, four fifths "
            "avoided by carrier sensing (assumed); losses assumed",
        ),
        Technology(
            name="nr-sidelink",
            label="5G NR sidelink",
            period_s=0.1,
            range_m=600.0,
            latency_s=(0.01, 0.1),
            loss=0.01,
            edge_loss=0.5,
            crowding=0.0005,
            source="period, range, latency: what 3GPP TS 22.125 asks of UAV-to-UAV broadcast (10 messages a second, "
            "600 m, at most 100 ms); crowding: 400 resources in 100 ms, four fifths of the conflicts avoided by "
            "sensing (both assumed); losses assumed",
        ),
        Technology(
            name="flarm",
            label="FLARM",
            period_s=1.0,
            range_m=5000.0,
            latency_s=(0.0, 0.1),
            loss=0.05,
            edge_loss=0.5,
            crowding=0.012,
            source="period: one message a second (data port specification 3.02); range: its manual; crowding: about "
            "6 ms a packet; latency and losses assumed",
        ),
        Technology(
            name="lora",
            label="LoRa",
            period_s=6.2,
            range_m=2000.0,
            latency_s=(0.062, 0.1),
            loss=0.05,
            edge_loss=0.5,
            crowding=0.02,
            source="period: 25 bytes at SF7, 125 kHz take 61.7 ms, 1 % duty cycle; latency: no less than that; "
            "crowding: twice the duty cycle; range and losses assumed",
        ),
    )
}
"""Technologies of the paper's comparison (whose figure is not part of its text), and an ideal one."""

COMPARED = tuple(technology for technology in TECHNOLOGIES.values() if technology.label)
"""The technologies that the paper compares."""
