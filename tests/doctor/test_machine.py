"""What this machine lacks is found, and each finding says what to do."""

from __future__ import annotations

import importlib.util
import socket

import pytest
from numba import config
from numba.core import caching

from ridlink.doctor import Verdict, examine_machine, machine


def test_every_finding_that_is_not_well_has_a_remedy() -> None:
    for finding in examine_machine():
        assert finding.text and finding.name
        assert finding.verdict in (Verdict.OK, Verdict.NOTE) or finding.remedy, finding


def test_a_port_that_somebody_has_is_named_with_the_way_to_find_out_who(monkeypatch: pytest.MonkeyPatch) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        monkeypatch.setattr(machine, "PORTS", {port: "a test"})
        [finding] = [finding for finding in examine_machine() if finding.name == f"port {port}"]
    assert finding.verdict is Verdict.WARNING
    assert "in use" in finding.text and f":{port}" in finding.remedy


def test_a_buffer_that_the_kernel_caps_comes_with_the_setting(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(machine, "RECEIVE_BUFFER_BYTES", 2**31 - 1)
    [finding] = [finding for finding in examine_machine() if finding.name == "receive buffer"]
    assert finding.verdict is Verdict.WARNING
    assert "net.core.rmem_max=2147483647" in finding.remedy


def test_an_extra_that_is_missing_comes_with_its_installation(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    [finding] = [finding for finding in examine_machine() if finding.name == "extra mqtt"]
    assert finding.verdict is Verdict.NOTE
    assert finding.remedy == "pip install 'ridlink[mqtt]'"


@pytest.mark.skipif(bool(config.DISABLE_JIT), reason="nothing is compiled")
def test_kernels_that_can_be_kept_nowhere_are_a_warning(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(machine, "COMPILED_S", 0.0)  # as if they had been compiled
    for places, verdict in ((None, Verdict.NOTE), ([], Verdict.WARNING)):
        if places is not None:
            monkeypatch.setattr(caching.CacheImpl, "_locator_classes", places)
        [finding] = [finding for finding in examine_machine() if finding.name == "solver"]
        assert finding.verdict is verdict
        assert ("NUMBA_CACHE_DIR" in finding.remedy) is (verdict is Verdict.WARNING)


def test_kernels_that_must_not_be_compiled_are_a_warning(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(config, "DISABLE_JIT", 1)
    [finding] = [finding for finding in examine_machine() if finding.name == "solver"]
    assert finding.verdict is Verdict.WARNING and finding.remedy == "unset NUMBA_DISABLE_JIT"
