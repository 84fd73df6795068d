"""ArduPilot's onboard logs: binary (.bin) and text (.log)."""
