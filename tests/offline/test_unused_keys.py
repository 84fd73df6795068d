"""Keys without effect are told, keys with one are not."""

from __future__ import annotations

from dataclasses import replace

from gcs_sysid.aircraft import Imu, Pitot, SensorError, StreamTiming, Vanes
from gcs_sysid.offline import unused_keys
from tests.offline.made_aircraft import small


def test_a_file_whose_keys_all_count_is_not_warned_about() -> None:
    used = replace(
        small(),
        imu=Imu(misalignment=(0.01, 0.0, 0.0)),
        pitot=Pitot(error=SensorError(lag=0.1, lag_sigma=0.05, scale_sigma=0.02)),
        vanes=Vanes(upwash=0.1),
        streams={
            "RAW_IMU": StreamTiming(0.01),
            "GLOBAL_POSITION_INT": StreamTiming(0.1, 0.05),
            "SERVO_OUTPUT_RAW": StreamTiming(0.02, 0.01),
        },
    )
    assert unused_keys.warnings(used) == []


def test_every_key_without_effect_is_named_as_the_file_has_it() -> None:
    idle = replace(
        small(),
        imu=Imu(misalignment_sigma=0.02),
        pitot=Pitot(error=SensorError(bias_sigma=0.5)),
        vanes=Vanes(upwash_sigma=0.1, alpha=SensorError(lag_sigma=0.05)),
        streams={"RAW_IMU": StreamTiming(0.01, 0.01), "RC_CHANNELS": StreamTiming(0.1)},
    )
    (warning,) = unused_keys.warnings(idle)
    for key in (
        "[imu] misalignment_sigma", "[pitot] bias_sigma", "[vanes] upwash_sigma",
        "[vanes] lag_sigma", "[streams.RAW_IMU] sigma", "[streams.RC_CHANNELS] delay",
    ):  # fmt: skip
        assert key in warning
    assert "[streams.RAW_IMU] delay" not in warning
    assert warning.endswith("have no effect yet")
