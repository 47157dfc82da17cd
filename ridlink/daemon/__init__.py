"""The daemon: its configuration and configuration file, the loop around the engine, and the recordings of a flight."""
