"""Campaigns: many runs of one scene in virtual time, row by row reproducible."""
