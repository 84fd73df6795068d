"""MAVLink signatures: only what carries a good one is taken.

A signed frame ends in a link number, a time (48 bits, 10 µs since 2015) and the first six bytes of
SHA-256 over the secret key, the frame and both (mavlink.io, "Message Signing").
"""

from __future__ import annotations

import hashlib
import hmac
from pathlib import Path

import numpy as np

from gcs_sysid.errors import SourceError
from gcs_sysid.sources.frames import Bytes, Frames

KEY_LENGTH = 32
_SIGNATURE = 13
_DIGEST = 6
_MINUTE = 60 * 100_000
"""A sender heard for the first time may be behind the newest time by this many steps of 10 µs."""


def load_key(path: Path) -> bytes:
    """The secret key in a file.

    Args:
        path: 32 bytes as they are, 64 hexadecimal digits, or a passphrase, of which ground stations
            take the SHA-256.

    Raises:
        SourceError: the file cannot be read, or is empty.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise SourceError(
            str(path), f"cannot be read ({error.strerror})", fix="give the file with the key"
        ) from error
    if len(data) == KEY_LENGTH:
        return data
    text = data.strip()
    if not text:
        raise SourceError(str(path), "holds no key", fix="write the passphrase into it")
    try:
        key = bytes.fromhex(text.decode("ascii"))
    except ValueError:
        key = b""
    return key if len(key) == KEY_LENGTH else hashlib.sha256(text).digest()


class Signatures:
    """Judges frames in the order in which they arrive.

    Args:
        key: the secret key.
    """

    def __init__(self, key: bytes) -> None:
        self._key = key
        self._newest = 0
        self._last: dict[tuple[int, int, int], int] = {}
        self.lost = {"unsigned": 0, "bad_signature": 0}

    def good(self, data: Bytes, frames: Frames) -> np.ndarray:
        """Which frames carry a good signature, newer than the one before of the same sender."""
        places = zip(
            frames.start.tolist(),
            frames.end.tolist(),
            (frames.size - frames.header - frames.length).tolist(),
            strict=True,
        )
        return np.array(
            [self._judge(data[start:end].tobytes(), tail) for start, end, tail in places],
            dtype=bool,
        )

    def _judge(self, frame: bytes, tail: int) -> bool:
        if tail < _SIGNATURE:
            self.lost["unsigned"] += 1
            return False
        expected = hashlib.sha256(self._key + frame[:-_DIGEST]).digest()[:_DIGEST]
        time = int.from_bytes(frame[-_SIGNATURE + 1 : -_DIGEST], "little")
        # Link number, system and component: each counts its own time.
        sender = (frame[-_SIGNATURE], frame[5], frame[6])
        oldest = self._last.get(sender, self._newest - _MINUTE)
        if time <= oldest or not hmac.compare_digest(expected, frame[-_DIGEST:]):
            self.lost["bad_signature"] += 1
            return False
        self._last[sender] = time
        self._newest = max(self._newest, time)
        return True
