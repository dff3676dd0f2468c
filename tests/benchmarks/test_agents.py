"""Agents and the bare arithmetic beside which they are measured come to the same bits."""

from benchmarks.agents import bare, prepared


def test_agents_do_what_is_timed_beside_them():
    plain, ours = bare(), prepared()()
    for name, values in plain.items():
        assert ours[name].tobytes() == values.tobytes()
