"""Settings of all tests."""

from __future__ import annotations

from hypothesis import HealthCheck, settings

# Machines are shared and noisy: no deadlines. What fails is printed in a form that can be run again.
settings.register_profile(
    "ridlink", deadline=None, print_blob=True, suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large]
)
settings.load_profile("ridlink")
