"""Reductions of what robots receive, against loops from their definitions."""

from statistics import mean, median

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from nrs_cosim.estimator_agents.received import Received
from nrs_cosim.estimator_agents.values import Values

FUZZ = settings(
    max_examples=150,
    derandomize=True,
    deadline=None,
    database=None,
    phases=(Phase.generate,),
    suppress_health_check=[HealthCheck.too_slow],
)


@st.composite
def boxes(draw, *, empty_rows=True):
    """Draw what some robots received, small whole numbers with many ties, and their own values."""
    least = 0 if empty_rows else 1
    degrees = draw(st.lists(st.integers(least, 6), min_size=1, max_size=6))
    m, seed = draw(st.integers(1, 3)), draw(st.integers(0, 10**6))
    rng = np.random.default_rng(seed)
    rows, edges = len(degrees), sum(degrees)
    row = np.repeat(np.arange(rows), degrees)
    source = np.concatenate(
        [np.sort(rng.choice(12, degree, replace=False)) for degree in degrees] or [[]]
    ).astype(np.intp)
    return (
        Received(
            row,
            np.searchsorted(row, np.arange(rows)),
            source,
            rng.integers(1, 4, (edges, 1)) / 4,
            Values(x=rng.integers(-4, 5, (edges, m)).astype(float)),
            Values(),
            rng.random(edges) < draw(st.sampled_from([0.0, 0.6, 1.0])),
        ),
        rng.integers(-3, 4, (rows, m)).astype(float),
    )


def present_of(received, i):
    return [e for e in range(len(received.row)) if received.row[e] == i and received.present[e]]


@FUZZ
@given(boxes())
def test_reductions_are_those_of_loops(given_box):
    received, own = given_box
    x = received.samples.x
    cells = [(i, axis) for i in range(len(own)) for axis in range(own.shape[1])]
    found = {
        "sum": received.sum(x),
        "maximum": received.maximum(x),
        "minimum": received.minimum(x),
        "median": received.median(x),
        "trimmed": received.trimmed_mean(x, 1, empty=-9.0),
        "mean": received.mean(x),
        "disagreement": received.disagreement("x", own),
        "signs": received.sum(np.sign(received.difference("x", own))),
    }
    for i, axis in cells:
        edges = present_of(received, i)
        values = [float(x[e, axis]) for e in edges]
        weights = [float(received.weight[e, 0]) for e in edges]
        own_value = float(own[i, axis])
        everywhere = len(edges) == int((received.row == i).sum())
        total = 1.0 if everywhere or not edges else sum(weights)
        weighed = list(zip(weights, values, strict=True))
        inner = sorted(values)[1:-1]
        want = {
            "sum": sum(values),
            "maximum": max(values, default=-np.inf),
            "minimum": min(values, default=np.inf),
            "median": median(values) if values else np.nan,
            "trimmed": mean(inner) if inner else -9.0,
            "mean": sum(w * v for w, v in weighed) / total,
            "disagreement": sum(w * (v - own_value) for w, v in weighed) / total,
            "signs": sum(float(np.sign(v - own_value)) for v in values),
        }
        for name, value in want.items():
            np.testing.assert_allclose(found[name][i, axis], value, rtol=1e-14, err_msg=name)
    assert received.count[:, 0].tolist() == [len(present_of(received, i)) for i in range(len(own))]


@FUZZ
@given(boxes(), st.integers(0, 3), st.booleans())
def test_w_msr_leaves_out_the_outliers(given_box, F, trusts):
    received, own = given_box
    x = received.samples.x
    trusted = received.source == 0 if trusts else None
    kept = received.trim(x, own, F, trusted)
    for i in range(len(own)):
        for axis in range(own.shape[1]):
            edges, mine = present_of(received, i), own[i, axis]
            safe = [e for e in edges if trusts and received.source[e] == 0]
            rest = [e for e in edges if e not in safe]
            above = sorted(x[e, axis] for e in rest if x[e, axis] > mine)
            below = sorted(x[e, axis] for e in rest if x[e, axis] < mine)
            level = [x[e, axis] for e in rest if x[e, axis] == mine]
            want = above[: max(len(above) - F, 0)] + below[F:] + level
            want += [x[e, axis] for e in safe]
            got = [x[e, axis] for e in np.flatnonzero(received.row == i) if kept[e, axis]]
            assert sorted(got) == sorted(want)


@FUZZ
@given(boxes())
def test_padded_puts_the_edges_of_a_robot_side_by_side(given_box):
    received, own = given_box
    width = 6
    wide = received.padded(received.samples.x, width, fill=7.0)
    for i in range(len(own)):
        edges = [e for e in range(len(received.row)) if received.row[e] == i]
        want = [received.samples.x[e].tolist() if received.present[e] else None for e in edges]
        want = [[7.0] * own.shape[1] if one is None else one for one in want]
        assert wide[i].tolist() == want + [[7.0] * own.shape[1]] * (width - len(edges))


@FUZZ
@given(boxes(empty_rows=False), st.data())
def test_a_robot_computed_alone_has_the_same_bits(given_box, data):
    """Scales are mixed, so that another order of the same sum would show."""
    together, own = given_box
    rng = np.random.default_rng(data.draw(st.integers(0, 10**6)))
    x = rng.normal(size=together.samples.x.shape) * 10.0 ** rng.integers(-8, 8, (len(own[0]),))
    i = data.draw(st.integers(0, len(own) - 1))
    mine = together.row == i
    alone = Received(
        np.zeros(int(mine.sum()), np.intp),
        np.zeros(1, np.intp),
        together.source[mine],
        together.weight[mine],
        Values(x=x[mine]),
        Values(),
        together.present[mine],
    )
    for reduction in ("sum", "mean", "median", "maximum", "minimum"):
        one, all_ = getattr(alone, reduction)(x[mine]), getattr(together, reduction)(x)
        assert one[0].tobytes() == all_[i].tobytes(), reduction


@pytest.mark.parametrize("m", [1, 2, 3])
def test_long_sums_computed_alone_have_the_same_bits(m):
    """From eight terms on NumPy sums in pairs, in one dimension."""
    rng = np.random.default_rng(m)
    degrees = [3, 40, 9, 17]
    row = np.repeat(np.arange(4), degrees)
    start = np.searchsorted(row, np.arange(4))
    x, weight = rng.normal(size=(len(row), m)), rng.random((len(row), 1))
    together = Received(row, start, row, weight, Values(), Values()).mean(x)
    for i in range(4):
        mine = row == i
        alone = Received(
            np.zeros(degrees[i], np.intp),
            np.zeros(1, np.intp),
            row[mine],
            weight[mine],
            Values(),
            Values(),
        )
        assert alone.mean(x[mine])[0].tobytes() == together[i].tobytes()


def test_absent_samples_do_not_enter_any_sum():
    """A value that is no number, of a sample that is not there, stays out of every reduction."""
    row = np.zeros(3, np.intp)
    x = np.array([[1.0], [np.nan], [3.0]])
    received = Received(
        row,
        np.zeros(1, np.intp),
        np.arange(3),
        np.full((3, 1), 0.25),
        Values(x=x),
        Values(),
        np.array([True, False, True]),
    )
    for reduction, value in {"sum": 4, "mean": 2, "median": 2, "maximum": 3, "minimum": 1}.items():
        assert getattr(received, reduction)(x).tolist() == [[value]], reduction
    assert received.trimmed_mean(x, 0).tolist() == [[2]]
    assert received.disagreement("x", np.zeros((1, 1))).tolist() == [[2]]


def test_received_values_are_immutable_and_list_their_fields():
    values = Values(a=np.zeros(2), b=np.ones(2))
    assert values.replace(a=np.ones(2)).a.tolist() == [1, 1]
    assert values.a.tolist() == [0, 0]
    with pytest.raises(AttributeError, match="no field c; the fields here are a, b"):
        values.c  # noqa: B018
    with pytest.raises(TypeError, match="no field c; the fields here are a, b"):
        values.replace(c=np.zeros(2))
    for change in (lambda: values.__setitem__("a", 1), lambda: setattr(values, "a", 1)):
        with pytest.raises(TypeError, match=r"x\.replace\(a=…\) returns others"):
            change()
    with pytest.raises(ValueError, match="read-only"):
        values.guarded().a[0] = 1
