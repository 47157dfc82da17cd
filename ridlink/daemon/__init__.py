"""The daemon: configuration, the loop around the engine, and the flight recording."""
