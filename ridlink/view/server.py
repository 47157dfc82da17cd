"""Serves pages on a socket: HTTP for the files, a WebSocket for the data.

Each page has a reader and a writer. The writer takes one message at a time from its `Conversation`, which computes it
if it is not cached, and waits until the socket has taken it. A page that reads nothing for 5 s is dropped. Work is
done in slices of one instant, one slice after the other for all pages, so that the next tenth of a second is late by
one slice at most.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import logging
import socket
import time
from collections import Counter
from collections.abc import AsyncIterator, Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from ridlink.companions import beside
from ridlink.errors import LinkError, MissingExtraError
from ridlink.view import wire
from ridlink.view.conversation import LONGEST_REQUEST, Conversation
from ridlink.view.door import Door
from ridlink.view.files import page_files
from ridlink.view.guard import LOOPBACK, Guard
from ridlink.view.show import Show

try:
    import uvicorn
    from starlette.applications import Starlette
    from starlette.requests import Request
    from starlette.responses import Response
    from starlette.routing import Route, WebSocketRoute
    from starlette.websockets import WebSocket, WebSocketDisconnect
    from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
except ImportError as error:
    raise MissingExtraError("web", "the page") from error

DEFAULT_PORT = 8090
MOST_PAGES = 32
TRY_AGAIN_LATER = 1013
UNREAD_S = 5.0
"""A page that reads nothing for this time is dropped."""

LEAVES_S = 1.0
"""Time for a peer to complete the closing handshake, which browsers do at once; it keeps its place until then."""

SECOND_S = 1.0
SLICE_S = 0.01
"""Time after which reading of histories is interrupted for other work."""

BACKLOG = 128
GONE = (WebSocketDisconnect, OSError)
"""Exceptions raised if a page has left."""

SEND_BUFFER_BYTES = 128 * 1024
"""Kernel buffer for each page; the default takes megabytes for a page that does not read."""

RECEIVE_BUFFER_BYTES = 16 * 1024
"""Kernel buffer for unread data from a page."""


class _Protocol(WebSocketsSansIOProtocol):
    """Lets the application end a connection without waiting for a peer that does not read or answer."""

    def connection_made(self, transport: Any) -> None:
        super().connection_made(transport)
        self.close_timeout = LEAVES_S
        self.app_state = {**self.app_state, "abort": transport.abort}

    def handle_ping(self) -> None:
        """Answer a ping, unless the peer reads no answers, which would then fill the memory."""
        if self.writable.is_set():
            super().handle_ping()
        else:
            self.conn.data_to_send()


@dataclass(slots=True, eq=False)
class _Page:
    conversation: Conversation
    wake: asyncio.Event


class ViewServer:
    """Serves a show.

    Args:
        show: The show.
        host: Address to listen on.
        port: Port; 0 lets the kernel choose.
        names: Further host names that are accepted.
        health: Returns further facts for the page; called once a second.

    Attributes:
        show: The show.
        counters: Pages that were ``served``, ``dropped`` because they read nothing, ``refused`` because there were too
            many.
    """

    def __init__(
        self,
        show: Show,
        host: str = "127.0.0.1",
        port: int = DEFAULT_PORT,
        *,
        names: Iterable[str] = (),
        health: Callable[[], Mapping[str, Any]] = dict,
    ) -> None:
        self.show = show
        self.counters: Counter[str] = Counter()
        self._host = host
        self._port = port
        self._health = health
        self._files = page_files()
        self._pages: set[_Page] = set()
        self._one_slice = asyncio.Lock()
        self._news = asyncio.Event()
        routes = [Route("/healthz", self._healthz), WebSocketRoute("/ws/v1", self._converse)]
        routes += [Route(path, self._file) for path in self._files]
        self._guard = Guard(Starlette(routes=routes), host, names)
        config = uvicorn.Config(
            self._guard,
            http="h11",
            ws=_Protocol,
            ws_max_size=2 * LONGEST_REQUEST,
            ws_per_message_deflate=False,
            lifespan="off",
            log_config=None,
            access_log=False,
            server_header=False,
            timeout_graceful_shutdown=1,
        )
        logging.getLogger("uvicorn").setLevel(logging.CRITICAL)
        self._server = _Server(config)
        self._door = Door(self._server.protocol)

    @property
    def url(self) -> str:
        """URL of the page, within `serving`."""
        host = "127.0.0.1" if self._host in ("0.0.0.0", "::", *LOOPBACK[:1]) else self._host
        return f"http://{f'[{host}]' if ':' in host else host}:{self._port}/"

    @property
    def pages(self) -> int:
        """Number of connected pages."""
        return len(self._pages)

    @contextlib.asynccontextmanager
    async def serving(self) -> AsyncIterator[None]:
        """Listen and serve while the block lasts; at its end all connections are closed and the port is free again.

        An error in the server ends the block and is raised there.

        Raises:
            LinkError: If the port is in use, or the address is not of this machine.
        """
        with _listen(self._host, self._port) as listening:
            self._port = listening.getsockname()[1]
            async with beside(
                self._server.serve(sockets=[listening]),
                self._door.run(listening),
                self._read_books(),
                self._count_seconds(),
            ):
                yield

    def publish(self) -> None:
        """Note a new instant, or a new source."""
        self._news.set()
        for page in self._pages:
            page.conversation.step()
            page.wake.set()

    async def _healthz(self, _: Request) -> Response:
        return Response("ok\n", media_type="text/plain")

    async def _file(self, request: Request) -> Response:
        file = self._files[request.url.path]
        headers = {"content-type": file.kind, "vary": "accept-encoding"}
        if "gzip" not in [name.strip() for name in request.headers.get("accept-encoding", "").split(",")]:
            return Response(file.content, headers=headers)
        return Response(file.gzipped, headers={**headers, "content-encoding": "gzip"})

    async def _converse(self, websocket: WebSocket) -> None:
        if len(self._pages) >= MOST_PAGES:
            self.counters["refused"] += 1
            with contextlib.suppress(*GONE):
                await websocket.accept()  # a browser does not tell its page why a handshake failed
                await websocket.close(TRY_AGAIN_LATER, f"{MOST_PAGES} pages look on already")
            return
        page = _Page(Conversation(self.show), asyncio.Event())
        self._pages.add(page)  # before the first await, so that there are never more pages
        page.wake.set()
        try:
            await websocket.accept()
            self._news.set()
            self.counters["served"] += 1
            reading = asyncio.create_task(_read(websocket, page))
            writing = asyncio.create_task(self._write(websocket, page))
            await asyncio.wait({reading, writing}, return_when=asyncio.FIRST_COMPLETED)
            for task in (reading, writing):
                task.cancel()
            results = await asyncio.gather(reading, writing, return_exceptions=True)
            failures = [one for one in results if isinstance(one, Exception) and not isinstance(one, GONE)]
            if any(isinstance(result, TimeoutError) for result in results):
                self.counters["dropped"] += 1
                websocket.scope["state"]["abort"]()
            elif failures:
                raise failures[0]
            elif page.conversation.hopeless:
                with contextlib.suppress(RuntimeError, TimeoutError):
                    async with asyncio.timeout(SECOND_S):
                        await websocket.close(1008, "too many mistakes")
        except GONE:
            pass
        finally:
            self._pages.discard(page)
            self._news.set()

    async def _write(self, websocket: WebSocket, page: _Page) -> None:
        conversation = page.conversation
        while not conversation.hopeless:
            async with self._one_slice:
                message = conversation.next()
                await asyncio.sleep(0)
            if message is None:
                page.wake.clear()
                await page.wake.wait()
            elif message:
                await _send(websocket, message)
        message = conversation.next()
        while message is not None and not message.startswith(b'{"type":"error"'):
            message = conversation.next()
        if message is not None:
            await _send(websocket, message)

    async def _read_books(self) -> None:
        """Let the books of all displayed definitions read on."""
        while True:
            wanted = {page.conversation.definition for page in self._pages} | {self.show.definition}
            behind = [book for book in map(self.show.book, wanted) if book.behind]
            if not behind:
                self._news.clear()
                await self._news.wait()
                continue
            for book in behind:
                async with self._one_slice:
                    until_s = time.monotonic() + SLICE_S
                    while book.read() and time.monotonic() < until_s:
                        continue
                    if not book.behind and not self.show.scenery.live:
                        book.end()
                await asyncio.sleep(0)

    async def _count_seconds(self) -> None:
        while True:
            await asyncio.sleep(SECOND_S)
            vehicles = 0 if self.show.scenery.live else self.show.vehicles
            facts = {"frames_per_s": 0.0, "vehicles": vehicles, "rejects": {}, "lag_ms": 0.0, **self._health()}
            failed = {"answers_failed": self._guard.failures} if self._guard.failures else {}
            facts["rejects"] = {**facts["rejects"], **self._door.counters, **failed}
            extent = self.show.history.extent_s
            health = wire.health(facts, self.pages, self.counters["dropped"], extent, live=self.show.scenery.live)
            self._news.set()
            for page in self._pages:
                page.conversation.second(health)
                page.wake.set()


async def _send(websocket: WebSocket, message: bytes) -> None:
    async with asyncio.timeout(UNREAD_S):
        await websocket.send({"type": "websocket.send", "text": message.decode()})


async def _read(websocket: WebSocket, page: _Page) -> None:
    while not page.conversation.hopeless:
        message = await websocket.receive()
        if message["type"] != "websocket.receive":
            return
        page.conversation.take(message.get("text") or message.get("bytes") or b"")
        page.wake.set()
    await asyncio.Event().wait()  # the writer sends the last message


class _Server(uvicorn.Server):
    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """New connections come through a `Door`."""
        await self.lifespan.startup()
        self.servers = []
        self.started = True

    async def main_loop(self) -> None:
        """Run until cancelled; then close all connections."""
        with contextlib.suppress(asyncio.CancelledError):
            await super().main_loop()

    def protocol(self) -> asyncio.Protocol:
        """The protocol of a new connection."""
        make: Callable[..., asyncio.Protocol] = self.config.http_protocol_class
        return make(config=self.config, server_state=self.server_state, app_state=self.lifespan.state)

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Signals belong to the program that runs the loop."""
        yield


def check_can_listen(host: str, port: int) -> None:
    """Check that a page could be served there now, before what takes long.

    Raises:
        LinkError: As `ViewServer.serving`.
    """
    _listen(host, port).close()


def _listen(host: str, port: int) -> socket.socket:
    try:
        family, kind, _, _, address = socket.getaddrinfo(
            host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )[0]  # fmt: skip
        listening = socket.socket(family, kind)
        try:
            listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            listening.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
            listening.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES)
            if hasattr(socket, "TCP_USER_TIMEOUT"):  # a peer that reads no answer for this time is gone
                listening.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, round(1000 * UNREAD_S))
            listening.bind(address)
            listening.listen(BACKLOG)
        except OSError:
            listening.close()
            raise
        return listening
    except UnicodeError as error:  # a name with an empty label is no OSError
        raise LinkError(f"http://{host}:{port}/: no such host: {error}") from error
    except OSError as error:
        known = {
            errno.EADDRINUSE: f"port {port} is in use; name another, or 0 for any that is free",
            errno.EADDRNOTAVAIL: "no address of this machine; 127.0.0.1 is for this machine only, 0.0.0.0 for all",
        }
        what = known.get(error.errno or 0) or error.strerror or str(error)
        raise LinkError(f"http://{host}:{port}/: {what}") from error
