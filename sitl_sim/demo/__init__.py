"""The demonstration: an emulated fleet, one avoidance daemon a vehicle, and a referee that alone knows the truth.

This is the only room that knows both sides. They still meet over MAVLink on UDP and nowhere else.
"""
