"""Where telemetry comes from: logs and links, each turned into a Recording."""
