"""An emulator to test ridlink: vehicle kinematics, position errors, a radio medium, a referee, and autopilots over
MAVLink.

The modules of the truth (``vehicle``, ``gnss``, ``faults``, ``routes``, ``world``, ``referee``, ``radio``) are pure:
the caller steps them with a time difference. They open no socket, read no clock and draw no unseeded random number.
"""
