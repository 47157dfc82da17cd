"""The daemon: configuration and its file, the loop around the engine, and the flight recording."""
