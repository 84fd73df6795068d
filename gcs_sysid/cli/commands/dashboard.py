"""`dashboard`: a web page of what `listen` knows."""

from __future__ import annotations

import contextlib
from pathlib import Path

import click

from gcs_sysid.cli import options


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
@click.option("--of", "parent", type=int, hidden=True, help="End with the process of this number.")
def command(folder: Path, host: str, port: int, parent: int | None) -> None:
    """Show what `listen` writes into FOLDER on a web page.

    The page needs nothing from elsewhere, reads live.json, and cannot disturb the listening.
    """
    from gcs_sysid.dashboard import server

    address = server.bind(host, port)
    click.echo(f"Dashboard: {address.url}", err=parent is not None)
    still = server.parent_lives(parent) if parent is not None else lambda: True
    with contextlib.suppress(KeyboardInterrupt):  # how a user ends it
        server.serve(folder, address, still=still)
