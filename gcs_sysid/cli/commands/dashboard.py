"""`dashboard`: a web page of what `listen` knows."""

from __future__ import annotations

import contextlib
import time
from pathlib import Path

import click

from gcs_sysid.cli import live_view, options


@click.command("dashboard")
@click.argument("folder", type=options.Existing("folder"))
@click.option(
    "--host", default="127.0.0.1", show_default=True,
    help="Address to serve on; beyond this computer (0.0.0.0) the page asks for a token.",
)  # fmt: skip
@click.option(
    "--port", type=click.IntRange(0, 65535), default=8642, show_default=True,
    help="Port; where it is taken, the next free one. 0 takes any.",
)  # fmt: skip
@click.option(
    "--terminal", is_flag=True,
    help="Show it in this terminal instead, for those without a browser.",
)  # fmt: skip
@click.option("--of", "parent", type=int, hidden=True, help="End with the process of this number.")
def command(folder: Path, host: str, port: int, terminal: bool, parent: int | None) -> None:
    """Show what `listen` writes into FOLDER on a web page.

    The page needs nothing from elsewhere, reads live.json, and cannot disturb the listening.
    """
    from gcs_sysid.dashboard import server

    if terminal:
        _terminal(folder)
        return
    address = server.bind(host, port)
    click.echo(f"Dashboard: {address.url}", err=parent is not None)
    still = server.parent_lives(parent) if parent is not None else lambda: True
    with contextlib.suppress(KeyboardInterrupt):  # how a user ends it
        server.serve(folder, address, still=still)


def _terminal(folder: Path) -> None:
    """Shows documents as they come, until interrupted or until the flight has ended."""
    from gcs_sysid.dashboard.watch import LOOK_S, Watch

    watch = Watch(folder)
    with contextlib.suppress(KeyboardInterrupt), live_view.opened(to_stderr=False) as show:
        while True:
            if watch.look() and watch.document is not None:
                show(watch.document)
                if watch.document["phase"].startswith("ended"):
                    return
            time.sleep(LOOK_S)
