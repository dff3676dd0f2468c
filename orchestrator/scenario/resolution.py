"""What a scenario names is put into its tables: edges, samples and parameters of files.

The samples of an FMU that is the target are put there too.
Each is an asset. One that is known already, as a recording has it, is taken as it is; another is
read from its file, once, and where no file may be read that is a fault. The scenario's text stays
as it was written.
"""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TypeVar

from nrs_cosim.bus.errors import InputError
from nrs_cosim.bus.text import quoted
from nrs_cosim.orchestrator.errors import ScenarioError
from nrs_cosim.orchestrator.scenario.assets import FMU, TABLE, Asset, Assets, sha256_of
from nrs_cosim.orchestrator.scenario.edges import Arrow, expect_distinct, read_edges, written
from nrs_cosim.orchestrator.scenario.samples import Array, Samples
from nrs_cosim.orchestrator.scenario.tables.fmus import Fmu, ParameterFile
from nrs_cosim.orchestrator.scenario.tables.networks import Digraph, Edge, Network
from nrs_cosim.orchestrator.scenario.tables.scenario import Scenario
from nrs_cosim.orchestrator.scenario.tables.targets import (
    FmuMotion,
    FmuTarget,
    SampledTarget,
    TargetMotion,
)

TARGET_FMU = "target.fmu"
"""The field whose asset are the samples of an FMU."""
_FILE = "target.file"
_Table = TypeVar("_Table", bound=Digraph)
_Value = TypeVar("_Value")


class Resolution:
    """The assets of a scenario, as they are found, and the faults of those that are not."""

    def __init__(self, folder: Path | None, known: Assets) -> None:
        """Take assets that are known, and look for others in a folder, if there is one."""
        self.assets = {field: asset for field, asset in known.items() if asset.media_type == FMU}
        self.faults: list[str] = []
        self._folder, self._known = folder, known

    def tables(self, scenario: Scenario) -> Scenario:
        """Return a scenario with what it names, but for the motion of an FMU that is to be run."""
        update = {
            "network": self._network(scenario.network),
            "target": self._target(self._with_file(scenario.target, "target")),
            "plant": self._with_file(scenario.plant, "plant"),
            "robots": tuple(
                robot.model_copy(
                    update={"plant": self._with_file(robot.plant, f"robots[{i}].plant")}
                )
                if robot.plant
                else robot
                for i, robot in enumerate(scenario.robots)
            ),
        }
        return scenario.model_copy(update=update)

    def _with_file(self, table: _Value, where: str) -> _Value:
        """Return the table of an FMU, if it is one, with the parameters of its file."""
        if not isinstance(table, Fmu) or not isinstance(table.parameters, ParameterFile):
            return table
        from nrs_cosim.orchestrator.scenario import parameter_sets  # noqa: PLC0415, it loads lxml

        field, file = f"{where}.parameters", table.parameters.file
        found = self._found(
            field, file, parameter_sets.parameter_table, parameter_sets.read_parameters
        )
        return table.model_copy(update={"parameters": found or {}})

    def _network(self, network: Network) -> Network:
        phases = tuple(
            self._interaction(phase, f"network.switching[{i}]")
            for i, phase in enumerate(network.switching or ())
        )
        whole = self._interaction(network, "network")
        return whole.model_copy(update={"switching": phases}) if phases else whole

    def _interaction(self, table: _Table, where: str) -> _Table:
        inner = {
            name: self._digraph(digraph, f"{where}.{name}")
            for name in ("position", "velocity")
            if (digraph := getattr(table, name)) is not None
        }
        return self._digraph(table, where).model_copy(update=inner)

    def _digraph(self, table: _Table, where: str) -> _Table:
        """Return a digraph with the edges of its file, where a file is its only form."""
        form = table.forms[0] if len(table.forms) == 1 else ""
        if form not in _GRAPHS:
            return table
        edges = self._found(f"{where}.{form}", getattr(table, form), _GRAPHS[form], _edges)
        return table.model_copy(update={form: None, "edge_list": edges}) if edges else table

    def _target(self, target: TargetMotion) -> TargetMotion:
        if isinstance(target, FmuTarget):
            if self._folder is not None and not self._knows(TARGET_FMU, target.fmu):
                return target
            return self._found(TARGET_FMU, target.fmu, _samples, partial(moved, target)) or target
        if not isinstance(target, SampledTarget) or target.file is None:
            return target
        given = [key for key in ("times", "positions") if getattr(target, key)]
        if given:
            self.faults.append(
                f"target.file: got {quoted(target.file)} and target.{given[0]} too; give one of "
                f"them"
            )
            return target
        return self._found(_FILE, target.file, _samples, partial(_sampled, target)) or target

    def _knows(self, field: str, name: str) -> bool:
        return field in self._known and self._known[field].name == name

    def _found(
        self,
        field: str,
        name: str,
        read: Callable[[bytes, str], bytes],
        parse: Callable[[Asset], _Value],
    ) -> _Value | None:
        """Return what an asset has; None where there is a fault.

        `read` makes a file's content that of an asset, which `parse` reads.
        """
        try:
            asset = self._asset(field, name, read)
            value = parse(asset)
        except InputError as error:
            self.faults.append(f"{field}: {error}")
            return None
        self.assets[field] = asset
        return value

    def _asset(self, field: str, name: str, read: Callable[[bytes, str], bytes]) -> Asset:
        if self._knows(field, name):
            return self._known[field]
        if self._folder is None:
            raise InputError(
                f"{quoted(name)} is read where a scenario file is, and did not come with this text"
            )
        data = _content(self._folder / name, name)
        return Asset.of(name, sha256_of(data), TABLE, read(data, name))


def moved(target: FmuTarget, asset: Asset) -> FmuMotion:
    """Return the target that an FMU is, with its samples."""
    samples = Samples.read(asset.content, asset.name, is_asset=True)
    if samples.velocities is None:
        raise InputError(f"{asset.name}: expected velocities, got none")
    return FmuMotion.model_construct(
        **dict(target),
        sha256=asset.source_sha256,
        times=tuple(samples.times.tolist()),
        positions=_rows(samples.positions),
        velocities=_rows(samples.velocities),
    )


def _sampled(target: SampledTarget, asset: Asset) -> SampledTarget:
    """Return a target with the samples of its file."""
    samples = Samples.read(asset.content, asset.name, is_asset=True)
    rows = {"times": tuple(samples.times.tolist()), "positions": _rows(samples.positions)}
    return target.model_copy(update={"file": None, **rows})


def _samples(data: bytes, name: str) -> bytes:
    """Return the table of a file with a target's samples; its velocities decide nothing."""
    samples = Samples.read(data, name)
    samples.expect_agreement(name)
    return Samples(samples.times, samples.positions, None).written()


def _rows(vectors: Array) -> tuple[tuple[float, ...], ...]:
    return tuple(map(tuple, vectors.tolist()))


def _content(path: Path, name: str) -> bytes:
    try:
        return path.read_bytes()
    except FileNotFoundError:
        raise ScenarioError(f"{name}: no such file; it is relative to the scenario's") from None
    except (OSError, ValueError) as error:  # a path with a null byte is a ValueError
        why = getattr(error, "strerror", None) or error
        raise ScenarioError(f"{name}: cannot be read: {why}") from None


def _of_csv(data: bytes, name: str) -> bytes:
    return written(_distinct(read_edges(data, name), name))


def _of_graphml(data: bytes, name: str) -> bytes:
    from nrs_cosim.orchestrator.scenario.graphml import arrows_of  # noqa: PLC0415, it loads lxml

    return written(_distinct(arrows_of(data, name), name))


def _edges(asset: Asset) -> tuple[Edge, ...]:
    """Return the edges of an asset as a network's table has them."""
    arrows = _distinct(read_edges(asset.content, asset.name), asset.name)
    return tuple((arrow.source, arrow.sink, arrow.weight) for arrow in arrows)


def _distinct(arrows: list[Arrow], name: str) -> list[Arrow]:
    if not arrows:
        raise ScenarioError(f"{name}: has no edge; robot 1, say, must receive from the target, 0")
    return expect_distinct(arrows, name)


_GRAPHS = {"edges": _of_csv, "graphml": _of_graphml}
"""What makes a file a table of edges, by its form."""
