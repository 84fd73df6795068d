"""An identified model on disk: `model/` with `model.json`, `arrays.npz` and the aircraft file.

Plain JSON and NumPy arrays without pickle, with a version; what a newer program wrote, or another
one, is refused. `model.json` is written last and holds the digest of the arrays, so that a run cut
short never leaves arrays of one model under the header of another.
"""

from __future__ import annotations

import hashlib
import io
import json
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gcs_sysid import aircraft_file, regressors
from gcs_sysid.aircraft import Aircraft
from gcs_sysid.errors import ModelFileError
from gcs_sysid.estimate.innovation_spectrum import Sensing
from gcs_sysid.estimate.result import AeroModel, CoefficientFit
from gcs_sysid.gp.aerodynamics import LearnedModel
from gcs_sysid.model.aided import Noise, Sensors
from gcs_sysid.model.air import Turbulence
from gcs_sysid.offline import documents, learned

FORMAT = "gcs-sysid model"
VERSION = 2
READABLE = (1, 2)
"""Version 1 had no Gaussian processes."""
ARRAYS = (
    "value",
    "covariance",
    "repeated_covariance",
    "flight_value",
    "white_deviation",
    "correlation",
    "excitation",
    "lowest",
    "highest",
)
LATER = ("late", "spread")
"""Not in models of before these were kept."""
RANGES = 8.5
"""From the lowest to the highest value of a regressor in a flight with test inputs, over its
standard deviation: 6.7 to 9.9 in the flight of `make demo`. What models say that have no spread."""
NUMBERS = ("discrepancy", "calibration", "residual", "samples", "effective_samples")


@dataclass(frozen=True)
class StoredModel:
    """A model with the aircraft it belongs to and what was learned of the streams.

    Attributes:
        model: the aerodynamics.
        aircraft: as its file described it.
        surface_delay: delay of the surfaces found in the flights [s].
        provenance: flights it was made from.
        inside_filter: whether it was found inside the aided filter, whose states it goes with.
        sensing: what that filter had to go by; models of before this was kept have none.
    """

    model: AeroModel
    aircraft: Aircraft
    surface_delay: float
    provenance: list[dict[str, Any]]
    inside_filter: bool = False
    sensing: Sensing | None = None


def save(directory: Path, stored: StoredModel) -> None:
    """Writes a model; `model.json`, which makes it whole, last."""
    arrays: dict[str, np.ndarray] = {}
    fits: dict[str, Any] = {}
    for name, fit in stored.model.fits.items():
        for field in (*ARRAYS, *LATER):
            arrays[f"{name}.{field}"] = np.asarray(getattr(fit, field))
        for origin, deviation in fit.deviations.items():
            arrays[f"{name}.deviation.{origin}"] = deviation
        fits[name] = {
            "regressors": list(fit.keys),
            "origins": list(fit.deviations),
            **{field: getattr(fit, field) for field in NUMBERS},
        }
    process = None
    if isinstance(stored.model, LearnedModel):
        arrays |= learned.arrays(stored.model)
        process = {"inputs": list(stored.model.inputs), "outputs": list(stored.model.outputs)}
    directory.mkdir(parents=True, exist_ok=True)
    packed = _packed(arrays)
    documents.write_atomic(directory / "arrays.npz", lambda path: _write(path, packed))
    documents.write_text(directory / "aircraft.toml", aircraft_file.dumps(stored.aircraft))
    documents.write_json(
        directory / "model.json",
        {
            "format": FORMAT,
            "version": VERSION,
            "arrays_sha256": hashlib.sha256(packed).hexdigest(),
            "controls": list(stored.model.controls),
            "fits": fits,
            "process": process,
            "surface_delay": stored.surface_delay,
            "flights": stored.provenance,
            "inside_filter": stored.inside_filter,
            "sensing": None if stored.sensing is None else _told(stored.sensing),
        },
    )


def _packed(arrays: Mapping[str, np.ndarray]) -> bytes:
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, **dict(arrays))
    return buffer.getvalue()


def _write(path: Path, data: bytes) -> None:
    path.write_bytes(data)


def load(directory: Path) -> StoredModel:
    """Reads a model directory (that of `identify`, or `model/` inside it).

    Raises:
        ModelFileError: nothing there, damaged, foreign, or from a newer version.
    """
    if not (directory / "model.json").is_file() and (directory / "model" / "model.json").is_file():
        directory = directory / "model"
    header = _header(directory)
    try:
        packed = (directory / "arrays.npz").read_bytes()
        if hashlib.sha256(packed).hexdigest() != header["arrays_sha256"]:
            raise ValueError("arrays.npz is not the file that model.json was written with")
        controls = tuple(header["controls"])
        with np.load(io.BytesIO(packed), allow_pickle=False) as arrays:
            fits = {
                name: _fit(name, entry, arrays, controls)
                for name, entry in dict(header["fits"]).items()
            }
            model = AeroModel(fits=fits, controls=controls)
            if header.get("process"):
                model = learned.from_arrays(model, header["process"], arrays)
        delay = float(header["surface_delay"])
        provenance = list(header["flights"])
        # Models of before this was told came with kinematic states as often as not.
        inside = bool(header.get("inside_filter", False))
        sensing = _sensing(header["sensing"]) if header.get("sensing") else None
    except (OSError, KeyError, TypeError, ValueError, EOFError, zipfile.BadZipFile) as error:
        raise ModelFileError(
            str(directory), f"the model is damaged ({error})", fix="run `gcs-sysid identify` again"
        ) from error
    aircraft = aircraft_file.load(directory / "aircraft.toml")
    return StoredModel(model, aircraft, delay, provenance, inside, sensing)


def _told(sensing: Sensing) -> dict[str, Any]:
    """As JSON, field by field."""

    def plain(part: Any) -> Any:
        if hasattr(part, "_asdict"):
            return {name: plain(value) for name, value in part._asdict().items()}
        return np.asarray(part).tolist()

    return plain(sensing)


def _sensing(told: Mapping[str, Any]) -> Sensing:
    noise = {name: value for name, value in told["log_noise"].items() if name != "turbulence"}
    blown = _arrays(told["log_noise"]["turbulence"])
    return Sensing(
        step=float(told["step"]),
        shares=np.asarray(told["shares"], dtype=float),
        log_noise=Noise(turbulence=Turbulence(**blown), **_arrays(noise)),
        deviation=Sensors(**_arrays(told["deviation"])),
    )


def _arrays(told: Mapping[str, Any]) -> dict[str, np.ndarray]:
    return {name: np.asarray(value, dtype=float) for name, value in told.items()}


def _header(directory: Path) -> dict[str, Any]:
    path = directory / "model.json"
    try:
        header = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise ModelFileError(
            str(directory),
            "holds no model.json",
            fix="give the directory that `gcs-sysid identify --out` wrote",
        ) from error
    except (OSError, ValueError) as error:
        raise ModelFileError(
            str(path), f"cannot be read ({error})", fix="run `gcs-sysid identify` again"
        ) from error
    if not isinstance(header, dict) or header.get("format") != FORMAT:
        raise ModelFileError(
            str(path),
            "is not a model of gcs-sysid",
            fix="give the directory that `gcs-sysid identify --out` wrote",
        )
    if header.get("version") not in READABLE:
        raise ModelFileError(
            str(path),
            f"has version {header.get('version')}, this program reads version {VERSION}",
            fix="install the gcs-sysid that wrote it, or run `gcs-sysid identify` again",
        )
    return header


def _fit(
    name: str,
    entry: Mapping[str, Any],
    arrays: Mapping[str, np.ndarray],
    controls: tuple[str, ...],
) -> CoefficientFit:
    keys = tuple(regressors.parse(key, controls=controls).key for key in entry["regressors"])
    fields: dict[str, Any] = {field: arrays[f"{name}.{field}"] for field in ARRAYS}
    origins = {origin: arrays[f"{name}.deviation.{origin}"] for origin in entry["origins"]}
    without = {
        "late": origins.get("lag", np.zeros(len(keys))),
        "spread": (fields["highest"] - fields["lowest"]) / RANGES,
    }
    fields |= {field: arrays.get(f"{name}.{field}", without[field]) for field in LATER}
    if any(set(values.shape) != {len(keys)} for values in fields.values()):
        raise ValueError(f"{name} has {len(keys)} regressors and arrays of another size")
    fields |= {field: entry[field] for field in NUMBERS}
    return CoefficientFit(keys=keys, deviations=origins, **fields)
