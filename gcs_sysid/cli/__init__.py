"""The program `gcs-sysid`: reads the command line, calls one run, says what came out."""

from gcs_sysid.cli.entry import main as main
