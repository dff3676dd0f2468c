"""A recording has its scenario's text to the byte, and beside it what the text names, by content.

That are edges and samples of files, and the user's own FMUs where the user wants it. An FMU is
native code: of a recording it is run only where the user allows it, and from the store of FMUs. So
that a recording is drawn without its FMUs, it also has each robot's URDF, once for all that share
it.
"""

import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from nrs_cosim.orchestrator.engine.plants import group_by_archive
from nrs_cosim.orchestrator.errors import ScenarioError
from nrs_cosim.orchestrator.scenario.assets import FMU, Asset, Assets, sha256_of
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.plant_fmu.bundled.declaration import bundled_models
from nrs_cosim.plant_fmu.bundled.model_urdf import model_urdf
from nrs_cosim.plant_fmu.cache import keep_fmu
from nrs_cosim.plant_fmu.errors import FmuError
from nrs_cosim.recordings.mcap.container import MOST_ATTACHED
from nrs_cosim.recordings.metadata import SCENARIO, URDFS, AssetRecord

XML = "application/xml"
Urdfs = Mapping[bytes, Sequence[int]]
"""The robots that share each URDF."""


def expect_attachable(assets: Assets) -> None:
    """Raise `ScenarioError` for an asset that is too large for a recording."""
    for field, asset in assets.items():
        if len(asset.content) > MOST_ATTACHED:
            raise ScenarioError(
                f"{field}: {asset.name}: expected up to {MOST_ATTACHED} bytes in a recording, got "
                f"{len(asset.content)}"
            )


def recorded_assets(experiment: Experiment, plants: Sequence[Mapping[str, Any]]) -> Assets:
    """Return what is recorded of a run with these plants: of FMUs those that it really has."""
    used = {plant["sha256"] for plant in plants}
    return {
        field: asset
        for field, asset in experiment.assets.items()
        if asset.media_type != FMU or asset.sha256 in used
    }


def folder_from(recording: Path, experiment: Experiment) -> str:
    """Return where the files are that a scenario names and a recording has not, seen from it.

    Where there are none, nobody need know where the scenario was.
    """
    if experiment.files_at is None:
        return "."
    try:
        return os.path.relpath(experiment.files_at, recording.absolute().parent.resolve())
    except ValueError:  # they are on two drives
        return str(experiment.files_at)


def attachments(
    experiment: Experiment, assets: Assets, urdfs: Urdfs
) -> dict[str, tuple[str, bytes]]:
    """Return what is attached to a recording, by name: media type and content."""
    text = {SCENARIO: ("application/toml", experiment.text.encode())}
    beside = {asset.attachment: (asset.media_type, asset.content) for asset in assets.values()}
    return text | beside | {_name_of(urdf): (XML, urdf) for urdf in urdfs}


def asset_records(assets: Assets) -> dict[str, str]:
    """Return the metadata record that says which attachment has what a field names."""
    records = {
        field: AssetRecord(
            name=asset.name,
            attachment=asset.attachment,
            sha256=asset.sha256,
            source_sha256=asset.source_sha256,
        )
        for field, asset in assets.items()
    }
    return {field: json.dumps(record.model_dump()) for field, record in records.items()}


def urdfs_of(experiment: Experiment, plants: Sequence[Mapping[str, Any]]) -> dict[bytes, list[int]]:
    """Return the URDFs that are known of a run's plants, and which robots have each."""
    found: dict[bytes, list[int]] = {}
    bundled = {*bundled_models()}
    for plant in plants:
        fmu, names = plant["fmu"], [joint["name"] for joint in plant["joints"]]
        texts: dict[int, str] = {}
        for robot in plant["robots"]:
            own, text = experiment.of_robot(robot), plant["urdf"]
            if fmu in bundled:  # robots that have no table of their own share one
                if id(own) not in texts:
                    texts[id(own)] = model_urdf(fmu, own.plant.parameters, names)
                text = texts[id(own)]
            if text:
                found.setdefault(text.encode(), []).append(robot)
    return found


def urdf_records(urdfs: Urdfs) -> dict[str, dict[str, str]]:
    """Return the metadata record that says whose each URDF is, if there is any."""
    records = {_name_of(urdf): json.dumps(robots) for urdf, robots in urdfs.items()}
    return {URDFS: records} if records else {}


def _name_of(urdf: bytes) -> str:
    return f"{sha256_of(urdf)}.urdf"


def with_fmus(experiment: Experiment) -> Experiment:
    """Return an experiment whose assets include the FMUs of its plants that are not bundled."""
    fmus = {}
    for group in group_by_archive(experiment):
        archive, name = group.archive, group.plant.fmu
        if name in bundled_models():
            continue
        content = archive.path.read_bytes()
        if sha256_of(content) != archive.sha256:
            raise FmuError(f"{archive.label}: has changed since it was read")
        fmus[f"{group.field}.fmu"] = Asset.of(name, archive.sha256, FMU, content)
    return experiment.but(assets={**experiment.assets, **fmus})


def with_allowed_fmus(experiment: Experiment) -> Experiment:
    """Return an experiment whose plants may be the FMUs among its assets: the user allows it."""
    fmus = {
        asset.name: keep_fmu(asset.content, asset.sha256)
        for asset in experiment.assets.values()
        if asset.media_type == FMU
    }
    return experiment.but(fmus=fmus)
