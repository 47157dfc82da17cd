"""Long, bounded runs that watch memory and timing, run by ``make soak``."""
