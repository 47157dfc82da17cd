"""Settings of all tests."""

from __future__ import annotations

import os
import signal

from hypothesis import HealthCheck, Phase, settings

QUICK = "RIDLINK_QUICK_FAILURES"
"""Set where it only matters whether a test fails, and not at what: then nothing is made smaller."""

# Machines are shared and noisy: no deadlines. What fails is printed in a form that can be run again.
settings.register_profile(
    "ridlink",
    deadline=None,
    print_blob=True,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
    phases=set(Phase) - ({Phase.shrink, Phase.explain} if QUICK in os.environ else set()),
)
settings.load_profile("ridlink")

# Who runs the tests in the background, or under nohup, has them ignore what ends a program, and what they start, too.
for number, handler in ((signal.SIGINT, signal.default_int_handler), (signal.SIGHUP, signal.SIG_DFL)):
    if signal.getsignal(number) is signal.SIG_IGN:
        signal.signal(number, handler)
