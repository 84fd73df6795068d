"""gcs_sysid: learns an aircraft's aerodynamics from its telemetry."""

from gcs_sysid import compiler

__all__ = ["compiler"]
