"""A run as a system of FMUs: other engines come to the very numbers that were recorded."""

import ctypes
import importlib.util
import re
import shutil
from functools import cache
from io import BytesIO
from pathlib import Path
from xml.etree import ElementTree
from zipfile import ZipFile

import fmpy
import fmpy.ssp
import numpy as np
import pytest
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave
from fmpy.validation import validate_fmu
from lxml import etree

from nrs_cosim.bus.errors import InputError
from nrs_cosim.bus.summation import Summation, summed
from nrs_cosim.orchestrator.engine.summary import experiment_of
from nrs_cosim.orchestrator.export.answers import answers
from nrs_cosim.orchestrator.export.package import ssp_bytes
from nrs_cosim.orchestrator.export.system import agent_of, node_names, system_of
from nrs_cosim.orchestrator.scenario.file import read_scenario
from nrs_cosim.plant_fmu.bundled.builder import build_library, copy_out
from nrs_cosim.plant_fmu.bundled.declaration import MODELS
from nrs_cosim.plant_fmu.bundled.urdf import read_urdf
from nrs_cosim.plant_fmu.bundled.urdf_fmu import build_urdf
from nrs_cosim.recordings.mcap.reader import Reader
from tests.cases import cases
from tests.command import nrs
from tests.elsewhere.engines import ENGINES, compared
from tests.orchestrator.test_exit_status import SLIDER
from tests.scenarios import SHORT, drawn, example, write

pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler")

NEEDS = {"ecos": "ecospy", "libcosim": "libcosimpy", "fmpy": "fmpy"}
SCHEMAS = Path(fmpy.ssp.__file__).parent / "schema"


def packed(recording: Path) -> bytes:
    with Reader(recording) as reader:
        experiment = experiment_of(reader)
        return ssp_bytes(system_of(experiment, reader.ticks), answers(reader, experiment))


@pytest.fixture(scope="module")
def systems(tmp_path_factory):
    """Return the SSPs of short runs: by the first and the second order, on several axes."""
    folder = tmp_path_factory.mktemp("systems")
    for base in ("paper_first_order", "paper_example_3a"):
        write(folder / f"{base}.toml", {"run.duration": 1.0}, base=base)
        assert nrs("run", f"{base}.toml", "-o", f"{base}.mcap", cwd=folder).returncode == 0
        done = nrs("export", f"{base}.mcap", "--to", "ssp", "-o", f"{base}.ssp", cwd=folder)
        assert done.returncode == 0, done.stderr
    return folder


@pytest.mark.parametrize("base", ["paper_first_order", "paper_example_3a"])
@pytest.mark.parametrize("engine", ENGINES)
def test_an_engine_comes_to_the_very_numbers_of_the_recording(systems, engine, base):
    if importlib.util.find_spec(NEEDS[engine]) is None:
        pytest.skip(f"{NEEDS[engine]} is not installed")
    size, same, _ = compared(engine, systems / f"{base}.ssp")
    assert size == same == 10 * (4 + 6 * 8)


THIRD = {"name": "dcea3", "alpha": 0.9, "beta": 0.8, "gamma": 0.7}
PI = {"name": "pi_consensus", "alpha": 0.7, "beta": 0.8, "kappa": 0.1}
SAMPLES = {"kind": "sampled", "times": [0, 0.3, 1], "positions": [[0, 0], [1, 2], [3, 1]]}
ALL = {
    "run.duration": 0.8,
    "target": SAMPLES,
    "initial": drawn(-1.0, 1.0),
    "network": {
        "repeat": 3,
        "switching": [
            {
                "from": 1,
                "position": {"adjacency": [[0, 0], [1, 0]], "pinning": [1, 0]},
                "velocity": {"edge_list": [[0, 2], [2, 1]]},
            },
            {"from": 3, "adjacency": [[0, 1], [0, 0]], "pinning": [0, 1]},
        ],
    },
}
MOVER = {
    "kind": "fmu",
    "fmu": "two_link_arm",
    "parameters": {"q": [0.3, 0.0]},
    "variables": {"position": "q", "velocity": "qd"},
}
IN_TURN = {
    "all at once": ("paper_first_order", ALL),
    "digraphs of which the last stays": (
        "switching",
        {"run.duration": 2.5, "network.repeat": None},
    ),
    "digraphs that come again": ("switching", {"run.duration": 2.8}),
    "velocities over another digraph": ("hetero_information", {"run.duration": 0.5}),
    "an acceleration too": ("paper_first_order", {"run.duration": 0.3, "algorithm": THIRD}),
    "an acceleration of a target that is sampled": (
        "paper_first_order",
        {"run.duration": 0.3, "algorithm": THIRD, "target": SAMPLES},
    ),
    "a target that is an FMU": (
        "paper_first_order",
        {"run.duration": 0.3, "algorithm": THIRD, "target": MOVER},
    ),
    "a target that is sampled": ("paper_first_order", {"run.duration": 0.5, "target": SAMPLES}),
}


@pytest.fixture(scope="module")
def in_turn(tmp_path_factory):
    """Return a function to the SSP of a case, which is run once for all engines."""

    @cache
    def exported(case):
        folder = tmp_path_factory.mktemp("in_turn")
        base, changes = IN_TURN[case]
        write(folder / "s.toml", changes, base=base)
        assert nrs("run", "s.toml", "-o", "s.mcap", cwd=folder).returncode == 0
        (folder / "s.ssp").write_bytes(packed(folder / "s.mcap"))
        return folder / "s.ssp"

    return exported


@pytest.mark.parametrize("case", cases([*IN_TURN], ["all at once", "an acceleration too"]))
@pytest.mark.parametrize("engine", ENGINES)
def test_what_changes_with_k_and_what_more_is_kept_is_in_the_fmus_to_the_same_bits(
    in_turn, engine, case
):
    if importlib.util.find_spec(NEEDS[engine]) is None:
        pytest.skip(f"{NEEDS[engine]} is not installed")
    size, same, most = compared(engine, in_turn(case))
    assert size == same > 0, most


@pytest.mark.parametrize(
    "base", cases(["hetero_information", "paper_first_order"], ["hetero_information"])
)
def test_what_is_kept_but_not_sent_is_in_the_fmus_but_for_rounding(tmp_path, base):
    write(tmp_path / "s.toml", {"run.duration": 0.3, "algorithm": PI}, base=base)
    assert nrs("run", "s.toml", "-o", "s.mcap", cwd=tmp_path).returncode == 0
    (tmp_path / "s.ssp").write_bytes(packed(tmp_path / "s.mcap"))
    size, _, most = compared("fmpy", tmp_path / "s.ssp")
    assert size > 0
    assert most < 1e-12


def test_robots_of_a_urdf_that_receive_from_many_come_to_the_same_numbers_too(tmp_path):
    pytest.importorskip("casadi", reason="casadi is not installed (the extra `urdf`)")
    (tmp_path / "slider.urdf").write_text(SLIDER, "utf-8")
    copy_out(build_urdf(read_urdf(tmp_path / "slider.urdf")), tmp_path / "slider.fmu")
    everyone = [[int(i != j) for j in range(10)] for i in range(10)]
    changes = {
        "run": {"duration": 0.5, "sampling_period": 0.1, "seed": 3},
        "network": {"adjacency": everyone, "pinning": [1, *[0] * 9]},
        "plant": {"fmu": "slider.fmu"},
        "target": {"axes": [{"rate": 1.0, "sines": [{"amplitude": 2.0, "frequency": 3.0}]}]},
        "disturbance": None,
        "initial": drawn(-1.0, 1.0),
    }
    write(tmp_path / "s.toml", changes)
    assert nrs("run", "s.toml", "-o", "s.mcap", cwd=tmp_path).returncode == 0
    (tmp_path / "s.ssp").write_bytes(packed(tmp_path / "s.mcap"))
    size, same, _ = compared("fmpy", tmp_path / "s.ssp")
    assert size == same == 5 * (2 + 10 * 4)


@pytest.mark.parametrize(
    ("algorithm", "exact"),
    [
        ({"name": "dcea1", "alpha": 0.7, "beta": 0.8}, True),
        ({"name": "dcea2", "alpha": 0.7, "beta": 0.8}, True),
        ({"name": "pd_like", "alpha": 1.7}, True),
        ({"name": "impulsive", "alpha": 0.7, "beta": 0.3}, False),
        (THIRD, True),
        (PI, False),
    ],
    ids=lambda value: value["name"] if isinstance(value, dict) else "",
)
def test_it_is_told_where_k_and_g_are_the_jump_but_for_rounding(algorithm, exact):
    changes = {"algorithm": algorithm, **SHORT}
    assert system_of(example("paper_first_order", changes), 1).exact == exact


def test_a_system_is_as_its_standard_has_it_and_always_the_same_bytes(systems):
    path = systems / "paper_first_order.ssp"
    assert packed(path.with_suffix(".mcap")) == path.read_bytes()
    with ZipFile(path) as archive:
        for name in archive.namelist():
            if name.endswith((".ssd", ".ssv")):
                kind = "Description" if name.endswith("d") else "ParameterValues"
                schema = etree.XMLSchema(file=str(SCHEMAS / f"SystemStructure{kind}.xsd"))
                schema.assertValid(etree.fromstring(archive.read(name)))
            elif name.endswith(".fmu"):
                fmu = BytesIO(archive.read(name))
                assert validate_fmu(fmu) == []
                assert fmpy.read_model_description(fmu).modelExchange is None


@pytest.mark.parametrize("n", [1, 9, 10, 11, 100])
def test_no_component_is_named_as_another_begins(n):
    names = node_names(n)
    assert len(set(names)) == n + 1
    assert not any(a != b and b.startswith(a) for a in names for b in names)


PAIR = {"adjacency": [[0, 1], [1, 0]], "pinning": [1, 0]}
MANY = {"switching": [{"from": k, **PAIR} for k in range(1, 102)]}
REFUSED = {
    "faults": ("paper_lossy_links", {}),
    "run": ("paper_jitter", {}),
    "algorithm.name: sliding does not jump linearly": (
        "paper_first_order", {"algorithm": {"name": "sliding", "alpha": 0.9, "beta": 0.9}},
    ),
    "algorithm.name: push_sum sends more than": (
        "paper_first_order", {"algorithm": {"name": "push_sum"}},
    ),
    "network: 101 digraphs come in turn": ("switching", {"network": MANY}),
    "plant: is driven by 'cvode'": ("paper_first_order", {"plant.solver": "cvode"}),
}  # fmt: skip


@pytest.mark.parametrize("why", REFUSED)
def test_what_is_no_system_is_refused_by_its_field(tmp_path, why):
    base, changes = REFUSED[why]
    write(tmp_path / "s.toml", changes, base=base)
    experiment = read_scenario(tmp_path / "s.toml")
    with pytest.raises(InputError, match=f"cannot be taken elsewhere: {why}"):
        system_of(experiment, 1)


def test_the_order_of_c_sums_is_that_of_the_agents():
    source = b'#include "summation.h"\n' + b"".join(
        b'__attribute__((visibility("default"))) double %s(const double *x, size_t n);\n'
        b"double %s(const double *x, size_t n) { return sum_%s(x, n); }\n" % (name, name, name)
        for name in (b"pairwise", b"from_first")
    )
    header = (MODELS / "agent" / "summation.h").read_bytes()
    library = ctypes.CDLL(str(build_library("sums", {"sums.c": source, "summation.h": header})))
    x = np.random.Generator(np.random.Philox(3)).normal(size=600)
    for n in (*range(40), 127, 128, 129, 130, 300, 513, 600):
        for name, expected in (
            ("pairwise", summed(x[:n])),
            ("from_first", Summation(np.array([0]), n)(x[:n, None])[0, 0] if n else 0.0),
        ):
            function = getattr(library, name)
            function.restype = ctypes.c_double
            assert function(x.ctypes, ctypes.c_size_t(n)) == expected, (name, n)


TWO = {"adjacency": [[0, 0], [1, 0]], "pinning": [1, 0]}


@pytest.mark.parametrize("fmi", [2, 3])
def test_an_agent_alone_jumps_at_the_beginning_of_the_step_from_a_sampling_time(tmp_path, fmi):
    """ε⁺ = 0.1 + 0.9 (1 − 0.1), υ⁺ = 1 + 1.1 (3 − 1), and ε(t_2) = ε⁺ + 0.1 υ⁺."""
    start = {"position": [[0.0, 0.0]] * 2, "velocity": [[1.0, 1.0]] * 2, "q": [[0.0, 0.0]] * 2}
    gains = {"algorithm": {"name": "dcea1", "alpha": 0.9, "beta": 1.1}}
    write(tmp_path / "s.toml", {"network": TWO, "initial": start, **gains})
    path = agent_of(read_scenario(tmp_path / "s.toml"), 2, fmi).path
    assert validate_fmu(str(path)) == []
    with ZipFile(path) as archive:
        page = archive.read("documentation/index.html").decode()
    for name, starts in (("keep", "1 0 0 1"), ("gain", "0.9 0 0 1.1")):
        assert re.search(rf"<td>{name}</td>.*<td>{starts}</td>", page)
    description = fmpy.read_model_description(path)
    reference = {v.name: v.valueReference for v in description.modelVariables}
    slave = (FMU2Slave if fmi == 2 else FMU3Slave)(
        guid=description.guid,
        unzipDirectory=fmpy.extract(str(path), str(tmp_path / "agent")),
        modelIdentifier="agent",
        instanceName="agent",
    )
    slave.instantiate()
    slave.enterInitializationMode()
    slave.exitInitializationMode()

    def estimate():
        if fmi == 3:
            return [slave.getFloat64([reference[name]], 2)[0] for name in ("position", "velocity")]
        return slave.getReal([reference[f"{name}[1]"] for name in ("position", "velocity")])

    def give(position, velocity):
        for name, value in (("position", position), ("velocity", velocity)):
            if fmi == 3:
                slave.setFloat64([reference[f"received_{name}"]], [value, value])
            else:
                slave.setReal([reference[f"received_{name}[1,{i}]"] for i in (1, 2)], [value] * 2)

    time = 0.0
    for step, received, after in (
        (0.1, (9.0, 9.0), (0.1, 1.0)),
        (0.05, (1.0, 3.0), (0.91 + 0.05 * 3.2, 3.2)),
        (0.05, (7.0, 7.0), (1.23, 3.2)),
    ):
        give(*received)
        slave.doStep(time, step)
        time += step
        np.testing.assert_allclose(estimate(), after, rtol=1e-15)
    with pytest.raises(Exception, match="DoStep"):
        slave.doStep(time, 0.2)
    assert np.isnan(estimate()).all()
    slave.freeInstance()


def test_connections_lead_from_samples_to_what_agents_receive(systems):
    with ZipFile(systems / "paper_first_order.ssp") as archive:
        root = ElementTree.fromstring(archive.read("SystemStructure.ssd"))
    pairs = {
        (of.get("startElement"), of.get("endElement"))
        for of in root.iter()
        if of.tag.endswith("}Connection")
    }
    experiment = read_scenario(systems / "paper_first_order.toml")
    names, graph = node_names(6), experiment.topologies.links
    edges = zip(graph.source.tolist(), graph.sink.tolist(), strict=True)
    assert pairs == {(names[source], names[sink]) for source, sink in edges}
