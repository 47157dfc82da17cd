"""``python -m ridlink``."""

from ridlink.cli import main

main()
