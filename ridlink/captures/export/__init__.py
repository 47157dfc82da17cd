"""Exports captures to other formats."""
