from __future__ import annotations

import re
from pathlib import Path

import pytest

from gcs_sysid.errors import SourceError
from gcs_sysid.sources import column_map
from gcs_sysid.sources.units import UNITS

TIME = 'time = { name = "t", unit = "s" }\n'


def entry(text):
    return column_map.loads(TIME + text, file="map.toml").entries[0]


def test_an_entry_says_name_unit_scale_sign_offset_and_clock():
    one = entry(
        'alpha = { name = "aoa", unit = "deg", scale = 2, sign = -1, offset = 3.5, time = "t2" }'
    )
    assert (one.channel, one.name, one.scale, one.offset) == ("alpha", "aoa", -2.0, 3.5)
    assert (one.time.name, one.time.unit.factor) == ("t2", 1.0)


def test_a_clock_of_its_own_may_have_a_unit_of_its_own():
    one = entry('q = { name = "q", unit = "rad/s", time = { name = "ms", unit = "ms" } }')
    assert (one.time.name, one.time.unit.factor) == ("ms", 1e-3)


def test_epoch_is_wall_time_in_microseconds():
    text = 'epoch = 2012-10-10T13:57:29.25+02:00\np = { name = "p", unit = "rad/s" }'
    assert column_map.loads(TIME + text, file="m").epoch_us == 1_349_870_249_250_000


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('q = { name = "q" }', ["map.toml: q", "no unit", "rad/s, deg/s"]),
        ('q = { name = "q", unit = "m/s" }', ["`m/s` is no unit of angular rate", "deg/s"]),
        ('q = { name = "q", unit = "furlong" }', ["`furlong`", "use rad/s, deg/s"]),
        ('q = { unit = "rad/s" }', ["names no column"]),
        ('q = "pitch rate"', ["no table of name and unit"]),
        ('q = { name = "q", unit = "rad/s", factor = 2 }', ["unknown key `factor`", "scale"]),
        ('q = { name = "q", unit = "rad/s", scale = "2" }', ["scale is no number"]),
        ('q = { name = "q", unit = "rad/s", sign = 2 }', ["sign is 2", "1 or -1"]),
        ('alfa = { name = "a", unit = "deg" }', ["`alfa`", "did you mean `alpha`"]),
        ('wombat = { name = "a", unit = "deg" }', ["`wombat`", "channels are"]),
        ("", ["maps no column"]),
        ("epoch = 2026-05-01T09:30:00", ["no date with time zone", "Z`"]),
        ('course = { name = "c", unit = "deg" }', ["`course` without `groundspeed`"]),
        ('pwm_2 = { name = "de", unit = "deg" }', ["no unit of pulse", "`deflection`"]),
        ('pwm_2 = { name = "d", unit = "deg", pwm = [1000, 2000] }', ["no calibration"]),
        (
            'pwm_2 = { name = "d", unit = "deg", pwm = [1, 2], deflection = [3, 3] }',
            ["no calibration", "[[servos]]"],
        ),
        ('q = { name = "q", unit = "rad/s", pwm = [1, 2] }', ["unknown key `pwm`"]),
        ("q = wrong", ["is no TOML", "line 2"]),
    ],
)
def test_a_wrong_line_is_told_in_one_line(text, said):
    with pytest.raises(SourceError) as caught:
        column_map.loads(TIME + text, file="map.toml")
    message = str(caught.value)
    assert message.startswith("map.toml")
    assert "\n" not in message
    assert all(part in message for part in said), message


def test_time_must_be_there():
    with pytest.raises(SourceError, match="no line says which column is the time"):
        column_map.loads('q = { name = "q", unit = "rad/s" }', file="map.toml")


def test_a_file_that_is_no_text_is_told(tmp_path):
    path = tmp_path / "map.toml"
    path.write_bytes(b"\xff\xfe")
    with pytest.raises(SourceError, match="cannot be read as text"):
        column_map.load(path)


def test_the_documentations_map_is_valid_and_names_every_channel_and_unit():
    page = (Path(__file__).parents[2] / "docs" / "tables.md").read_text(encoding="utf-8")
    [example] = re.findall(r"```toml\n(.*?)```", page, flags=re.DOTALL)
    assert len(column_map.loads(example, file="tables.md").entries) == 18
    table = page.split("## Surfaces")[0]
    numbered = {"pwm_1", "pwm_32", "rpm_1", "rpm_16"}
    single = {name for name in column_map.SENSOR_OF if name.rstrip("0123456789")[-1] != "_"}
    assert all(f"`{name}`" in table for name in single | numbered | set(UNITS))
