"""Allowed and forbidden sequences of FMI calls: no fault, and what FMI's tables say of each."""

import pytest

from tests.cases import cases
from tests.plant_fmu.call_fuzzing import FAULTS, compile_fuzzer, fuzz, has_sanitizers


@pytest.mark.parametrize(("model", "fmi"), [("two_link_arm", 2), ("n_link_arm", 3)])
def test_random_calls_do_no_harm_and_are_refused_where_fmi_says(tmp_path, model, fmi):
    if not has_sanitizers(tmp_path):
        pytest.skip("the compiler here has no sanitizers (libasan, libubsan)")
    program = compile_fuzzer(model, fmi, tmp_path)
    for fault in FAULTS:
        assert fuzz(program, 1, 1, fault)[0] != 0, f"a planted {fault} goes unseen"
    many = cases(50_000, 5000)
    status, text = fuzz(program, 1, many)
    assert status == 0, text
    sequences, calls, errors = map(int, text.split())
    assert sequences == many
    assert 0.2 < errors / calls < 0.8  # neither all is refused nor all let pass
