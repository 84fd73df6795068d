"""Which aerodynamics explain a flight."""
