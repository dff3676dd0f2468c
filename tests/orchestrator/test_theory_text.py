"""What `nrs check` claims, and no more: of which links, how far, and in which order."""

from itertools import count

import numpy as np
import pytest

from nrs_cosim.orchestrator.analysis.bounds import ultimate_bounds
from nrs_cosim.orchestrator.analysis.check_warnings import warnings_of
from nrs_cosim.orchestrator.analysis.conditions import check
from nrs_cosim.orchestrator.cli.theory_text import _complex, bound_rows, convergence_rows
from nrs_cosim.orchestrator.report.subject import subject_of
from nrs_cosim.orchestrator.scenario.file import read_scenario
from nrs_cosim.orchestrator.scenario.robot_ids import multiple
from tests.estimator_agents.paper import ADJACENCY
from tests.orchestrator.networks import on, phases
from tests.scenarios import SCENARIOS, example, paper

PATH = {"generator": {"kind": "path", "n": 30}}


def along_a_path(gain):
    return on(PATH, {"algorithm.alpha": gain, "algorithm.beta": gain})


def test_over_links_of_which_none_is_known_there_is_no_radius_but_that_without_faults():
    lossy, plain = (
        check(read_scenario(SCENARIOS / f"{name}.toml")).as_json()
        for name in ("paper_lossy_links", "paper_first_order")
    )
    said = [one["conditions_of"] for one in (lossy, plain)]
    assert said == ["links without faults", "the links as they are"]
    assert [of["links"]["status"] for of in (lossy, plain)] == [
        "converges in mean square",
        "converges",
    ]
    assert plain["spectral_radius"] == pytest.approx(0.877817, abs=1e-6)
    assert [one["spectral_radius_without_faults"] for one in (lossy, plain)] == [
        plain["spectral_radius"]
    ] * 2
    assert [lossy[name] for name in ("spectral_radius", "rate", "settling_time")] == [None] * 3


def test_with_a_delay_of_all_samples_convergence_is_that_of_the_delayed_recursion():
    """With a delay of one period and h = 0.4 the delayed recursion has a radius of 1.0118."""
    period = {"run.sampling_period": 0.4}
    plain = check(example("paper_example_3a", period))
    assert plain.convergence == "converges"
    scenario = example("paper_example_3a", period, {"faults.links": [{"delay": 1}]})
    checked = check(scenario)
    result = checked.as_json()
    assert (result["convergence"], result["conditions_of"]) == ("diverges", "links without faults")
    assert result["spectral_radius"] == pytest.approx(1.011777, abs=5e-7)
    assert result["links"]["radius"]["upper"] == checked.spectral_radius
    assert result["spectral_radius_without_faults"] == plain.spectral_radius
    assert (result["links"]["source"], result["links"]["delays"]) == ("statement D1", [1, 1])
    assert result["links"]["margin"] == {"periods": 0, "kind": "exact"}
    assert result["settling_time"] is None
    assert {v["source"][-23:] for v in subject_of(scenario, ["rad", "rad"]).conditions} == {
        "of links without faults"
    }


def test_with_link_faults_conditions_are_stated_for_links_without_them():
    *conditions, last = warnings_of(check(example("paper_lossy_links", {"algorithm.alpha": 5})))
    assert conditions
    assert all(line.startswith("of links without faults: ") for line in conditions)
    assert last.startswith("over these links the estimates diverge: ")


def test_on_a_path_the_settling_time_includes_the_hops():
    checked = check(along_a_path(0.9)).as_json()
    assert checked["rate"] == pytest.approx(23.03, abs=0.01)
    assert checked["settling_time"] > 3  # with ln 10⁶/rate = 0.6 s it would not


def test_gains_of_1_on_a_path_converge_in_finite_time():
    checked = check(along_a_path(1)).as_json()
    assert (checked["rate"], checked["spectral_radius"], checked["settling_time"]) == (None, 0, 3)


def test_for_switching_networks_the_settling_time_is_not_computed():
    checked = check(read_scenario(SCENARIOS / "switching.toml")).as_json()
    assert checked["rate"] == pytest.approx(4.363, abs=1e-3)
    assert checked["settling_time"] is None
    assert checked["why_unsettled"] == "there are several digraphs"
    any_order = checked["switching"]["any_order"]
    assert (any_order["status"], any_order["upper"]) == ("proven", 1)
    assert any_order["lower"] == pytest.approx(0.996294, abs=1e-6)


def test_rounding_digits_of_an_eigenvalue_are_not_shown():
    assert _complex(2.77556e-17 - 0.840896j) == "0-0.840896j"
    assert _complex(0.5 + 1e-17j) == "0.5"


def test_agents_that_keep_more_settle_in_all_that_they_keep():
    """Of `dcea3`, whose A is F ⊗ I − F diag(α, β, γ) ⊗ (I − D)."""
    D = ADJACENCY / (ADJACENCY.sum(axis=1) + np.eye(6)[2])[:, None]
    flow, gain = np.array([[1, 0.1, 0.005], [0, 1, 0.1], [0, 0, 1]]), np.diag([0.9, 1.0, 0.9])
    A = np.kron(flow, np.eye(6)) - np.kron(flow @ gain, np.eye(6) - D)
    sizes = (np.linalg.norm(np.linalg.matrix_power(A, k), np.inf) for k in count(1))
    ticks = next(k for k, size in enumerate(sizes, 1) if size <= 1e-6)
    checked = check(example("compare_dcea3"))
    assert checked.settling_time == pytest.approx(0.1 * ticks)
    assert convergence_rows(checked)["rate"].endswith("in all that agents keep (statement W8)")
    assert "(statement W8)" in bound_rows(ultimate_bounds(example("compare_dcea3")))["bounds"]


@pytest.mark.parametrize(
    ("name", "changes", "unsettled", "loose"),
    [
        ("paper_first_order", {}, "", ""),
        ("paper_first_order", {"faults.links": [{"delay": 1}]}, "links have f", "samples are late"),
        ("paper_first_order", {"run.sampling_jitter": 0.2}, "sampling is not periodic", ""),
        ("compare_dcea3", {}, "", "agents keep more than a position and a velocity"),
        ("compare_event_triggered", {}, "agents decide when they send", ""),
    ],
)
def test_what_is_less_than_of_the_paper_says_why(name, changes, unsettled, loose):
    checked, ultimate = check(example(name, changes)), ultimate_bounds(example(name, changes))
    assert checked.why_unsettled.startswith(unsettled)
    assert (checked.settling_time is None) == bool(unsettled) == bool(checked.why_unsettled)
    assert ultimate.why_loose == ultimate.as_json()["why_loose"] == loose
    assert checked.as_json()["why_unsettled"] == checked.why_unsettled
    said = f"not computed: {checked.why_unsettled} (statement W8)"
    assert (said in convergence_rows(checked)["rate"]) == bool(unsettled)


UNDECIDED = phases(
    (
        1,
        {
            "adjacency": [
                [0, 6.537718247713378, 2.0870878045586156],
                [0, 0, 0.21751134499774766],
                [0, 0, 0],
            ],
            "pinning": [0, 0, 0.4635780459912557],
        },
    ),
    (
        3,
        {
            "adjacency": [[0, 0.10072298714206508, 0], [0, 0, 3.724074243181288], [0, 0, 0]],
            "pinning": [0, 1.0785707615413929, 0.20099230474081026],
        },
    ),
    (
        4,
        {
            "adjacency": [
                [0, 0.22661238721856536, 0],
                [5.439090048080515, 0, 2.279450304638899],
                [0, 4.587390490030428, 0],
            ],
            "pinning": [0, 0.3743103727606542, 0],
        },
    ),
)


def test_convergence_in_any_order_is_proven_even_for_a_radius_near_1():
    gains = {"algorithm": {"name": "impulsive", "alpha": 0.294, "beta": 0.349}}
    times = {"run": {"duration": 1.0, "sampling_period": 0.05}}
    found = check(on(UNDECIDED, gains, times)).any_order
    assert found.status == "proven"
    assert 0.999 < found.lower <= found.upper <= 0.9994


@pytest.mark.parametrize(
    ("radius", "result"),
    [
        (0.8778174593, "0.877817"),
        (1.0, "1.000000"),
        (1 - 3e-8, "1 - 3e-08"),
        (1 + 2e-9, "1 + 2e-09"),
        (1.70710678e300, "1.70711e+300"),
    ],
)
def test_a_rounded_spectral_radius_stays_on_its_side_of_1(radius, result):
    assert multiple(radius) == result


def test_a_negative_bound_is_no_interval_from_0():
    warnings = warnings_of(check(example("paper_example_3a", {"algorithm.beta": 1.9})))
    assert any("no sampling_period above 0 is within the bound" in line for line in warnings)
    assert "(0, -" not in " ".join(warnings)


def test_over_late_links_no_norm_is_spoken_of_that_belongs_to_no_recursion():
    sound, late = (
        bound_rows(ultimate_bounds(paper(faults)))
        for faults in ({}, {"faults.links": [{"delay": 1}]})
    )
    assert "norm" in sound
    assert "norm" not in late
