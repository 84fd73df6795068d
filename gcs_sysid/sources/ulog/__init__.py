"""PX4's onboard logs (.ulg)."""
