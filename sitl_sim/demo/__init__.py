"""The demonstration: an emulated fleet, one avoidance daemon per vehicle, and a referee, the only part that knows the
truth.

This is the only package that imports both the emulator and the daemon. They still communicate only by MAVLink over UDP.
"""
