"""One thread for the batches of the tests: they are small, and threads that wait for each other cost more than that."""

import numba
import pytest


@pytest.fixture(autouse=True, scope="session")
def one_thread():
    before = numba.get_num_threads()
    numba.set_num_threads(1)
    yield
    numba.set_num_threads(before)
