"""Pages on a real socket: what they are told, and who is refused."""

from __future__ import annotations

import asyncio
import contextlib
import json
import time
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

pytest.importorskip("uvicorn", reason="needs ridlink[web]")
pytest.importorskip("websockets", reason="needs ridlink[web]")

import httpx
from websockets.exceptions import ConnectionClosed

from ridlink.errors import LinkError
from ridlink.view.guard import host_name
from ridlink.view.instants import Instant
from ridlink.view.server import MOST_PAGES, check_can_listen
from tests.observer.flights import Flyer
from tests.view.serving import PATIENCE_S, a_page, a_show, heard, run, serving


def test_a_page_is_greeted_and_sees_who_flies() -> None:
    async def body() -> None:
        async with serving(a_show()) as server, a_page(server) as page:
            hello = await heard(page, "hello")
            assert (hello["version"], hello["title"], hello["live"], hello["truth"]) == (1, "a test", False, False)
            assert [one["name"] for one in hello["definitions"]][4] == hello["definition"] == "candidate2"
            assert (hello["t0"], hello["t1"]) == (pytest.approx(0.1), pytest.approx(3.0))
            instant = await heard(page, "instant")
            alpha = next(row for row in instant["vehicles"] if row[0] == "ALPHA")
            assert alpha[1:5] == pytest.approx([30.0, 0.0, 10.0, 0.0], abs=0.2)
            airframe, error, displacement = alpha[5:8]
            assert (airframe, error) == (pytest.approx(0.3), pytest.approx(10.8))
            assert displacement == pytest.approx(11.8, abs=0.1), "a tenth of a second at 10 m/s on top"
            assert alpha[10:12] == [None, None], "nobody knows where it truly is"
            [[i, j, distance, required, entry]] = instant["pairs"]
            assert {i, j} == {0, 1} and distance == pytest.approx(240.0, abs=0.5)
            assert entry == pytest.approx((distance - required) / 20.0, abs=0.1)
            assert instant["tightest"] == [i, j, *instant["nearest"]] == [i, j, distance, required]
            encounters = await heard(page, "encounters")
            assert [one["pair"] for one in encounters["encounters"]] in ([["ALPHA", "BRAVO"]], [["BRAVO", "ALPHA"]])

    run(body)


def test_files_are_compressed_for_whoever_takes_that() -> None:
    async def body() -> None:
        async with serving(a_show()) as server, httpx.AsyncClient(base_url=server.url) as client:
            for path in ("", "static/vendor/leaflet.js"):
                small = await client.get(path, headers={"accept-encoding": "deflate, gzip, br"})
                plain = await client.get(path, headers={"accept-encoding": "identity"})
                assert small.headers["content-encoding"] == "gzip" and "content-encoding" not in plain.headers
                assert int(small.headers["content-length"]) < 0.4 * int(plain.headers["content-length"])
                assert small.content == plain.content
                for one in (small, plain):
                    assert one.headers["vary"] == "accept-encoding"
                    assert one.headers["content-type"].startswith("text/")

    run(body)


def test_another_definition_has_other_discs() -> None:
    async def body() -> None:
        async with serving(a_show()) as server, a_page(server) as page:
            small = await heard(page, "instant", definition="candidate2")
            await page.send('{"definition":"remote-id"}')
            large = await heard(page, "instant", definition="remote-id")
            assert large["vehicles"][0][7] > small["vehicles"][0][7] + 20.0

    run(body)


def test_time_goes_back_when_asked_to() -> None:
    async def body() -> None:
        async with serving(a_show()) as server, a_page(server) as page:
            await page.send('{"follow":false,"at":1.04,"id":7}')
            [instant] = (await heard(page, "instants", id=7, done=True))["instants"]
            assert instant["t"] == 1.0
            await page.send('{"window":[0.5,1.5],"id":"w"}')
            window = await heard(page, "instants", id="w", done=True)
            assert [one["t"] for one in window["instants"]] == pytest.approx([0.5 + k / 10 for k in range(11)])
            await page.send('{"series":[0,3]}')
            series = await heard(page, "series", complete=True)
            assert series["nearest_m"][9] == pytest.approx(300.0 - 20.0 * 1.0, abs=0.5)
            assert len(series["nearest_m"]) == len(series["required_m"]) == 30

    run(body)


def test_a_window_of_a_crowd_comes_in_parts() -> None:
    crowd = [Flyer(k + 1, (40.0 * k, 0.0), (5.0, 0.0), b"CROWD%03d" % k) for k in range(60)]

    async def body() -> None:
        async with serving(a_show(crowd, 2.0)) as server, a_page(server) as page:
            await page.send('{"follow":false,"window":[0,2],"id":1}')
            parts: list[dict[str, Any]] = []
            while not parts or not parts[-1]["done"]:
                parts.append(await heard(page, "instants", id=1))
            assert len(parts) > 1 and all(len(json.dumps(part)) < 90_000 for part in parts)
            times = [one["t"] for part in parts for one in part["instants"]]
            assert times == sorted(times) and len(times) == len(set(times)) == 20

    run(body)


def test_the_velocity_space_of_the_selected_vehicle_forbids_what_leads_into_the_other() -> None:
    async def body() -> None:
        show = a_show(until_s=10.0)
        show.look_at_vehicles()
        async with serving(show) as server, a_page(server) as page:
            await page.send('{"select":"ALPHA"}')
            while (space := (await heard(page, "instant"))["selected"]) is None:
                continue
            assert space["name"] == "ALPHA" and space["preferred"] is None, "nobody knows its goal"
            assert space["v"] == space["chosen"] == pytest.approx([10.0, 0.0], abs=0.1)
            assert space["max_speed"] >= 10.0 and space["reachable"]["radius"] > 0.0
            assert {plane[3] for plane in space["planes"]} == {"BRAVO"}
            assert any(n * 10.0 < bound for n, _, bound, _ in space["planes"]), "flying on leads into the disc"
            assert all(abs(n * n + e * e - 1.0) < 1e-3 for n, e, _, _ in space["planes"])

    run(body)


@pytest.mark.parametrize(
    "headers",
    [
        {"origin": "http://evil.example"},
        {"origin": "null"},
        {"origin": "http://127.0.0.1.evil.example:8090"},
        {"host": "evil.example"},
        {"host": "127.0.0.1.evil.example"},
        {"host": ""},
    ],
    ids=str,
)
def test_f31_a_page_of_another_site_is_refused(headers: dict[str, str]) -> None:
    async def body() -> None:
        async with serving(a_show()) as server, httpx.AsyncClient() as client:
            for path in ("", "healthz", "static/index.html", "ws/v1"):
                answer = await client.get(server.url + path, headers=headers)
                assert answer.status_code == 403, path
                assert "default-src 'self'" in answer.headers["content-security-policy"]
            upgrade = {"connection": "Upgrade", "upgrade": "websocket", "sec-websocket-version": "13",
                       "sec-websocket-key": "dGhlIHNhbXBsZSBub25jZQ=="}  # fmt: skip
            answer = await client.get(server.url + "ws/v1", headers=headers | upgrade)
            assert answer.status_code in (400, 403)

    run(body)


def test_f31_our_own_page_and_programs_are_answered() -> None:
    async def body() -> None:
        async with serving(a_show(), names=["field.example"]) as server, httpx.AsyncClient() as client:
            own = server.url.rstrip("/")
            async with a_page(server, origin=own) as page:
                await heard(page, "hello")
            for host in ("localhost", "localhost:9000", "field.example", "[::1]:8090"):
                assert (await client.get(server.url, headers={"host": host})).status_code == 200
            answer = await client.get(server.url)
            assert answer.headers["content-type"] == "text/html; charset=utf-8"
            assert answer.headers["x-content-type-options"] == "nosniff"
            assert "default-src 'self'" in answer.headers["content-security-policy"]
            assert answer.headers["referrer-policy"] == "no-referrer" and answer.headers["cache-control"] == "no-cache"
            assert "server" not in answer.headers
            assert (await client.post(server.url)).status_code == 405

    run(body)


@pytest.mark.parametrize(
    "path",
    [
        "/static/../server.py", "/static/%2e%2e/server.py", "/static/..%2fserver.py", "/static/%2e%2e%2f%2e%2e%2fcli",
        "/../../etc/passwd", "//etc/passwd", "/static//etc/passwd", "/static/%00", "/static/", "/static",
        "/static/index.html/", "/static/.%5cserver.py",
    ],
)  # fmt: skip
def test_f31_no_path_leads_out_of_the_table(path: str) -> None:
    async def body() -> None:
        async with serving(a_show()) as server:
            port = int(server.url.rsplit(":", 1)[1].strip("/"))
            reader, writer = await asyncio.open_connection("127.0.0.1", port)
            writer.write(f"GET {path} HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n".encode())
            answer = await asyncio.wait_for(reader.read(), PATIENCE_S)
            writer.close()
            assert answer.split(b"\r\n")[0].split()[1] in (b"404", b"400", b"307"), answer[:100]
            assert b"import" not in answer and b"root:" not in answer

    run(body)


def test_f31_one_page_too_many_is_refused_until_another_leaves() -> None:
    async def body() -> None:
        async with serving(a_show()) as server, contextlib.AsyncExitStack() as pages:
            opened = [await pages.enter_async_context(a_page(server)) for _ in range(MOST_PAGES)]
            async with a_page(server) as refused:
                await asyncio.wait_for(refused.wait_closed(), PATIENCE_S)
                assert refused.close_code == 1013
            await opened[0].close()
            async with asyncio.timeout(PATIENCE_S):
                is_inside = False
                while not is_inside:  # the server hears of the parting in its own time
                    async with a_page(server) as late:
                        with contextlib.suppress(ConnectionClosed):
                            is_inside = bool(await heard(late, "hello"))

    run(body)


MISTAKES = [
    "", "{", "[]", "null", "{}", '{"id":1}', '{"definition":"candidate3"}', '{"at":"now"}', '{"at":NaN}',
    '{"window":[1]}', '{"unknown":1}', '{"follow":1}', '{"select":' + "[" * 2000, '{"select":"' + "x" * 5000,
]  # fmt: skip


def test_f31_a_mistake_is_told_and_ten_in_a_row_end_it() -> None:
    async def body() -> None:
        async with serving(a_show()) as server:
            for mistake in MISTAKES:
                async with a_page(server) as page:
                    await page.send(mistake)
                    told = await heard(page, "error")
                    assert told["message"].startswith("request not understood")
                    await page.send('{"at":1,"id":1}')
                    await heard(page, "instants", id=1)
            async with a_page(server) as page:
                with pytest.raises(ConnectionClosed):
                    for _ in range(20):
                        await page.send("?")
                        await heard(page, "error")
                assert page.close_code == 1008

    run(body)


def test_f31_numbers_without_bound_are_no_harm() -> None:
    async def body() -> None:
        async with serving(a_show()) as server, a_page(server) as page:
            for number, request in enumerate(('"at":1e308', '"at":-1e308', '"window":[-1e308,1e308]',
                                              '"window":[5,-5]', '"at":99999999999999999999999')):  # fmt: skip
                await page.send(f'{{{request},"id":{number}}}')
                await heard(page, "instants", id=number, done=True)
            await page.send('{"series":[-1e308,1e308]}')
            assert (await heard(page, "series", complete=True))["from"] == pytest.approx(0.1)

    run(body)


def test_f32_hostile_ids_arrive_as_text() -> None:
    hostile = b"<img onerror=x>\x1b[2J"
    flyers = [Flyer(1, (0.0, 0.0), (1.0, 0.0), hostile[:20]), Flyer(2, (9.0, 0.0), (1.0, 0.0), b"=cmd|+/#\r\n\x00\xff")]

    async def body() -> None:
        async with serving(a_show(flyers, 1.0)) as server, a_page(server) as page:
            message = await asyncio.wait_for(page.recv(), PATIENCE_S)
            instant = await heard(page, "instant")
            names = [row[0] for row in instant["vehicles"]]
            assert isinstance(message, str) and len(names) == 2
            assert all(name.isascii() and name.isprintable() for name in names)
            assert any(name.startswith("<img onerror=x>\\x1b[") for name in names), "the page shows it as text"
            await page.send(json.dumps({"select": names[0]}))
            await page.send('{"select":"</script>\\u0000","at":1,"id":1}')
            await heard(page, "instants", id=1)

    run(body)


def test_how_far_behind_a_loop_was_that_stood_still_is_told_and_not_at_once_replaced(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("ridlink.view.server.SECOND_S", 0.2)

    async def body() -> None:
        told_s: list[float] = []
        has_gone_on = asyncio.Event()

        def health() -> dict[str, Any]:
            now_s = time.monotonic()
            told_s.append(now_s)
            while len(told_s) == 2 and time.monotonic() < now_s + 1.0:
                continue
            if len(told_s) == 5:
                has_gone_on.set()
            return {}

        async with serving(a_show(), health=health):
            await has_gone_on.wait()
        assert min(later - one for one, later in pairwise(told_s)) > 0.1

    run(body)


def test_an_answer_that_fails_is_logged_once_and_counted_and_nobody_else_is_disturbed(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async def body() -> None:
        show = a_show(obstacles=[[(0.0, 0.0)]])  # a polygon has three corners at the least
        show.look_at_vehicles()
        async with serving(show) as server, a_page(server) as other:
            await heard(other, "hello")
            for _ in range(2):
                async with a_page(server) as page:
                    await page.send('{"select":"ALPHA"}')
                    with pytest.raises(ConnectionClosed):
                        async with asyncio.timeout(PATIENCE_S):
                            while True:
                                await page.recv()
            while not (health := await heard(other, "health"))["rejects"]:
                continue
            assert health["rejects"] == {"answers_failed": 2}
        assert [record.message for record in caplog.records] == ["an answer failed, as others may: those are counted"]
        assert caplog.records[0].exc_info is not None

    run(body)


def test_what_fails_in_the_history_ends_what_is_served_beside_it() -> None:
    async def body() -> None:
        show = a_show()
        show.history.add(Instant(4.0, (1, 2), ("ALPHA", "BRAVO"), np.zeros((2, 3), np.float32)))
        with pytest.raises(IndexError):
            async with serving(show):
                await asyncio.Event().wait()

    run(body)


def test_an_address_of_another_machine_is_told_what_to_write() -> None:
    with pytest.raises(LinkError, match=r"192\.0\.2\.1:0/: no address of this machine; 127\.0\.0\.1 is for"):
        check_can_listen("192.0.2.1", 0)


def test_a_port_in_use_is_named() -> None:
    async def body() -> None:
        async with serving(a_show()) as server:
            port = int(server.url.rsplit(":", 1)[1].strip("/"))
            with pytest.raises(LinkError, match=f"port {port} is in use"):
                async with serving(a_show(), port=port):
                    pass

    run(body)


def test_a_name_that_no_host_can_have_is_one_line() -> None:
    async def body() -> None:
        with pytest.raises(LinkError, match=r"no such host: .*label empty"):
            async with serving(a_show(), host="127..0.0.1"):
                pass

    run(body)


def test_names_of_hosts() -> None:
    assert [host_name(host) for host in ("A:1", "[::1]:8090", "[::1]", "b", "")] == ["a", "::1", "::1", "b", ""]
