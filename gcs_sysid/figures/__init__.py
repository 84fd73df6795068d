"""Figures as data: series, bands, units. Nothing here draws; `gcs_sysid.report` does."""
