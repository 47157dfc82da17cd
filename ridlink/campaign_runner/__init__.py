"""Runs campaigns: the processes or machines that fly them, and the folder with the results."""
