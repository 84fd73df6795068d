"""`replay`: plays a recorded flight to a link."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import click

from gcs_sysid.cli import options, output


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
@options.vehicle
@options.columns
@options.as_json
def command(
    log: Path,
    link: str,
    speed: float,
    vehicle: int | None,
    columns: Path | None,
    as_json: bool,
) -> None:
    """Play a recorded flight to a link, with its own timing.

    A .tlog is sent frame by frame as it was received, of all vehicles unless --vehicle chooses one.
    Onboard logs and tables are sent as the vehicle would have sent them, at their own rates and in
    the resolution of the messages.
    """
    from gcs_sysid.sources import player
    from gcs_sysid.sources.link import Link

    playable = player.load(log, vehicle=vehicle, columns=columns)
    with Link(_sending(link)) as opened, output.progress(f"replay {log.name}") as progress:
        sent = player.play(
            playable.frames,
            opened.write,
            speed=speed,
            progress=lambda played, whole: progress(
                f"{played:.0f} of {whole:.0f} s", played / whole if whole > 0.0 else 1.0
            ),
        )
    document = {"sent": sent, "left_out": dict(playable.left_out)}
    output.show(document, _text(sent, link, playable.left_out), as_json=as_json)


def _text(sent: int, link: str, left_out: Mapping[str, int]) -> str:
    words = f"{sent} messages sent to {link}"
    if not left_out:
        return words
    return f"{words}; no message carries {', '.join(sorted(left_out))}"


def _sending(link: str) -> str:
    """The end that sends: plain `udp:` listens elsewhere, and here stands for `udpout:`."""
    return "udpout:" + link.removeprefix("udp:") if link.startswith("udp:") else link
