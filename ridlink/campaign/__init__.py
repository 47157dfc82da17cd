"""Campaigns: many runs of one scene in virtual time. Every run can be reproduced alone."""
