"""The bridge and brokers that encrypt: a certificate that is trusted, and those that are not, each with its reason."""

from __future__ import annotations

import asyncio
import shutil
import socket
import ssl
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

pytest.importorskip("aiomqtt", reason="needs ridlink[mqtt]")
pytest.importorskip("amqtt", reason="needs amqtt, a broker")

from ridlink.mqtt import BrokerUrl, Publisher, PublisherSettings
from ridlink.mqtt.bridge import Bridge, BrokerError
from tests.loopback import free_port
from tests.mqtt.brokers import PATIENCE_S, SOURCE, TOPICS, a_broker, run
from tests.mqtt.brokers import collected as collected

pytestmark = [
    pytest.mark.filterwarnings("ignore::DeprecationWarning"),
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
]

HERE, ELSEWHERE = "IP:127.0.0.1", "DNS:elsewhere.example"


@pytest.fixture(scope="module")
def certificates(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, tuple[Path, Path]]]:
    """Certificate and key of a broker, by where it says that it is."""
    openssl = shutil.which("openssl")
    if openssl is None:
        pytest.skip("needs openssl: apt-get install openssl")
    folder = tmp_path_factory.mktemp("tls")
    made = {}
    for name in (HERE, ELSEWHERE):
        certificate, key = (folder / f"{name.replace(':', '-')}.{kind}" for kind in ("crt", "key"))
        command = [openssl, "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes"]
        command += ["-keyout", str(key), "-out", str(certificate), "-days", "2", "-subj", "/CN=a broker"]
        subprocess.run([*command, "-addext", f"subjectAltName={name}"], check=True, capture_output=True)
        made[name] = (certificate, key)
    yield made


def a_bridge_to(port: int, ca_file: Path | None) -> Bridge:
    publisher = Publisher(PublisherSettings(TOPICS, rate_hz=10.0))
    trusted = None if ca_file is None else str(ca_file)
    return Bridge(BrokerUrl("127.0.0.1", port, True), TOPICS, publisher, SOURCE, ca_file=trusted)


def test_a_broker_whose_certificate_is_trusted(certificates: dict[str, tuple[Path, Path]]) -> None:
    async def body() -> None:
        certificate, key = certificates[HERE]
        port, stop = free_port(socket.SOCK_STREAM), asyncio.Event()
        async with a_broker(port, ssl=True, certfile=str(certificate), keyfile=str(key)):
            bridge = a_bridge_to(port, certificate)
            running = asyncio.create_task(bridge.run(stop))
            await asyncio.wait_for(bridge.connected.wait(), PATIENCE_S)
            stop.set()
            await running

    run(body)


@pytest.mark.parametrize(
    ("server", "trusted", "says"),
    [
        (HERE, None, "its certificate is not trusted: self-signed certificate"),
        (ELSEWHERE, ELSEWHERE, "its certificate is not trusted: IP address mismatch"),
        (None, HERE, "it speaks no TLS"),
    ],
)
def test_a_broker_that_is_not_who_it_should_be(
    certificates: dict[str, tuple[Path, Path]], server: str | None, trusted: str | None, says: str
) -> None:
    """The first attempt says why, and there is no second: trying again would not help."""
    context = None
    if server is not None:
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.load_cert_chain(*certificates[server])

    async def answer(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.write(b"HTTP/1.1 400 Bad Request\r\n\r\n")
        writer.close()

    async def body() -> None:
        async with await asyncio.start_server(answer, "127.0.0.1", 0, ssl=context) as listening:
            port = listening.sockets[0].getsockname()[1]
            bridge = a_bridge_to(port, None if trusted is None else certificates[trusted][0])
            with pytest.raises(BrokerError) as told:
                await bridge.run(asyncio.Event())
        assert str(told.value).startswith(f"mqtts://127.0.0.1:{port}: {says}") and "\n" not in str(told.value)
        assert "[" not in str(told.value), "no codes of a library"

    run(body)
