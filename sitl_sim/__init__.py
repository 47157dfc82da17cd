"""Vehicles and a sky to try ridlink in: kinematics, position errors, a radio medium, a referee, a MAVLink face.

The truth side (``vehicle``, ``gnss``, ``faults``, ``routes``, ``world``, ``referee``, ``radio``) is pure: the caller
steps it with a time difference, nobody there opens a socket, reads a clock or draws an unseeded random number.
"""
