"""Which states, wind and sensor errors explain a flight."""
