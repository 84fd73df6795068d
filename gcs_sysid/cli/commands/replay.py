"""`replay`: plays a recorded flight to a link."""

from __future__ import annotations

from pathlib import Path

import click

from gcs_sysid.cli import options, output
from gcs_sysid.errors import SourceError


@click.command("replay")
@options.log
@click.option(
    "--to", "link", metavar="LINK", required=True,
    help="Where to send: udp:127.0.0.1:14550, tcp:HOST:PORT, or a serial device.",
)  # fmt: skip
@click.option(
    "--speed", type=click.FloatRange(min=0.0, min_open=True), default=1.0, show_default=True,
    help="2 plays twice as fast; inf as fast as the link takes it.",
)  # fmt: skip
@options.as_json
def command(log: Path, link: str, speed: float, as_json: bool) -> None:
    """Play a recorded flight to a link, with its own timing."""
    from gcs_sysid.sources import player
    from gcs_sysid.sources.link import Link

    with Link(_sending(link)) as opened, output.progress(f"replay {log.name}") as progress:
        sent = player.play(
            log.read_bytes(),
            opened.write,
            speed=speed,
            progress=lambda played, whole: progress(
                f"{played:.0f} of {whole:.0f} s", played / whole if whole > 0.0 else 1.0
            ),
        )
    if not sent:
        raise SourceError(str(log), "holds no MAVLink message", fix="give a .tlog")
    output.show({"sent": sent}, f"{sent} messages sent to {link}", as_json=as_json)


def _sending(link: str) -> str:
    """The end that sends: plain `udp:` listens elsewhere, and here stands for `udpout:`."""
    return "udpout:" + link.removeprefix("udp:") if link.startswith("udp:") else link
