"""Captures into other formats."""
