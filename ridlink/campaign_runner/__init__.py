"""Campaigns on a machine: processes that fly them, and the folder that keeps what they flew."""
