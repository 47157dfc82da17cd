"""ridlink: Remote ID that keeps drones apart."""

