"""Self-contained HTML reports, and the same findings as lines of text.

`identify.render` and `predict.render` write pages; they are imported by name, because they load
templates and a drawing library that a command line does not need to start.
"""

from gcs_sysid.report.findings import ten_lines as ten_lines
