"""Read the manifest of a build and check that its entries are complete and have the right types."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from codegen import configuration
from codegen.configuration import Kind
from codegen.configuration.section import needed
from codegen.emit.contracts.proof import Proof
from codegen.emit.folder import MANIFEST, read_manifest
from codegen.emit.objects import ManifestObjects
from codegen.errors import BuildError

Numbers = Annotated[list[float], Field(min_length=1)]


class _Read(BaseModel):
    """Known entries are checked strictly; unknown ones are ignored."""

    model_config = ConfigDict(extra="ignore", strict=True, allow_inf_nan=False)


class _Options(_Read):
    prefix: Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")]
    kind: Kind
    precision: Literal["single", "double"]


class _Grip(_Read):
    speed_m_s: Numbers
    front_angle_rad: Numbers


class _Map(_Read):
    speed_m_s: Numbers
    front_angle_rad: Numbers
    friction: float
    frictions: Numbers
    longitudinal_accelerations: Numbers | None = None
    lateral_acceleration_caps_m_s2: Numbers | None = None
    lateral_acceleration_cap_m_s2: float
    lookup_error_bound_rad_s: float
    solved: bool
    flash_bytes: int
    rules: dict[str, dict[str, Any]]
    rule_by_speed_and_front_angle: list[str]
    grip: _Grip | None = None

    @model_validator(mode="after")
    def _check_rules(self) -> Self:
        rows = self.rule_by_speed_and_front_angle
        if [len(row) for row in rows] != [len(self.front_angle_rad)] * len(self.speed_m_s):
            raise ValueError("rule_by_speed_and_front_angle must have a row for each speed and a letter for each front angle")
        return self


class _Margins(_Read):
    gain_margin_db: float | None
    phase_margin_deg: float | None
    enough: bool
    warns_from_km_h: float | None
    unstable_from_km_h: float | None

    @model_validator(mode="after")
    def _check_warning(self) -> Self:
        if self.warns_from_km_h is None and not (self.enough and self.unstable_from_km_h is None):
            raise ValueError("warns_from_km_h must be a number where the margins are not enough")
        return self


class _LimiterCut(_Read):
    cells: Annotated[int, Field(ge=0)]
    of: int
    largest_deg_s: float
    at_km_h: float | None
    at_front_angle_deg: float | None

    @model_validator(mode="after")
    def _check_location(self) -> Self:
        if self.cells and None in (self.at_km_h, self.at_front_angle_deg):
            raise ValueError("at_km_h and at_front_angle_deg must be numbers where cells are cut off")
        return self


class _Excess(_Read):
    percent: float
    at_km_h: float
    at_front_angle_deg: float
    at_friction: float
    trim_max_percent: float
    enough: bool


class _Calibration(_Read):
    checksum_crc32: Annotated[str, Field(pattern=r"^[0-9a-f]{8}$")]


class _ConfigurationSource(_Read):
    source: str
    sha256: str


class _MapSource(_Read):
    file: str
    sha256: str
    case: str | None


class _Inputs(_Read):
    configuration: _ConfigurationSource
    map: _MapSource


class _File(_Read):
    sha256: str
    bytes: Annotated[int, Field(ge=0)]


class _Symbol(_Read):
    type: str
    shape: list[int]
    unit: str
    section: Literal["calibration", "const"]
    scale: float | None = None


class _Manifest(_Read, ManifestObjects):
    schema_version: Literal[1]
    name: str
    version: str
    build_id: Annotated[str, Field(pattern=r"^[0-9A-F]{8}$")]
    options: _Options
    map: _Map
    margins: _Margins | None
    limiter_cut: _LimiterCut
    reference_model_excess: _Excess | None = None
    calibration: _Calibration | None = None
    tools: dict[str, str]
    inputs: _Inputs
    dynamics_library_functions: list[str]
    files: dict[str, _File]
    configuration: dict[str, Any]
    symbols: dict[str, _Symbol] = Field(default_factory=dict)
    proofs: list[Proof] = []


def read_build(folder: Path) -> dict[str, Any]:
    """Return the manifest of a build folder, complete and of the right types.

    Raises:
        BuildError: the folder is not a build, or an entry is missing or has a wrong type.
        ConfigError: the configuration in the manifest is not valid.
    """
    manifest, place = read_manifest(folder), Path(folder) / MANIFEST
    if "what" in manifest:  # an export for AUTOSAR, or a firmware project
        what = "it was made from a build, but is not one itself"
        raise BuildError(what, where=folder, remedy="name the folder of `codegen build`")
    try:
        found = _Manifest.model_validate(manifest)
    except ValidationError as error:
        fault = error.errors(include_url=False)[0]
        entry = ".".join(str(part) for part in fault["loc"])
        raise BuildError(f"{entry}: {needed(fault)}", where=place, remedy="build again with `codegen build`") from None
    for section, field in configuration.Config.model_fields.items():
        if section not in found.configuration and field.exclude_if is None:
            raise BuildError(f"configuration.{section}: missing", where=place, remedy="build again with `codegen build`")
    configuration.parse(found.configuration, f"{place}: configuration")
    return manifest
