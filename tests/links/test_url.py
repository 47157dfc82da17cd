"""Connection strings: what is right, and that every mistake is answered with something right."""

from __future__ import annotations

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ridlink.errors import ConfigError
from ridlink.links import LinkUrl, Scheme, parse_link_url


@pytest.mark.parametrize(
    ("text", "url"),
    [
        ("udpin:127.0.0.1:14540", LinkUrl(Scheme.UDPIN, "127.0.0.1", 14540)),
        ("udpin://127.0.0.1:14540", LinkUrl(Scheme.UDPIN, "127.0.0.1", 14540)),
        (" UDPOUT:drone.local:14550 ", LinkUrl(Scheme.UDPOUT, "drone.local", 14550)),
        ("udpin:0.0.0.0:0", LinkUrl(Scheme.UDPIN, "0.0.0.0", 0)),
        ("udpin::14540", LinkUrl(Scheme.UDPIN, "127.0.0.1", 14540)),
        ("tcpout:[::1]:5760", LinkUrl(Scheme.TCPOUT, "::1", 5760)),
        ("tcpin:127.0.0.1:65535", LinkUrl(Scheme.TCPIN, "127.0.0.1", 65535)),
        ("serial:/dev/ttyACM0:57600", LinkUrl(Scheme.SERIAL, "/dev/ttyACM0", 57600)),
        ("serial:COM3:921600", LinkUrl(Scheme.SERIAL, "COM3", 921600)),
    ],
)
def test_right_spellings(text: str, url: LinkUrl) -> None:
    assert parse_link_url(text) == url
    assert parse_link_url(str(url)) == url


@pytest.mark.parametrize(
    ("text", "right"),
    [
        ("udp:127.0.0.1:14540", "udpin:127.0.0.1:14540"),
        ("udp://127.0.0.1:14540", "udpout:127.0.0.1:14540"),
        ("udp:", "udpin:127.0.0.1:14540"),
        ("tcp:10.0.0.1:5760", "tcpout:10.0.0.1:5760"),
        ("udpinn:127.0.0.1:14541", "udpin:127.0.0.1:14541"),
        ("udb-out:host:1", "udpout:host:1"),
        ("127.0.0.1:14540", "udpin:127.0.0.1:14540"),
        ("10.0.0.1:14550", "udpout:10.0.0.1:14550"),
        ("[::1]:14550", "udpin:[::1]:14550"),
        ("drone.local", "udpout:drone.local:14540"),
        ("drone.local:", "udpout:drone.local:14540"),
        ("14550", "udpin:127.0.0.1:14550"),
        ("drone.local:0", "udpin:127.0.0.1:14540"),
        ("drone.local:99999", "udpin:127.0.0.1:14540"),
        ("", "udpin:127.0.0.1:14540"),
        ("udpin:127.0.0.1", "udpin:127.0.0.1:14540"),
        ("udpin:127.0.0.1:", "udpin:127.0.0.1:14540"),
        ("udpin:14540", "udpin:127.0.0.1:14540"),
        ("udpin:127.0.0.1:65536", "udpin:127.0.0.1:14540"),
        ("udpin:127.0.0.1:" + 5000 * "9", "udpin:127.0.0.1:14540"),
        ("udpin:127.0.0.1:-1", "udpin:127.0.0.1:14540"),
        ("udpin:127.0.0.1:1454O", "udpin:127.0.0.1:14540"),
        ("udpout:127.0.0.1:0", "udpout:127.0.0.1:14540"),
        ("udpin:::1:14540", "udpin:127.0.0.1:14540"),
        ("udpin:a b:14540", "udpin:127.0.0.1:14540"),
        ("udpin:[::1:14540", "udpin:127.0.0.1:14540"),
        ("udpin:127.0.0.1:٣", "udpin:127.0.0.1:14540"),
        ("serial:/dev/ttyACM0", "serial:/dev/ttyACM0:57600"),
        ("serial:/dev/ttyACM0:fast", "serial:/dev/ttyACM0:57600"),
        ("serial:/dev/ttyACM0:" + 5000 * "9", "serial:/dev/ttyACM0:57600"),
        ("serial:", "serial:/dev/ttyACM0:57600"),
    ],
)
def test_mistakes_are_answered_with_a_right_spelling(text: str, right: str) -> None:
    with pytest.raises(ConfigError) as caught:
        parse_link_url(text)
    assert right in str(caught.value)
    assert "\n" not in str(caught.value)


def test_the_address_that_a_link_was_given_reads_back() -> None:
    given = parse_link_url("udpin:[::1]:0").at(("::1", 14541))
    assert str(given) == "udpin:[::1]:14541"
    assert parse_link_url(str(given)) == given


PARTS = st.sampled_from([
    "udpin", "udpout", "tcpin", "tcpout", "serial", "udp", "", ":", ":", ":", "//", "[::1]", "127.0.0.1", "localhost",
    "/dev/ttyACM0", "0", "14540", "65536", "@",
])  # fmt: skip


@given(
    st.text(alphabet="udpintcoserl:/[].0123456789 @\u0663-", max_size=30)
    | st.lists(PARTS, max_size=7).map("".join)
    | st.tuples(PARTS, st.just(":"), PARTS, st.just(":"), PARTS).map("".join)
)
def test_any_text_parses_or_is_refused_with_a_spelling_that_parses(text: str) -> None:
    try:
        url = parse_link_url(text)
    except ConfigError as error:
        spelling = re.findall(r"(?:udpin|udpout|tcpin|tcpout|serial):[^\s,]+", str(error).rpartition("write ")[2])
        assert spelling
        for right in spelling:
            parse_link_url(right)
    else:
        assert parse_link_url(str(url)) == url


@pytest.mark.parametrize(
    ("mine", "other", "leads"),
    [
        ("udpout:127.0.0.1:1", "udpin:127.0.0.1:1", True),
        ("udpout:localhost:1", "udpin:127.0.0.1:1", True),
        ("udpout:127.0.0.1:1", "udpin:0.0.0.0:1", True),
        ("udpout:[::1]:1", "udpin:[::]:1", True),
        ("udpout:0.0.0.0:1", "udpin:127.0.0.1:1", True),
        ("tcpout:drone.local:1", "tcpin:drone.local:1", True),
        ("udpout:127.0.0.1:2", "udpin:127.0.0.1:1", False),
        ("udpout:drone.local:1", "udpin:0.0.0.0:1", False),
        ("tcpout:127.0.0.1:1", "udpin:127.0.0.1:1", False),
        ("udpin:127.0.0.1:1", "udpin:127.0.0.1:1", False),
        ("udpin:127.0.0.1:1", "udpout:127.0.0.1:1", False),
    ],
)
def test_whether_a_link_leads_to_a_port_of_this_machine_that_is_listened_on(mine: str, other: str, leads: bool) -> None:
    assert parse_link_url(mine).leads_to(parse_link_url(other)) is leads
