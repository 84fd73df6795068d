"""Listening from the first frame to the last line, whatever goes wrong around it."""

from __future__ import annotations

import inspect
import json
import socket
from collections.abc import Callable
from pathlib import Path

import pytest

from gcs_sysid.aircraft import Aircraft
from gcs_sysid.cli import entry
from gcs_sysid.errors import RefusedError, SourceError
from gcs_sysid.live import listen, warming
from gcs_sysid.live.listen import Ending, Options
from gcs_sysid.live.session import Clock
from gcs_sysid.offline import identify
from gcs_sysid.sources import tlog
from gcs_sysid.sources.link import Link

MICRO = 1e-6
AIRCRAFT = Path(__file__).resolve().parents[2] / "data/aircraft/ultra_stick_25e.toml"


class Ticking:
    """Time that goes on by a good tenth of a second at every look."""

    def __init__(self, start_us: int) -> None:
        self.us = start_us

    @property
    def clock(self) -> Clock:
        return Clock(seconds=self.seconds, us=lambda: self.us)

    def seconds(self) -> float:
        self.us += 150_000
        return self.us * MICRO


@pytest.fixture(autouse=True)
def cold(monkeypatch: pytest.MonkeyPatch) -> None:
    """These flights never leave the ground: there is nothing to compile."""
    monkeypatch.setattr(warming, "warm", lambda _aircraft, _compiled: None)


@pytest.fixture
def port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as opened:
        opened.bind(("127.0.0.1", 0))
        return int(opened.getsockname()[1])


@pytest.fixture
def hear(
    aircraft: Aircraft, played: list[tuple[int, bytes]], port: int, tmp_path: Path
) -> Callable[..., Ending]:
    """Listens while some frames are sent; if asked to, stops when all came and so many looks."""

    def run(
        *,
        frames: int = 50,
        looks: int | None = None,
        show: Callable[..., None] = lambda _document: None,
        resume: bool = False,
    ) -> Ending:
        time = Ticking(played[0][0])
        looked = [0]

        def stopped() -> bool:
            looked[0] += 1
            if looked[0] == 1 and frames:
                with Link(f"udpout:127.0.0.1:{port}") as vehicle:
                    for _, frame in played[:frames]:
                        vehicle.write(frame)
            if looks is None:
                return False
            kept = recorded(tmp_path / "recording.tlog") if frames else []
            return looked[0] >= looks and len(kept) == frames

        return listen.run(
            f"udpin:127.0.0.1:{port}",
            aircraft,
            Options(prior="none", quiet_after=5.0 if looks is None else 1e6, resume=resume),
            out=tmp_path,
            show=show,
            stopped=stopped,
            clock=time.clock,
        )

    return run


def recorded(path: Path) -> list[bytes]:
    return [frame for _, frame in tlog.frames(path.read_bytes())]


def test_a_link_that_falls_quiet_ends_the_flight(hear, played, tmp_path) -> None:
    shown: list[dict] = []
    ending = hear(show=shown.append)
    assert ending.why == "quiet"
    assert recorded(ending.recording) == [frame for _, frame in played[:50]]
    live = json.loads((tmp_path / "live.json").read_text())
    assert live["phase"] == "ended: quiet"
    assert live["program"].startswith("gcs-sysid ")
    assert live["counts"]["recorded"] == 50
    assert live["vehicle"] == 1
    assert any(document["phase"].startswith("waiting for data") for document in shown) or shown
    assert any("quiet for" in document["phase"] for document in shown)


def test_the_user_ends_it(hear, played) -> None:
    ending = hear(looks=2)
    assert ending.why == "stopped"
    assert recorded(ending.recording) == [frame for _, frame in played[:50]]


def test_nothing_heard_leaves_nothing_behind(hear, tmp_path) -> None:
    with pytest.raises(SourceError, match=r"nothing was received in .* s; check") as error:
        hear(frames=0, looks=8)
    assert "\n" not in str(error.value)
    assert list(tmp_path.iterdir()) == []


def test_a_display_that_fails_does_not_stop_the_recording(hear, played, caplog) -> None:
    calls = [0]

    def broken(_document: object) -> None:
        calls[0] += 1
        raise BrokenPipeError("nobody looks")

    ending = hear(show=broken)
    assert len(recorded(ending.recording)) == 50
    assert calls[0] == 1
    assert "display failed" in caplog.text


def test_a_disk_that_is_full_stops_loudly(hear, tmp_path) -> None:
    (tmp_path / "recording.tlog").symlink_to("/dev/full")
    with pytest.raises(SourceError, match=r"recording failed .*space.*; free or choose"):
        hear(resume=True)


def test_a_recording_is_never_overwritten_but_continued_when_asked(hear) -> None:
    hear()
    with pytest.raises(SourceError, match="exists already"):
        hear()
    assert len(recorded(hear(resume=True).recording)) == 100


def test_a_link_that_the_other_end_closes_is_opened_again(aircraft, played, tmp_path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        time = Ticking(played[0][0])
        sent: list[int] = []

        def stopped() -> bool:
            """The vehicle hangs up, and takes the next call."""
            if len(sent) < 2:
                vehicle, _ = server.accept()
                with vehicle:
                    half = played[25 * len(sent) : 25 * len(sent) + 25]
                    vehicle.sendall(b"".join(frame for _, frame in half))
                sent.append(25)
            return False

        ending = listen.run(
            f"tcp:127.0.0.1:{server.getsockname()[1]}",
            aircraft,
            Options(prior="none", quiet_after=20.0),
            out=tmp_path,
            show=lambda _document: None,
            stopped=stopped,
            clock=time.clock,
        )
    assert ending.why == "quiet"
    assert ending.live["health"]["losses"] == 2
    assert recorded(ending.recording) == [frame for _, frame in played[:50]]


def test_a_link_that_cannot_be_opened(aircraft, tmp_path) -> None:
    with pytest.raises(SourceError, match="neither a link nor a serial device"):
        listen.run(
            "carrier-pigeon",
            aircraft,
            Options(prior="none", quiet_after=1.0),
            out=tmp_path,
            show=lambda _document: None,
            stopped=lambda: True,
        )
    assert list(tmp_path.iterdir()) == []


def test_it_is_identified_as_identify_would_do_it(tmp_path, monkeypatch) -> None:
    """Only by least squares, once, in gusts too: `identify` chooses by itself."""
    asked: list[inspect.BoundArguments] = []
    signature = inspect.signature(identify.run)

    def run(*given: object, **named: object) -> dict:
        asked.append(signature.bind(*given, **named))
        raise RefusedError("recording.tlog", "it never flew", fix="fly")

    monkeypatch.setattr(identify, "run", run)
    log = tmp_path / "recording.tlog"
    log.write_bytes(b"frames")
    with pytest.raises(RefusedError):
        listen.identified(
            Ending("quiet", {"vehicle": 1}, log),
            AIRCRAFT,
            prior="file",
            vehicle=None,
            out=tmp_path,
            progress=lambda _stage, _share: None,
        )
    words = ["identify", str(log), "--aircraft", str(AIRCRAFT), "--out", str(tmp_path)]
    assert entry.main(words) == 1
    one, other = asked
    for each in asked:
        each.apply_defaults()
    for name in ("method", "body", "stepwise", "segments", "columns", "can", "prior"):
        assert one.arguments[name] == other.arguments[name], name


def test_a_recording_that_cannot_be_identified_stays(hear, tmp_path) -> None:
    ending = hear()
    with pytest.raises((RefusedError, SourceError)):
        listen.identified(
            ending,
            AIRCRAFT,
            prior="file",
            vehicle=None,
            out=tmp_path,
            progress=lambda _stage, _share: None,
        )
    assert ending.recording.is_file()
    assert (tmp_path / "live.json").is_file()
