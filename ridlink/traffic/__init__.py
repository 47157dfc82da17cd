"""Traffic: Remote ID reports -> tracks -> the neighbours that count, as arrays for the solver."""
