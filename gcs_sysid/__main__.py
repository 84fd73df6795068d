"""Lets `python -m gcs_sysid` stand for the program."""

from __future__ import annotations

import sys

from gcs_sysid.cli import main

sys.exit(main())
