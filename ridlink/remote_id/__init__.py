"""Remote ID: the only room where wire integers meet SI floats, and where wire sentinels become ``None``."""
