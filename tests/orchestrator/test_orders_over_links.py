"""Digraphs in any order over late links: the bounds beside every order of a few digraphs."""

from itertools import product

import numpy as np

from nrs_cosim.orchestrator.analysis.conditions import check
from nrs_cosim.orchestrator.analysis.convergence import periods_of
from nrs_cosim.orchestrator.analysis.link_recursions import factor_over_links, joint_radius_over
from nrs_cosim.orchestrator.cli.theory_text import convergence_rows
from tests.cases import cases
from tests.orchestrator.networks import phases
from tests.scenarios import SECOND_ORDER, paper

EACH = {"edge_list": [[0, 1], [0, 2], [1, 2, 0.5]]}, {"edge_list": [[0, 1], [0, 2], [2, 1, 2.0]]}
LATE = {"faults.links": [{"delay": 1}], "algorithm.missing": "drop", "initial": {}}


def in_order(order, *changes):
    turns = phases(*((k, EACH[e]) for k, e in enumerate(order, 1)), repeat=len(order))
    return paper(LATE, {"network": turns}, *changes)


def test_no_order_that_is_tried_is_beyond_the_bounds_and_some_order_comes_near():
    rng = np.random.default_rng(51)
    orders = [o for n in (2, 3) for o in product((0, 1), repeat=n) if len({*o}) == 2]
    for _ in range(cases(300, 2)):
        alpha, beta = rng.uniform(0.3, 1.6, 2).tolist()
        law = SECOND_ORDER, {"algorithm.alpha": alpha, "algorithm.beta": beta}
        periods = periods_of(in_order((0, 1), *law))
        found = joint_radius_over(in_order((0, 1), *law), periods)
        nothing = np.zeros(0, complex)
        radii = [factor_over_links(in_order(o, *law), nothing, periods).upper for o in orders]
        assert max(radii) <= found.upper * (1 + 1e-9)
        assert found.lower >= max(radii) * (1 - 2e-3)


def test_agents_that_drop_have_it_over_late_links_and_others_of_links_without_faults_alone():
    for missing, said in (("drop", "statement D8"), ("hold", "without faults")):
        checked = check(in_order((0, 1), {"algorithm.missing": missing}))
        assert checked.any_order.over_links == (missing == "drop")
        assert said in convergence_rows(checked)["any order"]
