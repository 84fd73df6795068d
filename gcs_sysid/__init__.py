"""gcs_sysid: learns an aircraft's aerodynamics from its telemetry."""
