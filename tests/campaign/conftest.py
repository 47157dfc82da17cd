"""One thread for the batches of the tests: they are small, and threads that wait for each other cost more than that."""

from tests.avoidance.conftest import one_thread

__all__ = ["one_thread"]
