"""What `nrs check` says, word by word, where a reader could take it for more than it is."""

import io

import pytest
from rich.console import Console

from nrs_cosim.orchestrator.analysis.bounds import bounds, ultimate_bounds
from nrs_cosim.orchestrator.analysis.conditions import check
from nrs_cosim.orchestrator.cli import summary_text
from nrs_cosim.orchestrator.cli.theory_text import _complex, convergence_rows
from nrs_cosim.orchestrator.report.subject import subject_of
from nrs_cosim.orchestrator.scenario.file import read_scenario
from nrs_cosim.orchestrator.scenario.robot_ids import multiple
from tests.orchestrator.networks import on, phases
from tests.scenarios import SCENARIOS, example

PATH = {"generator": {"kind": "path", "n": 30}}


def said(scenario):
    return convergence_rows(check(scenario))


def along_a_path(gain):
    return on(PATH, {"algorithm.alpha": gain, "algorithm.beta": gain})


def table(scenario):
    """Return the rows of the conditions by name."""
    written = io.StringIO()
    ultimate = ultimate_bounds(scenario)
    summary_text.theory_table(
        Console(file=written, width=100), check(scenario), ultimate, bounds(ultimate)
    )
    text = written.getvalue().replace(" (tracking)", "-tracking")
    rows = (line.split() for line in text.splitlines())
    return {row[0]: row[1:] for row in rows if len(row) > 2}


def test_with_link_faults_the_spectral_radius_is_stated_for_links_without_them():
    lossy = said(read_scenario(SCENARIOS / "paper_lossy_links.toml"))
    plain = said(read_scenario(SCENARIOS / "paper_first_order.toml"))
    assert lossy["rho"] == (
        "spectral radius 0.877817, of links without faults: "
        "whether the estimates converge with these links is not known"
    )
    assert lossy["rate"] == plain["rate"].partition(";")[0] + ", of links without faults"


def test_with_a_delay_convergence_is_unknown():
    """With a delay of one period and h = 0.4 the delayed recursion has a radius of 1.0118."""
    period = {"run.sampling_period": 0.4}
    plain = check(example("paper_example_3a", period))
    assert (plain.convergence, plain.as_json()["of"]) == ("converges", "the links as they are")
    scenario = example("paper_example_3a", period, {"faults.links": [{"delay": 1}]})
    checked = check(scenario)
    result = checked.as_json()
    assert (result["convergence"], result["of"]) == ("unknown", "links without faults")
    assert (result["settling_time"], result["millionth"]) == (None, None)
    assert {v.source[-23:] for v in subject_of(scenario, "rad").conditions} == {
        "of links without faults"
    }
    assert "settle" not in " ".join(convergence_rows(checked).values())
    written = io.StringIO()
    ultimate = ultimate_bounds(scenario)
    summary_text.theory_table(Console(file=written, width=200), checked, ultimate, bounds(ultimate))
    assert "conditions are of links without faults" in written.getvalue()


def test_with_link_faults_warnings_are_stated_for_links_without_them():
    warnings = check(example("paper_lossy_links", {"algorithm.alpha": 5})).warnings()
    assert warnings
    assert all(line.startswith("of links without faults: ") for line in warnings)


def test_on_a_path_the_settling_time_includes_the_hops():
    scenario = along_a_path(0.9)
    assert said(scenario)["rate"].startswith("23.03 per s in the long run; any error has fallen to")
    assert check(scenario).settling_time == pytest.approx(0.6)
    assert check(scenario).millionth > 3


def test_gains_of_1_on_a_path_converge_in_finite_time():
    result = said(along_a_path(1))["rate"]
    assert result == "without limit in the long run; any error has fallen to a millionth in 3 s"


def test_for_switching_networks_the_settling_time_is_not_computed():
    result = said(read_scenario(SCENARIOS / "switching.toml"))
    assert (
        result["rate"]
        == "4.363 per s in the long run; how long the beginning lasts is not computed"
    )
    assert result["any order"].startswith(
        "0.996294 to below 1 at worst: the estimates converge in any"
    )


def test_a_bound_below_0_shows_no_interval():
    warnings = check(example("paper_example_3a", {"algorithm.beta": 1.9})).warnings()
    begins = "algorithm dcea2: no sampling_period above 0 is within the"
    assert any(line.startswith(begins) for line in warnings)
    assert "(0, -" not in " ".join(warnings)


def test_rounding_digits_of_an_eigenvalue_are_not_shown():
    assert _complex(2.77556e-17 - 0.840896j) == "0-0.840896j"
    assert _complex(0.5 + 1e-17j) == "0.5"


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


def test_counts_of_one_are_singular_and_spectra_are_not_repeated():
    result = said(on({"edge_list": [[0, 1], [2, 1], [1, 2]]}))
    assert result["components"].startswith("1, strongly connected; of several robots: robots 1-2")
    assert "at most 2 links leads" in result["network"]
    assert "at most 1 link leads" in said(on({"edge_list": [[0, 1], [0, 2]]}))["network"]
    long = said(on(phases((1, PATH), (5, PATH))))["k >= 5"]
    assert "; spectrum 30 eigenvalues, 0 to 0, all real; alone" in long


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


def test_a_lower_bound_is_shown_with_a_greater_than_sign():
    rows = table(read_scenario(SCENARIOS / "paper_first_order.toml"))
    assert rows["kp"][:3] == ["200", ">", "0.000000"]
    assert rows["kd-tracking"][:4] == ["300", ">", "30.778666", "+269.221334"]
    assert rows["alpha"][:3] == ["0.9", "<", "1.171573"]
