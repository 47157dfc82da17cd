"""Flights in real time through the command line: too long for ``make test``, run by ``make e2e``."""
