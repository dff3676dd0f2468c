"""Links with faults: frequencies, independence of the draws, and the edges of the definitions."""

import numpy as np
import pytest

from nrs_cosim.bus.clock import Clock
from nrs_cosim.bus.codecs import Codecs
from nrs_cosim.bus.fields import ESTIMATE, Field, Sizes
from nrs_cosim.bus.links.draws import BLOCK
from nrs_cosim.bus.links.links import LinkFault, Links, link_events
from nrs_cosim.bus.links.outages import Outages
from nrs_cosim.bus.random_streams import normal, random_stream
from nrs_cosim.bus.topologies import TopologySchedule
from nrs_cosim.bus.topology import Topology
from tests.bus.test_topology import PAPER

TOPOLOGY = Topology.of(*PAPER)
ALL = np.arange(1, 7)
EDGES = [*zip(TOPOLOGY.source.tolist(), TOPOLOGY.sink.tolist(), strict=True)]
TICKS = 4000
CLOCK = Clock((10,), 1, TICKS)


def links(faults, silences=None, robots=ALL, seed=3, m=2, clock=CLOCK, sent=ESTIMATE):
    return Links(
        TopologySchedule.constant(TOPOLOGY),
        np.asarray(robots),
        faults,
        silences or {},
        ticks=clock,
        seed=seed,
        codecs=Codecs.of(Sizes(m), "Mine", sent),
    )


def both(position, velocity):
    return {"position": position, "velocity": velocity}


def everywhere(**given):
    if "noise" in given:
        given["noise"] = both(*given["noise"])
    return dict.fromkeys(EDGES, LinkFault(**given))


def received(made, k, sent):
    """Return what arrives of positions and velocities (F, 2, m), as they were sent."""
    arrives = made.received(k, both(*sent.transpose(1, 0, 2)))
    return np.stack([*arrives.values()], axis=1)


def story(made, ticks=range(1, 200)):
    """Return lost, outage, delay (ticks, F) and what zeros become (ticks, F, 2, m)."""
    outcomes = [made.outcome(k) for k in ticks]
    zeros = np.zeros((len(made.sink), 2, 2))
    return (
        np.array([outcome.lost for outcome in outcomes]),
        np.array([outcome.outage for outcome in outcomes]),
        np.array([outcome.delay for outcome in outcomes]),
        np.array([received(made, k, zeros) for k in ticks]),
    )


def test_links_without_faults_are_not_stored():
    made = links({(3, 6): LinkFault(loss=0.5), (2, 5): LinkFault(), (3, 4): LinkFault()})
    assert (made.source.tolist(), made.sink.tolist()) == ([3], [6])
    assert len(links({}).sink) == len(links({}).outcome(1).lost) == 0
    assert received(links({}), 1, np.zeros((0, 2, 2))).shape == (0, 2, 2)


def test_all_links_of_a_robot_with_outages_are_stored():
    made = links({}, {4: ((0, 5),)})
    assert sorted(zip(made.source.tolist(), made.sink.tolist(), strict=True)) == [
        (1, 4), (3, 4), (4, 5),
    ]  # fmt: skip


@pytest.mark.parametrize("p", [0.02, 0.3, 0.9])
def test_the_share_of_lost_samples_matches_the_probability(p):
    lost, *_ = story(links(everywhere(loss=p)), range(1, TICKS + 1))
    deviation = np.sqrt(p * (1 - p))
    assert np.abs(lost.mean(axis=0) - p).max() < 4 * deviation / np.sqrt(TICKS)
    assert abs(lost.mean() - p) < 4 * deviation / np.sqrt(lost.size)
    correlation = np.corrcoef(np.vstack([lost.T[:, 1:], lost.T[:, :-1]]).astype(float))
    assert np.abs(correlation - np.eye(len(correlation))).max() < 5 / np.sqrt(TICKS)


def test_probabilities_0_and_1_lose_nothing_and_everything():
    assert not story(links(everywhere(loss=0.0, delay=(1, 1))))[0].any()
    assert story(links(everywhere(loss=1.0)))[0].all()


def test_delays_are_uniform_and_both_ends_are_included():
    _, _, delay, _ = story(links(everywhere(delay=(1, 4))), range(1, TICKS + 1))
    values, counts = np.unique(delay, return_counts=True)
    assert values.tolist() == [1, 2, 3, 4]
    share = delay.size / 4
    assert ((counts - share) ** 2 / share).sum() < 16.3  # chi squared, 3 degrees: p = 0.001
    assert set(story(links(everywhere(delay=(2, 2))))[2].ravel().tolist()) == {2}


def test_noise_is_normal_with_the_deviations_asked_for():
    *_, received = story(links(everywhere(noise=(0.5, 3.0))), range(1, TICKS + 1))
    for part, deviation in ((0, 0.5), (1, 3.0)):
        numbers = received[:, :, part].ravel() / deviation
        assert abs(numbers.mean()) < 4 / np.sqrt(numbers.size)
        assert abs(numbers.var() - 1) < 4 * np.sqrt(2 / numbers.size)
        assert abs((np.abs(numbers) < 1).mean() - 0.682689) < 2 / np.sqrt(numbers.size)


def test_a_draw_depends_on_its_own_key_alone():
    given = {"loss": 0.4, "delay": (0, 5), "noise": (1.0, 2.0)}
    whole = story(links(everywhere(**given)))
    for robot in (1, 5):
        rows = TOPOLOGY.sink == robot
        for alone, all_of_them in zip(
            story(links(everywhere(**given), robots=[robot])), whole, strict=True
        ):
            assert alone.tobytes() == all_of_them[:, rows].tobytes()
    for name, part in (("loss", 0), ("delay", 2), ("noise", 3)):
        only = story(links(everywhere(**{name: given[name]})))[part]
        assert only.tobytes() == whole[part].tobytes()
    other = story(links(everywhere(**given), seed=4))
    assert all((other[part] != whole[part]).any() for part in (0, 2, 3))


def test_time_may_begin_anywhere_and_go_back():
    given = everywhere(loss=0.5, delay=(0, 3), noise=(1.0, 1.0))
    onwards = links(given)
    forth = [story(onwards, [k]) for k in range(1, 4 * BLOCK)]
    asked = links(given)
    for k in (3 * BLOCK + 5, 2, BLOCK, BLOCK - 1, 4 * BLOCK - 1):
        for now, then in zip(story(asked, [k]), forth[k - 1], strict=True):
            assert now.tobytes() == then.tobytes()
    _, block = onwards._noise._fields["position"][1]._kept
    assert block.shape[0] == BLOCK


GOLDEN = ([True, True], [6, 6], [-0.17642299349048463, -0.1599593890539026])


def test_draws_of_a_key_are_the_same_on_any_machine():
    """From NumPy's Philox and SeedSequence as documented in the module; kept against change."""
    lost, _, delay, values = story(
        links({(3, 6): LinkFault(0.5, (0, 9), noise=both(1, 1))}), [1, 99]
    )
    assert (lost.ravel().tolist(), delay.ravel().tolist()) == GOLDEN[:2]
    assert values[:, 0, 0, 0].tolist() == GOLDEN[2]


def test_an_outage_begins_and_ends_with_sampling_times():
    """With t_k = 10 k ns: [20, 40) is k = 2, 3; [21, 40) and [11, 31) begin and end between."""
    for span, ticks in {(20, 40): [2, 3], (21, 40): [3], (11, 31): [2, 3], (11, 20): []}.items():
        made = links({(3, 6): LinkFault(outages=(span,))})
        assert [k for k in range(8) if made.outcome(k).outage.any()] == ticks
        made = links({}, {6: (span, (60, 10**30))})
        assert [k for k in range(8) if made.silent(k)] == [*ticks, 6, 7]
    assert Outages.of({}, CLOCK.since).at(3).tolist() == []
    several = {2: ((0, 30), (10, 20)), 1: ((0, 20),)}
    assert Outages.of(several, CLOCK.since).at(1).tolist() == [1, 2]


def test_a_robot_in_an_outage_neither_sends_nor_receives():
    made = links({}, {3: ((20, 30),)})
    gone = {(made.source[f], made.sink[f]) for f in np.flatnonzero(made.outcome(2).gone)}
    assert gone == {(0, 3), (3, 1), (3, 4), (3, 5), (3, 6)}
    assert not made.outcome(1).gone.any()
    assert not made.outcome(3).gone.any()


@pytest.mark.parametrize("delay", [1, 2, 4])
def test_a_sample_that_would_arrive_during_an_outage_is_lost(delay):
    made = links({(3, 6): LinkFault(delay=(delay, delay))}, {6: ((50, 60),)})
    assert [k for k in range(1, 8) if made.outcome(k).outage.any()] == [5 - delay, 5]
    sender = links({(3, 6): LinkFault(delay=(delay, delay))}, {3: ((50, 60),)})
    late = sender.sink.tolist().index(6)
    assert [k for k in range(1, 8) if sender.outcome(k).outage[late]] == [5]


def test_numbers_are_rounded_to_multiples_after_the_noise():
    numbers = np.array([0.1234, -0.1236, 0.0005, 1e17, 1e308, 0.0]).reshape(1, 1, -1)
    sent = np.concatenate([numbers, numbers], axis=1)
    made = links({(3, 6): LinkFault(quantisation={"position": 0.001})}, m=6)
    coarse = received(made, 1, sent)
    assert coarse[0, 0].tolist() == [123 * 0.001, -124 * 0.001, 0, 1e17, 1e308, 0]
    assert coarse[0, 1].tolist() == sent[0, 1].tolist()
    tiny = links({(3, 6): LinkFault(quantisation=both(5e-324, 1e-300))}, m=6)
    assert received(tiny, 1, sent).tolist() == sent.tolist()
    noisy = links({(3, 6): LinkFault(noise=both(1, 1), quantisation=both(0.5, 0.5))}, m=6)
    rough = received(noisy, 1, sent)[0, 0, :3] / 0.5
    assert (rough == np.rint(rough)).all()
    assert sent[0, 0, 0] == 0.1234


OTHERS = {"P": Field((2, "m")), **ESTIMATE, "level": Field(())}
NOISE = {"P": 0.1, "position": 1.0, "velocity": 0.5, "level": 3.0}


def zeros_of(made, sent):
    codec = Codecs.of(Sizes(2), "Mine", sent).samples
    return {name: np.zeros((len(made.sink), *shape)) for name, shape in codec.shapes.items()}


def test_each_further_field_has_its_own_noise_stream():
    made = links({(3, 6): LinkFault(noise=NOISE)}, sent=OTHERS)
    found = made.received(70, zeros_of(made, OTHERS))
    number, offset = divmod(70, BLOCK)
    pair = normal(random_stream(3, "link noise", 3, 6, number), (BLOCK, 2, 2))[offset]
    assert found["position"].tolist() == [pair[0].tolist()]
    assert found["velocity"].tolist() == [(0.5 * pair[1]).tolist()]
    for name, shape in (("P", (2, 2)), ("level", ())):
        rng = random_stream(3, f"link noise {name}", 3, 6, number)
        drawn = NOISE[name] * normal(rng, (BLOCK, *shape))[offset]
        assert found[name].tolist() == [drawn.tolist()]


def test_options_of_another_field_change_no_draw():
    whole = links({(3, 6): LinkFault(noise=NOISE)}, sent=OTHERS)
    every = whole.received(5, zeros_of(whole, OTHERS))
    for name, field in OTHERS.items():
        alone = links({(3, 6): LinkFault(noise={name: NOISE[name]})}, sent=OTHERS)
        found = alone.received(5, zeros_of(alone, OTHERS))
        assert found[name].tobytes() == every[name].tobytes()
        assert not any(found[other].any() for other in OTHERS if other != name)
        by_itself = links({(3, 6): LinkFault(noise={name: NOISE[name]})}, sent={name: field})
        only = by_itself.received(5, zeros_of(by_itself, {name: field}))
        assert only[name].tobytes() == every[name].tobytes()


def test_a_link_event_holds_what_arrived_of_every_field():
    faults = {(3, 6): LinkFault(quantisation={"P": 0.5}), (2, 5): LinkFault(loss=1.0)}
    made = links(faults, sent=OTHERS)
    sent = {name: zeros + 0.7 for name, zeros in zeros_of(made, OTHERS).items()}
    outcome = made.outcome(1)
    events = link_events(made, ALL, 1, outcome, sent, made.received(1, sent))
    assert events[["robot", "source", "lost"]].tolist() == [(5, 2, 1), (6, 3, 0)]
    assert all(not events[name][0].any() for name in OTHERS)
    assert events["P"][1].tolist() == [[0.5, 0.5], [0.5, 0.5]]
    assert (events["level"][1], events["velocity"][1].tolist()) == (0.7, [0.7, 0.7])
    fresh = made.sink == 6
    some = link_events(made, ALL, 1, outcome, sent, made.received(1, sent), fresh)
    assert some.tobytes() == events[1:].tobytes()


def duplicates_of(made, ticks):
    return np.array([made.outcome(k).duplicates for k in ticks])


@pytest.mark.parametrize("p", [0.02, 0.3, 0.9])
def test_the_share_of_duplicated_samples_matches_the_probability(p):
    found = duplicates_of(links(everywhere(duplicate=p)), range(1, TICKS + 1))
    assert set(np.unique(found)) <= {0, 1}
    deviation = np.sqrt(p * (1 - p))
    assert np.abs(found.mean(axis=0) - p).max() < 4 * deviation / np.sqrt(TICKS)
    assert abs(found.mean() - p) < 4 * deviation / np.sqrt(found.size)


def test_probabilities_0_and_1_duplicate_no_sample_and_all_that_arrive():
    ticks = range(1, 200)
    assert duplicates_of(links(everywhere(duplicate=1.0)), ticks).all()
    assert not duplicates_of(links(everywhere(loss=0.5)), ticks).any()
    made = links(everywhere(duplicate=1.0, loss=0.5), {3: ((50, 90),)})
    for k in ticks:
        outcome = made.outcome(k)
        assert (outcome.duplicates == ~outcome.gone).all()
        assert outcome.gone.any()


def test_duplication_is_drawn_by_its_own_key():
    both_of_them = links(everywhere(duplicate=0.4, loss=0.0, delay=(0, 5), noise=(1.0, 2.0)))
    without = links(everywhere(delay=(0, 5), noise=(1.0, 2.0)))
    for mine, theirs in zip(story(both_of_them), story(without), strict=True):
        assert mine.tobytes() == theirs.tobytes()
    alone = links({(3, 6): LinkFault(duplicate=0.4)})
    ticks = range(1, 3 * BLOCK)
    drawn = [
        random_stream(3, "link duplicate", 3, 6, k // BLOCK).random(BLOCK)[k % BLOCK] for k in ticks
    ]
    assert duplicates_of(alone, ticks)[:, 0].tolist() == [int(x < 0.4) for x in drawn]
    edge = [*zip(both_of_them.source, both_of_them.sink, strict=True)].index((3, 6))
    assert (duplicates_of(both_of_them, ticks)[:, edge] == duplicates_of(alone, ticks)[:, 0]).all()


def test_a_link_without_noise_beside_one_that_has_some_alters_nothing():
    faults = {
        (3, 6): LinkFault(noise={"P": 1.0, "position": 1.0}, quantisation={"level": 0.25}),
        (2, 5): LinkFault(delay=(1, 1)),
    }
    made = links(faults, sent=OTHERS)
    sent = {name: zeros + 0.7 for name, zeros in zeros_of(made, OTHERS).items()}
    received = made.received(3, sent)
    sound = made.sink == 5
    for name, values in sent.items():
        assert received[name][sound].tobytes() == values[sound].tobytes()
        assert (values == 0.7).all()
    changed = {name for name in OTHERS if (received[name][~sound] != 0.7).any()}
    assert changed == {"P", "position", "level"}


def test_from_2_to_the_52_steps_on_a_number_is_left_as_it_is():
    made = links({(3, 6): LinkFault(quantisation={"position": 0.1})}, m=400)
    sent = np.random.default_rng(52).uniform(0.1 * 2.0**52, 0.1 * 2.0**53, (1, 400))
    assert (np.rint(sent / 0.1) * 0.1 != sent).any()
    received = made.received(1, {"position": sent, "velocity": sent})
    assert received["position"].tobytes() == sent.tobytes()
