"""Speed is kept, as ratios within one run against those in benchmarks/floors.json."""

from benchmarks.ratios import fallen, floors, measured


def test_no_ratio_has_fallen_by_more_than_a_third(tmp_path):
    kept = floors()
    found = measured(tmp_path, is_enough=lambda ratios: not fallen(ratios, kept))
    assert fallen(found, kept) == []


def test_a_ratio_that_falls_by_a_third_fails():
    kept = {"recorded": 0.9, "flat": 1.2, "writer": 3.0}
    found = {"recorded": 0.59, "flat": 0.81, "writer": 9.0}
    assert fallen(found, kept) == ["recorded fell from 0.90 to 0.59"]
