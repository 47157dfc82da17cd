"""The ridlink MAVLink dialect: definition, specification, golden vectors and generator."""
