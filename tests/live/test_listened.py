"""A minute of flight over a link: nothing lost, states and coefficients those of the batch run."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import jax
import numpy as np
import pyarrow.parquet as parquet
import pytest

from gcs_sysid.aircraft import Aircraft
from gcs_sysid.errors import InputError
from gcs_sysid.live import snapshot
from gcs_sysid.live.coefficients import HOP, KEPT
from gcs_sysid.live.inside_feed import InsideFeed
from gcs_sysid.live.processes import Processes
from gcs_sysid.live.regression import RunningModel
from gcs_sysid.live.rows import Row, RowMaker
from gcs_sysid.live.station import Compiled, Station
from gcs_sysid.model.kinematics import MEASURED
from gcs_sysid.offline import documents, identify
from gcs_sysid.reconstruct import inertial_filter, measurements
from gcs_sysid.reconstruct.kinematic_ekf import KinematicFilter
from gcs_sysid.reconstruct.reconstruction import first_noise, first_state, sensor_levers
from gcs_sysid.reconstruct.smoother import CHUNK, _Belief, _chunk, _forward
from gcs_sysid.sources.registry import open_recording
from gcs_sysid.sources.samples import SampleDecoder
from gcs_sysid.sources.stream import FrameStream
from tests.sources.conftest import Writer

pytestmark = pytest.mark.slow
ROOT = Path(__file__).resolve().parents[2]
SETTLED_S = 15.0
"""After this the filter has learned the wind and its noise."""
FAULTY_S = 25.0
STEP_S = 0.02


@pytest.fixture(scope="session")
def rows(listened) -> list:
    """The flight as the live filter read it."""
    return [item.row for item in listened.estimates]


@pytest.fixture(scope="session")
def batch(listened, aircraft: Aircraft):
    """The same part of the flight, read as a log."""
    recording = open_recording(listened.log)
    return measurements.select(recording, aircraft, (0.0, 1e9))


def test_the_recording_is_the_log_byte_for_byte(listened) -> None:
    assert listened.recording.read_bytes() == listened.log.read_bytes()


def matched(rows: list, batch) -> tuple[list, np.ndarray]:
    """Live rows and the batch rows of the same inertial samples (to 1e-9 of rate and force)."""
    first = np.flatnonzero(np.all(batch.gyro == rows[0].after.gyro, axis=1))
    assert first.size >= 1
    count = min(len(rows), batch.time.size - first[0])
    chosen = np.arange(first[0], first[0] + count)
    np.testing.assert_allclose(
        np.stack([row.after.gyro for row in rows[:count]]), batch.gyro[chosen], atol=1e-12
    )
    return rows[:count], chosen


def test_rows_are_those_of_the_batch_run(rows, batch) -> None:
    """Same samples, same steps, same measurements in the same places with the same ages.

    Only a batch run knows, where the radio lost an inertial sample, that a measurement in the hole
    is nearer to the one before it.
    """
    live, chosen = matched(rows, batch)
    steps = np.diff([row.time for row in live])
    # Both clocks count whole microseconds.
    np.testing.assert_allclose(steps, np.diff(batch.time[chosen]), atol=2.1e-6)
    holes = np.flatnonzero(steps > 1.2 * np.median(steps))
    beside = np.isin(np.arange(len(live)), np.concatenate([holes, holes + 1]))
    assert beside.mean() < 0.02
    for group in ("velocity", "attitude", "vanes"):
        index = list(MEASURED).index(group)
        valid = np.array([row.measured.valid[index] for row in live])
        np.testing.assert_array_equal(valid[~beside], batch.measured.valid[chosen, index][~beside])
        for row, place in zip(live, chosen, strict=True):
            if beside[place - chosen[0]]:
                continue
            if row.measured.valid[index] and batch.measured.valid[place, index]:
                np.testing.assert_allclose(
                    getattr(row.measured, group), getattr(batch.measured, group)[place], atol=1e-12
                )
                assert row.measured.age[index] == pytest.approx(
                    batch.measured.age[place, index], abs=2.1e-6
                )
    # Without a stamp the airspeed's time follows from its arrival, which a log knows better.
    index = list(MEASURED).index("airspeed")
    seen = sum(row.measured.valid[index] for row in live)
    assert seen == pytest.approx(batch.measured.valid[chosen, index].sum(), abs=3)


def test_an_inertial_filter_is_undone_as_in_the_batch_run(
    played, aircraft: Aircraft, tmp_path: Path
) -> None:
    """Told on the link that rates come 11 ms late, attitudes belong to other rows, as in a log."""
    told = Writer().frame(
        "PARAM_VALUE", param_id=inertial_filter.GYRO.encode(), param_value=20.0, param_type=9
    )
    flown = [(link_us, frame) for link_us, frame in played if link_us < played[0][0] + 20e6]
    records = [*flown[:5], (flown[5][0], told), *flown[5:]]
    log = tmp_path / "told.tlog"
    log.write_bytes(b"".join(struct.pack(">Q", link_us) + frame for link_us, frame in records))
    whole = measurements.select(open_recording(log), aircraft, (0.0, 1e9))

    stream, maker = FrameStream(), RowMaker(aircraft)
    decoder = SampleDecoder(watched=(inertial_filter.GYRO,))
    rows: list[Row] = []
    for link_us, frame in records:
        samples = decoder.samples(stream.feed(frame, link_us))
        maker.told(decoder.parameters)
        rows += [row for item in samples for row in maker.take(item)]
    # The last state of a row holds all that belongs to it.
    last = list({row.time: row for row in rows}.values())
    live, chosen = matched(last[10:], whole)
    index = list(MEASURED).index("attitude")
    ages = np.array([row.measured.age[index] for row in live])
    valid = np.array([row.measured.valid[index] for row in live])
    both = valid & whole.measured.valid[chosen, index]
    assert both.mean() > 0.3
    same = np.abs(ages - whole.measured.age[chosen, index])[both] < 2.1e-6
    assert same.mean() > 0.98, "but beside holes"
    assert np.median(ages[both]) == pytest.approx(-STEP_S + inertial_filter.delay(20.0), abs=2e-3)


def test_the_live_filter_is_the_batch_runs_forward_filter(rows, batch, aircraft: Aircraft) -> None:
    """Twenty seconds from the same start: what differs is the time of the airspeed's arrival."""
    live, chosen = matched(rows, batch)
    count = 1000
    live, chosen = live[:count], chosen[:count]
    levers, _ = sensor_levers(aircraft)
    noise = first_noise(batch)
    state, covariance = first_state(batch, aircraft, int(chosen[0]))
    running = KinematicFilter(state, covariance, levers, noise)
    for row in live:
        running.predict((row.before, row.after, row.step))
        running.observe(row.after, row.measured)
    inputs = jax.tree.map(lambda values: values[chosen], batch.inputs())
    inputs.step[0] = 0.0
    end = _Belief(state, jax.numpy.asarray(covariance))
    for first in range(0, count, CHUNK):
        end, _ = _forward(end, _chunk(inputs, first), levers, noise)
    deviation = np.sqrt(np.diagonal(running.P))
    np.testing.assert_allclose(deviation, np.sqrt(np.diagonal(end.covariance)), rtol=0.02)
    apart = np.abs(running.x - np.asarray(end.state.rest)) / np.maximum(deviation, 1e-12)
    assert np.max(apart) < 0.25
    assert np.abs(running.attitude @ np.asarray(end.state.attitude)) > 1.0 - 1e-6


def test_states_hold_the_truth(listened) -> None:
    """Of the simulated flight: within their bands about as often as these promise."""
    truth = np.load(ROOT / "data/flights/demo_truth.npz")
    table = (
        dict(zip(truth["cols"], truth["rows"], strict=True))
        if truth["rows"].shape[0] == 30
        else dict(zip(truth["cols"], truth["rows"].T, strict=True))
    )
    epoch = listened.station.rows.epoch_us
    late = [item for item in listened.estimates if item.row.time > SETTLED_S]
    time = np.array([item.row.time + (epoch - int(truth["t0_us"])) * 1e-6 for item in late])
    flow = np.stack([item.flow for item in late])
    spread = np.sqrt(np.stack([np.diagonal(item.flow_covariance) for item in late]))
    for index, name in enumerate(("V", "alpha", "beta")):
        error = (flow[:, index] - np.interp(time, table["t"], table[name])) / spread[:, index]
        assert np.mean(np.abs(error) < 1.96) > 0.85, name
        assert np.abs(np.mean(error)) < 1.0, name


@pytest.fixture(scope="session")
def summary(listened, tmp_path_factory: pytest.TempPathFactory) -> tuple[dict, Path]:
    """The recording identified by least squares, as the live coefficients and first model are."""
    out = tmp_path_factory.mktemp("identified")
    document = identify.run(
        [listened.recording],
        ROOT / "data/aircraft/ultra_stick_25e.toml",
        prior="none",
        segments=None,
        vehicle=1,
        method="equation-error",
        stepwise=False,
        out=out,
        progress=lambda _stage, _share: None,
    )
    return document, out


def test_the_recording_is_identified(summary) -> None:
    document, out = summary
    assert document["command"] == "identify"
    assert document["flights"][0]["vehicle"] == 1
    assert (out / "model").is_dir()
    assert (out / "samples.parquet").is_file()


def test_live_coefficients_are_those_of_the_batch_run(listened, summary) -> None:
    """Sample by sample, in units of what both claim to know."""
    table = parquet.read_table(summary[1] / "samples.parquet")
    batch_us = table["time_us"].to_numpy()
    epoch = listened.station.rows.epoch_us
    late = [item for item in listened.windows if item.time[0] > SETTLED_S]
    live_us = np.concatenate([epoch + np.round(item.time[KEPT] * 1e6) for item in late])
    place = np.clip(np.searchsorted(batch_us, live_us - 5_000), 0, batch_us.size - 1)
    near = np.abs(batch_us[place] - live_us) < 5_000
    assert near.sum() > 1000
    for name in ("CX", "CY", "CZ", "Cl", "Cm", "Cn"):
        live = np.concatenate([item.measured[name][KEPT] for item in late])[near]
        claimed = np.concatenate([item.noise[name][KEPT] for item in late])[near]
        whole = table[f"{name}_measured"].to_numpy()[place][near]
        sd = np.hypot(claimed, table[f"{name}_measured_sd"].to_numpy()[place][near])
        assert np.mean(np.abs(live - whole) < 3.0 * sd) > 0.95, name
        assert np.corrcoef(live, whole)[0, 1] > 0.9, name


def test_the_first_model_agrees_with_the_batch_runs(listened, summary) -> None:
    """Both without prior; each derivative within what the two claim together."""
    derivatives = summary[0]["derivatives"]
    found = listened.station.model.estimates()
    assert set(found) == {"CX", "CY", "CZ", "Cl", "Cm", "Cn"}
    for name, terms in found.items():
        for key, term in terms.items():
            other = derivatives[name][key]
            sd = np.hypot(term.deviation, other["sd"])
            assert abs(term.value - other["value"]) < 3.0 * sd, (name, key)


def test_windows_follow_each_other_without_hole_or_overlap(listened) -> None:
    kept = np.concatenate([item.time[KEPT] for item in listened.windows])
    assert KEPT.stop - KEPT.start == HOP
    assert np.all(np.diff(kept) > 0.0)
    # The radio lost a sample here and there.
    assert np.max(np.diff(kept)) < 0.1


def test_the_live_document_says_all_and_is_json(listened) -> None:
    last = listened.documents[-1]
    assert json.loads(documents.dump_json(last)) == documents.plain(last)
    assert last["program"].startswith("gcs-sysid ")
    assert set(last["state"]) >= {"V", "alpha", "beta", "roll", "wind_north", "wind_down"}
    assert all(item["sd"] > 0.0 for item in last["state"].values())
    assert set(last["coefficients"]) == {"CX", "CY", "CZ", "Cl", "Cm", "Cn"}
    assert last["derivatives"]["CZ"]["alpha"]["value"] < -2.0
    counts = last["counts"]
    assert counts["decimated"] == counts["late"] == counts["restarts"] == 0
    assert counts["updates"] == len(listened.estimates)
    assert len(listened.documents) >= 41


def test_nothing_grows_with_the_flight(listened) -> None:
    """What a station keeps is as large at the end as when its buffers had filled."""
    station = listened.station
    assert station.idle
    assert len(station.window._ring.rows()) == 128
    assert len(station.commands._servos.rows()) == 512
    assert station.latency._ring.rows().shape[0] <= 4096
    assert all(len(waiting) <= 8 for waiting in station.rows._open.values())


def test_the_model_goes_on_as_it_was_kept(
    listened, aircraft: Aircraft, compiled: Compiled, tmp_path: Path
) -> None:
    path, kept = tmp_path / snapshot.NAME, listened.station.model
    told = {inertial_filter.GYRO: 20.0}
    processes = listened.station.processes
    inside = InsideFeed(aircraft, listened.station.commands, None, None)
    arrays = snapshot.taken(kept, processes, inside, time_us=1234, updates=77, parameters=told)
    snapshot.write(path, arrays)
    again = RunningModel(aircraft, compiled.regressors, None)
    assert again.estimates() == {}
    processes = Processes(aircraft, believing=False)
    restored = snapshot.restore(path, again, processes, inside)
    assert restored == snapshot.Restored(1234, 77, True, False, told)
    assert processes.count == listened.station.processes.count > 0
    assert kept.estimates()
    assert again.estimates() == kept.estimates()


def test_a_snapshot_that_is_damaged_or_anothers_is_refused(
    listened, aircraft: Aircraft, compiled: Compiled, tmp_path: Path
) -> None:
    path, kept = tmp_path / snapshot.NAME, listened.station.model
    model = RunningModel(aircraft, compiled.regressors, None)
    processes = Processes(aircraft, believing=False)
    inside = InsideFeed(aircraft, listened.station.commands, None, None)
    snapshot.write(path, snapshot.taken(kept, processes, inside, time_us=1, updates=1))
    whole = path.read_bytes()
    for damaged in (b"", b"no archive", whole[: len(whole) // 2]):
        path.write_bytes(damaged)
        with pytest.raises(InputError, match="cannot be read as a snapshot"):
            snapshot.restore(path, model, processes, inside)
    arrays = {**kept.state(), "schema": np.array(snapshot.SCHEMA), "time_us": np.array(1)}
    np.savez(path, **arrays, updates=np.array(1), structure=np.array("Cm alpha"))
    with pytest.raises(InputError, match="another aircraft file"):
        snapshot.restore(path, model, processes, inside)
    first = next(name for name in arrays if name.endswith("information"))
    arrays[first] = np.full_like(arrays[first], np.nan)
    np.savez(path, **arrays, updates=np.array(1), structure=np.array(model.structure))
    with pytest.raises(InputError, match="not finite"):
        snapshot.restore(path, model, processes, inside)
    assert model.estimates() == {}


def test_a_bad_link_costs_certainty_not_truth(
    listened, played, aircraft: Aircraft, compiled: Compiled
) -> None:
    """A third lost, some twice, out of order or with flipped bits, another vehicle beside."""
    chance, now = np.random.default_rng(5), [played[0][0]]
    station = Station(aircraft, compiled, prior=None, vehicle=1, clock_us=lambda: now[0])
    stream, other = FrameStream(), Writer(system=2)
    held: bytes | None = None
    for index, (link_us, frame) in enumerate(played):
        if link_us > played[0][0] + FAULTY_S * 1e6:
            break
        now[0] = link_us
        fate = chance.random()
        data = frame
        if index > 200 and fate < 0.30:
            continue  # heartbeats and parameters at the beginning arrive
        if fate > 0.99:
            place = int(chance.integers(len(frame)))
            data = frame[:place] + bytes([frame[place] ^ 0x10]) + frame[place + 1 :]
        elif fate > 0.95:
            data = frame + frame
        elif fate > 0.93 and held is None:
            held = frame
            continue
        if index % 40 == 0:
            data += other.frame("HEARTBEAT", type=1, autopilot=3)
            data += other.frame("ATTITUDE", time_boot_ms=index, roll=3.0)
        if held is not None:
            data, held = data + held, None
        station.receive(stream.feed(data, link_us))
        station.work(2**62)
    assert stream.lost["bad_crc"] + stream.lost["garbage_bytes"] > 0
    assert list(station.decoder.others) == [2]
    newest = station.newest
    assert newest is not None
    whole = min(listened.estimates, key=lambda item: abs(item.row.time - newest.row.time))
    assert whole.row.time == pytest.approx(newest.row.time, abs=0.05)
    spread = np.sqrt(np.diagonal(newest.flow_covariance) + np.diagonal(whole.flow_covariance))
    assert np.all(np.abs(newest.flow - whole.flow) < 3.0 * spread)
    assert np.all(np.diagonal(newest.flow_covariance) >= 0.5 * np.diagonal(whole.flow_covariance))
